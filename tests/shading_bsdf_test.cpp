// Every lobe: its samples follow its density, its density integrates to 1, its value is reciprocal
// where it should be.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "chi_squared.h"
#include "shading/bsdf_math.h"
#include "shading_bsdf_cases.h"

namespace cloudrenderer {
namespace {

using namespace bsdf;

using testing::BsdfCase;
using testing::make_bsdf;

BsdfCase coated(const std::string& name, const Layers& layers) {
  return {name, {layers.all().begin(), layers.all().end()}, false, true, true};
}

std::vector<BsdfCase> cases() {
  const Rgb eta(0.2f, 0.92f, 1.1f), k(3.9f, 2.45f, 2.14f);
  static const MeasuredReflectance flat = testing::formula(0.6f, 0.f, 1.f),
                                   satin = testing::formula(0.3f, 0.4f, 20.f),
                                   shiny = testing::formula(0.1f, 0.5f, 100.f);
  static const auto layered = testing::fourier_table({.albedo = 0.9f, .through = 0.3f}),
                    peaked = testing::fourier_table({.peak = 0.6f, .channels = 3});
  static const auto brushed = testing::rgl_table({.alpha_x = 0.1, .alpha_y = 0.4, .phis = 9, .folds = 2});
  static const auto lacquer = testing::rgl_table({.alpha_x = 0.2, .alpha_y = 0.2, .diffuse = 0.4, .gloss = 0.5});
  const Rgb sigma(0.1f, 0.4f, 1.2f);
  const FresnelTerm plastic_v2 = dielectric_one_sided(1.f / 1.5f),
                    plastic_v3 = dielectric(1.f / 1.5f);
  return {
      {"Lambert", {lambert(Rgb(0.7f))}},
      {"LambertBothSides", {lambert(Rgb(0.5f)), lambert(Rgb(0.3f), true)}},
      {"OrenNayar", {oren_nayar(Rgb(0.7f), 30.f)}},
      {"BlinnRough", {microfacet(Rgb(1.f), blinn(0.3f), conductor_v2(eta, k))}},
      {"BlinnSharp", {microfacet(Rgb(1.f), blinn(0.01f), conductor_v2(eta, k))}, true, false},
      {"PlasticV2", {lambert(Rgb(0.4f)), microfacet(Rgb(0.3f), blinn(0.1f), plastic_v2)}},
      {"PlasticV3",
       {lambert(Rgb(0.4f)), microfacet(Rgb(0.3f), trowbridge_reitz(0.3f, 0.3f), plastic_v3)}},
      {"MetalV3", {microfacet(Rgb(1.f), trowbridge_reitz(0.15f, 0.15f), conductor(eta, k))}},
      {"MetalV3Anisotropic",
       {microfacet(Rgb(1.f), trowbridge_reitz(0.5f, 0.1f), conductor(eta, k))}},
      {"SubstrateV2",
       {fresnel_blend(Rgb(0.4f), Rgb(0.1f), blinn_anisotropic(0.1f, 0.02f))},
       true,
       false},
      {"SubstrateV3",
       {fresnel_blend(Rgb(0.4f), Rgb(0.1f), trowbridge_reitz(0.3f, 0.15f))},
       true,
       false},
      {"TranslucentV2",
       {lambert(Rgb(0.2f)), lambert(Rgb(0.2f), true),
        microfacet(Rgb(0.2f), blinn(0.2f), plastic_v2),
        microfacet(Rgb(0.2f), blinn(0.2f), plastic_v2, true)}},
      {"RoughGlass",
       {microfacet_dielectric(Rgb(1.f), Rgb(1.f), trowbridge_reitz(0.3f, 0.3f), 1.5f)},
       false,
       true},
      {"RoughGlassAnisotropic",
       {microfacet_dielectric(Rgb(0.9f), Rgb(0.8f), trowbridge_reitz(0.2f, 0.5f), 1.3f)},
       false,
       true},
      {"RoughTransmission",
       {lambert(Rgb(0.2f)),
        microfacet_dielectric(Rgb(0.f), Rgb(0.5f), trowbridge_reitz(0.4f, 0.4f), 1.5f)},
       false,
       true},
      {"WithSpecular",
       {lambert(Rgb(0.3f)), specular_reflection(Rgb(0.5f), dielectric(1.5f)),
        microfacet(Rgb(0.3f), blinn(0.2f), plastic_v2)},
       true,
       false},
      {"MeasuredFlat", {measured(flat)}},
      {"MeasuredSatin", {measured(satin)}},
      {"MeasuredShiny", {measured(shiny)}},
      {"MeasuredMixed", {lambert(Rgb(0.3f)), measured(satin)}},
      {"FourierLayered", {fourier(*layered)}, false},
      {"FourierPeaked", {fourier(*peaked)}, false},
      {"FourierMixed", {fourier(*layered), lambert(Rgb(0.05f)), specular_reflection(Rgb(0.03f), no_fresnel())}, false},
      {"RglBrushed", {measured(*brushed)}, false},
      {"RglLacquer", {measured(*lacquer)}, false},
      {"RglMixed", {lambert(Rgb(0.1f)), measured(*brushed)}, false},
      {"DisneyDiffuse", {disney_diffuse(DisneyDiffuse{Rgb(0.5f), 0.7f, 0.3f, 0.5f, Rgb(0.2f)})}},
      {"DisneyGloss",
       {microfacet(Rgb(1.f), separable(trowbridge_reitz(0.4f, 0.1f)), disney_fresnel(Rgb(0.5f), 0.7f, 1.5f))}},
      {"DisneySatinCoat", {disney_diffuse(DisneyDiffuse{Rgb(0.5f), 1.f, 0.f, 0.5f, Rgb(0.f)}), disney_clearcoat(1.f, 0.f)}},
      {"DisneyShinyCoat", {lambert(Rgb(0.5f)), disney_clearcoat(1.f, 0.9f)}},
      {"DisneyThrough",
       {microfacet_dielectric(Rgb(0.f), Rgb(0.9f), separable(trowbridge_reitz(0.3f, 0.2f)), 1.5f)},
       false},
      {"Hair", {hair({0.3f, 1.55f, sigma, 0.3f, 0.3f, 2.f})}, false, false},
      {"HairAtTheEdge", {hair({-0.95f, 1.55f, sigma, 0.5f, 0.8f, 2.f})}, false, false},
      {"HairSharp", {hair({0.7f, 1.55f, sigma, 0.15f, 0.15f, 0.f})}, false},
      coated("RoughCoat", coated_diffuse({1.5f, 0.3f, 0.2f, 0.01f}, Rgb(0.7f), 0.f)),
      coated("ScatteringCoat", coated_diffuse({1.5f, 0.f, 0.f, 0.5f, Rgb(0.9f), 0.5f}, Rgb(0.7f), 0.f)),
      coated("RoughCoatOverMetal", coated_conductor({1.5f, 0.2f, 0.3f, 0.01f}, eta, k, 0.3f, 0.2f)),
      coated("SmoothCoatOverMetal", coated_conductor({1.5f, 0.f, 0.f, 0.01f}, eta, k, 0.2f, 0.2f)),
      coated("RoughCoatOverMirror", coated_conductor({1.5f, 0.3f, 0.3f, 0.01f}, eta, k, 0.f, 0.f)),
      coated("ScatteringCoatOverMirror", coated_conductor({1.5f, 0.f, 0.f, 0.5f, Rgb(0.9f), 0.5f}, eta, k, 0.f, 0.f)),
  };
}

Vec3 polar(float z, float phi) {
  const float r = std::sqrt(std::max(0.f, 1.f - z * z));
  return {r * std::cos(phi), r * std::sin(phi), z};
}

// From above, from below, and near grazing.
std::vector<Vec3> viewers() {
  return {polar(0.95f, 0.3f), polar(0.6f, 2.f), polar(0.2f, 4.f), polar(0.03f, 5.5f), polar(-0.5f, 1.f), polar(-0.06f, 2.7f)};
}

class Lobes : public ::testing::TestWithParam<std::size_t> {
 protected:
  BsdfCase c_ = cases()[GetParam()];
};

std::string case_name(const ::testing::TestParamInfo<std::size_t>& i) {
  return cases()[i.param].name;
}

TEST_P(Lobes, SamplesFollowTheDensity) {
  constexpr int kSamples = 40000;
  const double level = testing::corrected_level(static_cast<int>(cases().size() * viewers().size()));
  for (const Vec3& wo : viewers()) {
    const Bsdf b = make_bsdf(c_, wo);
    std::mt19937 random(7);
    std::uniform_real_distribution<float> uniform(0.f, 1.f);
    testing::SphereCells cells;
    const double inside = cells.integrate([&](const Vec3& w) { return b.pdf(wo, w); });
    EXPECT_LE(inside, 1 + 1e-3) << c_.name << " wo.z " << wo.z;
    int specular = 0, lost = 0;
    for (int i = 0; i < kSamples; ++i) {
      BsdfSample s;
      s.pdf = 0.f;
      s.wi = Vec3(0.f);
      if (!b.sample(wo, uniform(random), {uniform(random), uniform(random)}, s) && !(c_.estimated && s.pdf > 0.f))  // an estimate may be 0
        ++lost;
      else if (s.specular)
        ++specular;
      else
        cells.add(s.wi);
    }
    // What the density lacks of 1 is what sampling cannot place: below the horizon, specular, or without value.
    const double out = static_cast<double>(specular + lost) / kSamples;
    EXPECT_NEAR(inside + out, 1, 1e-3 + 5 * std::sqrt(out / kSamples)) << c_.name << " wo.z " << wo.z;
    EXPECT_GT(cells.p_value(kSamples), level) << c_.name << " wo.z " << wo.z << ", seed 7";
  }
}

TEST_P(Lobes, WeightIsValueOverDensity) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0.f, 1.f);
  const Frame frame(glm::normalize(Vec3(0.3f, -0.5f, 0.7f)));
  for (const Vec3& local : viewers()) {
    const Vec3 wo = frame.to_world(local);
    const Bsdf b = make_bsdf(c_, wo, frame);
    for (int i = 0; i < 2000; ++i) {
      BsdfSample s;
      if (!b.sample(wo, uniform(random), {uniform(random), uniform(random)}, s)) continue;
      ASSERT_TRUE(is_finite(s.weight) && is_finite(s.wi));
      EXPECT_NEAR(glm::length(s.wi), 1.f, 1e-5f);
      if (s.specular) {
        EXPECT_EQ(s.pdf, 0.f);
        continue;
      }
      float pdf;
      const Rgb f = b.eval_cos(wo, s.wi, pdf);
      // directions that were sampled in the last bit of their range differ after the way through
      // world space
      if (pdf < 1e-3f || std::fabs(glm::dot(s.wi, frame.n)) < 1e-3f) continue;
      const float tolerance = 0.02f;
      EXPECT_NEAR(s.pdf / pdf, 1.f, tolerance);
      if (c_.estimated) continue;
      for (int ch = 0; ch < 3; ++ch)
        EXPECT_NEAR(s.weight[ch], f[ch] / pdf, tolerance * (0.01f + f[ch] / pdf));
    }
  }
}

