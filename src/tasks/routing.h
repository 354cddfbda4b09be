#pragma once
// Which host holds which part and how busy it is: an immutable snapshot that compute threads use
// outside of any lock.
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/id.h"
#include "wire/messages.h"

namespace cloudrenderer {

class Routing {
 public:
  using Slot = std::uint16_t;  // index of a host in the snapshot
  static constexpr Slot kNoSlot = 0xffff;

  Routing() = default;
  // alpha weighs a host's load (seconds of queued work) against the number of hosts.
  Routing(const wire::SceneHostMap& map, HostId self, float alpha);

  std::uint32_t epoch() const { return epoch_; }
  std::uint32_t generation() const { return generation_; }
  HostId self() const { return self_; }
  float alpha() const { return alpha_; }
  std::size_t part_count() const { return target_.size(); }
  std::size_t hosts() const { return hosts_.size(); }
  HostId host(Slot s) const { return hosts_[s]; }
  Slot slot(HostId h) const;  // kNoSlot when unknown
  float load(Slot s) const { return load_[s]; }
  // The host is asked about segments, which stay where they are.
  bool only_intersects(HostId h) const {
    const Slot s = slot(h);
    return s != kNoSlot && only_intersects_[s];
  }
  bool holds(Slot s, PartId p) const {
    return p.value == 0 || (p.value < part_count() &&
                            (bits_[s * words_ + p.value / 64] >> (p.value % 64) & 1u) != 0);
  }
  // No host is to hold the part: who needs it loads it for a while (SceneHostMap.paged).
  bool paged(PartId p) const { return p.value < paged_.size() && paged_[p.value]; }
  bool paging() const { return !paged_.empty(); }
  // Holders of a part in the order of slots; empty for an unknown part.
  std::span<const Slot> holders(PartId p) const;
  // The host to which a segment goes whose nearest untested candidate is this part: this host
  // itself if it holds it, else the least loaded holder, rather one that segments can move to (holders of equal load share by a hash of
  // this host and the part); or kNoSlot.
  Slot target(PartId p) const { return p.value < target_.size() ? target_[p.value] : kNoSlot; }

 private:
  std::uint32_t epoch_ = 0, generation_ = 0;
  HostId self_;
  float alpha_ = 0;
  std::size_t words_ = 0;
  std::vector<HostId> hosts_;
  std::vector<float> load_;
  std::vector<bool> only_intersects_;
  std::vector<std::uint64_t> bits_;          // host-major
  std::vector<std::uint32_t> first_holder_;  // part -> range of holder_slots_
  std::vector<Slot> holder_slots_;
  std::vector<Slot> target_;
  std::vector<bool> paged_;  // by part; empty: none
};
using RoutingPtr = std::shared_ptr<const Routing>;

// Hosts that together hold all of `needed` (nearest first): the greedy local optimum of |SH| +
// alpha * load(SH). The first holds needed[0]; this host costs nothing. Parts that nobody holds are
// left out.
std::vector<Routing::Slot> cover(std::span<const PartId> needed, const Routing& routing);
// Only the first of them; kNoSlot if nobody holds needed[0].
Routing::Slot cover_first(std::span<const PartId> needed, const Routing& routing);

}  // namespace cloudrenderer
