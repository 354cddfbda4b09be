// Participating media against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "scene/spectrum.h"
#include "shading/media.h"
#include "shading/phase.h"

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kSeed = 7;

Param real(const std::string& name, std::vector<float> values, ParamType type = ParamType::real) {
  Param p;
  p.name = name;
  p.type = type;
  p.reals = BulkArray<float>(std::move(values));
  return p;
}

MediumDesc desc(const std::string& type, std::initializer_list<Param> params) {
  MediumDesc d;
  d.type = type;
  for (const Param& p : params) d.params.add(p);
  return d;
}

std::unique_ptr<const Media> build(Dialect dialect, std::initializer_list<MediumDesc> media) {
  SceneDescription scene;
  scene.dialect = dialect;
  scene.media = media;
  Warnings warnings;
  auto out = Media::build(scene, warnings);
  EXPECT_TRUE(warnings.list().empty()) << warnings.list()[0];
  return out;
}

const Param kBox0 = real("p0", {-1, -1, 0}, ParamType::point3), kBox1 = real("p1", {1, 1, 2}, ParamType::point3);
Param rgb(const std::string& name, float r, float g, float b) { return real(name, {r, g, b}, ParamType::rgb); }

void expect_near(const Rgb& found, const Rgb& expected, float relative) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c], expected[c], relative * std::fabs(expected[c]) + 1e-7f) << "channel " << c;
}

// Mean of what is done with many samples of a ray.
template <class F>
Rgb mean_over_samples(std::uint32_t n, F f) {
  glm::dvec3 sum(0.0);
  for (std::uint32_t i = 0; i < n; ++i)
    sum += glm::dvec3(f(MediumNumbers{SampleSequence(SampleSequence::Kind::sobol, kSeed, 3, i), 100}));
  return Rgb(sum / static_cast<double>(n));
}

TEST(Phase, IntegratesToOneAndSamplesItsDensity) {
  const Vec3 wo = glm::normalize(Vec3(.3f, -.5f, .8f));
  for (const float g : {-.9f, -.3f, 0.f, 5e-4f, .5f, .95f}) {
    double integral = 0;
    constexpr int kRows = 40000;
    for (int i = 0; i < kRows; ++i) {
      const float cosine = -1.f + (static_cast<float>(i) + .5f) * 2.f / kRows;
      integral += static_cast<double>(phase_hg({0, 0, 1}, {std::sqrt(1 - cosine * cosine), 0, cosine}, g)) * 4 * M_PI / kRows;
    }
    EXPECT_NEAR(integral, 1, 2e-3) << "g = " << g;
    // Chi-squared over cells of equal chance: the cosine's distribution function, and turns.
    constexpr int kCells = 16, kSamples = 40000;
    std::vector<int> seen(kCells * 2, 0);
    std::mt19937 random(kSeed);
    std::uniform_real_distribution<float> uniform(0.f, 1.f);
    double mean = 0;
    const Frame frame(-wo);
    for (int i = 0; i < kSamples; ++i) {
      const Vec3 wi = sample_phase_hg(wo, g, {uniform(random), uniform(random)});
      EXPECT_NEAR(glm::length(wi), 1.f, 1e-5f);
      const double c = std::clamp(static_cast<double>(-glm::dot(wo, wi)), -1.0, 1.0), k = static_cast<double>(g);
      mean += c / kSamples;
      const double below = std::fabs(g) < 1e-3f ? (1 + c) / 2
                                                : (1 - k * k) / (2 * k) * (1 / std::sqrt(1 + k * k - 2 * k * c) - 1 / (1 + k));
      const int cell = std::clamp(static_cast<int>(below * kCells), 0, kCells - 1);
      ++seen[static_cast<std::size_t>(2 * cell + (glm::dot(frame.s, wi) > 0.f ? 1 : 0))];
    }
    EXPECT_NEAR(mean, static_cast<double>(g), 0.02) << "the mean cosine is g";
    double chi2 = 0;
    const double expected = static_cast<double>(kSamples) / (2 * kCells);
    for (const int n : seen) chi2 += (n - expected) * (n - expected) / expected;
    EXPECT_LT(chi2, 62) << "31 degrees of freedom, one in a thousand; seed " << kSeed << ", g = " << g;
  }
}