TEST_P(Lobes, IsReciprocal) {
  if (!c_.reciprocal) GTEST_SKIP() << "refraction scales radiance";
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(0.f, 1.f);
  const Bsdf b = make_bsdf(c_, Vec3(0, 0, 1));
  for (int i = 0; i < 2000; ++i) {
    const Vec3 wo = polar(uniform(random), 7.f * uniform(random)),
               wi = polar(2.f * uniform(random) - 1.f, 7.f * uniform(random));
    const Rgb f = b.eval(wo, wi), g = b.eval(wi, wo);
    // pbrt-v3's plastic treats the two sides differently; above the surface it is reciprocal
    if (wi.z < 0.f) continue;
    for (int ch = 0; ch < 3; ++ch) EXPECT_NEAR(f[ch], g[ch], 1e-5f + 1e-3f * f[ch]) << c_.name;
  }
}

TEST_P(Lobes, ScattersNoMoreThanArrives) {
  if (!c_.conserves) GTEST_SKIP() << "pbrt's model gains energy";
  std::mt19937 random(11);
  std::uniform_real_distribution<float> uniform(0.f, 1.f);
  for (const Vec3& wo : viewers()) {
    const Bsdf b = make_bsdf(c_, wo);
    constexpr int kSamples = 20000;
    double sum = 0.0;
    for (int i = 0; i < kSamples; ++i) {
      BsdfSample s;
      if (!b.sample(wo, uniform(random), {uniform(random), uniform(random)}, s)) continue;
      // radiance is denser by eta^2 in glass: the energy does not have the factor
      sum += static_cast<double>(luminance(s.weight)) * s.eta * s.eta;
    }
    EXPECT_LT(sum / kSamples, 1.015) << c_.name << " wo.z " << wo.z;
    EXPECT_GT(sum / kSamples, 0.005) << c_.name;
  }
}

