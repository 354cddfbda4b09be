// What is inside of subsurface materials, and what of the light in it comes out again.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "shading/material.h"
#include "shading/media.h"
#include "shading/subsurface.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

double fresnel(double cosine, double eta) {
  const double sine2 = (1 - cosine * cosine) / (eta * eta);
  if (sine2 >= 1) return 1;
  const double t = std::sqrt(1 - sine2);
  const double a = (eta * cosine - t) / (eta * cosine + t), b = (cosine - eta * t) / (cosine + eta * t);
  return (a * a + b * b) / 2;
}

// Plain Monte Carlo in double: light from all sides that has entered an isotropic half-space, and how much of it leaves.
double simulated(double albedo, double eta, int walks, std::mt19937_64& random) {
  std::uniform_real_distribution<double> u;
  double left = 0;
  for (int n = 0; n < walks;) {
    const double outside = std::sqrt(u(random));
    if (u(random) < fresnel(outside, eta)) continue;
    ++n;
    double cosine = std::sqrt(1 - (1 - outside * outside) / (eta * eta)), z = 0, weight = 1;
    while (weight > 1e-4) {
      z += cosine * -std::log(1 - u(random));
      if (z < 0) {
        if (u(random) >= fresnel(-cosine, 1 / eta)) {
          left += weight;
          break;
        }
        z = -z;  // the rest of the way, reflected
      }
      weight *= albedo;
      cosine = 2 * u(random) - 1;
    }
  }
  return left / walks;
}

TEST(MeasuredMedia, AreThoseOfTheVersion) {
  Rgb v2_a, v2_s, v3_a, v3_s;
  ASSERT_TRUE(find_measured_medium("Skin1", Dialect::v2, v2_a, v2_s));
  ASSERT_TRUE(find_measured_medium("Skin1", Dialect::v3, v3_a, v3_s));
  EXPECT_EQ(v2_a, v3_a);
  EXPECT_EQ(v2_s, v3_s);
  ASSERT_TRUE(find_measured_medium("Espresso", Dialect::v2, v2_a, v2_s));
  ASSERT_TRUE(find_measured_medium("Espresso", Dialect::v3, v3_a, v3_s));
  EXPECT_EQ(v2_a, Rgb(.1669f, .2287f, .3078f));
  EXPECT_EQ(v3_a, Rgb(4.7984f, 6.5751f, 8.8493f));
  EXPECT_TRUE(find_measured_medium("Suisse Mocha", Dialect::v2, v2_a, v2_s));
  EXPECT_FALSE(find_measured_medium("Suisse Mocha", Dialect::v3, v2_a, v2_s)) << "its powder";
}

TEST(HalfSpaceAlbedo, IsThatOfASimulation) {
  constexpr std::uint64_t kSeed = 5;
  std::mt19937_64 random(kSeed);
  for (const double eta : {1.0, 1.3, 1.7}) {
    const HalfSpaceAlbedo solved(static_cast<float>(eta), static_cast<float>(eta));
    for (const double albedo : {0.3, 0.9, 0.99}) {
      const int walks = 20000;
      const double expected = solved.reflectance(albedo);
      EXPECT_NEAR(simulated(albedo, eta, walks, random), expected, 4 * std::sqrt(expected * (1 - expected) / walks))
          << "albedo " << albedo << ", index " << eta << ", seed " << kSeed;
    }
  }
}

TEST(HalfSpaceAlbedo, OfMediaThatAbsorbNothingIsOne) {
  for (const float eta : {1.f, 1.33f, 2.f}) EXPECT_NEAR(HalfSpaceAlbedo(eta, eta).reflectance(1), 1, 1e-9);
  EXPECT_EQ(HalfSpaceAlbedo(1.3f, 1.3f).reflectance(0), 0);
}

TEST(HalfSpaceAlbedo, IsInverted) {
  const HalfSpaceAlbedo matched(1.5f, 1.f), bounded(1.33f, 1.33f);
  for (const HalfSpaceAlbedo* h : {&matched, &bounded}) {
    for (const float wanted : {0.01f, 0.1f, 0.5f, 0.9f, 0.99f})
      EXPECT_NEAR(h->reflectance(static_cast<double>(h->single_scattering(wanted))), wanted, 1e-4 + 2e-3 * static_cast<double>(wanted))
          << wanted;
    EXPECT_EQ(h->single_scattering(0.f), 0.f);
    EXPECT_EQ(h->single_scattering(-1.f), 0.f);
    EXPECT_EQ(h->single_scattering(1.f), 1.f);
    EXPECT_EQ(h->single_scattering(3.f), 1.f);
  }
}

