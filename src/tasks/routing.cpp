#include "tasks/routing.h"

#include <algorithm>
#include <limits>

#include "base/random.h"

namespace cloudrenderer {
namespace {

constexpr float kAskingCosts = 0.1f;  // seconds of load: the answer is to be waited for, and shaded here

}  // namespace

Routing::Routing(ClusterMapPtr map, HostLoadsPtr loads, HostId self, float alpha)
    : map_(std::move(map)),
      loads_(std::move(loads)),
      self_(self),
      own_(map_->slot(self)),
      alpha_(alpha),
      targets_(std::make_unique<std::atomic<Slot>[]>(map_->part_count())) {
  for (std::size_t p = 0; p < map_->part_count(); ++p) targets_[p].store(kNotKnown, std::memory_order_relaxed);
}

Routing::Routing(const wire::SceneHostMap& complete, HostId self, float alpha)
    : Routing(std::make_shared<const ClusterMap>(complete), nullptr, self, alpha) {
  loads_ = std::make_shared<const HostLoads>(*map_);
}

// Threads that find it out at the same time find the same.
Routing::Slot Routing::target(PartId p) const {
  if (p.value >= part_count()) return kNoSlot;
  Slot target = targets_[p.value].load(std::memory_order_relaxed);
  if (target == kNotKnown) targets_[p.value].store(target = find_target(p), std::memory_order_relaxed);
  return target;
}

Routing::Slot Routing::find_target(PartId p) const {
  if (p.value == 0 || (own_ != kNoSlot && holds(own_, p))) return own_;
  Slot target = kNoSlot;
  float best = std::numeric_limits<float>::infinity();
  std::uint64_t best_tie = 0;
  for (const Slot s : holders(p)) {
    const std::uint64_t tie = mix64((std::uint64_t{self_.value} << 40) ^ (std::uint64_t{p.value} << 16) ^ s);
    const float rank = load(s) + (map_->only_intersects(s) ? kAskingCosts : 0.f);
    if (rank > best || (rank == best && tie <= best_tie)) continue;
    best = rank;
    best_tie = tie;
    target = s;
  }
  return target;
}

Routing::Slot cover_first(std::span<const PartId> needed, const Routing& routing) {
  if (needed.empty()) return Routing::kNoSlot;
  const auto candidates = routing.holders(needed[0]);
  if (needed.size() == 1 || candidates.size() <= 1) return routing.target(needed[0]);
  Routing::Slot best = Routing::kNoSlot;
  float best_cost = std::numeric_limits<float>::infinity();
  for (const Routing::Slot s : candidates) {
    const auto covered = static_cast<float>(
        std::count_if(needed.begin(), needed.end(), [&](PartId p) { return routing.holds(s, p); }));
    const bool self = routing.host(s) == routing.self();
    const float cost = self ? 0.f : (1.f + routing.alpha() * routing.load(s)) / covered;
    // The holder that whole batches go to wins a tie, so that equal hosts share the work.
    if (cost < best_cost || (cost == best_cost && s == routing.target(needed[0]))) {
      best = s;
      best_cost = cost;
    }
  }
  return best;
}

std::vector<Routing::Slot> cover(std::span<const PartId> needed, const Routing& routing) {
  std::vector<Routing::Slot> hosts;
  std::vector<PartId> open(needed.begin(), needed.end());
  while (!open.empty()) {
    const Routing::Slot s = cover_first(open, routing);
    if (s == Routing::kNoSlot) {
      open.erase(open.begin());  // nobody holds it
      continue;
    }
    hosts.push_back(s);
    std::erase_if(open, [&](PartId p) { return routing.holds(s, p); });
  }
  // A host whose parts the others hold too is not needed; the first one stays.
  for (std::size_t i = hosts.size(); i-- > 1;) {
    const bool needless = std::all_of(needed.begin(), needed.end(), [&](PartId p) {
      if (!routing.holds(hosts[i], p)) return true;
      for (std::size_t j = 0; j < hosts.size(); ++j)
        if (j != i && routing.holds(hosts[j], p)) return true;
      return false;
    });
    if (needless) hosts.erase(hosts.begin() + static_cast<std::ptrdiff_t>(i));
  }
  return hosts;
}

}  // namespace cloudrenderer
