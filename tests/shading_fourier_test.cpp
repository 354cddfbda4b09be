// Tabulated BSDFs: the file, the value, what is broken.
#include <gtest/gtest.h>

#include "base/log.h"
#include "shading/bsdf_lobes.h"
#include "shading/material.h"
#include "shading_fourier_support.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

Vec3 direction(float z, float phi) {
  const float r = std::sqrt(1.f - z * z);
  return {r * std::cos(phi), r * std::sin(phi), z};
}

TEST(Fourier, HasTheValueOfItsFormula) {
  const FourierFormula formula{.albedo = 0.9f, .through = 0.3f, .peak = 0.5f, .eta = 1.5f};
  const auto table = fourier_table(formula);
  for (const float zo : {0.93f, 0.51f, -0.37f})
    for (const float zi : {0.8f, 0.33f, -0.61f})
      for (const float phi : {0.1f, 1.7f, 3.f}) {
        const Vec3 wo = direction(zo, 0.4f), wi = direction(zi, 0.4f + phi);
        const float g = 0.5f * std::sqrt((1 - zo * zo) * (1 - zi * zi));
        const bool through = zo * zi < 0;
        // The azimuth is taken to where the light goes, so that forward is 0; sum of 2 g^k cos(k phi), Poisson's kernel.
        const float kernel = (1 - g * g) / (1 + 2 * g * std::cos(phi) + g * g);
        const float scale = !through ? 1.f : zi < 0 ? 1 / 2.25f : 2.25f;  // radiance in glass is denser
        const float expected = 0.9f * (through ? 0.3f : 0.7f) * 1.5f / kPi * std::fabs(zi * zo) * kernel * scale;
        const Rgb f = table->value(wo, wi);
        EXPECT_NEAR(f.x, expected, 0.01f * expected + 1e-4f) << zo << " " << zi << " " << phi;
        EXPECT_EQ(f.x, f.y);
      }
  EXPECT_NEAR(table->albedo(0.7f), 0.9f * 0.7f, 5e-3f);
}

TEST(Fourier, ThreeChannelsAreLuminanceRedAndBlue) {
  const auto table = fourier_table({.channels = 3});
  const auto grey = fourier_table({});
  const Vec3 wo = direction(0.7f, 0.f), wi = direction(0.5f, 2.f);
  const Rgb c = table->value(wo, wi);
  const float y = grey->value(wo, wi).x;
  EXPECT_NEAR(c.x, 0.9f * y, 1e-5f);
  EXPECT_NEAR(c.z, 0.8f * y, 1e-5f);
  EXPECT_NEAR(luminance(c), y, 2e-3f * y);
}

std::string read_error(const std::string& bytes) {
  try {
    FourierTable::read(BsdfFile(bytes).path(), {});
  } catch (const SceneError& e) {
    return e.what();
  }
  return "";
}

TEST(Fourier, BrokenFilesSayWhy) {
  const std::string good = FourierFormula{.nodes = 4, .terms = 3}.bytes();
  EXPECT_EQ(read_error(good), "");
  const auto with = [&](std::size_t at, std::int32_t value) {
    std::string s = good;
    std::memcpy(s.data() + at, &value, sizeof value);
    return read_error(s);
  };
  const auto has = [](const std::string& text, const char* part) { EXPECT_NE(text.find(part), std::string::npos) << text; };
  has(read_error(""), "header of 64 bytes");
  has(read_error("x" + good), "SCATFUN");
  has(with(8, 3), "harmonic extrapolation");
  has(with(12, 100000), "2 to 8192 cosines");
  has(with(12, -1), "2 to 8192 cosines");
  has(with(16, 1 << 30), "cut off");
  has(with(20, 5000), "at most 4096 terms");
  has(with(24, 2), "1 or 3 channels");
  has(with(44, 0), "index of refraction");
  has(with(64, 0x7fc00000), "cosines that rise");
  has(with(68, static_cast<std::int32_t>(0xbf800000)), "cosines that rise");
  const std::size_t places = 64 + 4 * 4 + 4 * 16;
  has(with(places + 4 * 8 * 2, -5), "outside of the coefficients");
  has(with(places + 4 * 8 * 2 + 4, 1000), "outside of the coefficients");
  has(with(good.size() - 4, 0x7f800000), "no number");
  has(read_error(good.substr(0, good.size() - 1)), "cut off");
}

TEST(Fourier, AFileIsReadOnceAndAMissingOneIsBlack) {
  const BsdfFile file(FourierFormula{}.bytes());
  SceneDescription scene;
  scene.dialect = Dialect::v3;
  scene.materials = {material("fourier", {string_param("bsdffile", file.path())}),
                     material("fourier", {string_param("bsdffile", file.path())}),
                     material("fourier", {string_param("bsdffile", "/no/such.bsdf")}), material("fourier")};
  Warnings warnings;
  const auto shading = Shading::build(scene, {}, warnings);
  ASSERT_EQ(warnings.list().size(), 2u);
  EXPECT_NE(warnings.list()[0].find("/no/such.bsdf"), std::string::npos);
  EXPECT_NE(warnings.list()[1].find("bsdffile"), std::string::npos);
  EXPECT_EQ(shading->bytes(), fourier_table({})->bytes());
  SurfacePoint p;
  p.ng = p.ns = {0, 0, 1};
  EXPECT_TRUE(shading->bsdf(2, p, {0, 0, 1}, {}).empty());
  EXPECT_TRUE(shading->bsdf(0, p, {0, 0, 1}, {}).has_smooth());
}

}  // namespace
}  // namespace cloudrenderer
