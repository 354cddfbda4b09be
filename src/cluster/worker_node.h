#pragma once
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "cluster/clock.h"
#include "cluster/job_seat.h"
#include "cluster/scene_loader.h"
#include "tasks/worker_core.h"

namespace cloudrenderer {

// A worker's core with its threads: `threads` that compute, one that loads. Knows no sockets: what
// the core has to say goes to `deliver`, what others say comes in by receive(). All functions may
// be called from any thread.
class WorkerNode {
 public:
  struct Callbacks {
    // A message for a host; called one at a time, in the order of the core's outbox, with no lock
    // held.
    std::function<void(HostId, wire::Message&&)> deliver;
    std::function<void(double)> deadline;  // tick() wants to be called at this time, or earlier
    std::function<void(const std::string&)> failed;  // a compute thread could not go on
    std::function<DriverCounters()> counters;        // the driver's part of the report
  };

  WorkerNode(HostId self, std::uint64_t incarnation, const WorkerOptions& options,
             SceneLoader& loader, const Clock& clock, Callbacks callbacks,
             std::shared_ptr<JobSeat> seat = nullptr);
  ~WorkerNode();  // finishes what runs, and drops the rest
  WorkerNode(const WorkerNode&) = delete;
  WorkerNode& operator=(const WorkerNode&) = delete;

  void receive(HostId from, wire::Message message);
  double tick();  // the next deadline
  void peer_unreachable(HostId peer);
  void peer_reachable(HostId peer);
  void leave(const std::string& reason);
  bool left() const;
  // The list of hosts when it has changed since `version`, which is renewed.
  bool new_hosts(std::uint64_t& version, std::vector<wire::HostEntry>& hosts) const;

 private:
  void count();  // renews the driver's counters in the core
  void compute();
  void load();
  WorkResult load_metered(Work& work);
  void run(Work& work, std::unique_lock<std::mutex>& lock);
  void after(
      std::unique_lock<std::mutex>& lock);  // of every call of the core: outbox, wake-ups, deadline

  SceneLoader& loader_;
  const Clock& clock_;
  const Callbacks callbacks_;
  const std::shared_ptr<JobSeat> seat_;
  mutable std::mutex mutex_;  // guards what follows
  WorkerCore core_;
  WorkerCore::Outbox outgoing_;
  bool draining_ = false;  // some thread delivers; it takes what comes meanwhile, too
  bool stopping_ = false;
  double announced_ = 0;
  double counted_ = -1;
  std::condition_variable work_, load_work_;
  std::vector<std::thread> threads_;
};

}  // namespace cloudrenderer
