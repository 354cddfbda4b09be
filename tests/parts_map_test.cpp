#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>
#include <random>
#include <vector>

#include "parts/part_map.h"

namespace cloudrenderer {
namespace {

struct Ray {
  Vec3 origin, direction;
};

std::vector<PartInfo> random_parts(std::mt19937& random, std::size_t count, std::size_t boxes) {
  std::uniform_real_distribution<float> place(-10.f, 10.f), size(0.f, 4.f);
  std::vector<PartInfo> parts(count + 1);
  for (std::size_t p = 1; p <= count; ++p) {
    const Vec3 middle(place(random), place(random), place(random));
    for (std::size_t b = 0; b < boxes; ++b) {
      const Vec3 low = middle + Vec3(size(random), size(random), size(random));
      const Vec3 extent(size(random), b % 3 ? size(random) : 0.f, size(random));  // flat boxes too
      parts[p].boxes.push_back({low, low + extent});
    }
  }
  return parts;
}

std::vector<Ray> random_rays(std::mt19937& random, std::size_t count) {
  std::uniform_real_distribution<float> place(-15.f, 15.f);
  std::normal_distribution<float> normal;
  std::vector<Ray> rays(count);
  for (Ray& r : rays) {
    r.origin = {place(random), place(random), place(random)};
    r.direction = {normal(random), normal(random), normal(random)};
    for (int a = 0; a < 3; ++a)
      if (random() % 8 == 0) r.direction[a] = random() % 2 ? 0.f : -0.f;
    if (r.direction == Vec3(0)) r.direction.z = 1;
  }
  return rays;
}

// Where the ray enters a box, exactly enough (double), or infinity.
double entry(const Bounds3& b, const Ray& r) {
  double t0 = 0, t1 = std::numeric_limits<double>::infinity();
  for (int a = 0; a < 3; ++a) {
    const double o = r.origin[a], d = r.direction[a];
    if (d == 0) {
      if (o < b.min[a] || o > b.max[a]) return std::numeric_limits<double>::infinity();
      continue;
    }
    const double n = (b.min[a] - o) / d, f = (b.max[a] - o) / d;
    t0 = std::max(t0, std::min(n, f));
    t1 = std::min(t1, std::max(n, f));
  }
  return t0 <= t1 ? t0 : std::numeric_limits<double>::infinity();
}

TEST(PartMap, FindsEveryPartThatARayEnters) {
  for (const std::size_t count : {1, 7, 8, 9, 40, 300}) {
    std::mt19937 random(static_cast<unsigned>(count));
    const std::vector<PartInfo> parts = random_parts(random, count, 1 + count % 6);
    const PartMap map(parts);
    EXPECT_EQ(map.part_count(), count + 1);
    std::vector<Candidate> found(count);
    std::size_t extra = 0, all = 0;
    for (const Ray& ray : random_rays(random, 3000)) {
      const std::size_t n = map.candidates(ray.origin, ray.direction, kInfinity, found);
      ASSERT_LE(n, count);
      for (std::size_t i = 0; i + 1 < n; ++i)
        ASSERT_TRUE(
            found[i].t_enter < found[i + 1].t_enter ||
            (found[i].t_enter == found[i + 1].t_enter && found[i].part < found[i + 1].part));
      for (std::uint32_t p = 1; p <= count; ++p) {
        double expected = std::numeric_limits<double>::infinity();
        for (const Bounds3& b : parts[p].boxes) expected = std::min(expected, entry(b, ray));
        const auto c = std::find_if(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(n),
                                    [p](const Candidate& x) { return x.part == p; });
        const bool here = c != found.begin() + static_cast<std::ptrdiff_t>(n);
        all += here;
        if (std::isinf(expected)) {
          extra += here;
          continue;
        }
        ASSERT_TRUE(here) << "part " << p << " of " << count;
        ASSERT_LE(c->t_enter, expected);
        ASSERT_GE(c->t_enter, expected * (1 - 1e-4) - 1e-3);
      }
    }
    EXPECT_LE(static_cast<double>(extra), 0.001 * static_cast<double>(all) + 2)
        << count;  // only grazing rays are extra
  }
}

TEST(PartMap, AShorterRayGivesTheStartOfTheSameList) {
  std::mt19937 random(3);
  const PartMap map(random_parts(random, 60, 4));
  std::vector<Candidate> whole(60), cut(60), few(3);
  for (const Ray& ray : random_rays(random, 2000)) {
    const std::size_t n = map.candidates(ray.origin, ray.direction, kInfinity, whole);
    const float t_max = n ? whole[n / 2].t_enter : 5.f;
    const std::size_t m = map.candidates(ray.origin, ray.direction, t_max, cut);
    ASSERT_LE(m, n);
    for (std::size_t i = 0; i < n; ++i) ASSERT_EQ(i < m, whole[i].t_enter <= t_max);
    for (std::size_t i = 0; i < m; ++i) {
      ASSERT_EQ(cut[i].part, whole[i].part);
      ASSERT_EQ(cut[i].t_enter, whole[i].t_enter);
    }
    ASSERT_EQ(map.candidates(ray.origin, ray.direction, kInfinity, few), std::min<std::size_t>(n, 3));
    for (std::size_t i = 0; i < std::min<std::size_t>(n, 3); ++i)
      ASSERT_EQ(few[i].part, whole[i].part);
  }
}

TEST(PartMap, RaysAlongAnAxisInTheFaceOfABoxHit) {
  std::vector<PartInfo> parts(2);
  parts[1].boxes = {{{1, 0, 0}, {2, 1, 1}}};
  const PartMap map(parts);
  std::array<Candidate, 1> c;
  for (const float zero : {0.f, -0.f})
    for (const float face : {0.f, 1.f}) {
      EXPECT_EQ(map.candidates({0, face, face}, {1, zero, zero}, kInfinity, c), 1u);
      EXPECT_NEAR(c[0].t_enter, 1.f, 1e-5);
      EXPECT_EQ(map.candidates({3, face, face}, {-1, zero, zero}, kInfinity, c), 1u);
      EXPECT_EQ(map.candidates({0, 2, face}, {1, zero, zero}, kInfinity, c), 0u);
      EXPECT_EQ(map.candidates({0, face, face}, {-1, zero, zero}, kInfinity, c), 0u);
    }
  EXPECT_EQ(map.candidates({1.5f, 0.5f, 0.5f}, {0, 0, 1e-30f}, kInfinity, c), 1u);
  EXPECT_EQ(c[0].t_enter, 0.f);
}

TEST(PartMap, RaysThatAreNoRaysHitNothing) {
  std::vector<PartInfo> parts(2);
  parts[1].boxes = {{Vec3(-1), Vec3(1)}};
  const PartMap map(parts);
  std::array<Candidate, 1> c;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(map.candidates({nan, 0, 0}, {1, 0, 0}, kInfinity, c), 0u);
  EXPECT_EQ(map.candidates({0, 0, 0}, {nan, 0, 0}, kInfinity, c), 0u);
  EXPECT_EQ(map.candidates({0, 0, 0}, {kInfinity, 0, 0}, kInfinity, c), 0u);
}

TEST(PartMap, WithoutPartsThereIsNothing) {
  const PartMap none({}), only_main(std::vector<PartInfo>(1));
  std::array<Candidate, 1> c;
  EXPECT_EQ(none.candidates({0, 0, 0}, {1, 0, 0}, kInfinity, c), 0u);
  EXPECT_EQ(only_main.candidates({0, 0, 0}, {1, 0, 0}, kInfinity, c), 0u);
}

// Not a test of speed, a report of it: a surface over a square, cut into cells as the partition
// does, and bounce rays.
TEST(PartMap, SaysHowLongARayTakes) {
  for (const int side : {4, 16}) {
    std::mt19937 random(5);
    std::uniform_real_distribution<float> unit(0.f, 1.f);
    std::vector<PartInfo> parts(1);
    for (int x = 0; x < side; ++x)
      for (int y = 0; y < side; ++y) {
        parts.emplace_back();
        for (int b = 0; b < 4; ++b) {
          const Vec3 low(2 * x + b % 2, 2 * y + b / 2, unit(random));
          parts.back().boxes.push_back({low, low + Vec3(1, 1, 1)});
        }
      }
    const PartMap map(parts);
    std::vector<Ray> rays = random_rays(random, 100000);
    for (Ray& r : rays) {
      r.origin = Vec3(unit(random) * 2 * static_cast<float>(side),
                      unit(random) * 2 * static_cast<float>(side), 1);
      r.direction.z = std::fabs(r.direction.z);
    }
    std::array<Candidate, 64> c;
    std::size_t found = 0;
    const auto start = std::chrono::steady_clock::now();
    for (const Ray& r : rays) found += map.candidates(r.origin, r.direction, kInfinity, c);
    const std::chrono::duration<double, std::nano> time = std::chrono::steady_clock::now() - start;
    std::cout << side * side
              << " parts x 4 boxes: " << time.count() / static_cast<double>(rays.size())
              << " ns a ray, " << static_cast<double>(found) / static_cast<double>(rays.size())
              << " candidates\n";
    EXPECT_GT(found, 0u);
  }
}

}  // namespace
}  // namespace cloudrenderer