INSTANTIATE_TEST_SUITE_P(All, Lobes, ::testing::Range<std::size_t>(0, cases().size()), case_name);

TEST(Bsdf, RoughGlassWithoutAbsorptionKeepsMostEnergy) {
  const BsdfCase c{"", {microfacet_dielectric(Rgb(1.f), Rgb(1.f), trowbridge_reitz(0.1f, 0.1f), 1.5f)}};
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform(0.f, 1.f);
  for (float z : {0.9f, 0.5f, -0.9f, -0.3f}) {
    const Vec3 wo = polar(z, 1.f);
    const Bsdf b = make_bsdf(c, wo);
    double sum = 0.0;
    for (int i = 0; i < 20000; ++i) {
      BsdfSample s;
      if (b.sample(wo, uniform(random), {uniform(random), uniform(random)}, s))
        sum += static_cast<double>(s.weight.x) * s.eta * s.eta;
    }
    EXPECT_NEAR(sum / 20000, 1.0, std::fabs(z) < 0.4f ? 0.1 : 0.03)
        << z;  // single scattering loses a little
  }
}

// The second moment of a sample's weight over its squared mean: 1 without noise. Plastic of pbrt-v2 with a roughness of 0.15, no diffuse
// part, from 60 and 86 degrees; by visible normals, and as it would be by all (whose density even_pdf has).
TEST(Bsdf, GrazingBlinnLobesHaveLittleNoise) {
  const auto noise = [](float degrees, bool all) {
    const Vec3 wo(std::sin(degrees * kPi / 180), 0, std::cos(degrees * kPi / 180));
    const Bsdf b = testing::make_bsdf({"", {bsdf::microfacet(Rgb(1.f), bsdf::blinn(0.15f), bsdf::dielectric_one_sided(1.f / 1.5f))}}, wo);
    std::mt19937 engine(3);
    std::uniform_real_distribution<float> u(0.f, 0.9999999f);
    double sum = 0, squares = 0;
    constexpr int kCount = 100000;
    for (int i = 0; i < kCount; ++i) {
      BsdfSample s;
      const float u_lobe = u(engine), u0 = u(engine), u1 = u(engine);
      const double weight = b.sample(wo, u_lobe, {u0, u1}, s) ? static_cast<double>(s.weight.x) : 0;
      sum += weight / kCount;
      if (weight > 0) squares += weight * weight / kCount * (all ? static_cast<double>(s.pdf / b.even_pdf(wo, s.wi)) : 1);
    }
    return squares / (sum * sum);
  };
  EXPECT_NEAR(noise(60, false), 1.43, 0.03);
  EXPECT_NEAR(noise(60, true), 1.75, 0.03);
  EXPECT_NEAR(noise(86, false), 1.03, 0.02);
  EXPECT_NEAR(noise(86, true), 1.97, 0.03);
}

