#pragma once
#include <string>
#include <utility>

#include "cluster/pool.h"
#include "service/frame_hosts.h"

namespace cloudrenderer {

// What the hosts of a pool have said, as the service needs it. A value.
class PoolWords {
 public:
  // Only jobs whose names begin so are counted as frames.
  explicit PoolWords(std::string prefix) : prefix_(std::move(prefix)) {}
  std::map<std::uint64_t, ServiceHost> take(const std::map<std::uint64_t, PoolHost>& hosts);

 private:
  const std::string prefix_;
  std::map<std::uint64_t, std::uint64_t> words_;  // of hosts, when they were last asked for
};

// The hosts of a Pool.
class PoolHosts : public FrameHosts {
 public:
  // The pool outlives this. `service` names ours among all whose jobs the hosts have worked for and speak of.
  PoolHosts(Pool& pool, std::string service) : pool_(pool), prefix_(std::move(service) + "."), words_(prefix_) {}
  void order(const std::vector<FrameOrder>& orders) override;
  std::map<std::uint64_t, ServiceHost> hosts() const override { return words_.take(pool_.hosts()); }

 private:
  Pool& pool_;
  const std::string prefix_;
  mutable PoolWords words_;
};

}  // namespace cloudrenderer
