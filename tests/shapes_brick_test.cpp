// Density grids in bricks: what rays collide with, against the grid as a whole.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "base/random.h"
#include "shapes/density_brick.h"

namespace cloudrenderer {
namespace {

constexpr unsigned kSeed = 11;

struct Grid {
  glm::uvec3 size{37, 20, 18};
  Vec3 p0{-1, -2, 0}, p1{2, 1, 2};
  bool clamped = false;
  Transform to_world{Mat4(1.f)};
  std::vector<float> density;

  Grid() {
    std::mt19937 random(kSeed);
    std::uniform_real_distribution<float> uniform(0.f, 1.f);
    density.resize(std::size_t{size.x} * size.y * size.z);
    for (float& d : density) d = uniform(random) * uniform(random);
    Mat4 m(1.f);  // shears, so that nothing is parallel
    m[1][0] = .3f;
    m[2][1] = -.2f;
    m[3] = {1, 2, 3, 1};
    to_world = Transform(m);
  }
  struct Piece {
    DensityBrick brick;
    std::uint32_t number;
    std::vector<float> samples;
  };
  std::vector<Piece> cut() const {
    std::vector<Piece> out;
    const DenseVoxels voxels(size, clamped ? DenseVoxels::Beyond::last : DenseVoxels::Beyond::nothing, {{BulkArray<float>(density)}});
    cut_grid({size, p0, p1}, voxels, to_world, [&](const DensityBrick& b, std::uint32_t n, std::span<const float> s) {
      out.push_back({b, n, {s.begin(), s.end()}});
    });
    return out;
  }
  double sample(int x, int y, int z) const {
    const glm::ivec3 last = glm::ivec3(size) - 1, at(x, y, z);
    const glm::ivec3 inside = glm::clamp(at, glm::ivec3(0), last);
    if (!clamped && inside != at) return 0;
    return static_cast<double>(density[static_cast<std::size_t>((inside.z * static_cast<int>(size.y) + inside.y) * static_cast<int>(size.x) + inside.x)]);
  }
  // Trilinear between the centres of the cells, as pbrt has it.
  double at(const Vec3& world) const {
    const glm::dvec3 p(to_world.inverse().point(world)), u = (p - glm::dvec3(p0)) / glm::dvec3(p1 - p0);
    if (u.x < 0 || u.y < 0 || u.z < 0 || u.x > 1 || u.y > 1 || u.z > 1) return 0;
    const glm::dvec3 s = u * glm::dvec3(size) - .5, f = glm::floor(s), d = s - f;
    double sum = 0;
    for (int i = 0; i < 8; ++i) {
      const glm::ivec3 c(i & 1, i >> 1 & 1, i >> 2);
      const double w = (c.x ? d.x : 1 - d.x) * (c.y ? d.y : 1 - d.y) * (c.z ? d.z : 1 - d.z);
      sum += w * sample(static_cast<int>(f.x) + c.x, static_cast<int>(f.y) + c.y, static_cast<int>(f.z) + c.z);
    }
    return sum;
  }
};

float first_collision(const std::vector<Grid::Piece>& pieces, const Vec3& o, const Vec3& d, float t_far, float rate, std::uint64_t ray) {
  float nearest = kInfinity;
  for (const Grid::Piece& p : pieces) {
    const std::uint64_t key = mix64(mix64(ray) + p.number);
    const Vec2 first{to_unit(static_cast<std::uint32_t>(key)), to_unit(static_cast<std::uint32_t>(key >> 32))};
    nearest = std::min(nearest, track(p.brick, p.samples, o, d, t_far, rate, first, key));
  }
  return nearest;
}

void expect_transmittance(const Grid& grid) {
  const std::vector<Grid::Piece> pieces = grid.cut();
  EXPECT_GT(pieces.size(), 8u);
  const Vec3 o(-1, 0, 2), d = glm::normalize(Vec3(3, 2.2f, 1.6f));
  constexpr float kRate = 1.7f;
  for (const float length : {3.9f, 4.4f, 9.f}) {
    constexpr int kSteps = 20000, kRays = 20000;
    double depth = 0;
    for (int i = 0; i < kSteps; ++i) {
      const float t = (static_cast<float>(i) + .5f) * length / kSteps;
      depth += grid.at(o + t * d) * static_cast<double>(kRate * length / kSteps);
    }
    int passed = 0;
    for (std::uint64_t ray = 0; ray < kRays; ++ray) passed += !(first_collision(pieces, o, d, length, kRate, ray) < length);
    const double expected = std::exp(-depth), error = std::sqrt(expected * (1 - expected) / kRays);
    EXPECT_GT(depth, 0.05);
    EXPECT_NEAR(static_cast<double>(passed) / kRays, expected, 4 * error + 1e-4) << "length " << length << ", seed " << kSeed;
  }
}

TEST(DensityBrick, RaysPassAsOftenAsTheWholeGridLetsThem) { expect_transmittance(Grid()); }
TEST(DensityBrick, SamplesOfPbrt2GoOnBeyondTheLastOnes) {
  Grid grid;
  grid.clamped = true;
  expect_transmittance(grid);
}
TEST(DensityBrick, ABoxWithMirroredCorners) {
  Grid grid;
  std::swap(grid.p0.x, grid.p1.x);
  expect_transmittance(grid);
}

TEST(DensityBrick, EmptyOnesAreLeftOutAndNumbersStay) {
  Grid grid;
  grid.clamped = true;
  for (std::uint32_t z = 0; z < grid.size.z; ++z)
    for (std::uint32_t y = 0; y < grid.size.y; ++y)
      for (std::uint32_t x = 0; x < 16; ++x) grid.density[(std::size_t{z} * grid.size.y + y) * grid.size.x + x] = 0;
  const auto pieces = grid.cut();  // 3 x 2 x 2 bricks; those of the first cells reach sample 15
  ASSERT_EQ(pieces.size(), 8u);
  EXPECT_EQ(pieces[0].number, 1u);
  EXPECT_EQ(pieces[2].number, 4u);
  EXPECT_EQ(pieces[0].brick.size, (std::array<std::uint32_t, 3>{17, 17, 17}));
}

TEST(DensityBrick, WhereARayEndsDoesNotMoveItsCollision) {
  const Grid grid;
  const auto pieces = grid.cut();
  const Vec3 o(-1, 0, 2), d = glm::normalize(Vec3(3, 2.2f, 1.6f));
  int collisions = 0;
  for (std::uint64_t ray = 0; ray < 500; ++ray) {
    const float t = first_collision(pieces, o, d, kInfinity, 3, ray);
    if (!(t < kInfinity)) continue;
    ++collisions;
    EXPECT_EQ(first_collision(pieces, o, d, t * 1.001f, 3, ray), t);
    EXPECT_EQ(first_collision(pieces, o, d, t * .999f, 3, ray), kInfinity);
  }
  EXPECT_GT(collisions, 100);
}

}  // namespace
}  // namespace cloudrenderer