TEST(Bsdf, TheGeometricNormalDecidesBetweenReflectionAndTransmission) {
  const Frame bent(glm::normalize(Vec3(0.6f, 0.f, 0.8f)));
  Bsdf b(bent, Vec3(0, 0, 1));
  b.add(lambert(Rgb(1.f)));
  const Vec3 wo(0, 0, 1);
  b.finish(wo);
  const Vec3 under_bent =
      glm::normalize(Vec3(-0.95f, 0.f, 0.1f));  // above the surface, below the bent horizon
  EXPECT_LT(glm::dot(under_bent, bent.n), 0.f);
  EXPECT_NEAR(b.eval(wo, under_bent).x, kInvPi, 1e-6f);
  EXPECT_EQ(b.pdf(wo, under_bent), 0.f);
  const Vec3 below =
      glm::normalize(Vec3(0.95f, 0.f, -0.1f));  // below the surface, above the bent horizon
  EXPECT_GT(glm::dot(below, bent.n), 0.f);
  EXPECT_EQ(b.eval(wo, below).x, 0.f);
}

TEST(Bsdf, SmoothGlassSplitsByFresnelAndScalesRadiance) {
  for (const bool v3 : {false, true}) {
    Bsdf b(Frame(), Vec3(0, 0, 1));
    b.add(specular_dielectric(Rgb(1.f), Rgb(1.f), 1.5f, v3));
    const Vec3 wo = polar(0.7f, 0.f);
    b.finish(wo);
    EXPECT_FALSE(b.has_smooth());
    const float f = fresnel_dielectric(0.7f, 1.5f);
    BsdfSample s;
    ASSERT_TRUE(b.sample(wo, f * 0.99f, {0.5f, 0.5f}, s));
    EXPECT_FALSE(s.transmission);
    EXPECT_NEAR(s.weight.x, 1.f, 1e-5f);
    EXPECT_NEAR(glm::length(s.wi - Vec3(-wo.x, -wo.y, wo.z)), 0.f, 1e-6f);
    ASSERT_TRUE(b.sample(wo, f * 1.01f, {0.5f, 0.5f}, s));
    EXPECT_TRUE(s.transmission);
    EXPECT_NEAR(s.weight.x, v3 ? 1.f / 2.25f : 1.f, 1e-5f);
    EXPECT_NEAR(s.eta, 1.5f, 1e-6f);
    EXPECT_NEAR(std::hypot(s.wi.x, s.wi.y) * 1.5f, std::hypot(wo.x, wo.y), 1e-5f);  // Snell
    const Vec3 inside = polar(-0.5f, 0.f);  // beyond the critical angle
    ASSERT_TRUE(b.sample(inside, 0.999f, {0.5f, 0.5f}, s));
    EXPECT_FALSE(s.transmission);
    EXPECT_NEAR(s.weight.x, 1.f, 1e-5f);
  }
}

