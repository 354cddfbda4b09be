#include <gtest/gtest.h>

#include <set>

#include "shading/light_choice.h"
#include "shading/lights.h"
#include "shading_lights_support.h"

namespace cloudrenderer {
namespace {

using namespace test;

// The choice of a light.

EmitterBounds emitter(Uniform& u, int kind) {
  EmitterBounds b;
  b.center = Vec3(u(), u(), u()) * 10.f;
  b.axis = uniform_direction(u);
  b.strength = 0.1f + u();
  switch (kind % 5) {
    case 0:
      break;
    case 1:
      b.shape = EmitterShape::planar;
      b.radius = 0.3f;
      break;
    case 2:
      b.shape = EmitterShape::planar_two_sided;
      b.radius = 0.1f;
      break;
    case 3:
      b.shape = EmitterShape::cone;
      b.cos_spread = 1;
      b.cos_emission = 0.5f;
      break;
    default:
      b.radius = 0.5f;
  }
  return b;
}

TEST(LightChoice, ChancesSumToOneAndAreThoseOfSamples) {
  for (const int count : {2, 16, 17, 300}) {
    SCOPED_TRACE(count);
    Uniform u;
    std::vector<EmitterBounds> all;
    for (int i = 0; i < count; ++i) all.push_back(emitter(u, i));
    all[0].shape = EmitterShape::everywhere;
    if (count > 100)
      for (int i = 1; i < 40; ++i) all[static_cast<std::size_t>(i)].shape = EmitterShape::distant;
    // Flat ones, of some points.
    std::vector<EmitterPoints> points(all.size());
    for (std::size_t i = 0; i < all.size(); ++i)
      if (all[i].shape == EmitterShape::planar || all[i].shape == EmitterShape::planar_two_sided)
        for (int k = 0; k < 3 + static_cast<int>(i % 2); ++k)
          points[i].at[points[i].count++] = all[i].center + all[i].radius * glm::cross(all[i].axis, uniform_direction(u));
    const LightChoice choice(all, points);
    for (int round = 0; round < 5; ++round) {
      const Vec3 p = Vec3(u(), u(), u()) * 10.f, n = round == 0 ? Vec3(0) : uniform_direction(u);
      double sum = 0;
      for (std::uint32_t i = 0; i < all.size(); ++i)
        sum += static_cast<double>(choice.chance(i, p, n));
      EXPECT_LE(sum, 1.0001);
      std::vector<int> seen(all.size());
      int missed = 0;
      constexpr int kCount = 20000;
      for (int i = 0; i < kCount; ++i) {
        float chance;
        const std::int64_t e =
            choice.sample(p, n, (static_cast<float>(i) + u()) / kCount * 0.9999999f, chance);
        if (e < 0) {
          ++missed;
          continue;
        }
        ++seen[static_cast<std::size_t>(e)];
        EXPECT_NEAR(chance / choice.chance(static_cast<std::uint32_t>(e), p, n), 1, 1e-4);
      }
      EXPECT_NEAR(missed / static_cast<double>(kCount), 1 - sum, 0.01)
          << "only dead ends are missing";
      for (std::uint32_t i = 0; i < all.size(); ++i) {
        const double expected = kCount * static_cast<double>(choice.chance(i, p, n));
        EXPECT_NEAR(seen[i], expected, 3 + 0.02 * expected) << i;
        if (importance(all[i], p, n) > 0) {
          EXPECT_GT(choice.chance(i, p, n), 0) << i;
        }
      }
    }
  }
}

TEST(LightChoice, ManyLightsGiveTheSumOfTheirLight) {
  for (const int count : {5, 60}) {
    Scene scene;
    Uniform u;
    glm::dvec3 expected(0);
    const Vec3 p(5, 0.5f, 5), n = glm::normalize(Vec3(0.2f, 1, 0.1f));
    for (int i = 0; i < count; ++i) {
      const Vec3 at = Vec3(u(), u(), u()) * 10.f;
      const Rgb intensity(0.5f + u(), u(), 1);
      scene.light("point", {color("I", intensity), point("from", at)});
      const Vec3 w = at - p;
      const float d = glm::length(w);
      expected += glm::dvec3(intensity * std::max(0.f, glm::dot(w, n)) / (d * d * d));
    }
    const auto lights = scene.build();
    expect_ratio(irradiance(*lights, p, n, 40000), Rgb(expected), 0.02f);
    // The estimate is right for a wrong normal too, only with more noise.
    expect_ratio(irradiance(*lights, p, n, 250000, -n), Rgb(expected), 0.03f);
  }
}

TEST(LightChoice, NearLightsAreChosenMoreOften) {
  Scene scene;
  for (int i = 0; i < 100; ++i)
    scene.light("point", {point("from", {static_cast<float>(i) * 10.f, 5, 0})});
  const auto lights = scene.build();
  Uniform u;
  int near = 0;
  for (int i = 0; i < 1000; ++i) {
    LightSample s;
    ASSERT_TRUE(lights->sample({400, 0, 0}, {0, 1, 0}, u(), u.pair(), s));
    near += s.distance < 12;
  }
  EXPECT_GT(near, 700) << "three of a hundred lights";
}

// Of two lamps the nearer one turns its edge to the surface. By their middles and radii it would get nearly all.
TEST(LightChoice, FlatLightsAreWeighedByWhatTheirPointsGive) {
  std::vector<EmitterBounds> both(2);
  std::vector<EmitterPoints> points(2);
  for (std::size_t i = 0; i < 2; ++i) {
    both[i].shape = EmitterShape::planar;
    both[i].strength = 1;
    both[i].radius = 1;
    both[i].center = Vec3(i ? 1.f : -1.f, 0, 1);
    both[i].axis = i ? Vec3(-1, 0, 0) : Vec3(0, 0, -1);
    points[i].count = 2;
    for (const std::size_t k : {0u, 1u}) points[i].at[k] = both[i].center + Vec3(0, k ? 0.5f : -0.5f, 0);
  }
  const Vec3 p(0.99f, 0, 0), up(0, 0, 1);
  EXPECT_LT(LightChoice(both).chance(0, p, up), 0.2f);
  EXPECT_GT(LightChoice(both, points).chance(0, p, up), 0.3f);
}

TEST(LightChoice, EqualPlacesDoNotMakeEndlessTrees) {
  std::vector<EmitterBounds> all(5000);
  for (EmitterBounds& b : all) b.strength = 1;
  const LightChoice choice(all);
  EXPECT_NEAR(choice.chance(4321, Vec3(1), Vec3(0)) * 5000.f, 1, 1e-3);
  // Distances that double: median splits take over before a trail is too long.
  for (std::size_t i = 0; i < all.size(); ++i)
    all[i].center.x = std::exp2(static_cast<float>(i % 120) - 60.f);
  const LightChoice far(all);
  float chance;
  EXPECT_GE(far.sample(Vec3(1), Vec3(0), 0.7f, chance), 0);
}

TEST(Lights, SingleLightCostsNoChoice) {
  const auto lights = Scene().quadric(sphere({0, 0, 5}, 1), Rgb(1)).build();
  LightSample a, b;
  ASSERT_TRUE(lights->sample(Vec3(0), {0, 0, -1}, 0.1f, Vec2(0.3f), a));
  ASSERT_TRUE(lights->sample(Vec3(0), {1, 0, 0}, 0.9f, Vec2(0.3f), b));
  EXPECT_EQ(a.pdf, b.pdf);
  EXPECT_EQ(a.wi, b.wi);
}

TEST(Lights, MixedKindsAgreeOnTheirDensities) {
  Scene scene;
  scene.light("infinite", {}).light("point", {}).quadric(sphere({0, 4, 0}, 1), Rgb(2));
  scene.mesh({{-1, -1, 5}, {-1, 1, 5}, {1, 1, 5}, {1, -1, 5}}, kTwoTriangles, Rgb(4));
  const auto lights = scene.build();
  Uniform u;
  std::set<bool> kinds;
  const Vec3 p(0.2f, 0.3f, 1), n = glm::normalize(Vec3(0, 1, 1));
  for (int i = 0; i < 2000; ++i) {
    LightSample s;
    if (!lights->sample(p, n, u(), u.pair(), s) || s.delta) continue;
    kinds.insert(std::isinf(s.distance));
    float pdf = 0;
    if (std::isinf(s.distance)) {
      lights->escaped(p, n, s.wi, pdf);
    } else if (s.radiance.x == 2) {
      pdf = lights->emitted_pdf(0, p, n, s.wi, s.distance, p + s.wi * s.distance, -s.wi, 0);
    } else {
      pdf = lights->emitted_pdf(1, p, n, s.wi, s.distance, p + s.wi * s.distance, {0, 0, -1}, 1);
    }
    EXPECT_NEAR(pdf / s.pdf, 1, 1e-4);
  }
  EXPECT_EQ(kinds.size(), 2u);
}

}  // namespace
}  // namespace cloudrenderer
