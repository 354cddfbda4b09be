#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "net/address.h"
#include "service/job.h"

namespace cloudrenderer {

// A frame that hosts are to work for.
struct FrameOrder {
  FrameRef frame;
  Address manager;
  double weight = 1;  // of the processors
  double memory = 1;  // part of a host's
  std::uint64_t least_memory = 0;  // bytes, without which a host is of no use to it
};

struct ServiceHost {
  std::string name, kind;
  std::uint32_t threads = 0;
  std::uint64_t memory = 0, memory_used = 0;
  double cpu_s = 0;  // since it came
  bool here = true;
  std::uint32_t working = 0;  // frames that it works for now
  // By frame, since it came; without rays and cost. Empty if it has said nothing since it was last asked for, as those
  // that have left, of which there may be a thousand. host_s is the time that it has worked for the frame, shared with
  // others or not.
  std::map<FrameRef, Usage> used;
};

// The hosts that work for the service, as it needs them: behind it stands a pool of workers, or a test's script. Used by
// the service's thread only.
class FrameHosts {
 public:
  virtual ~FrameHosts() = default;
  virtual void order(const std::vector<FrameOrder>& orders) = 0;   // all that there are
  virtual std::map<std::uint64_t, ServiceHost> hosts() const = 0;  // those that have left lately, too
};

}  // namespace cloudrenderer
