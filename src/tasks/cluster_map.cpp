#include "tasks/cluster_map.h"

#include <algorithm>

namespace cloudrenderer {

ClusterMap::ClusterMap(const wire::SceneHostMap& complete) {
  std::vector<Holder> holders;
  for (const wire::HostEntry& e : complete.hosts()) holders.push_back({e, {}});
  build(complete, std::move(holders));
}

ClusterMap::ClusterMap(const ClusterMap& base, const wire::SceneHostMap& change) {
  std::vector<Holder> holders;
  std::vector<bool> gone;
  for (const std::uint32_t h : change.gone()) {
    if (gone.size() <= h) gone.resize(h + 1);
    gone[h] = true;
  }
  for (std::size_t s = 0; s < base.hosts(); ++s) {
    const std::uint32_t h = base.entries_[s].host();
    if (h < gone.size() && gone[h]) continue;
    const auto parts = base.parts_of(s);
    holders.push_back({base.entries_[s], {parts.begin(), parts.end()}});
  }
  for (const wire::HostEntry& e : change.hosts()) {
    const Slot s = base.slot(HostId(e.host()));
    const auto same = s == kNoSlot ? holders.end()
                                   : std::ranges::find_if(holders, [&](const Holder& h) { return h.entry.host() == e.host(); });
    if (same == holders.end())
      holders.push_back({e, {}});
    else
      same->entry = e;
  }
  build(change, std::move(holders));
}

void ClusterMap::build(const wire::SceneHostMap& m, std::vector<Holder> holders) {
  epoch_ = m.epoch();
  generation_ = m.generation();
  pause_ = m.pause();
  part_count_ = m.part_count();
  words_ = (part_count_ + 63) / 64;
  for (std::size_t s = 0; s < holders.size(); ++s) {
    const std::uint32_t h = holders[s].entry.host();
    if (slots_.size() <= h) slots_.resize(h + 1, kNoSlot);
    if (slots_[h] == kNoSlot) slots_[h] = static_cast<Slot>(s);
  }
  // What is named replaces what was known of the host; one that is named twice has both.
  std::vector<bool> named(holders.size());
  for (const wire::Holding& h : m.holdings()) {
    const Slot s = slot(HostId(h.host()));
    if (s == kNoSlot) continue;
    auto& parts = holders[s].parts;
    if (!named[s]) parts.clear();
    named[s] = true;
    parts.insert(parts.end(), h.parts().begin(), h.parts().end());
  }
  bits_.resize(holders.size() * words_);
  first_holder_.assign(part_count_ + 1, 0);
  for (std::size_t s = 0; s < holders.size(); ++s) {
    auto& parts = holders[s].parts;
    std::ranges::sort(parts);
    parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
    std::erase_if(parts, [&](std::uint32_t p) { return p == 0 || p >= part_count_; });
    for (const std::uint32_t p : parts) {
      bits_[s * words_ + p / 64] |= std::uint64_t{1} << (p % 64);
      ++first_holder_[p + 1];
    }
    parts_.insert(parts_.end(), parts.begin(), parts.end());
    first_part_.push_back(static_cast<std::uint32_t>(parts_.size()));
    only_intersects_.push_back(holders[s].entry.only_intersects());
    entries_.push_back(std::move(holders[s].entry));
  }
  for (std::size_t p = 0; p < part_count_; ++p) first_holder_[p + 1] += first_holder_[p];
  holder_slots_.resize(parts_.size());
  std::vector<std::uint32_t> next(first_holder_.begin(), first_holder_.end());
  for (std::size_t s = 0; s < entries_.size(); ++s)
    for (const std::uint32_t p : parts_of(s)) holder_slots_[next[p]++] = static_cast<Slot>(s);
  for (const std::uint32_t p : m.paged()) {
    paged_.resize(part_count_);
    if (p < part_count_ && this->holders(PartId(p)).empty()) paged_[p] = true;
  }
}

std::span<const ClusterMap::Slot> ClusterMap::holders(PartId p) const {
  if (p.value >= part_count_) return {};
  return std::span(holder_slots_).subspan(first_holder_[p.value], first_holder_[p.value + 1] - first_holder_[p.value]);
}

HostLoads::HostLoads(const ClusterMap& map) {
  for (const wire::HostEntry& e : map.entries()) by_slot.push_back(static_cast<float>(e.load_s()));
  rank();
}

HostLoads::HostLoads(const ClusterMap& map, const ClusterMap& before, const HostLoads& known) {
  for (const wire::HostEntry& e : map.entries()) {
    const auto s = before.slot(HostId(e.host()));
    by_slot.push_back(s != ClusterMap::kNoSlot && s < known.by_slot.size() ? known.by_slot[s] : static_cast<float>(e.load_s()));
  }
  rank();
}

HostLoads::HostLoads(const HostLoads& before, const ClusterMap& map, const wire::HostList& news) : by_slot(before.by_slot) {
  by_slot.resize(map.hosts());
  const auto put = [&](std::uint32_t host, double load) {
    if (const auto s = map.slot(HostId(host)); s != ClusterMap::kNoSlot) by_slot[s] = static_cast<float>(load);
  };
  for (const wire::HostEntry& e : news.hosts()) put(e.host(), e.load_s());
  for (int i = 0; i < std::min(news.changed_size(), news.load_s_size()); ++i) put(news.changed(i), news.load_s(i));
  rank();
}

void HostLoads::rank() {
  for (std::size_t s = 0; s < by_slot.size(); ++s) {
    if (busiest == ClusterMap::kNoSlot || by_slot[s] > most) {
      second = most;
      most = by_slot[s];
      busiest = static_cast<ClusterMap::Slot>(s);
    } else {
      second = std::max(second, by_slot[s]);
    }
  }
}

ClusterMapPtr SharedMaps::map(const ClusterMapPtr& before, const wire::SceneHostMap& m) {
  if (last_ && last_->epoch() == m.epoch()) return last_;
  first_.reset();
  return last_ = m.since() == 0 ? std::make_shared<ClusterMap>(m) : std::make_shared<ClusterMap>(*before, m);
}

HostLoadsPtr SharedMaps::first_loads(const ClusterMapPtr& map, const ClusterMap& before, const HostLoads& known) {
  if (!first_ || map != last_) first_ = std::make_shared<const HostLoads>(*map, before, known);
  return first_;
}

HostLoadsPtr SharedMaps::loads(const HostLoadsPtr& before, const ClusterMapPtr& map, const wire::HostList& m) {
  if (m.number() != 0 && loads_.number == m.number() && loads_.before == before && loads_.map == map) return loads_.after;
  loads_ = {before, std::make_shared<HostLoads>(*before, *map, m), map, m.number()};
  return loads_.after;
}

}  // namespace cloudrenderer
