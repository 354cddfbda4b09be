#pragma once
#include <functional>
#include <mutex>
#include <thread>

namespace cloudrenderer {

// Takes SIGINT, SIGTERM and SIGHUP from their default, which ends the process: a thread waits for them and
// calls the handler of the moment. Make one at the start of main, before any other thread; children
// start with the signals as usual.
class Interrupts {
 public:
  Interrupts();
  ~Interrupts();
  Interrupts(const Interrupts&) = delete;
  Interrupts& operator=(const Interrupts&) = delete;

  // Null: signals are only remembered. A signal that came before is delivered at once.
  void set_handler(std::function<void()> handler);
  bool seen() const;
  // As if the user had pressed Ctrl-C. Any thread.
  void raise();

 private:
  void wait();

  mutable std::mutex mutex_;
  std::function<void()> handler_;
  bool seen_ = false, stopping_ = false;
  std::thread thread_;
};

}  // namespace cloudrenderer
