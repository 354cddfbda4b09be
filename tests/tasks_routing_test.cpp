#include <gtest/gtest.h>

#include "tasks/routing.h"

namespace cloudrenderer {
namespace {

struct HostIs {
  std::uint32_t host;
  double load;
  std::vector<std::uint32_t> parts;
};

Routing routing(std::uint32_t self, std::uint32_t part_count, const std::vector<HostIs>& hosts,
                float alpha = 0.25f) {
  wire::SceneHostMap map;
  map.set_epoch(1);
  map.set_part_count(part_count);
  for (const HostIs& h : hosts) {
    auto& e = *map.add_hosts();
    e.set_host(h.host);
    e.set_load_s(h.load);
    auto& holding = *map.add_holdings();
    holding.set_host(h.host);
    for (const std::uint32_t p : h.parts) holding.add_parts(p);
  }
  return {map, HostId(self), alpha};
}

std::vector<std::uint32_t> cover_of(const Routing& r, std::initializer_list<std::uint32_t> parts) {
  std::vector<PartId> needed;
  for (const std::uint32_t p : parts) needed.emplace_back(p);
  std::vector<std::uint32_t> hosts;
  for (const Routing::Slot s : cover(needed, r)) hosts.push_back(r.host(s).value);
  return hosts;
}

TEST(Routing, KnowsHolders) {
  const Routing r = routing(1, 4, {{1, 0, {1}}, {5, 0, {2, 3}}, {7, 0, {3}}});
  EXPECT_TRUE(r.holds(r.slot(HostId(5)), PartId(2)));
  EXPECT_FALSE(r.holds(r.slot(HostId(1)), PartId(2)));
  EXPECT_TRUE(r.holds(r.slot(HostId(7)), PartId(0)));
  EXPECT_EQ(r.holders(PartId(3)).size(), 2u);
  EXPECT_TRUE(r.holders(PartId(99)).empty());
  EXPECT_EQ(r.slot(HostId(2)), Routing::kNoSlot);
}

TEST(Routing, SendsToTheLeastLoadedHolder) {
  const Routing r = routing(1, 3, {{1, 0, {}}, {2, 3, {2}}, {3, 1, {2}}});
  EXPECT_EQ(r.host(r.target(PartId(2))), HostId(3));
  EXPECT_EQ(r.target(PartId(1)), Routing::kNoSlot);
}

TEST(Routing, PrefersThisHostAtAnyLoad) {
  const Routing r = routing(1, 3, {{1, 100, {2}}, {2, 0, {2}}});
  EXPECT_EQ(r.host(r.target(PartId(2))), HostId(1));
}

TEST(Routing, SpreadsOverEqualHolders) {
  std::vector<HostIs> hosts = {{1, 0, {}}};
  for (std::uint32_t h = 2; h < 6; ++h) {
    hosts.push_back({h, 0, {}});
    for (std::uint32_t p = 1; p < 100; ++p) hosts.back().parts.push_back(p);
  }
  const Routing r = routing(1, 100, hosts);
  std::vector<int> used(5);
  for (std::uint32_t p = 1; p < 100; ++p) ++used[r.target(PartId(p))];
  for (std::size_t s = 1; s < 5; ++s) EXPECT_GT(used[s], 10);
}

TEST(Cover, TakesFewHosts) {
  const Routing r = routing(9, 5, {{1, 0, {1}}, {2, 0, {1, 2, 3}}, {3, 0, {3, 4}}});
  EXPECT_EQ(cover_of(r, {1, 2, 3}), (std::vector<std::uint32_t>{2}));
  EXPECT_EQ(cover_of(r, {1, 2, 3, 4}), (std::vector<std::uint32_t>{2, 3}));
}

TEST(Cover, FirstHostHoldsTheNearestPart) {
  const Routing r = routing(9, 5, {{1, 0, {1}}, {2, 0, {2, 3, 4}}});
  EXPECT_EQ(cover_of(r, {1, 2, 3, 4}), (std::vector<std::uint32_t>{1, 2}));
}

TEST(Cover, WeighsLoadAgainstTheNumberOfHosts) {
  const std::vector<HostIs> hosts = {{1, 0, {1}}, {2, 100, {1, 2}}, {3, 0, {2}}};
  EXPECT_EQ(cover_of(routing(9, 3, hosts, 0.f), {1, 2}), (std::vector<std::uint32_t>{2}));
  EXPECT_EQ(cover_of(routing(9, 3, hosts, 1.f), {1, 2}), (std::vector<std::uint32_t>{1, 3}));
}

TEST(Cover, ThisHostCostsNothing) {
  const Routing r = routing(1, 3, {{1, 50, {1}}, {2, 0, {1, 2}}});
  EXPECT_EQ(cover_of(r, {1}), (std::vector<std::uint32_t>{1}));
}

TEST(Cover, LeavesOutWhatNobodyHolds) {
  const Routing r = routing(1, 4, {{2, 0, {2}}});
  EXPECT_EQ(cover_of(r, {1, 2, 3}), (std::vector<std::uint32_t>{2}));
  EXPECT_TRUE(cover_of(r, {3}).empty());
}

TEST(Cover, CoversEverythingThatIsHeldWithoutNeedlessHosts) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    std::vector<HostIs> hosts;
    for (std::uint32_t h = 1; h < 8; ++h) {
      hosts.push_back({h, static_cast<double>((seed * 7 + h * 3) % 5), {}});
      for (std::uint32_t p = 1; p < 20; ++p)
        if ((seed * 31 + h * 17 + p * 13 + h * p) % 4 == 0) hosts.back().parts.push_back(p);
    }
    const Routing r = routing(20, 20, hosts);
    std::vector<PartId> needed;
    for (std::uint32_t p = 1; p < 20; p += 2) needed.emplace_back(p);
    const auto chosen = cover(needed, r);
    const auto covers = [&](std::size_t without) {
      for (const PartId p : needed) {
        bool held = r.holders(p).empty();
        for (std::size_t i = 0; i < chosen.size(); ++i)
          held |= i != without && r.holds(chosen[i], p);
        if (!held) return false;
      }
      return true;
    };
    EXPECT_TRUE(covers(99));
    for (std::size_t i = 1; i < chosen.size(); ++i) EXPECT_FALSE(covers(i)) << seed;
  }
}

}  // namespace
}  // namespace cloudrenderer
