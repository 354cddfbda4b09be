#pragma once
// Which host holds which part and how busy it is: an immutable snapshot that compute threads use
// outside of any lock.
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/id.h"
#include "tasks/cluster_map.h"
#include "wire/messages.h"

namespace cloudrenderer {

class Routing {
 public:
  using Slot = ClusterMap::Slot;
  static constexpr Slot kNoSlot = ClusterMap::kNoSlot;

  Routing() = default;
  // alpha weighs a host's load (seconds of queued work) against the number of hosts.
  Routing(ClusterMapPtr map, HostLoadsPtr loads, HostId self, float alpha);
  Routing(const wire::SceneHostMap& complete, HostId self, float alpha);

  const ClusterMapPtr& map() const { return map_; }
  const HostLoadsPtr& loads() const { return loads_; }
  std::uint32_t epoch() const { return map_->epoch(); }
  std::uint32_t generation() const { return map_->generation(); }
  HostId self() const { return self_; }
  float alpha() const { return alpha_; }
  std::size_t part_count() const { return map_->part_count(); }
  std::size_t hosts() const { return map_->hosts(); }
  HostId host(Slot s) const { return map_->host(s); }
  Slot slot(HostId h) const { return map_->slot(h); }  // kNoSlot when unknown
  float load(Slot s) const { return loads_->by_slot[s]; }
  float most_load_of_others() const { return loads_->most_of_others(own_); }
  // The host is asked about segments, which stay where they are.
  bool only_intersects(HostId h) const {
    const Slot s = slot(h);
    return s != kNoSlot && map_->only_intersects(s);
  }
  bool holds(Slot s, PartId p) const { return map_->holds(s, p); }
  // No host is to hold the part: who needs it loads it for a while (SceneHostMap.paged).
  bool paged(PartId p) const { return map_->paged(p); }
  bool paging() const { return map_->paging(); }
  // Holders of a part in the order of slots; empty for an unknown part.
  std::span<const Slot> holders(PartId p) const { return map_->holders(p); }
  // The host to which a segment goes whose nearest untested candidate is this part: this host
  // itself if it holds it, else the least loaded holder, rather one that segments can move to (holders of equal load share by a hash of
  // this host and the part); or kNoSlot.
  Slot target(PartId p) const;

 private:
  static constexpr Slot kNotKnown = 0xfffe;
  Slot find_target(PartId p) const;

  ClusterMapPtr map_ = std::make_shared<const ClusterMap>();
  HostLoadsPtr loads_ = std::make_shared<const HostLoads>();
  HostId self_;
  Slot own_ = kNoSlot;
  float alpha_ = 0;
  std::unique_ptr<std::atomic<Slot>[]> targets_;  // by part, as they are asked for: many never are
};
using RoutingPtr = std::shared_ptr<const Routing>;

// Hosts that together hold all of `needed` (nearest first): the greedy local optimum of |SH| +
// alpha * load(SH). The first holds needed[0]; this host costs nothing. Parts that nobody holds are
// left out.
std::vector<Routing::Slot> cover(std::span<const PartId> needed, const Routing& routing);
// Only the first of them; kNoSlot if nobody holds needed[0].
Routing::Slot cover_first(std::span<const PartId> needed, const Routing& routing);

}  // namespace cloudrenderer