TEST(Media, RegionsAttenuateByTheirLengthAndAddUp) {
  const auto media = build(Dialect::v2, {desc("homogeneous", {rgb("sigma_a", .1f, .2f, .3f), rgb("sigma_s", .4f, .3f, .1f), kBox0, kBox1}),
                                         desc("homogeneous", {rgb("sigma_a", 1, 1, 1), kBox0, real("p1", {1, 1, .5f}, ParamType::point3)})});
  const auto through = [](float length, float own) {
    return Rgb(std::exp(-.5f * length - own), std::exp(-.5f * length - own), std::exp(-.4f * length - own));
  };
  expect_near(media->transmittance(0, {{0, 0, -5}, {0, 0, 1}, kInfinity}), through(2, .5f), 1e-5f);
  expect_near(media->transmittance(0, {{0, 0, -5}, {0, 0, 1}, 6}), through(1, .5f), 1e-5f);
  expect_near(media->transmittance(0, {{0, 0, 1}, {0, 0, 1}, kInfinity}), through(1, 0), 1e-5f);
  expect_near(media->transmittance(0, {{0, 3, 1}, {0, 0, 1}, kInfinity}), Rgb(1), 0);
  expect_near(media->transmittance(0, {{0, 0, 5}, {0, 0, 1}, kInfinity}), Rgb(1), 0);
}

TEST(Media, ExponentialDensityAgainstASum) {
  const auto media = build(Dialect::v2, {desc("exponential", {rgb("sigma_a", .5f, 1, 2), real("a", {1.5f}), real("b", {1.2f}),
                                                              real("updir", {0, 0, 2}, ParamType::vector3), kBox0, kBox1})});
  for (const Vec3& direction : {Vec3(0, 0, 1), Vec3(.6f, 0, .8f), Vec3(1, 0, 0), glm::normalize(Vec3(1, 0, 1e-4f)), Vec3(0, 0, -1)}) {
    const Vec3 origin = Vec3(0, 0, .9f) - .8f * direction;
    double depth = 0;
    constexpr int kSteps = 200000;
    constexpr double kLength = 1.6;
    for (int i = 0; i < kSteps; ++i) {
      const glm::dvec3 p = glm::dvec3(origin) + (i + .5) * kLength / kSteps * glm::dvec3(direction);
      if (std::fabs(p.x) <= 1 && p.z >= 0 && p.z <= 2) depth += 1.5 * std::exp(-1.2 * p.z) * kLength / kSteps;
    }
    const Rgb expected(static_cast<float>(std::exp(-.5 * depth)), static_cast<float>(std::exp(-depth)), static_cast<float>(std::exp(-2 * depth)));
    expect_near(media->transmittance(0, {origin, direction, 1.6f}), expected, 1e-4f);
  }
}

// What passes, on average over the samples, is what the closed form says; and what scatters is the rest times the albedo.
void expect_unbiased(const Media& media, std::uint16_t medium, const MediumRay& ray, const Rgb& scattered) {
  constexpr std::uint32_t kSamples = 1 << 15;
  const Rgb passed = mean_over_samples(kSamples, [&](const MediumNumbers& n) {
    const MediumSample s = media.sample(medium, ray, n);
    return s.collides ? Rgb(0.f) : s.weight;
  });
  expect_near(passed, media.transmittance(medium, ray), 5e-3f);
  const Rgb collided = mean_over_samples(kSamples, [&](const MediumNumbers& n) {
    const MediumSample s = media.sample(medium, ray, n);
    if (s.collides) {
      EXPECT_TRUE(s.t > 0.f && s.t <= ray.t_max);
    }
    return s.collides ? s.weight : Rgb(0.f);
  });
  expect_near(collided, scattered, 5e-3f);
}

TEST(Media, CollisionsOfAGrayMedium) {
  const auto media = build(Dialect::v3, {desc("homogeneous", {rgb("sigma_a", .2f, .2f, .2f), rgb("sigma_s", .6f, .6f, .6f)})});
  const float absorbed = 1 - std::exp(-1.2f);
  expect_unbiased(*media, 1, {{1, 2, 3}, {0, 0, 1}, 1.5f}, Rgb(.75f * absorbed));
  expect_near(media->transmittance(0, {{1, 2, 3}, {0, 0, 1}, 1.5f}), Rgb(1), 0);  // vacuum
}

