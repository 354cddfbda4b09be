#include "cluster/pool_order.h"

#include <algorithm>
#include <chrono>

#include "base/log.h"

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;
constexpr auto kFirstPause = 500ms, kLongestPause = 8000ms;  // after a failure

}  // namespace

OrderRun::OrderRun(WorkerConfig config, std::function<void()> ended)
    : config_(std::move(config)), ended_(std::move(ended)), thread_([this] { run(); }) {}

OrderRun::~OrderRun() {
  stop();
  stop();
  thread_.join();
}

void OrderRun::stop() {
  // Under the mutex, since the worker behind the function ends under it.
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  if (leave_) leave_();
  stopped_.notify_all();
}

void OrderRun::run() {
  {
    const Meter::Thread metered(config_.seat->host().meter, &config_.seat->account());
    const auto on_leave = [this](std::function<void()> leave) {
      const std::lock_guard lock(mutex_);
      leave_ = std::move(leave);
      if (stopping_ && leave_) leave_();
    };
    std::unique_lock lock(mutex_, std::defer_lock);
    for (auto pause = kFirstPause;; pause = std::min(2 * pause, kLongestPause)) {
      try {
        run_worker(config_, on_leave);
        break;
      } catch (const std::exception& e) {
        spdlog::warn("the job at {}: {}", config_.manager.to_string(), e.what());
      }
      lock.lock();
      const bool stopping = stopped_.wait_for(lock, pause, [this] { return stopping_; });
      lock.unlock();
      if (stopping) break;
    }
  }
  working_ = false;
  ended_();
}

}  // namespace cloudrenderer
