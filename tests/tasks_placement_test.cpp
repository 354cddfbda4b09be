#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "tasks/placement.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kMiB = 1u << 20;

PlacementInput scene(std::size_t parts, std::uint64_t bytes, std::size_t hosts,
                     std::uint64_t memory) {
  PlacementInput in;
  in.parts.push_back({kMiB, {}, {}});
  for (std::size_t p = 0; p < parts; ++p)
    in.parts.push_back({bytes, Vec3(static_cast<float>(p)), {}});
  for (std::size_t h = 0; h < hosts; ++h)
    in.hosts.push_back({HostId(static_cast<std::uint32_t>(h + 1)), memory, 1, {}, {}});
  return in;
}

std::vector<int> copies(const PlacementInput& in, const std::vector<std::vector<PartId>>& placed) {
  std::vector<int> n(in.parts.size());
  for (const auto& host : placed)
    for (const PartId p : host) ++n[p.value];
  return n;
}

void expect_within_budgets(const PlacementInput& in,
                           const std::vector<std::vector<PartId>>& placed) {
  for (std::size_t h = 0; h < placed.size(); ++h) {
    std::set<std::uint32_t> prototypes(in.parts[0].prototypes.begin(),
                                       in.parts[0].prototypes.end());
    std::uint64_t used = in.parts[0].bytes;
    for (const PartId p : placed[h]) {
      used += in.parts[p.value].bytes;
      prototypes.insert(in.parts[p.value].prototypes.begin(), in.parts[p.value].prototypes.end());
    }
    for (const std::uint32_t t : prototypes) used += in.prototype_bytes[t];
    EXPECT_LE(used, in.hosts[h].memory) << h;
  }
}

TEST(Placement, GivesOneHostEverything) {
  const auto in = scene(10, kMiB, 1, 20 * kMiB);
  const auto placed = place(in);
  ASSERT_TRUE(placed);
  EXPECT_EQ((*placed)[0].size(), 10u);
}

TEST(Placement, UsesLeftoverMemoryForMoreCopies) {
  const auto in = scene(10, kMiB, 3, 100 * kMiB);
  const auto placed = place(in);
  ASSERT_TRUE(placed);
  for (const auto& host : *placed) EXPECT_EQ(host.size(), 10u);
}

TEST(Placement, SharesTheVisitsAndCopiesTheMostVisited) {
  // Room for 22 parts, of which each host needs to keep one free: the eight most visited can be on both.
  auto in = scene(12, 10 * kMiB, 2, 111 * kMiB);
  for (std::size_t p = 1; p <= 12; ++p) in.parts[p].visits = static_cast<double>(p);
  for (const double faster : {1.0, 3.0}) {
    in.hosts[0].speed = faster;
    const auto placed = place(in);
    ASSERT_TRUE(placed) << placed.error();
    expect_within_budgets(in, *placed);
    const auto n = copies(in, *placed);
    for (std::size_t p = 5; p <= 12; ++p) EXPECT_EQ(n[p], 2) << p;
    EXPECT_TRUE(std::all_of(n.begin() + 1, n.end(), [](int c) { return c >= 1; }));
  }
  // No room for copies: of 78 visits each host has its share, to one part.
  for (std::size_t p = 1; p <= 12; ++p) in.parts[p].bytes = 16 * kMiB;
  in.hosts[0].memory = in.hosts[1].memory = 9 * 16 * kMiB + kMiB;
  const auto tight = place(in);
  ASSERT_TRUE(tight) << tight.error();
  double first = 0;
  for (const PartId p : (*tight)[0]) first += in.parts[p.value].visits;
  EXPECT_GT(first, 78 * 0.6);
}

TEST(Placement, SplitsWhatNoHostCouldHold) {
  const auto in = scene(100, 10 * kMiB, 4, 300 * kMiB);
  const auto placed = place(in);
  ASSERT_TRUE(placed) << placed.error();
  expect_within_budgets(in, *placed);
  const auto n = copies(in, *placed);
  EXPECT_TRUE(std::all_of(n.begin() + 1, n.end(), [](int c) { return c >= 1; }));
}

TEST(Placement, FillsHostsNearlyToTheBrim) {
  // 4 hosts of 27 % of the scene each, and what the build of one part takes.
  const auto in = scene(100, kMiB, 4, 27 * kMiB + kMiB + kMiB / 2);
  const auto placed = place(in);
  ASSERT_TRUE(placed) << placed.error();
  expect_within_budgets(in, *placed);
}

TEST(Placement, ReplicatesAsAsked) {
  auto in = scene(20, kMiB, 4, 12 * kMiB);
  in.min_replication = 2;
  const auto placed = place(in);
  ASSERT_TRUE(placed) << placed.error();
  expect_within_budgets(in, *placed);
  const auto n = copies(in, *placed);
  EXPECT_TRUE(std::all_of(n.begin() + 1, n.end(), [](int c) { return c >= 2; }));
  in.min_replication = 3;
  EXPECT_FALSE(place(in));
}

TEST(Placement, KeepsNeighboursTogether) {
  const auto in = scene(64, kMiB, 4, 18 * kMiB);
  const auto placed = place(in);
  ASSERT_TRUE(placed);
  int together = 0;
  for (const auto& host : *placed)
    for (std::size_t i = 1; i < host.size(); ++i)
      together += host[i].value == host[i - 1].value + 1;
  EXPECT_GE(together, 48);
}

TEST(Placement, BalancesByMemory) {
  auto in = scene(60, kMiB, 2, 0);
  in.hosts[0].memory = 25 * kMiB;
  in.hosts[1].memory = 45 * kMiB;
  const auto placed = place(in);
  ASSERT_TRUE(placed) << placed.error();
  expect_within_budgets(in, *placed);
  EXPECT_GT((*placed)[1].size(), (*placed)[0].size());
}

