// Solid noise and the textures made of it.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <random>

#include "shading/texture_noise.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

std::mt19937 seeded(unsigned seed) { return std::mt19937(seed); }

Vec3 random_point(std::mt19937& random, float size) {
  std::uniform_real_distribution<float> uniform(-size, size);
  const float x = uniform(random), y = uniform(random), z = uniform(random);
  return {x, y, z};
}

TEST(Noise, HasThePublishedValue) {
  // A value of Perlin's reference implementation that is known from many ports of it; none of the
  // four doubled gradients is near this point.
  EXPECT_NEAR(noise({3.14f, 42.f, 7.f}), 0.13691996f, 2e-6f);
}

TEST(Noise, UsesEachGradientAsOftenAsItsTableHasIt) {
  // Along an axis the hash runs through a permutation, so that every gradient comes 16 times, and
  // the four that stand twice in the list 32 times.
  constexpr float kStep = 1.f / 64;
  std::map<std::array<int, 3>, int> seen;
  for (int x = 0; x < 256; ++x) {
    const Vec3 p(static_cast<float>(x), 0.f, 0.f);
    EXPECT_EQ(noise(p), 0.f);
    std::array<int, 3> gradient{};
    for (int axis = 0; axis < 3; ++axis) {
      Vec3 d(0.f);
      d[axis] = kStep;
      gradient[static_cast<std::size_t>(axis)] =
          static_cast<int>(std::lround((noise(p + d) - noise(p - d)) / (2 * kStep)));
    }
    ++seen[gradient];
  }
  ASSERT_EQ(seen.size(), 12u);
  using Gradient = std::array<int, 3>;
  for (const auto& [g, times] : seen) {
    const bool twice = g == Gradient{1, 1, 0} || g == Gradient{-1, 1, 0} ||
                       g == Gradient{0, 1, -1} || g == Gradient{0, -1, -1};
    EXPECT_EQ(times, twice ? 32 : 16) << g[0] << ' ' << g[1] << ' ' << g[2];
    EXPECT_EQ(std::abs(g[0]) + std::abs(g[1]) + std::abs(g[2]), 2);
  }
}

TEST(Noise, IsSmoothBalancedAndRepeats) {
  std::mt19937 random = seeded(1);
  double sum = 0.0, absolute = 0.0;
  constexpr int kPoints = 50000;
  for (int i = 0; i < kPoints; ++i) {
    const Vec3 p = random_point(random, 100.f);
    const float value = noise(p);
    sum += static_cast<double>(value);
    absolute += std::fabs(static_cast<double>(value));
    ASSERT_LE(std::fabs(value), 1.1f);
    ASSERT_NEAR(noise(p + Vec3(1e-3f, -1e-3f, 1e-3f)), value, 1e-2f);
    const Vec3 grid = glm::floor(p * 64.f) / 64.f;  // exact in what follows
    ASSERT_EQ(noise(grid), noise(grid + Vec3(256.f, -512.f, 1024.f)));
  }
  EXPECT_NEAR(sum / kPoints, 0.0, 0.01);
  EXPECT_NEAR(absolute / kPoints, 0.2, 0.02);  // what turbulence counts for octaves left out
}

TEST(Noise, SumsOfOctavesFollowTheirWeights) {
  std::mt19937 random = seeded(2);
  for (int i = 0; i < 1000; ++i) {
    const SolidCoordinates at{random_point(random, 10.f), Vec3(0.f), Vec3(0.f)};
    const float first = noise(at.p), second = noise(1.99f * at.p);
    ASSERT_EQ(fbm(at, {0.5f, 0}), 0.f);
    ASSERT_EQ(fbm(at, {0.5f, 1}), first);
    ASSERT_NEAR(fbm(at, {0.25f, 2}), first + 0.25f * second, 1e-6f);
    const float sum = std::fabs(first) + 0.25f * std::fabs(second);
    ASSERT_NEAR(turbulence(at, {0.25f, 2}, Dialect::v2), sum, 1e-6f);
    ASSERT_NEAR(turbulence(at, {0.25f, 2}, Dialect::v3), sum + 0.0625f * 0.2f, 1e-6f);
  }
}

