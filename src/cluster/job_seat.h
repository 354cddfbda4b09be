#pragma once
// How the workers of one process share it while it is in a pool.
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "cluster/compute_gate.h"
#include "cluster/meter.h"
#include "trace/part_cache.h"

namespace cloudrenderer {

struct SharedHost {
  SharedHost(unsigned threads, std::uint64_t memory)
      : gate(threads), cache(std::make_shared<PartCache>(PartCache::Options{.threads = threads, .memory = memory})) {}
  ComputeGate gate;
  std::shared_ptr<PartCache> cache;
  Meter meter;
};

// The place of one order. Whoever works where there is no seat has the process to itself.
class JobSeat {
 public:
  JobSeat(std::shared_ptr<SharedHost> host, std::shared_ptr<Meter::Account> account, double weight)
      : host_(std::move(host)), account_(std::move(account)), job_(host_->gate.add(weight)) {}
  ~JobSeat() { host_->gate.remove(job_); }
  JobSeat(const JobSeat&) = delete;
  JobSeat& operator=(const JobSeat&) = delete;

  SharedHost& host() const { return *host_; }
  Meter::Account& account() const { return *account_; }
  ComputeGate::Job gate_job() const { return job_; }
  void set_weight(double weight) { host_->gate.set_weight(job_, weight); }

  // Whom to ask for the bytes that the order has loaded, shared ones divided; null: nobody now.
  void set_memory(std::function<double()> ask) {
    const std::lock_guard lock(mutex_);
    ask_memory_ = std::move(ask);
  }
  double memory() const {
    const std::lock_guard lock(mutex_);
    return ask_memory_ ? ask_memory_() : 0;
  }

 private:
  const std::shared_ptr<SharedHost> host_;
  const std::shared_ptr<Meter::Account> account_;
  const ComputeGate::Job job_;
  mutable std::mutex mutex_;
  std::function<double()> ask_memory_;
};

}  // namespace cloudrenderer
