#include "tasks/routing.h"

#include <algorithm>
#include <limits>

#include "base/random.h"

namespace cloudrenderer {
namespace {

constexpr float kAskingCosts = 0.1f;  // seconds of load: the answer is to be waited for, and shaded here

}  // namespace

Routing::Routing(const wire::SceneHostMap& map, HostId self, float alpha)
    : epoch_(map.epoch()),
      generation_(map.generation()),
      self_(self),
      alpha_(alpha),
      words_((map.part_count() + 63) / 64) {
  const std::size_t parts = map.part_count();
  for (const wire::HostEntry& e : map.hosts()) {
    hosts_.emplace_back(e.host());
    load_.push_back(static_cast<float>(e.load_s()));
    only_intersects_.push_back(e.only_intersects());
  }
  bits_.resize(hosts_.size() * words_);
  std::vector<std::vector<Slot>> holders(parts);
  for (const wire::Holding& h : map.holdings()) {
    const Slot s = slot(HostId(h.host()));
    if (s == kNoSlot) continue;
    for (const std::uint32_t p : h.parts()) {
      if (p == 0 || p >= parts || holds(s, PartId(p))) continue;
      bits_[s * words_ + p / 64] |= std::uint64_t{1} << (p % 64);
      holders[p].push_back(s);
    }
  }
  for (const std::uint32_t p : map.paged()) {
    paged_.resize(parts);
    if (p < parts && holders[p].empty()) paged_[p] = true;
  }
  first_holder_.assign(parts + 1, 0);
  target_.assign(parts, kNoSlot);
  const Slot own = slot(self);
  for (std::size_t p = 0; p < parts; ++p) {
    auto& list = holders[p];
    std::sort(list.begin(), list.end());
    holder_slots_.insert(holder_slots_.end(), list.begin(), list.end());
    first_holder_[p + 1] = static_cast<std::uint32_t>(holder_slots_.size());
    if (p == 0 || (own != kNoSlot && holds(own, PartId(static_cast<std::uint32_t>(p))))) {
      target_[p] = own;
      continue;
    }
    float best = std::numeric_limits<float>::infinity();
    std::uint64_t best_tie = 0;
    for (const Slot s : list) {
      const std::uint64_t tie =
          mix64((std::uint64_t{self.value} << 40) ^ (std::uint64_t{p} << 16) ^ s);
      const float rank = load_[s] + (only_intersects_[s] ? kAskingCosts : 0.f);
      if (rank > best || (rank == best && tie <= best_tie)) continue;
      best = rank;
      best_tie = tie;
      target_[p] = s;
    }
  }
}

Routing::Slot Routing::slot(HostId h) const {
  const auto it = std::find(hosts_.begin(), hosts_.end(), h);
  return it == hosts_.end() ? kNoSlot : static_cast<Slot>(it - hosts_.begin());
}

std::span<const Routing::Slot> Routing::holders(PartId p) const {
  if (p.value >= part_count()) return {};
  return std::span(holder_slots_)
      .subspan(first_holder_[p.value], first_holder_[p.value + 1] - first_holder_[p.value]);
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
