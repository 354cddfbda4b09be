// The hair material: energy, symmetry, absorption.
#include <gtest/gtest.h>

#include "chi_squared.h"
#include "shading/bsdf_hair.h"
#include "shading_bsdf_cases.h"

namespace cloudrenderer {
namespace {

using bsdf::hair;
using bsdf::HairFiber;
using testing::make_bsdf;

// The share of light that is scattered.
double albedo(const HairFiber& fiber, const Vec3& wo) {
  const Bsdf b = make_bsdf({"", {hair(fiber)}}, wo);
  return testing::SphereCells().integrate([&](const Vec3& wi) {
    float pdf;
    return b.eval_cos(wo, wi, pdf).x;
  });
}

Vec3 at(float sine, float phi) {
  const float c = std::sqrt(1.f - sine * sine);
  return {sine, c * std::cos(phi), c * std::sin(phi)};
}

TEST(Hair, WithoutAbsorptionScattersAllLight) {
  for (const float beta_m : {0.3f, 0.6f, 1.f})
    for (const float beta_n : {0.3f, 0.9f})
      for (const float h : {-0.8f, 0.1f}) {
        const double a = albedo({h, 1.55f, Rgb(0.f), beta_m, beta_n, 0.f}, at(0.4f, 1.1f));
        EXPECT_NEAR(a, 1, 1e-3) << beta_m << " " << beta_n << " " << h;
      }
}

// Tilted scales turn light along the hair without regard to how solid angles shrink there.
TEST(Hair, TiltedScalesLoseOrGainAFewPerCent) {
  for (const float sine : {-0.6f, 0.f, 0.6f}) {
    const double a = albedo({0.3f, 1.55f, Rgb(0.f), 0.3f, 0.3f, 2.f}, at(sine, 1.1f));
    EXPECT_NEAR(a, 1, 0.03) << sine;
  }
}

TEST(Hair, IsTheSameFromBothSides) {
  const HairFiber fiber{0.4f, 1.55f, Rgb(0.3f), 0.3f, 0.4f, 2.f}, mirrored{-0.4f, 1.55f, Rgb(0.3f), 0.3f, 0.4f, 2.f};
  const Vec3 wo = at(0.2f, 0.7f);
  const Vec3 flip(1, 1, -1);
  for (float phi = 0.1f; phi < 6.f; phi += 0.7f) {
    const Vec3 wi = at(-0.3f, phi);
    const float a = make_bsdf({"", {hair(fiber)}}, wo).eval(wo, wi).x;
    const float b = make_bsdf({"", {hair(mirrored)}}, wo * flip).eval(wo * flip, wi * flip).x;
    EXPECT_NEAR(a, b, 1e-4f * a) << phi;
  }
}

TEST(Hair, DarkensWithPigmentsAndKeepsItsColour) {
  const auto color = [](const Rgb& sigma) {
    Rgb sum(0.f);
    const Vec3 wo = at(0.1f, 1.2f);
    const Bsdf b = make_bsdf({"", {hair({0.3f, 1.55f, sigma, 0.3f, 0.3f, 2.f})}}, wo);
    for (float phi = 0.f; phi < 6.28f; phi += 0.05f) {
      const Vec3 wi = at(-0.2f, phi);
      sum += b.eval(wo, wi) * std::fabs(wi.z);
    }
    return sum;
  };
  const Rgb none = color(bsdf::hair_absorption(0.f, 0.f)), some = color(bsdf::hair_absorption(0.3f, 0.f)),
            red = color(bsdf::hair_absorption(0.f, 1.f));
  EXPECT_NEAR(none.x, none.z, 1e-4f * none.x);
  EXPECT_LT(some.z, some.x);
  EXPECT_LT(some.x, none.x);
  EXPECT_LT(red.z, 0.7f * red.x);
  // of Chiang et al.'s fit: ln(0.5)^2 / 5.969^2 where roughness is 0
  EXPECT_NEAR(bsdf::hair_absorption_of(Rgb(0.5f), 0.f).x, 0.480453f / 35.6290f, 1e-5f);
  EXPECT_EQ(bsdf::hair_absorption_of(Rgb(1.f), 0.3f).x, 0.f);
  EXPECT_TRUE(is_finite(bsdf::hair_absorption_of(Rgb(0.f), 0.3f)));
}

TEST(Hair, IsFiniteWhereverItIsLookedAt) {
  for (const float h : {-1.f, 0.f, 1.f, -7.f, std::numeric_limits<float>::quiet_NaN()})
    for (const float beta : {0.f, 0.02f, 1.f, 3.f})
      for (const Vec3& wo : {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, -1), at(0.99999f, 1.f)}) {
        const Bsdf b = make_bsdf({"", {hair({h, 1.55f, Rgb(0.f, 1.f, 100.f), beta, beta, 2.f})}}, wo);
        for (const Vec3& wi : {at(-0.999f, 1.f), at(0.f, 4.f), at(0.3f, 0.01f)}) {
          float pdf;
          const Rgb f = b.eval_cos(wo, wi, pdf);
          EXPECT_TRUE(is_finite(f) && std::isfinite(pdf)) << h << " " << beta;
        }
        for (const float u : {0.f, 0.3f, 0.7f, 0.9999f}) {
          BsdfSample s;
          if (!b.sample(wo, u, {u, 1.f - u}, s)) continue;
          EXPECT_TRUE(is_finite(s.weight)) << h << " " << beta << " " << u;
          EXPECT_NEAR(glm::length(s.wi), 1.f, 1e-5f);
        }
      }
}

}  // namespace
}  // namespace cloudrenderer
