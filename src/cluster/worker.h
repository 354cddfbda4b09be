#pragma once
#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "cluster/job_seat.h"
#include "net/address.h"
#include "net/tls.h"
#include "tasks/worker_core.h"

namespace cloudrenderer {

struct WorkerConfig {
  Address manager;
  std::optional<Address> listen;     // else: the interface that reaches the manager, any port
  std::optional<Address> advertise;  // what peers are told instead
  std::uint64_t memory = 0;
  unsigned threads = 1;
  std::string name;
  std::string kind;   // of machine, as a pool's price table names it
  std::string parts;  // folder to look for parts in before asking the manager
  std::string token;
  TlsOptions tls;
  bool allow_inexact = false;
  bool only_intersect = false;  // no paths: it loads parts and answers for them
  float alpha = 0.25f;  // weight of load in the choice of hosts
  std::chrono::duration<double> patience{
      30};  // for the first connection, and for a manager that went away
  std::shared_ptr<JobSeat> seat;  // of this job in a process of a pool
};

// Works for a manager until the job has ended; when the manager goes away, waits for it or for the
// one that takes its place. A pool at that address makes it a member (cluster/pool_member.h). `on_leave` is called with a function that asks for
// leave (from any thread; a second call ends at once). Throws ClusterError.
void run_worker(const WorkerConfig& config,
                const std::function<void(std::function<void()>)>& on_leave);

// What a host with these means says of itself; address and name apart.
wire::Hello make_hello(std::uint64_t incarnation, const std::string& name, std::uint64_t memory,
                       unsigned threads, const WorkerOptions& options, bool only_intersect = false);
std::uint64_t new_incarnation();
DriverCounters process_counters();  // cpu and peak of this process

}  // namespace cloudrenderer
