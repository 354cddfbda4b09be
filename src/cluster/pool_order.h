#pragma once
#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "cluster/worker.h"

namespace cloudrenderer {

// One order of a pool as its host carries it out: run_worker() on a thread, again after a pause when
// it fails, until its job has ended or it is stopped.
class OrderRun {
 public:
  // `ended` is called on the order's thread, last.
  OrderRun(WorkerConfig config, std::function<void()> ended);
  ~OrderRun();  // ends at once
  OrderRun(const OrderRun&) = delete;
  OrderRun& operator=(const OrderRun&) = delete;

  // Leaves the job well; the second time at once. Any thread, as what follows.
  void stop();
  bool working() const { return working_; }
  JobSeat& seat() const { return *config_.seat; }

 private:
  void run();

  const WorkerConfig config_;
  const std::function<void()> ended_;
  std::atomic<bool> working_ = true;
  std::mutex mutex_;  // guards what follows
  std::condition_variable stopped_;
  std::function<void()> leave_;
  bool stopping_ = false;
  std::thread thread_;  // last: it uses the rest
};

}  // namespace cloudrenderer