TEST(Media, CollisionsOfAChromaticMedium) {
  const auto media = build(Dialect::v3, {desc("homogeneous", {rgb("sigma_a", .2f, .5f, 0), rgb("sigma_s", .6f, .1f, 2), real("scale", {.5f})})});
  const auto scattered = [](float a, float s) { return s / (a + s) * (1 - std::exp(-(a + s) * .5f * 2)); };
  expect_unbiased(*media, 1, {{}, {0, 0, 1}, 2}, {scattered(.2f, .6f), scattered(.5f, .1f), scattered(0, 2)});
}

TEST(Media, CollisionsOfOverlappingRegions) {
  const auto media = build(Dialect::v2, {desc("homogeneous", {rgb("sigma_s", .5f, .5f, .5f), kBox0, kBox1}),
                                         desc("exponential", {rgb("sigma_s", .2f, .4f, .8f), real("b", {.7f}), kBox0, kBox1})});
  const MediumRay ray{{0, .4f, -1}, {0, 0, 1}, 2.5f};
  expect_unbiased(*media, 0, ray, Rgb(1.f) - media->transmittance(0, ray));  // nothing is absorbed
}

TEST(Media, EmissionOfASlab) {
  const auto media = build(Dialect::v2, {desc("homogeneous", {rgb("sigma_a", .5f, 1, 2), rgb("Le", 3, 2, 1), kBox0, kBox1})});
  const MediumRay ray{{0, 0, -1}, {0, 0, 1}, kInfinity};
  const Rgb found = mean_over_samples(4096, [&](const MediumNumbers& n) { return media->emitted(0, ray, n); });
  const auto expected = [](float sigma, float le) { return le * (1 - std::exp(-2 * sigma)) / sigma; };
  expect_near(found, {expected(.5f, 3), expected(1, 2), expected(2, 1)}, 2e-3f);
}

TEST(Media, UnmarchedLightIsWhatTheLastStepKeepsFromPbrt) {
  const auto media = build(Dialect::v2, {desc("homogeneous", {rgb("sigma_a", .5f, 1, 2), kBox0, kBox1})});
  const MediumRay ray{{0, 0, -1}, {0, 0, 1}, kInfinity};  // two long: four steps of .5
  const Rgb found = mean_over_samples(4096, [&](const MediumNumbers& n) { return media->unmarched(ray, .6f, n); });
  const auto expected = [](float sigma) { return (std::exp(.5f * sigma) - 1) / (.5f * sigma); };
  expect_near(found, {expected(.5f), expected(1), expected(2)}, 2e-3f);
}

TEST(Media, MeasuredMediaByName) {
  const auto media = build(Dialect::v3, {desc("homogeneous", {[] {
                                                Param p;
                                                p.name = "preset";
                                                p.type = ParamType::string;
                                                p.strings = {"Skin1"};
                                                return p;
                                              }()})});
  expect_near(media->transmittance(1, {{}, {0, 0, 1}, 1}), {std::exp(-.772f), std::exp(-1.05f), std::exp(-1.49f)}, 1e-5f);
}

TEST(Media, BadOnesAreErrors) {
  const auto fails = [](Dialect dialect, const std::string& type, std::initializer_list<Param> params) {
    SceneDescription scene;
    scene.dialect = dialect;
    scene.media = {desc(type, params)};
    Warnings warnings;
    try {
      Media::check(scene, warnings);
    } catch (const SceneError&) {
      return true;
    }
    return false;
  };
  const float nan = std::nanf("");
  EXPECT_TRUE(fails(Dialect::v3, "homogeneous", {rgb("sigma_a", -1, 0, 0)}));
  EXPECT_TRUE(fails(Dialect::v3, "homogeneous", {rgb("sigma_s", nan, 0, 0)}));
  EXPECT_TRUE(fails(Dialect::v3, "homogeneous", {real("scale", {-1})}));
  EXPECT_TRUE(fails(Dialect::v3, "homogeneous", {real("g", {1})}));
  EXPECT_TRUE(fails(Dialect::v3, "homogeneous", {real("g", {nan})}));
  EXPECT_TRUE(fails(Dialect::v2, "homogeneous", {kBox0, real("p1", {-1, 1, 2}, ParamType::point3)}));
  EXPECT_TRUE(fails(Dialect::v2, "homogeneous", {rgb("Le", 0, -1, 0)}));
  EXPECT_TRUE(fails(Dialect::v2, "exponential", {real("a", {-1})}));
  EXPECT_TRUE(fails(Dialect::v2, "exponential", {real("b", {kInfinity})}));
  EXPECT_TRUE(fails(Dialect::v2, "exponential", {real("updir", {0, 0, 0}, ParamType::vector3)}));
}

