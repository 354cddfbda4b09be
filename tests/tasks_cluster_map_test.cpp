#include "tasks/cluster_map.h"

#include <gtest/gtest.h>

#include <map>
#include <set>
#include <string>

#include "simulate/dice.h"

namespace cloudrenderer {
namespace {

using Holdings = std::map<std::uint32_t, std::set<std::uint32_t>>;

void add(wire::SceneHostMap& m, std::uint32_t host, const std::set<std::uint32_t>& parts) {
  m.add_hosts()->set_host(host);
  auto& h = *m.add_holdings();
  h.set_host(host);
  for (const std::uint32_t p : parts) h.add_parts(p);
}

void expect_is(const ClusterMap& map, const Holdings& holdings, std::uint32_t parts) {
  ASSERT_EQ(map.hosts(), holdings.size());
  for (const auto& [host, held] : holdings) {
    const auto s = map.slot(HostId(host));
    ASSERT_NE(s, ClusterMap::kNoSlot);
    EXPECT_EQ(map.host(s), HostId(host));
    EXPECT_EQ(map.holds_any(s), !held.empty());
    for (std::uint32_t p = 1; p < parts; ++p) EXPECT_EQ(map.holds(s, PartId(p)), held.contains(p));
  }
  for (std::uint32_t p = 1; p < parts; ++p) {
    std::size_t n = 0;
    for (const auto& [host, held] : holdings) n += held.count(p);
    EXPECT_EQ(map.holders(PartId(p)).size(), n);
  }
}

TEST(ClusterMap, ChangesLeadToWhatACompleteMapSays) {
  constexpr std::uint32_t kParts = 70;
  constexpr std::uint64_t kSeed = 20;
  sim::Dice dice(kSeed);
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  Holdings now;
  wire::SceneHostMap first;
  first.set_epoch(1);
  first.set_part_count(kParts);
  for (std::uint32_t h = 1; h <= 5; ++h) add(first, h, now[h] = {h, h + 1});
  ClusterMap map(first);
  expect_is(map, now, kParts);
  for (std::uint32_t epoch = 2; epoch < 60; ++epoch) {
    wire::SceneHostMap change;
    change.set_epoch(epoch);
    change.set_since(epoch - 1);
    change.set_part_count(kParts);
    if (dice.chance(0.3) && now.size() > 1) {
      const std::uint32_t gone = now.begin()->first;
      now.erase(gone);
      change.add_gone(gone);
    }
    std::set<std::uint32_t> held;
    while (dice.chance(0.7)) held.insert(dice.between(1, kParts - 1));
    const std::uint32_t host = dice.chance(0.5) ? now.rbegin()->first : 5 + epoch;  // one that is there, or a new one
    now[host] = held;
    add(change, host, held);
    map = ClusterMap(map, change);
    expect_is(map, now, kParts);
  }
}

TEST(HostLoads, KnowsTheMostLoadedOfTheOthers) {
  wire::SceneHostMap m;
  m.set_epoch(1);
  m.set_part_count(2);
  for (std::uint32_t h = 1; h <= 3; ++h) add(m, h, {});
  const ClusterMap map(m);
  wire::HostList news;
  for (const auto& [host, load] : {std::pair(2u, 5.f), std::pair(3u, 1.f), std::pair(9u, 7.f)}) {
    news.add_changed(host);
    news.add_load_s(load);
  }
  const HostLoads loads(HostLoads(map), map, news);
  EXPECT_EQ(loads.most_of_others(map.slot(HostId(1))), 5.f);
  EXPECT_EQ(loads.most_of_others(map.slot(HostId(2))), 1.f);
}

}  // namespace
}  // namespace cloudrenderer