TEST(BsdfMath, FresnelAgreesWithTheFormsOfTheBooks) {
  // Normal incidence, Brewster's angle for the parallel half, grazing incidence, total reflection.
  EXPECT_NEAR(fresnel_dielectric(1.f, 1.5f), 0.04f, 1e-6f);
  EXPECT_NEAR(fresnel_dielectric(1.f, 1.f / 1.5f), 0.04f, 1e-6f);
  EXPECT_NEAR(fresnel_dielectric(0.f, 1.5f), 1.f, 1e-6f);
  EXPECT_EQ(fresnel_dielectric(0.5f, 1.f / 1.5f), 1.f);
  const float brewster = 1.f / std::sqrt(1.f + 1.5f * 1.5f);
  EXPECT_NEAR(fresnel_dielectric(brewster, 1.5f),
              0.5f * std::pow((2.25f - 1.f) / (2.25f + 1.f), 2.f), 1e-5f);
  const Rgb eta(0.2f, 1.1f, 2.f), k(3.9f, 2.f, 0.f);
  for (int i = 0; i < 3; ++i) {
    const float n = eta[i], x = k[i];
    EXPECT_NEAR(conductor_channel(1.f, n, x), ((n - 1) * (n - 1) + x * x) / ((n + 1) * (n + 1) + x * x), 1e-5f);
  }
  EXPECT_NEAR(conductor_channel(0.3f, eta.z, k.z), fresnel_dielectric(0.3f, 2.f),
              1e-4f);  // no absorption
}

TEST(BsdfMath, CosinePowerIsPrecise) {
  for (const float e : {0.f, 1.f, 3.7f, 10.f, 100.f, 10000.f})
    for (float s2 = 1e-7f; s2 < 1.f; s2 *= 1.7f) {
      const double exact = std::pow(1.0 - static_cast<double>(s2), 0.5 * static_cast<double>(e));
      if (exact > 1e-6) {
        EXPECT_NEAR(cosine_power(s2, e) / exact, 1.0, 4e-6) << s2 << " " << e;
      }
    }
  EXPECT_EQ(cosine_power(1.f, 10.f), 0.f);
  EXPECT_EQ(cosine_power(0.f, 10.f), 1.f);
}

TEST(BsdfMath, DistributionsAreNormalised) {
  for (const Microfacets& m : {blinn(0.1f), blinn_anisotropic(0.2f, 0.05f),
                               trowbridge_reitz(0.3f, 0.3f), trowbridge_reitz(0.5f, 0.2f)}) {
    const Lobe l = microfacet(Rgb(1.f), m, no_fresnel());
    double sum = 0.0;
    constexpr int kN = 400;
    for (int i = 0; i < kN; ++i)
      for (int j = 0; j < kN; ++j) {
        const Vec3 w = polar((static_cast<float>(i) + 0.5f) / kN,
                             2 * kPi * (static_cast<float>(j) + 0.5f) / kN);
        sum += static_cast<double>(normal_density(l, w) * w.z);
      }
    EXPECT_NEAR(sum * 2 * kPi / (kN * kN), 1.0, 1e-3);
  }
}

}  // namespace
}  // namespace cloudrenderer
