#include "cluster/interrupts.h"

#include <pthread.h>
#include <signal.h>

namespace cloudrenderer {
namespace {

sigset_t interrupt_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGHUP);  // the terminal is gone; under nohup it is ignored and never comes
  sigaddset(&set, SIGUSR2);  // of our own destructor
  return set;
}

}  // namespace

Interrupts::Interrupts() {
  const sigset_t set = interrupt_signals();
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  signal(SIGPIPE, SIG_IGN);  // a peer that is gone is an error of the write
  thread_ = std::thread([this] { wait(); });
}

Interrupts::~Interrupts() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    handler_ = nullptr;
  }
  pthread_kill(thread_.native_handle(), SIGUSR2);
  thread_.join();
}

void Interrupts::wait() {
  const sigset_t set = interrupt_signals();
  for (;;) {
    int signal = 0;
    if (sigwait(&set, &signal) != 0) continue;
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    if (signal == SIGUSR2) continue;
    seen_ = true;
    if (handler_) handler_();
  }
}

void Interrupts::set_handler(std::function<void()> handler) {
  const std::lock_guard lock(mutex_);
  handler_ = std::move(handler);
  if (seen_ && handler_) handler_();
}

void Interrupts::raise() { pthread_kill(thread_.native_handle(), SIGINT); }

bool Interrupts::seen() const {
  const std::lock_guard lock(mutex_);
  return seen_;
}

}  // namespace cloudrenderer
