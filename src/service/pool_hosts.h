#pragma once
#include <string>

#include "cluster/pool.h"
#include "service/frame_hosts.h"

namespace cloudrenderer {

// The hosts of a Pool.
class PoolHosts : public FrameHosts {
 public:
  // The pool outlives this. `service` names ours among all whose jobs the hosts have worked for and speak of.
  PoolHosts(Pool& pool, std::string service) : pool_(pool), prefix_(std::move(service) + ".") {}
  void order(const std::vector<FrameOrder>& orders) override;
  std::map<std::uint64_t, ServiceHost> hosts() const override;

 private:
  Pool& pool_;
  const std::string prefix_;
  mutable std::map<std::uint64_t, std::uint64_t> words_;  // of hosts, when they were last asked for
};

}  // namespace cloudrenderer
