#include <gtest/gtest.h>

#include <iostream>

#include "scene/cie1931.h"
#include "scene/spectrum.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

void expect_near(const Rgb& a, const Rgb& b, float tolerance) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], tolerance) << "channel " << i;
}

TEST(Spectrum, TheTableIsTheObserver) {
  double x = 0, y = 0, z = 0;
  for (const auto& row : kCie1931) x += row[0], y += row[1], z += row[2];
  EXPECT_NEAR(x, 106.8655, 1e-4);  // the CIE's own check sums
  EXPECT_NEAR(y, 106.8569, 1e-4);
  EXPECT_NEAR(z, 106.8923, 1e-4);
  EXPECT_EQ(kCie1931[555 - kCieFirst][1], 1.0);
}

TEST(Spectrum, ConstantOneIsEqualEnergyWhite) {
  // The row sums of the matrix, as X, Y and Z are equal within 3e-4.
  expect_near(spectrum_to_rgb({{400, 700}, {1, 1}}, Dialect::v2), {1.2048f, 0.9483f, 0.9089f},
              6e-4f);
}

TEST(Spectrum, DialectsDifferByOneSampleIn471) {
  const SampledSpectrum s{{400, 500, 600, 700}, {.2, .8, .4, .1}};
  const Rgb v2 = spectrum_to_rgb(s, Dialect::v2), v3 = spectrum_to_rgb(s, Dialect::v3);
  expect_near(v3, v2 * (470.f / 471.f), 1e-6f);
}

TEST(Spectrum, ThatEndsIsOneWithZerosAroundIt) {
  const SampledSpectrum ends{{600, 500}, {.5, .5}, true}, around{{300, 499.5, 500, 600, 600.5, 900}, {0, 0, .5, .5, 0, 0}};
  EXPECT_EQ(reflectance_to_rgb(ends), reflectance_to_rgb(around));
  EXPECT_EQ(reflectance_to_rgb({{360, 830}, {.5, .5}, true}), Rgb(.5f));
  EXPECT_EQ(reflectance_to_rgb({{500, 600}, {.5, .5}}), Rgb(.5f)) << "before pbrt-v4 and in tables";
}

TEST(Spectrum, OrderOfSamplesDoesNotMatter) {
  EXPECT_EQ(spectrum_to_rgb({{600, 400, 500}, {3, 1, 2}}, Dialect::v2),
            spectrum_to_rgb({{400, 500, 600}, {1, 2, 3}}, Dialect::v2));
}

TEST(Spectrum, GoldIsWhatEveryRendererQuotes) {
  const std::string folder = std::string(CLOUDRENDERER_SHARED_DIR) + "/scenes/v2/spds/metals/";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "the spectra are not here: " << folder;
  // Widely quoted RGB values of gold, from the same measurements and observer.
  expect_near(spectrum_to_rgb(read_spd(folder + "Au.eta.spd", {}), Dialect::v2),
              {0.1431f, 0.3750f, 1.4425f}, 2e-3f);
  expect_near(spectrum_to_rgb(read_spd(folder + "Au.k.spd", {}), Dialect::v2),
              {3.9832f, 2.3857f, 1.6032f}, 2e-3f);
}

TEST(Spectrum, BlackbodiesGoFromRedToBlue) {
  for (const Dialect d : {Dialect::v2, Dialect::v3}) {
    const Rgb warm = blackbody_to_rgb(2700, d), white = blackbody_to_rgb(6500, d),
              hot = blackbody_to_rgb(20000, d);
    EXPECT_GT(warm.x, 2 * warm.z);
    EXPECT_GT(hot.z, hot.x);
    EXPECT_NEAR(white.x / white.y, 1, 0.1);
    EXPECT_EQ(blackbody_to_rgb(0, d), Rgb(0));
    for (const double kelvin : {1e-30, 1.0, 30.0, 1e12, 1e300})
      EXPECT_TRUE(is_finite(blackbody_to_rgb(kelvin, d)));
  }
  // v2 is 1 at 555 nm, so its luminance is near 1; v3 is 1 at the maximum.
  EXPECT_NEAR(luminance(blackbody_to_rgb(6500, Dialect::v2)), 1.f, 0.05f);
  EXPECT_LT(luminance(blackbody_to_rgb(2700, Dialect::v3)), 0.6f);
}

TEST(Spectrum, IsReadInEverySpelling) {
  const TemporaryFolder folder;
  folder.write("grey.spd", "# a comment\n400 0.5\r\n 700 0.5 # more\n");
  const std::string path =
      folder.write("a.pbrt",
                   "WorldBegin Shape \"sphere\" \"spectrum a\" [400 .5 700 .5] \"spectrum b\" "
                   "\"grey.spd\" \"spectrum c\" [\"grey.spd\"] \"xyz d\" [1 1 1] \"blackbody e\" "
                   "[6500 2] WorldEnd");
  SceneCollector sink;
  Warnings warnings;
  parse_scene(path, {}, sink, warnings);
  const ParamSet& p = sink.shapes.at(0).params;
  const Rgb grey = spectrum_to_rgb({{400, 700}, {.5, .5}}, Dialect::v2);
  EXPECT_EQ(p.rgb("a", {}), grey);
  EXPECT_EQ(p.rgb("b", {}), grey);
  EXPECT_EQ(p.rgb("c", {}), grey);
  EXPECT_EQ(p.rgb("d", {}), xyz_to_rgb(1, 1, 1));
  EXPECT_EQ(p.rgb("e", {}), 2.f * blackbody_to_rgb(6500, Dialect::v2));
}

}  // namespace
}  // namespace cloudrenderer
