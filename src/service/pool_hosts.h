#pragma once
#include <memory>

#include "cluster/pool.h"
#include "service/frame_hosts.h"

namespace cloudrenderer {

// The hosts of a Pool.
class PoolHosts : public FrameHosts {
 public:
  explicit PoolHosts(Pool& pool) : pool_(pool) {}  // which outlives this
  void order(const std::vector<FrameOrder>& orders) override;
  std::map<std::uint64_t, ServiceHost> hosts() const override;

 private:
  Pool& pool_;
};

}  // namespace cloudrenderer