TEST(Placement, OnlyAddsToWhatHostsHold) {
  auto in = scene(20, kMiB, 3, 12 * kMiB);
  in.hosts[0].holds = {PartId(3), PartId(17)};
  in.hosts[2].holds = {PartId(4)};
  const auto placed = place(in);
  ASSERT_TRUE(placed);
  expect_within_budgets(in, *placed);
  for (std::size_t h = 0; h < 3; ++h)
    for (const PartId p : in.hosts[h].holds)
      EXPECT_TRUE(std::binary_search((*placed)[h].begin(), (*placed)[h].end(), p));
}

TEST(Placement, CountsAPrototypeOnceAHost) {
  auto in = scene(10, kMiB, 1, 0);
  in.prototype_bytes = {50 * kMiB};
  for (auto& p : in.parts) p.prototypes = {0};
  in.hosts[0].memory = 62 * kMiB;
  EXPECT_TRUE(place(in));
  in.hosts[0].memory = 60 * kMiB;
  EXPECT_FALSE(place(in));
}

TEST(Placement, GivesNoHostWhatItCannotTrace) {
  auto in = scene(4, kMiB, 2, 50 * kMiB);
  in.hosts[0].cannot = {PartId(2)};
  const auto placed = place(in);
  ASSERT_TRUE(placed);
  EXPECT_FALSE(std::binary_search((*placed)[0].begin(), (*placed)[0].end(), PartId(2)));
  EXPECT_TRUE(std::binary_search((*placed)[1].begin(), (*placed)[1].end(), PartId(2)));
}

TEST(Placement, LeavesRoomForTheBuildThatTakesMost) {
  auto in = scene(10, kMiB, 1, 13 * kMiB);
  in.parts[4].build = 2 * kMiB;
  in.parts[5].build = kMiB;
  EXPECT_TRUE(place(in));
  in.hosts[0].memory -= 1;
  EXPECT_FALSE(place(in));
}

TEST(Placement, LeavesRoomForTheBuildOfTheMainScene) {
  auto in = scene(1, kMiB, 2, 4 * kMiB);
  in.parts[0].build = 3 * kMiB;
  EXPECT_FALSE(place(in));
  in.hosts[0].memory = in.hosts[1].memory = 5 * kMiB;
  EXPECT_TRUE(place(in));
}

TEST(Placement, AddsNothingToAHostThatHoldsMoreThanItShould) {
  auto in = scene(4, kMiB, 2, 4 * kMiB);
  in.hosts[0].memory = 2 * kMiB;  // has become less since
  in.hosts[0].holds = {PartId(1), PartId(2)};
  const auto placed = place(in);
  ASSERT_TRUE(placed) << placed.error();
  EXPECT_EQ((*placed)[0], in.hosts[0].holds);
  EXPECT_TRUE(std::binary_search((*placed)[1].begin(), (*placed)[1].end(), PartId(3)));
}

TEST(Placement, SaysWhatIsMissing) {
  const auto small = place(scene(100, kMiB, 3, 20 * kMiB));
  ASSERT_FALSE(small);
  EXPECT_NE(small.error().find("the parts need 100 MiB (1 copy)"), std::string::npos)
      << small.error();
  const auto tiny = place(scene(1, kMiB, 1, 1000));
  ASSERT_FALSE(tiny);
  EXPECT_NE(tiny.error().find("host 1 may use"), std::string::npos) << tiny.error();
  EXPECT_FALSE(place(scene(1, kMiB, 0, 0)));
}

TEST(Placement, IsTheSameForTheSameSeed) {
  auto in = scene(50, kMiB, 5, 14 * kMiB);
  in.seed = 4;
  const auto a = place(in), b = place(in);
  EXPECT_EQ(*a, *b);
}

TEST(PagedPlacement, HoldsTheMostVisitedBesideRoomForAPage) {
  auto in = scene(10, 4 * kMiB, 1, 22 * kMiB);
  for (std::size_t p = 1; p <= 10; ++p) {
    in.parts[p].build = kMiB;
    in.parts[p].page = 6 * kMiB;
    in.parts[p].visits = p == 3 || p == 7 ? 10 : 1;
  }
  ASSERT_FALSE(place(in));
  const auto placed = place_paged(in);
  ASSERT_TRUE(placed) << placed.error();
  // 22 MiB: the main scene 1, a page 6, three parts of 4.
  EXPECT_EQ(placed->hold[0].size(), 3u);
  EXPECT_EQ(placed->paged.size(), 7u);
  for (const std::uint32_t p : {3u, 7u}) EXPECT_FALSE(std::ranges::count(placed->paged, PartId(p)));
  expect_within_budgets(in, placed->hold);
}

TEST(PagedPlacement, LeavesPartsWhereTheyAre) {
  auto in = scene(10, 4 * kMiB, 2, 14 * kMiB);
  in.hosts[1].holds = {PartId(9), PartId(10)};
  const auto placed = place_paged(in);
  ASSERT_TRUE(placed) << placed.error();
  EXPECT_EQ(placed->hold[1], in.hosts[1].holds);
  EXPECT_EQ(placed->hold[0].size(), 2u);
  EXPECT_EQ(placed->paged.size(), 6u);
}

TEST(PagedPlacement, NeedsRoomForOnePartAtATime) {
  const auto in = scene(10, 4 * kMiB, 2, 4 * kMiB);
  const auto placed = place_paged(in);
  ASSERT_FALSE(placed);
  EXPECT_NE(placed.error().find("one part at a time"), std::string::npos) << placed.error();
}

}  // namespace
}  // namespace cloudrenderer
