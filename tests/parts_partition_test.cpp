#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "parts/partition.h"

namespace cloudrenderer {
namespace {

std::vector<Item> scattered(std::size_t n, float size) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> unit(0.f, 1.f);
  std::vector<Item> items(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3 p(unit(random), unit(random), unit(random));
    items[i] = {{p, p + size}, 0, static_cast<std::uint32_t>(i)};
  }
  return items;
}

struct Runs {
  std::vector<std::size_t> sizes;
  std::vector<std::uint32_t> seen;
};

Runs cut(
    std::vector<Item>& items, double capacity,
    const ItemCost& cost = [](const Item&) { return 1.f; }) {
  Runs runs;
  partition(items, cost, capacity, [&](std::span<Item> run) {
    runs.sizes.push_back(run.size());
    for (const Item& i : run) runs.seen.push_back(i.primitive);
    return true;
  });
  std::sort(runs.seen.begin(), runs.seen.end());
  return runs;
}

void expect_each_once(const Runs& runs, std::size_t n) {
  ASSERT_EQ(runs.seen.size(), n);
  for (std::size_t i = 0; i < n; ++i) ASSERT_EQ(runs.seen[i], i);
}

TEST(Partition, PutsEachItemIntoOneRunWithinTheCapacity) {
  std::vector<Item> items = scattered(10000, 0.01f);
  const Runs runs = cut(items, 300);
  expect_each_once(runs, 10000);
  for (const std::size_t n : runs.sizes) EXPECT_LE(n, 300u);
  EXPECT_LT(runs.sizes.size(), 48u);  // 34 would be full ones
}

TEST(Partition, ItemsAtOnePlaceAreStillCut) {
  std::vector<Item> items(1000);
  for (std::uint32_t i = 0; i < 1000; ++i) items[i] = {{Vec3(1), Vec3(1)}, 0, i};
  const Runs runs = cut(items, 100);
  expect_each_once(runs, 1000);
  for (const std::size_t n : runs.sizes) EXPECT_LE(n, 100u);
}

TEST(Partition, ATeapotInAStadiumIsCutToo) {
  std::vector<Item> items = scattered(5000, 1e-6f);
  for (Item& i : items) i.box = {i.box.min * 1e-4f, i.box.max * 1e-4f};
  items[0].box = {Vec3(1e6f), Vec3(1e6f)};
  items[1].box = {Vec3(-1e6f), Vec3(-1e6f)};
  const Runs runs = cut(items, 200);
  expect_each_once(runs, 5000);
  for (const std::size_t n : runs.sizes) EXPECT_LE(n, 200u);
}

TEST(Partition, AnItemLargerThanTheCapacityStandsAlone) {
  std::vector<Item> items = scattered(10, 0.1f);
  const Runs runs = cut(items, 5, [](const Item& i) { return i.primitive == 3 ? 100.f : 1.f; });
  expect_each_once(runs, 10);
  EXPECT_NE(std::find(runs.sizes.begin(), runs.sizes.end(), 1u), runs.sizes.end());
}

TEST(Partition, ARefusedRunIsCutAgain) {
  std::vector<Item> items = scattered(1000, 0.01f);
  std::size_t seen = 0;
  partition(
      items, [](const Item&) { return 1.f; }, 100,
      [&](std::span<Item> run) {
        if (run.size() > 30) return false;
        seen += run.size();
        return true;
      });
  EXPECT_EQ(seen, 1000u);
}

TEST(Partition, NothingIsCutIntoNothing) {
  std::vector<Item> none;
  EXPECT_TRUE(cut(none, 10).sizes.empty());
  EXPECT_TRUE(tight_boxes(none).empty());
}

TEST(TightBoxes, HoldAllAndLeaveEmptySpaceOut) {
  // Two clusters far apart: one box would be nearly all empty.
  std::vector<Item> items = scattered(1000, 0.01f);
  for (std::size_t i = 0; i < 500; ++i)
    items[i].box = {items[i].box.min + 100.f, items[i].box.max + 100.f};
  const std::vector<Item> before = items;
  const std::vector<Bounds3> boxes = tight_boxes(items);
  EXPECT_GE(boxes.size(), 4u);
  EXPECT_LE(boxes.size(), 8u);
  float area = 0;
  for (const Bounds3& b : boxes) area += b.surface_area();
  EXPECT_LT(area, 2 * 6 * 2.5f);
  for (const Item& i : before)
    EXPECT_TRUE(std::any_of(boxes.begin(), boxes.end(), [&](const Bounds3& b) {
      return glm::all(glm::lessThanEqual(b.min, i.box.min)) &&
             glm::all(glm::lessThanEqual(i.box.max, b.max));
    }));
}

TEST(TightBoxes, FewItemsHaveABoxEach) {
  std::vector<Item> items = scattered(2, 0.1f);
  EXPECT_EQ(tight_boxes(items).size(), 2u);
}

}  // namespace
}  // namespace cloudrenderer