// A ray through a medium that emits: sigma_a Le (1 - exp(-sigma_t d)) / sigma_t at its collisions.
TEST(Media, HomogeneousMediaOfPbrt4Shine) {
  const auto check = [](const Rgb& a, const Rgb& s, const Rgb& light, float length) {
    const auto media = build(Dialect::v3, {desc("homogeneous", {rgb("sigma_a", a.x, a.y, a.z), rgb("sigma_s", s.x, s.y, s.z),
                                                               rgb("emission", light.x, light.y, light.z), real("Lescale", {2})})});
    const MediumRay ray{{0, 0, 0}, {0, 0, 1}, length};
    const Rgb found = mean_over_samples(1 << 18, [&](const MediumNumbers& n) { return media->sample(1, ray, n).emitted; });
    Rgb expected;
    for (int c = 0; c < 3; ++c) {
      const float t = a[c] + s[c];
      expected[c] = t > 0 ? 2 * light[c] * a[c] * (1 - std::exp(-t * length)) / t : 0;
    }
    expect_near(found, expected, 3e-3f);
  };
  check(Rgb(.5f), Rgb(.25f), {1, 2, 3}, 2.5f);
  check({.5f, .1f, 0}, {.25f, .5f, .3f}, {1, 2, 3}, 2.5f);
  check({.5f, 0, 2}, {0, 0, 0}, {1, 2, 3}, .5f);
}

Param names(const std::string& name, std::vector<std::string> values) {
  Param p;
  p.name = name;
  p.type = ParamType::string;
  p.strings = std::move(values);
  return p;
}

// Emission at a collision is that of what absorbs; the temperature's colour is pbrt-v3's black body times the integral of Y.
TEST(Media, GridsShineByTheirTemperature) {
  const auto media = build(Dialect::v3, {desc("nanovdb", {rgb("sigma_a", 1, 1, 1), rgb("sigma_s", 3, 1, 0), real("Lescale", {.5f}),
                                                          real("temperatureoffset", {10}), real("temperaturescale", {100}),
                                                          names("channels", {"density", "temperature"})})});
  const GridMedium& grid = media->grids()[0];
  EXPECT_TRUE(grid.varies());
  EXPECT_TRUE(media->chromatic_grids());
  for (const float t : {20.f, 33.3f, 60.f, 110.f}) {
    const std::array<float, 2> values{1, t};
    const GridCollision at = media->collision(grid, values, {});
    expect_near(at.albedo, {.75f, .5f, 0}, 1e-6f);
    const Rgb black = glm::max(Rgb(0), blackbody_to_rgb(static_cast<double>(t - 10) * 100, Dialect::v3));
    expect_near(at.emission, .5f * 106.856895f * black * Rgb(.25f, .5f, 1), 2e-3f);
  }
  for (const float cold : {0.f, 10.f, 11.f, -1e30f}) EXPECT_EQ(media->collision(grid, std::array<float, 2>{1, cold}, {}).emission, Rgb(0.f));
}

TEST(Media, RgbGridsHaveTheirOwnAlbedoEverywhere) {
  const auto media = build(Dialect::v3, {desc("rgbgrid", {real("scale", {3}), real("Lescale", {2}),
                                                          names("channels", {"sigma_t", "sigma_t", "sigma_t", "sigma_s", "sigma_s", "sigma_s",
                                                                             "Le", "Le", "Le"})})});
  const GridMedium& grid = media->grids()[0];
  EXPECT_EQ(grid.blocking, Rgb(3));
  EXPECT_TRUE(media->chromatic_grids());
  const GridCollision at = media->collision(grid, std::array<float, 9>{2, 4, 0, 1, 3, 0, .1f, .2f, .3f}, {});
  expect_near(at.albedo, {.5f, .75f, 0}, 1e-6f);
  expect_near(at.emission, 2 * 106.856895f * Rgb(.05f, .05f, .3f), 1e-6f);
}

}  // namespace
}  // namespace cloudrenderer