TEST(Noise, AFootprintLeavesOutFineOctaves) {
  std::mt19937 random = seeded(3);
  for (int i = 0; i < 200; ++i) {
    const Vec3 p = random_point(random, 10.f);
    const auto wide = [&](float width) {
      return SolidCoordinates{p, {0.f, width, 0.f}, {0.5f * width, 0.f, 0.f}};
    };
    const SolidCoordinates exact = wide(0.f);
    // -1 - log2(1/8) = 2 octaves
    ASSERT_NEAR(fbm(wide(0.125f), {0.5f, 8}), fbm(exact, {0.5f, 2}), 1e-6f);
    ASSERT_EQ(fbm(wide(1.f), {0.5f, 8}), 0.f);
    // half way between two octaves and three, the third has half its weight
    const float between = std::exp2(-3.5f);
    const float two = fbm(exact, {0.5f, 2}), three = fbm(exact, {0.5f, 3});
    ASSERT_NEAR(fbm(wide(between), {0.5f, 8}), 0.5f * (two + three), 1e-5f);
    // what is left out counts with its mean
    ASSERT_NEAR(turbulence(wide(1.f), {0.5f, 8}, Dialect::v2), 8 * 0.2f, 1e-6f);
    ASSERT_NEAR(turbulence(wide(1.f), {0.5f, 2}, Dialect::v3), 0.2f * (1.f + 1.f + 0.5f), 1e-6f);
  }
}

// The only texture of a scene, at a point.
struct OneTexture {
  explicit OneTexture(const TextureDesc& desc, Dialect dialect = Dialect::v2) {
    scene.dialect = dialect;
    scene.textures = {desc};
    scene.materials.push_back(material("matte", {texture_param("sigma", desc.name)}));
    set = std::make_unique<TextureSet>(scene, std::uint64_t{1} << 20, warnings);
    if (desc.is_float)
      EXPECT_TRUE(set->find(desc.name, real, needs, {}, warnings));
    else
      EXPECT_TRUE(set->find(desc.name, rgb, needs, {}, warnings));
  }
  float real_at(const Vec3& p) const { return real(at(p)); }
  Rgb rgb_at(const Vec3& p) const { return rgb(at(p)); }
  static TexturePoint at(const Vec3& p) {
    TexturePoint t;
    t.p = p;
    t.uv = {p.x, p.y};
    return t;
  }

  SceneDescription scene;
  Warnings warnings;
  std::unique_ptr<TextureSet> set;
  TexturedFloat real;
  TexturedRgb rgb;
  TextureNeeds needs;
};

TEST(NoiseTextures, TakeTheirDefaultsFromPbrt) {
  const Vec3 p(1.3f, -2.4f, 0.7f);
  const SolidCoordinates at{p, Vec3(0.f), Vec3(0.f)};
  EXPECT_EQ(OneTexture(texture("t", "fbm", true)).real_at(p), fbm(at, {0.5f, 8}));
  EXPECT_EQ(OneTexture(texture("t", "fbm", false)).rgb_at(p), Rgb(fbm(at, {0.5f, 8})));
  for (const Dialect d : {Dialect::v2, Dialect::v3})
    EXPECT_EQ(OneTexture(texture("t", "wrinkled", true), d).real_at(p),
              turbulence(at, {0.5f, 8}, d));
  const auto set =
      texture("t", "fbm", true, {integer_param("octaves", 3), real_param("roughness", 0.75f)});
  EXPECT_EQ(OneTexture(set).real_at(p), fbm(at, {0.75f, 3}));
  const OneTexture windy(texture("t", "windy", true));
  const SolidCoordinates tenth{0.1f * p, Vec3(0.f), Vec3(0.f)};
  EXPECT_EQ(windy.real_at(p), std::fabs(fbm(tenth, {0.5f, 3})) * fbm(at, {0.5f, 6}));
  EXPECT_TRUE(windy.needs.footprint);
  EXPECT_FALSE(windy.needs.uv);
  EXPECT_TRUE(windy.warnings.list().empty());
}

TEST(NoiseTextures, FollowTheirTransformAndFootprint) {
  TextureDesc desc = texture("t", "fbm", true);
  glm::mat4 m(2.f);  // twice as large
  m[3] = {0.25f, 0.5f, 0.75f, 1.f};
  desc.texture_to_world = Transform(m);
  const OneTexture t(desc);
  TexturePoint at = OneTexture::at({0.3f, 0.1f, -0.6f});
  at.dpdx = {0.03125f, 0.f, 0.f};  // 1/16 in the texture: 5 octaves in pbrt-v2, 3 in later ones
  const SolidCoordinates there{{0.85f, 0.7f, -0.45f}, Vec3(0.f), Vec3(0.f)};
  EXPECT_NEAR(t.real(at), fbm(there, {0.5f, 5}), 1e-5f);
  EXPECT_NEAR(OneTexture(desc, Dialect::v3).real(at), fbm(there, {0.5f, 3}), 1e-5f);
}

