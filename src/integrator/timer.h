#pragma once
#include <time.h>

#include <atomic>
#include <cstdint>

namespace cloudrenderer {

// Adds the processor time of this thread between its construction and destruction to a counter. Once a batch.
class BatchTimer {
 public:
  explicit BatchTimer(std::atomic<std::uint64_t>& total) : total_(total), start_(now()) {}
  ~BatchTimer() { total_.fetch_add(now() - start_, std::memory_order_relaxed); }
  BatchTimer(const BatchTimer&) = delete;
  BatchTimer& operator=(const BatchTimer&) = delete;

 private:
  static std::uint64_t now() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<std::uint64_t>(t.tv_sec) * 1'000'000'000u + static_cast<std::uint64_t>(t.tv_nsec);
  }
  std::atomic<std::uint64_t>& total_;
  std::uint64_t start_;
};

}  // namespace cloudrenderer
