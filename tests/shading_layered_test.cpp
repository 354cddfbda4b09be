// Coated surfaces against light that is followed between the layers one ray at a time.
#include <gtest/gtest.h>

#include <random>

#include "shading/bsdf_layered.h"
#include "shading/bsdf_lobes.h"
#include "shading/bsdf_math.h"
#include "shading_layered_support.h"

namespace cloudrenderer {
namespace {

using namespace bsdf;
using testing::LayerReference;
using testing::ReferenceBase;

const Rgb kEta(0.2f, 0.92f, 1.1f), kK(3.9f, 2.45f, 2.14f);

struct LayerCase {
  std::string name;
  Coat coat;
  ReferenceBase base;
};

ReferenceBase diffuse(const Rgb& r) { return {true, r, {}, {}, 0, 0}; }
ReferenceBase metal(float alpha_x, float alpha_y) { return {false, {}, kEta / 1.5f, kK / 1.5f, alpha_x, alpha_y}; }

Coat coat(float eta, float alpha_x, float alpha_y, float thickness, const Rgb& albedo = Rgb(0.f), float g = 0.f) {
  return {eta, alpha_x, alpha_y, thickness, albedo, g, 1};
}

std::vector<LayerCase> cases() {
  const Rgb color(0.9f, 0.5f, 0.1f), milk(1.f, 0.8f, 0.3f);
  return {
      {"SmoothOverDiffuse", coat(1.5f, 0.f, 0.f, 0.f), diffuse(color)},
      {"SmoothAbsorbingOverDiffuse", coat(1.5f, 0.f, 0.f, 0.4f), diffuse(color)},
      {"RoughOverDiffuse", coat(1.5f, 0.4f, 0.4f, 0.f), diffuse(color)},
      {"SatinAbsorbingOverDiffuse", coat(1.5f, 0.15f, 0.3f, 0.2f), diffuse(color)},
      {"SmoothScatteringOverDiffuse", coat(1.5f, 0.f, 0.f, 0.7f, milk, 0.4f), diffuse(color)},
      {"RoughScatteringOverDiffuse", coat(1.33f, 0.3f, 0.3f, 2.f, milk, -0.3f), diffuse(color)},
      {"SmoothOverRoughMetal", coat(1.5f, 0.f, 0.f, 0.1f), metal(0.3f, 0.3f)},
      {"SmoothOverSatinMetal", coat(1.5f, 0.f, 0.f, 0.01f), metal(0.05f, 0.1f)},
      {"RoughOverRoughMetal", coat(1.5f, 0.3f, 0.15f, 0.01f), metal(0.2f, 0.4f)},
      {"RoughOverMirror", coat(1.5f, 0.4f, 0.4f, 0.05f), metal(0.f, 0.f)},
      {"ScatteringOverRoughMetal", coat(1.5f, 0.2f, 0.2f, 0.5f, milk, 0.6f), metal(0.2f, 0.2f)},
      {"SmoothScatteringOverMirror", coat(1.5f, 0.f, 0.f, 0.5f, milk, 0.6f), metal(0.f, 0.f)},
      {"RoughScatteringOverMirror", coat(1.5f, 0.3f, 0.3f, 0.5f, milk, 0.6f), metal(0.f, 0.f)},
      {"NoInterfaceScatteringOverDiffuse", coat(1.f, 0.f, 0.f, 1.f, milk, 0.f), diffuse(color)},
  };
}

Layers layers_of(const LayerCase& c) {
  if (c.base.diffuse) return coated_diffuse(c.coat, Rgb(c.base.reflectance), coat_internal(c.coat.eta, c.coat.thickness));
  return coated_conductor(c.coat, Rgb(c.base.eta), Rgb(c.base.k), static_cast<float>(c.base.alpha_x), static_cast<float>(c.base.alpha_y));
}
Bsdf bsdf_of(const Layers& layers, const Vec3& wo) {
  Bsdf b(Frame(), Vec3(0, 0, 1));
  b.add(layers.all());
  b.finish(wo);
  return b;
}

Vec3 polar(float z, float phi) {
  const float r = std::sqrt(1.f - z * z);
  return {r * std::cos(phi), r * std::sin(phi), z};
}

class Layered : public ::testing::TestWithParam<std::size_t> {};

// What leaves through each cell of the hemisphere. Mirrored light is no part of the value.
TEST_P(Layered, AgreesWithLightFollowedThroughTheSlab) {
  constexpr int kRays = 1'000'000, kEvaluations = 6000;
  const LayerCase c = cases()[GetParam()];
  const bool mirrors = !c.base.diffuse && c.base.alpha_x == 0 && c.coat.alpha_x == 0.f;
  for (const Vec3& wo : {polar(0.9f, 0.4f), polar(0.3f, 2.5f)}) {
    const Layers layers = layers_of(c);
    const Bsdf b = bsdf_of(layers, wo);
    LayerReference reference(c.coat, c.base, 5);
    const auto cells = reference.trace(wo, kRays, c.coat.alpha_x > 0.f);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> u(0, 1);
    const int mirror_cell = mirrors ? LayerReference::cell_of(glm::dvec3(-wo.x, -wo.y, wo.z)) : -1;
    for (int cell = 0; cell < LayerReference::kCells; ++cell) {
      glm::dvec3 sum(0), squares(0);
      for (int i = 0; i < kEvaluations; ++i) {
        // a cell's projected solid angle is pi over their number
        const glm::dvec3 f = glm::dvec3(b.eval(wo, LayerReference::direction_in(cell, u(random), u(random)))) *
                             (static_cast<double>(kPi) / LayerReference::kCells);
        sum += f;
        squares += f * f;
      }
      const glm::dvec3 mean = sum / static_cast<double>(kEvaluations);
      const glm::dvec3 variance = (squares / static_cast<double>(kEvaluations) - mean * mean) / static_cast<double>(kEvaluations);
      if (cell == mirror_cell) continue;
      const auto& expected = cells[static_cast<std::size_t>(cell)];
      for (int k = 0; k < 3; ++k) {
        const double error = std::sqrt(std::max(0.0, variance[k]) + expected.error[k] * expected.error[k]);
        EXPECT_NEAR(mean[k], expected.mean[k], 5 * error + 2e-6)
            << c.name << " wo.z " << wo.z << " cell " << cell << " channel " << k << ", seeds 5 and 3";
      }
    }
  }
}

// All that comes back, mirrored light included, by sampling.
TEST_P(Layered, SamplesReflectWhatLightDoes) {
  constexpr int kSamples = 200'000, kRays = 400'000;
  const LayerCase c = cases()[GetParam()];
  for (const Vec3& wo : {polar(0.8f, 0.4f), polar(-0.2f, 2.5f)}) {
    const Bsdf b = bsdf_of(layers_of(c), wo);
    LayerReference reference(c.coat, c.base, 9);
    glm::dvec3 expected(0), expected_variance(0), sum(0), squares(0);
    for (const auto& cell : reference.trace({wo.x, wo.y, std::fabs(wo.z)}, kRays, true)) {
      expected += cell.mean;
      expected_variance += cell.error * cell.error;
    }
    std::mt19937 random(4);
    std::uniform_real_distribution<float> u(0.f, 1.f);
    for (int i = 0; i < kSamples; ++i) {
      BsdfSample s;
      if (!b.sample(wo, u(random), {u(random), u(random)}, s)) continue;
      EXPECT_GT(s.wi.z * wo.z, 0.f);
      const glm::dvec3 w(s.weight);
      sum += w;
      squares += w * w;
    }
    for (int k = 0; k < 3; ++k) {
      const double mean = sum[k] / kSamples, variance = (squares[k] / kSamples - mean * mean) / kSamples;
      EXPECT_NEAR(mean, expected[k], 5 * std::sqrt(variance + expected_variance[k])) << c.name << " wo.z " << wo.z << " channel " << k;
      EXPECT_LT(std::sqrt(variance * kSamples), 3.5 * mean) << "noise: " << c.name << " wo.z " << wo.z << " channel " << k;
    }
  }
}

TEST_P(Layered, IsReciprocalInTheMean) {
  const LayerCase c = cases()[GetParam()];
  const Layers layers = layers_of(c);
  std::mt19937 random(6);
  std::uniform_real_distribution<float> u(0.f, 1.f);
  glm::dvec3 difference(0), squares(0);
  constexpr int kPairs = 100'000;
  for (int i = 0; i < kPairs; ++i) {
    const Vec3 wo = polar(0.2f + 0.3f * u(random), 6.f * u(random)), wi = polar(0.5f + 0.5f * u(random), 6.f * u(random));
    const Bsdf b = bsdf_of(layers, wo);
    const glm::dvec3 d = glm::dvec3(b.eval(wo, wi)) - glm::dvec3(b.eval(wi, wo));
    difference += d;
    squares += d * d;
  }
  for (int k = 0; k < 3; ++k) EXPECT_LE(std::fabs(difference[k]), 5 * std::sqrt(squares[k]) + 1e-6 * kPairs) << c.name;
}

INSTANTIATE_TEST_SUITE_P(All, Layered, ::testing::Range<std::size_t>(0, cases().size()),
                         [](const auto& i) { return cases()[i.param].name; });

// Nothing is lost where nothing absorbs. A rough surface loses what its facets send to others (single scattering), so that
// the rough ones here are nearly smooth: with widths of 0.05 the diffuse base reflects 0.975.
TEST(Layered, WhiteLayersReflectAllThatArrives) {
  const Rgb white(1.f), much(1e4f);
  const auto internal = [](const Coat& c) { return coat_internal(c.eta, c.thickness); };
  const Coat smooth = coat(1.5f, 0.f, 0.f, 0.f), milk = coat(1.5f, 0.f, 0.f, 1.f, white, 0.5f), thick = coat(1.3f, 0.f, 0.f, 5.f, white),
             satin = coat(1.5f, 0.005f, 0.005f, 0.f);
  const std::vector<std::pair<Layers, double>> white_layers{
      {coated_diffuse(smooth, white, internal(smooth)), 0.005}, {coated_diffuse(milk, white, internal(milk)), 0.005},
      {coated_diffuse(thick, white, internal(thick)), 0.005},   {coated_diffuse(satin, white, internal(satin)), 0.005},
      {coated_conductor(smooth, Rgb(1.f), much, 0.f, 0.f), 0.005}, {coated_conductor(milk, Rgb(1.f), much, 0.f, 0.f), 0.005},
      {coated_conductor(smooth, Rgb(1.f), much, 0.01f, 0.01f), 0.005}};
  for (std::size_t i = 0; i < white_layers.size(); ++i)
    for (const float z : {0.95f, 0.5f}) {
      const Vec3 wo = polar(z, 1.f);
      const Bsdf b = bsdf_of(white_layers[i].first, wo);
      std::mt19937 random(8);
      std::uniform_real_distribution<float> u(0.f, 1.f);
      double sum = 0, squares = 0;
      constexpr int kSamples = 400'000;
      for (int n = 0; n < kSamples; ++n) {
        BsdfSample s;
        if (!b.sample(wo, u(random), {u(random), u(random)}, s)) continue;
        sum += static_cast<double>(s.weight.y);
        squares += static_cast<double>(s.weight.y * s.weight.y);
      }
      const double mean = sum / kSamples, error = std::sqrt(std::max(0.0, squares / kSamples - mean * mean) / kSamples);
      EXPECT_LT(error, 0.003) << "layers " << i;
      EXPECT_NEAR(mean, 1, white_layers[i].second) << "layers " << i << " cosine " << z << " error " << error;
    }
}

// Of even light from below, against a fine sum.
TEST(Layered, InternalReflectanceOfACoat) {
  for (const double eta : {1.0, 1.2, 1.5, 2.4})
    for (const double thickness : {0.0, 0.01, 0.5, 3.0}) {
      constexpr int kSteps = 200'000;
      double sum = 0;
      for (int i = 0; i < kSteps; ++i) {
        const double c = (i + 0.5) / kSteps, s2 = eta * eta * (1 - c * c);
        double f = 1;
        if (s2 < 1) {
          const double t = std::sqrt(1 - s2), s = (eta * c - t) / (eta * c + t), p = (eta * t - c) / (eta * t + c);
          f = 0.5 * (s * s + p * p);
        }
        sum += 2 * c * f * std::exp(-2 * thickness / c) / kSteps;
      }
      EXPECT_NEAR(coat_internal(static_cast<float>(eta), static_cast<float>(thickness)), sum, 3e-4) << eta << ' ' << thickness;
    }
}

TEST(Layered, ValuesAreFunctionsOfDirectionsAndSalt) {
  const LayerCase c = cases()[5];
  const Vec3 wo = polar(0.7f, 1.f), wi = polar(0.6f, 2.f);
  Bsdf b = bsdf_of(layers_of(c), wo);
  const Rgb first = b.eval(wo, wi);
  EXPECT_EQ(first, b.eval(wo, wi));
  EXPECT_NE(first, b.eval(wo, polar(0.6f, 2.000001f)));
  b.set_salt(1);
  EXPECT_NE(first, b.eval(wo, wi));
  EXPECT_EQ(Bsdf(b).eval(wo, wi), b.eval(wo, wi));
}

TEST(Layered, MoreWalksMakeLessNoise) {
  LayerCase c = cases()[3];
  const Vec3 wo = polar(0.7f, 1.f), wi = polar(0.6f, 2.f);
  const auto variance = [&] {
    Bsdf b = bsdf_of(layers_of(c), wo);
    double sum = 0, squares = 0;
    for (std::uint32_t i = 0; i < 20'000; ++i) {
      b.set_salt(i);
      const auto f = static_cast<double>(b.eval(wo, wi).y);
      sum += f;
      squares += f * f;
    }
    return squares / 20'000 - sum / 20'000 * sum / 20'000;
  };
  const double one = variance();
  c.coat.walks = 16;
  EXPECT_NEAR(variance() / one, 1.0 / 16, 0.01);
}

}  // namespace
}  // namespace cloudrenderer