TEST(NoiseTextures, OctavesThatMakeNoSenseAreCut) {
  for (const int octaves : {-5, 2000000000}) {
    const OneTexture t(texture("t", "wrinkled", true, {integer_param("octaves", octaves)}));
    EXPECT_EQ(t.warnings.list().size(), 1u);
    EXPECT_TRUE(std::isfinite(t.real_at({1.f, 2.f, 3.f})));
  }
}

TEST(NoiseTextures, MarbleHasItsColoursAlongY) {
  const OneTexture t(texture("t", "marble", false, {real_param("variation", 0.f)}));
  const auto near = [&](float y, const Rgb& expected) {
    const Rgb found = t.rgb_at({5.f, y, -3.f});
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(found[i], expected[i], 1e-5f) << y;
  };
  near(-0.5f * kPi, 1.5f * Rgb(0.58f, 0.58f, 0.6f));  // the ends and the middle of the list
  near(0.5f * kPi, 1.5f * Rgb(0.58f, 0.58f, 0.6f));
  near(0.f, Rgb(0.75f));
  const OneTexture twice(
      texture("t", "marble", false, {real_param("variation", 0.f), real_param("scale", 2.f)}));
  EXPECT_EQ(twice.rgb_at({0.f, 0.4f, 0.f}), t.rgb_at({0.f, 0.8f, 0.f}));
  const OneTexture disturbed(texture("t", "marble", false));
  const Vec3 p(0.3f, 0.7f, 0.1f);
  const float moved = p.y + 0.2f * fbm({p, Vec3(0.f), Vec3(0.f)}, {0.5f, 8});
  EXPECT_EQ(disturbed.rgb_at(p), t.rgb_at({0.f, moved, 0.f}));
  EXPECT_EQ(OneTexture(texture("t", "marble", true)).warnings.list().size(), 1u);
}

TEST(NoiseTextures, DotsAreRoundAndWithinTheirCells) {
  const OneTexture t(
      texture("t", "dots", true, {real_param("inside", 0.75f), real_param("outside", 0.25f)}));
  EXPECT_TRUE(t.needs.uv);
  EXPECT_FALSE(t.needs.footprint);
  constexpr int kFine = 50;
  int dots = 0;
  for (int j = 0; j < 20; ++j)
    for (int i = 0; i < 20; ++i) {
      int inside = 0;
      for (int v = 0; v < kFine; ++v)
        for (int u = 0; u < kFine; ++u) {
          // cells are centred on the integers
          const Vec2 in_cell = (Vec2(u, v) + 0.5f) / static_cast<float>(kFine) - 0.5f;
          const float value = t.real_at(
              {static_cast<float>(i) + in_cell.x, static_cast<float>(j) + in_cell.y, 0.f});
          ASSERT_TRUE(value == 0.75f || value == 0.25f);
          inside += value == 0.75f;
        }
      if (inside == 0) continue;
      ++dots;
      EXPECT_NEAR(static_cast<float>(inside) / (kFine * kFine), kPi * 0.35f * 0.35f, 0.01f);
    }
  EXPECT_GT(dots, 100);
  EXPECT_LT(dots, 300);
}

TEST(NoiseTextures, AnyFinitePointGivesFiniteValues) {
  const std::array kinds{texture("t", "fbm", false), texture("t", "wrinkled", false),
                         texture("t", "windy", false), texture("t", "marble", false),
                         texture("t", "dots", false)};
  for (const TextureDesc& desc : kinds)
    for (const Dialect d : {Dialect::v2, Dialect::v3}) {
      const OneTexture t(desc, d);
      for (const float x : {0.f, -1e-38f, 1e9f, -1e18f, 16777217.f})
        for (const float width : {0.f, 1e-30f, 1e18f}) {
          TexturePoint at = OneTexture::at({x, 0.5f * x, 1.f - x});
          at.dpdx = Vec3(width);
          EXPECT_TRUE(is_finite(t.rgb(at))) << desc.type << ' ' << x << ' ' << width;
        }
    }
}

}  // namespace
}  // namespace cloudrenderer
