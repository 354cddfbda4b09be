#pragma once
// Who is there and who holds what, at one epoch: an immutable value that everything shares which routes by it.
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/id.h"
#include "wire/messages.h"

namespace cloudrenderer {

class ClusterMap {
 public:
  using Slot = std::uint16_t;  // index of a host
  static constexpr Slot kNoSlot = 0xffff;

  ClusterMap() = default;
  explicit ClusterMap(const wire::SceneHostMap& complete);
  // What becomes of `base` (change.since() is its epoch).
  ClusterMap(const ClusterMap& base, const wire::SceneHostMap& change);

  std::uint32_t epoch() const { return epoch_; }
  std::uint32_t generation() const { return generation_; }
  bool pause() const { return pause_; }
  std::size_t part_count() const { return part_count_; }
  const std::vector<wire::HostEntry>& entries() const { return entries_; }  // by slot
  std::size_t hosts() const { return entries_.size(); }
  HostId host(Slot s) const { return HostId(entries_[s].host()); }
  Slot slot(HostId h) const { return h.value < slots_.size() ? slots_[h.value] : kNoSlot; }
  bool only_intersects(Slot s) const { return only_intersects_[s]; }
  bool holds_any(Slot s) const { return first_part_[s] != first_part_[s + 1u]; }
  bool holds(Slot s, PartId p) const {
    return p.value == 0 || (p.value < part_count_ && (bits_[s * words_ + p.value / 64] >> (p.value % 64) & 1u) != 0);
  }
  std::span<const Slot> holders(PartId p) const;  // in the order of slots; empty for an unknown part
  bool paged(PartId p) const { return p.value < paged_.size() && paged_[p.value]; }
  bool paging() const { return !paged_.empty(); }

 private:
  struct Holder {
    wire::HostEntry entry;
    std::vector<std::uint32_t> parts;
  };
  void build(const wire::SceneHostMap& m, std::vector<Holder> hosts);
  std::span<const std::uint32_t> parts_of(std::size_t slot) const {
    return std::span(parts_).subspan(first_part_[slot], first_part_[slot + 1] - first_part_[slot]);
  }

  std::uint32_t epoch_ = 0, generation_ = 0;
  bool pause_ = false;
  std::size_t part_count_ = 0, words_ = 0;
  std::vector<wire::HostEntry> entries_;
  std::vector<Slot> slots_;  // by host number
  std::vector<bool> only_intersects_;
  std::vector<std::uint32_t> first_part_{0}, parts_;  // slot -> its parts
  std::vector<std::uint64_t> bits_;                   // the same, slot-major
  std::vector<std::uint32_t> first_holder_;           // part -> range of holder_slots_
  std::vector<Slot> holder_slots_;
  std::vector<bool> paged_;  // by part; empty: none
};
using ClusterMapPtr = std::shared_ptr<const ClusterMap>;

// Seconds of queued work, by slot of one map.
struct HostLoads {
  HostLoads() = default;
  explicit HostLoads(const ClusterMap& map);  // as the map says
  // Of hosts that were there before, as was known; of others as the map says.
  HostLoads(const ClusterMap& map, const ClusterMap& before, const HostLoads& known);
  HostLoads(const HostLoads& before, const ClusterMap& map, const wire::HostList& news);
  float most_of_others(ClusterMap::Slot self) const { return self == busiest ? second : most; }

  std::vector<float> by_slot;
  float most = 0, second = 0;
  ClusterMap::Slot busiest = ClusterMap::kNoSlot;

 private:
  void rank();
};
using HostLoadsPtr = std::shared_ptr<const HostLoads>;

// Cores in one process that hear the same may share what they make of it: a simulation has thousands. Not for several
// threads.
class SharedMaps {
 public:
  ClusterMapPtr map(const ClusterMapPtr& before, const wire::SceneHostMap& m);
  HostLoadsPtr first_loads(const ClusterMapPtr& map, const ClusterMap& before, const HostLoads& known);
  HostLoadsPtr loads(const HostLoadsPtr& before, const ClusterMapPtr& map, const wire::HostList& m);

 private:
  ClusterMapPtr last_;
  HostLoadsPtr first_;  // of the last map
  struct Loads {
    HostLoadsPtr before, after;
    ClusterMapPtr map;
    std::uint32_t number = 0;
  } loads_;
};

}  // namespace cloudrenderer
