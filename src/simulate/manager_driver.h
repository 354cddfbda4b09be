#pragma once
// The manager of a simulated cluster: the real core behind the real codec and links, with a meter of the processor time
// that they take on this machine.
#include <array>
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

  // real_pixels: of the largest tile of a renderer task in the real film; pixels_of_one: that a simulated pixel stands for.
  ManagerDriver(const ManagerOptions& options, JobSpec job, std::uint64_t real_pixels, std::uint64_t pixels_of_one, Transmit transmit);

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
  // Bytes on the wire of a frame, with real sizes; reply_sums: of the renderer task's reply that it is, 0: it is none.
  std::uint64_t frame_bytes(const Link::Frame& frame, std::uint64_t reply_sums) const;
  ManagerLoad load(double began, double ended) const;

 private:
  enum class Work : std::uint8_t { film, tasks, heartbeats, loading, maps, acknowledgements };
  static constexpr std::array kWork{"film", "tasks", "heartbeats", "loading", "maps", "acknowledgements"};

  static Work work_of(const wire::Message& message);
  std::uint64_t real_pixels(std::uint64_t reply_sums) const;
  void measure(double now, Work work, double seconds);
  void finish(double now, Work work, double start);  // measures what was done since, and transmits what came of it
  void drain(double now);
  void send_all(HostId to, Link& link, double now);

  ManagerCore core_;
  Transmit transmit_;
  std::map<HostId, Link> links_;
  std::vector<HostId> gone_;
  double decode_s_ = 0, merge_s_ = 0;  // of a pixel of a reply
  double clock_s_ = 0;                 // a look at the clock
  std::uint64_t real_pixels_ = 0, pixels_of_one_ = 1;
  std::uint64_t reply_bytes_ = 0;  // of real_pixels_
  std::array<std::vector<double>, kWork.size()> cpu_;  // by second
  std::vector<std::pair<HostId, Link::Frame>> outgoing_;  // to transmit: that is the simulation's work, not the manager's
  double unmeasured_ = 0;                                // what takes the place of a socket, for these
  std::vector<double> sent_;  // bytes, by second
  std::uint64_t received_ = 0, messages_ = 0;
};

// Of this thread.
double thread_cpu_seconds();

}  // namespace cloudrenderer::sim