TEST(InteriorMedium, IsKeptInSixteenBytes) {
  constexpr std::uint32_t kSeed = 9;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<float> exponent(-18.f, 18.f), g(-0.999f, 0.999f);
  for (int i = 0; i < 1000; ++i) {
    InteriorMedium m;
    for (int c = 0; c < 3; ++c) {
      m.sigma_a[c] = i % 5 == 0 ? 0.f : std::exp(exponent(random));
      m.sigma_s[c] = std::exp(exponent(random));
    }
    m.g = g(random);
    const InteriorMedium rounded = rounded_g(m), kept = InteriorMedium::unpack(rounded.pack());
    EXPECT_EQ(kept.g, rounded.g) << "seed " << kSeed;
    EXPECT_NEAR(rounded.g, m.g, 0.008f);
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(kept.sigma_a[c], m.sigma_a[c], m.sigma_a[c] * 0x1p-13f);
      EXPECT_NEAR(kept.sigma_s[c] * (1.f - kept.g), m.sigma_s[c] * (1.f - m.g), m.sigma_s[c] * (1.f - m.g) * 0x1.2p-13f);
    }
  }
  EXPECT_EQ(rounded_g({Rgb(1.f), Rgb(2.f), 0.f}).g, 0.f);
}

SubsurfacePoint inside(const std::vector<MaterialDesc>& materials, Dialect dialect, bool& found,
                       const std::vector<TextureDesc>& textures = {}, const Vec2& uv = {}) {
  SceneDescription scene;
  scene.dialect = dialect;
  scene.materials = materials;
  scene.textures = textures;
  Warnings warnings;
  const auto shading = Shading::build(scene, {}, warnings);
  EXPECT_TRUE(warnings.list().empty()) << warnings.list()[0];
  SubsurfacePoint out;
  SurfacePoint p;
  p.uv = uv;
  found = shading->subsurface(static_cast<std::uint32_t>(materials.size() - 1), p, {}, out);
  EXPECT_EQ(shading->needs().subsurface, found);
  return out;
}

TEST(SubsurfaceMaterials, HaveTheCoefficientsThatTheirParametersSay) {
  bool found = false;
  const auto near = [](const Rgb& a, const Rgb& b) { return glm::length(a - b) < 1e-4f * glm::length(b) + 1e-7f; };
  SubsurfacePoint p = inside({material("subsurface")}, Dialect::v2, found);
  EXPECT_TRUE(found && near(p.medium.sigma_s, {2.55f, 3.21f, 3.77f}) && p.eta == 1.3f);
  p = inside({material("subsurface", {string_param("name", "Ketchup"), real_param("scale", 10.f), real_param("g", 0.5f)})}, Dialect::v3, found);
  EXPECT_TRUE(found && near(p.medium.sigma_a, {.61f, 9.7f, 14.5f}) && p.medium.g == 0.f && p.eta == 1.33f);
  p = inside({material("subsurface", {rgb_param("sigma_s", Rgb(4.f)), rgb_param("sigma_a", Rgb(1.f)), real_param("eta", 1.5f)})}, Dialect::v3, found);
  EXPECT_TRUE(found && near(p.medium.sigma_s, Rgb(4.f)) && near(p.medium.sigma_a, Rgb(1.f)) && p.eta == 1.5f);
  p = inside({material("kdsubsurface", {rgb_param("Kd", Rgb(0.6f)), rgb_param("mfp", Rgb(0.1f, 0.2f, 0.5f)), real_param("scale", 2.f)})},
             Dialect::v3, found);
  EXPECT_TRUE(found && near(p.medium.sigma_s + p.medium.sigma_a, {5.f, 2.5f, 1.f}));
  EXPECT_NEAR(HalfSpaceAlbedo(1.33f, 1.33f).reflectance(static_cast<double>(p.medium.sigma_s.x / 5.f)), 0.6, 2e-3);
  p = inside({material("disney", {rgb_param("scatterdistance", Rgb(0.5f)), rgb_param("color", Rgb(0.8f))})}, Dialect::v3, found);
  EXPECT_TRUE(found && near(p.medium.sigma_s + p.medium.sigma_a, Rgb(1.f / (0.2f * 0.5f * 1.1f))) && p.eta == 1.f);
  inside({material("disney")}, Dialect::v3, found);
  EXPECT_FALSE(found);
  inside({material("glass")}, Dialect::v2, found);
  EXPECT_FALSE(found);
  const Param first = string_param("namedmaterial1", "0"), second = string_param("namedmaterial2", "1");
  p = inside({material("matte"), material("subsurface"), material("mix", {first, second})}, Dialect::v3, found);
  EXPECT_TRUE(found && near(p.medium.sigma_s, {2.55f, 3.21f, 3.77f}));
  // A texture of uv.
  const std::vector<TextureDesc> ramp{texture("ramp", "uv", false)};
  p = inside({material("subsurface", {texture_param("sigma_s", "ramp")})}, Dialect::v3, found, ramp, {0.25f, 0.5f});
  EXPECT_TRUE(found && near(p.medium.sigma_s, {0.25f, 0.5f, 0.f}));
}

}  // namespace
}  // namespace cloudrenderer
