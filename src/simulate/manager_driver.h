#pragma once
// The manager of a simulated cluster: the real core behind the real codec and links, with a meter of the processor time
// that they take on this machine.
#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "simulate/cluster_plan.h"
#include "tasks/link.h"
#include "tasks/manager_core.h"

namespace cloudrenderer::sim {

class ManagerDriver {
 public:
  using Transmit = std::function<void(HostId, const Link::Frame&)>;

  // real_pixels: of a renderer task's tile in the real film, whose sums its replies would have.
  ManagerDriver(const ManagerOptions& options, JobSpec job, std::uint64_t real_pixels, Transmit transmit);

  Result<HostId> join(const wire::Hello& hello, double now);
  void receive(HostId from, const Link::Frame& frame, double now);
  void tick(double now);
  void host_lost(HostId host, double now);
  void acknowledge(HostId host, double now);  // when its link's deadline has come
  double link_deadline(HostId host) const;

  ManagerCore& core() { return core_; }
  const ManagerCore& core() const { return core_; }
  bool knows(HostId host) const { return links_.contains(host); }
  std::vector<HostId> take_gone() { return std::exchange(gone_, {}); }
  // Bytes on the wire of a frame, with real sizes.
  std::uint64_t frame_bytes(const Link::Frame& frame, bool renderer_reply) const;
  ManagerLoad load(double began, double ended) const;

 private:
  void measure(double now, double seconds);
  void drain(double now);
  void send_all(HostId to, Link& link, double now);

  ManagerCore core_;
  Transmit transmit_;
  std::map<HostId, Link> links_;
  std::vector<HostId> gone_;
  double reply_s_ = 0;             // decoding and merging a reply of real size
  std::uint64_t reply_bytes_ = 0;
  std::vector<double> cpu_;        // by second
  std::vector<double> sent_;       // likewise, bytes
  std::uint64_t received_ = 0, messages_ = 0;
};

// Of this thread.
double thread_cpu_seconds();

}  // namespace cloudrenderer::sim
