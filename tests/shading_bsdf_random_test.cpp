// What pbrt's models promise, over 10,000 random BSDFs and directions of all kinds.
#include <gtest/gtest.h>

#include <random>

#include "shading_bsdf_cases.h"

namespace cloudrenderer {
namespace {

using testing::BsdfCase;
using testing::make_bsdf;

constexpr int kRounds = 10000 / testing::kBsdfKinds + 1;

struct Uniform {
  explicit Uniform(std::uint32_t s) : engine(s) {}
  float operator()() { return static_cast<float>(engine() >> 8) * 0x1p-24f; }
  std::mt19937 engine;
};

// One in four near grazing.
Vec3 direction(Uniform& u, bool both_sides) {
  const float z = u() < 0.25f ? 0.001f + 0.05f * u() : 0.001f + 0.999f * u(), phi = 2.f * kPi * u();
  const float r = std::sqrt(std::max(0.f, 1.f - z * z));
  return {r * std::cos(phi), r * std::sin(phi), both_sides && u() < 0.5f ? -z : z};
}

class RandomBsdfs : public ::testing::TestWithParam<int> {};

class ReciprocalBsdfs : public RandomBsdfs {};

// The others' reasons stand at random_case.
std::vector<int> reciprocal_kinds() {
  std::vector<int> out;
  for (int kind = 0; kind < testing::kBsdfKinds; ++kind) {
    Uniform u(0);
    if (testing::random_case(kind, u).reciprocal) out.push_back(kind);
  }
  return out;
}

TEST_P(ReciprocalBsdfs, AreReciprocal) {
  for (std::uint32_t seed = 0; seed < kRounds; ++seed) {
    Uniform u(seed * 64 + static_cast<std::uint32_t>(GetParam()));
    const BsdfCase c = testing::random_case(GetParam(), u);
    for (int i = 0; i < 4; ++i) {
      const Vec3 wo = direction(u, false), wi = direction(u, c.name == "Lambert" || c.name == "TranslucentV2");
      const Bsdf b = make_bsdf(c, wo);
      const Rgb f = b.eval(wo, wi), g = b.eval(wi, wo);
      for (int k = 0; k < 3; ++k) ASSERT_NEAR(f[k], g[k], 1e-5f + 2e-3f * f[k]) << c.name << " seed " << seed;
    }
  }
}

TEST_P(RandomBsdfs, ScatterNoMoreThanArrives) {
  constexpr int kSamples = 128;
  for (std::uint32_t seed = 0; seed < kRounds; ++seed) {
    Uniform u(seed * 64 + static_cast<std::uint32_t>(GetParam()));
    const BsdfCase c = testing::random_case(GetParam(), u);
    const Vec3 wo = direction(u, true);
    const Bsdf b = make_bsdf(c, wo);
    glm::dvec3 sum(0), squares(0);
    for (int i = 0; i < kSamples; ++i) {
      BsdfSample s;
      if (!b.sample(wo, u(), {u(), u()}, s)) continue;
      ASSERT_TRUE(is_finite(s.weight) && is_finite(s.wi)) << c.name << " seed " << seed;
      ASSERT_GE(std::min(s.weight.x, std::min(s.weight.y, s.weight.z)), 0.f) << c.name << " seed " << seed;
      ASSERT_TRUE(s.specular || s.pdf > 0.f) << c.name << " seed " << seed;
      // radiance is denser by eta^2 in glass: the energy does not have the factor
      const glm::dvec3 energy(s.weight * s.eta * s.eta);
      sum += energy;
      squares += energy * energy;
    }
    if (!c.conserves) continue;
    for (int k = 0; k < 3; ++k) {
      const double mean = sum[k] / kSamples;
      const double deviation = std::sqrt(std::max(0.0, squares[k] / kSamples - mean * mean) / kSamples);
      ASSERT_LE(mean, 1 + 1e-3 + 5 * deviation) << c.name << " seed " << seed << " wo.z " << wo.z;
    }
  }
}

std::string name_of(const ::testing::TestParamInfo<int>& i) {
  Uniform u(0);
  return testing::random_case(i.param, u).name;
}
INSTANTIATE_TEST_SUITE_P(All, RandomBsdfs, ::testing::Range(0, testing::kBsdfKinds), name_of);
INSTANTIATE_TEST_SUITE_P(All, ReciprocalBsdfs, ::testing::ValuesIn(reciprocal_kinds()), name_of);

}  // namespace
}  // namespace cloudrenderer
