#include "film/features.h"
#include "film/film.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <numeric>
#include <random>

#include "film_support.h"
#include "scene/spectrum.h"

namespace cloudrenderer {
namespace {

using test::entity;
using test::integer;
using test::reals;
using test::string;

Fixed3 fixed(const Rgb& c, int k = 20) {
  bool clamped = false;
  return quantise(c, fixed_units(k), clamped);
}

TEST(Quantise, RoundsToNearestAndTiesToEven) {
  EXPECT_EQ(fixed({0.5f, 1.5f, 2.5f}, 0), (Fixed3{0, 2, 2}));
  EXPECT_EQ(fixed({-0.5f, -1.5f, 2.75f}, 0), (Fixed3{0, -2, 3}));
  EXPECT_EQ(fixed({1.f, 0.25f, -3.f}, 3), (Fixed3{8, 2, -24}));
  EXPECT_EQ(fixed({1024.f, 0, 0}, -10), (Fixed3{1, 0, 0}));
}

TEST(Quantise, ClampsAndSaysSo) {
  bool clamped = false;
  EXPECT_EQ(quantise({1.f, 2.f, 3.f}, fixed_units(20), clamped)[0], 1 << 20);
  EXPECT_FALSE(clamped);
  const Fixed3 v = quantise({1e30f, -1e30f, 1.f}, fixed_units(20), clamped);
  EXPECT_TRUE(clamped);
  EXPECT_EQ(v, (Fixed3{std::int64_t{1} << 62, -(std::int64_t{1} << 62), 1 << 20}));
  quantise(Rgb(0.f), fixed_units(20), clamped);
  EXPECT_TRUE(clamped) << "a later sample does not take the mark away";
}

TEST(PixelSums, DoNotDependOnTheOrderOfSamples) {
  std::mt19937 random(1);
  std::lognormal_distribution<float> value(0.f, 4.f);
  std::vector<std::pair<Fixed3, std::uint32_t>> samples;
  for (std::uint32_t s = 0; s < 500; ++s)
    samples.emplace_back(fixed({value(random), value(random), -value(random)}), s);
  PixelSums in_order;
  for (const auto& [v, s] : samples) in_order.add(v, s);
  for (int round = 0; round < 10; ++round) {
    std::shuffle(samples.begin(), samples.end(), random);
    PixelSums a, b;
    for (std::size_t i = 0; i < samples.size(); ++i)
      (i < 123 ? a : b).add(samples[i].first, samples[i].second);
    b.merge(a);
    EXPECT_EQ(b.sum, in_order.sum);
    EXPECT_EQ(b.count, in_order.count);
  }
}

TEST(PixelSums, HoldMoreThan64Bits) {
  PixelSums s;
  const std::int64_t big = std::int64_t{1} << 62;
  for (std::uint32_t i = 0; i < 16; ++i) s.add({big, -big, 1}, i);
  Film film({1, 1, 0, 0, 1, 1}, 0);
  film.at(0, 0) = s;
  const Image image = film.image(1.f);
  EXPECT_EQ(image.pixels[0], Rgb(0x1p62f, -0x1p62f, 1.f));
}

TEST(Film, ImageIsTheScaledMean) {
  Film film({10, 8, 2, 3, 5, 5}, 20);
  film.at(2, 3).add(fixed({1, 2, 4}), 0);
  film.at(2, 3).add(fixed({3, 2, 0}), 1);
  film.at(4, 4).add(fixed({5, 5, 5}), 7);
  const Image image = film.image(2.f);
  ASSERT_EQ(image.width, 3u);
  ASSERT_EQ(image.height, 2u);
  EXPECT_EQ(image.pixels[0], Rgb(4, 4, 4));
  EXPECT_EQ(image.pixels[1], Rgb(0, 0, 0));
  EXPECT_EQ(image.pixels[5], Rgb(10, 10, 10));
}

TEST(Film, NegativeLobesAreWeighedByTheirIntegralNotByTheirSamples) {
  const FilterLobes lobes{1.25, 0.25};
  Film film({2, 1, 0, 0, 2, 1}, 20, lobes);
  ASSERT_EQ(film.sums().size(), 4u);
  for (std::uint32_t s = 0; s < 5; ++s) film.at(0, 0).add(fixed({2, 3, 1}), s);
  film.at(0, 0, true).add(fixed({2, 5, 9}), 5);
  film.at(1, 0, true).add(fixed({4, 4, 4}), 0);  // nothing of the other kind
  const Image image = film.image(1.f);
  EXPECT_EQ(image.pixels[0], Rgb(2, 2.5f, -1)) << "1.25 a - 0.25 b";
  EXPECT_EQ(image.pixels[1], Rgb(4, 4, 4));
  EXPECT_EQ(film.samples(0), 6u);
  EXPECT_EQ(film.samples(0, 1), 3u);
  EXPECT_EQ(film.mean(0, 1, fixed_units(-20), 0), 3) << "the even half has no sample in the negative lobes";
  EXPECT_EQ(film.mean(0, 1, fixed_units(-20), 1), 2.5);
  EXPECT_EQ(std::get<std::vector<float>>(samples_layer(film).values), (std::vector<float>{6, 1}));
}

TEST(Film, IsDevelopedWithoutNegativePixelsBeforePbrtV4) {
  Film film({2, 1, 0, 0, 2, 1}, 20, {1.25, 0.25});
  film.at(0, 0).add(fixed({2, 3, 1}), 0);
  film.at(0, 0, true).add(fixed({2, 5, 9}), 1);
  FilmOptions options;
  options.scale = 2;
  EXPECT_EQ(developed(film, options).pixels[0], Rgb(4, 5, 0));
  options.keeps_negative = true;
  EXPECT_EQ(developed(film, options).pixels[0], Rgb(4, 5, -2));
}

TEST(Film, LimitsTheLargestOfXyz) {
  FilmOptions options;
  options.scale = 0.5f;
  options.max_component = 1.5f;
  EXPECT_FALSE(limits_samples(FilmOptions()));
  EXPECT_TRUE(limits_samples(options));
  EXPECT_EQ(sample_limit(options, {2, 2, 2}), 1.f);
  EXPECT_NEAR(sample_limit(options, xyz_to_rgb(2, 3, 8)), 1.5 / 4, 3e-4);
  EXPECT_NEAR(sample_limit(options, xyz_to_rgb(2, 6, 3)), 1.5 / 3, 3e-4);
  EXPECT_NEAR(sample_limit(options, -xyz_to_rgb(2, 6, 3)), 1.5 / 3, 3e-4);
  options = {};
  options.max_sample_luminance = 2;
  EXPECT_EQ(sample_limit(options, {2, 2, 2}), 1.f);
  EXPECT_FLOAT_EQ(sample_limit(options, {8, 8, 8}), 0.25f);
  options.max_sample_luminance = 0;
  EXPECT_EQ(sample_limit(options, {1, 1, 1}), 0.f);
  EXPECT_EQ(sample_limit(options, {0, 0, 0}), 1.f);
  Warnings warnings;
  EXPECT_FALSE(limits_samples(film_options(entity("image", {reals("maxsampleluminance", {-1})}), Dialect::v3, warnings)));
  EXPECT_EQ(warnings.list().size(), 1u);
}

// However samples fall among the lobes: radiance that is the same everywhere is the pixel's.
TEST(Film, NegativeLobesLeaveConstantPicturesAsTheyAre) {
  std::mt19937 random(5);
  Film film({16, 16, 0, 0, 16, 16}, 20, {1.6, 0.6});
  for (std::uint32_t y = 0; y < 16; ++y)
    for (std::uint32_t x = 0; x < 16; ++x)
      for (std::uint32_t s = 0; s < 1 + (x + y) % 9; ++s) film.at(x, y, random() % 3 == 0).add(fixed({1, 2, 3}), s);
  for (const Rgb& c : film.image(1.f).pixels)
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(c[i], static_cast<float>(i + 1), 1e-6f);
  EXPECT_NEAR(film.estimated_relmse(1.f), 0, 1e-12);
}

TEST(Film, HalvesEstimateTheError) {
  Film one({2, 1, 0, 0, 2, 1}, 24);
  EXPECT_EQ(one.estimated_relmse(1), 0);
  one.at(0, 0).add(fixed({1, 1, 1}, 24), 0);
  EXPECT_EQ(one.estimated_relmse(1), 0) << "one half tells nothing";
  one.at(0, 0).add(fixed({3, 1, 1}, 24), 1);
  EXPECT_NEAR(one.estimated_relmse(1), (4. / 4 / (4 + 0.01)) / 3, 1e-9);

  // Against the true variance of the mean: n samples of variance v have v/n.
  constexpr std::uint32_t kSide = 64, kSamples = 32;
  Film film({kSide, kSide, 0, 0, kSide, kSide}, 24);
  std::mt19937 random(7);
  std::uniform_real_distribution<float> value(0.f, 2.f);
  for (std::uint32_t y = 0; y < kSide; ++y)
    for (std::uint32_t x = 0; x < kSide; ++x)
      for (std::uint32_t s = 0; s < kSamples; ++s)
        film.at(x, y).add(fixed({value(random), value(random), value(random)}, 24), s);
  const double expected = (4. / 12 / kSamples) / 1.01;
  EXPECT_NEAR(film.estimated_relmse(1) / expected, 1, 0.05);
}

TEST(Film, AFireflyIsAnErrorAgainstItsNeighboursAndTheEdgeOfALightIsNot) {
  const auto film_with = [](float even, float odd, float beside) {
    Film film({32, 32, 0, 0, 32, 32}, 24);
    for (std::uint32_t y = 0; y < 32; ++y)
      for (std::uint32_t x = 0; x < 32; ++x)
        for (std::uint32_t s = 0; s < 2; ++s) film.at(x, y).add(fixed({1, 1, 1}, 24), s);
    film.at(8, 8) = {};
    film.at(8, 8).add(fixed({even, even, even}, 24), 0);
    film.at(8, 8).add(fixed({odd, odd, odd}, 24), 1);
    film.at(9, 8) = {};
    for (std::uint32_t s = 0; s < 2; ++s) film.at(9, 8).add(fixed({beside, beside, beside}, 24), s);
    return film.estimated_error(1);
  };
  const auto firefly = film_with(100, 1, 1);
  EXPECT_NEAR(firefly.relmse, 99. * 99 / 4 / 1.01 / 1024, 1e-3);
  EXPECT_EQ(firefly.trimmed, 0) << "the worst 0.1 % are left out";
  EXPECT_LT(film_with(100, 1, 5000).relmse, firefly.relmse / 1000) << "beside a light";
  EXPECT_NEAR(film_with(100, 90, 1).relmse, 100. / 4 / (90 * 90 + 0.01) / 1024, 1e-6) << "both halves see it";
}

// Noise of three kinds around a picture with edges, many times: how often the interval holds the error that was made.
TEST(Film, TheIntervalHoldsTheTrueError) {
  constexpr std::uint32_t kSide = 40, kSamples = 8;
  constexpr int kRuns = 100;
  constexpr unsigned kSeed = 20240517;
  std::mt19937 random(kSeed);
  const auto uniform = [&] { return std::uniform_real_distribution<float>(0.f, 2.f)(random); };
  const auto exponential = [&] { return std::exponential_distribution<float>(1.f)(random); };
  const auto rare = [&] { return std::bernoulli_distribution(0.02)(random) ? 50.f : 0.f; };  // all have the mean 1
  const std::array<std::function<float()>, 3> noises{uniform, exponential, rare};
  for (std::size_t kind = 0; kind < noises.size(); ++kind) {
    int held = 0;
    for (int run = 0; run < kRuns; ++run) {
      Film film({kSide, kSide, 0, 0, kSide, kSide}, 24);
      double error = 0;
      for (std::uint32_t y = 0; y < kSide; ++y) {
        for (std::uint32_t x = 0; x < kSide; ++x) {
          const float level = x < kSide / 2 ? 0.2f : 2.f;
          float sum = 0;
          for (std::uint32_t s = 0; s < kSamples; ++s) {
            const float v = level * (0.9f + 0.1f * noises[kind]());
            film.at(x, y).add(fixed(Rgb(v), 24), s);
            sum += v;
          }
          const double off = static_cast<double>(sum / kSamples - level);
          error += off * off / static_cast<double>(level * level + 0.01f) / (kSide * kSide);
        }
      }
      const Film::ErrorEstimate e = film.estimated_error(1);
      ASSERT_TRUE(e.low <= e.relmse && e.relmse <= e.high);
      held += e.low <= error && error <= e.high;
      ASSERT_LT(e.high - e.low, 2 * error) << "nor does it hold everything";
    }
    EXPECT_GE(held, 90) << "noise " << kind << ", seed " << kSeed;
  }
}

TEST(FilmOptions, CropsAsPbrtDoes) {
  Warnings warnings;
  const Entity film = entity("image", {integer("xresolution", 700), integer("yresolution", 500),
                                       reals("cropwindow", {.34f, .49f, .67f, .8f})});
  const FilmFrame f = film_options(film, Dialect::v2, warnings).frame;
  EXPECT_EQ(f, (FilmFrame{700, 500, 238, 335, 343, 400}));
  EXPECT_EQ(f.pixels(), 105u * 65u);
  EXPECT_TRUE(warnings.list().empty());
}

TEST(FilmOptions, NeighbouringCropsMeetWithoutOverlap) {
  Warnings warnings;
  std::uint32_t end = 0;
  for (int i = 0; i < 7; ++i) {
    const float a = static_cast<float>(i) / 7.f, b = static_cast<float>(i + 1) / 7.f;
    const FilmFrame f =
        film_options(entity("image", {integer("xresolution", 100), integer("yresolution", 10),
                                      reals("cropwindow", {a, b, 0, 1})}),
                     Dialect::v3, warnings)
            .frame;
    EXPECT_EQ(f.x0, end);
    end = f.x1;
  }
  EXPECT_EQ(end, 100u);
}

TEST(FilmOptions, EmptyCropsKeepOnePixel) {
  Warnings warnings;
  const FilmFrame f =
      film_options(entity("image", {integer("xresolution", 10), integer("yresolution", 10),
                                    reals("cropwindow", {1, 1, 0.5f, 0.5f})}),
                   Dialect::v2, warnings)
          .frame;
  EXPECT_EQ(f, (FilmFrame{10, 10, 9, 5, 10, 6}));
}

TEST(FilmOptions, HaveTheDefaultsOfTheirDialect) {
  Warnings warnings;
  const FilmOptions v2 = film_options(entity("image", {}), Dialect::v2, warnings);
  EXPECT_EQ(v2.frame, (FilmFrame{640, 480, 0, 0, 640, 480}));
  EXPECT_EQ(v2.filename, "pbrt.exr");
  const FilmOptions v3 = film_options(entity("image", {reals("scale", {6}), reals("diagonal", {35}),
                                                       reals("maxsampleluminance", {10})}),
                                      Dialect::v3, warnings);
  EXPECT_EQ(v3.frame, (FilmFrame{1280, 720, 0, 0, 1280, 720}));
  EXPECT_EQ(v3.scale, 6.f);
  EXPECT_EQ(v3.max_sample_luminance, 10.f);
  EXPECT_TRUE(warnings.list().empty());
}

TEST(FilmOptions, RefusesImpossibleSizes) {
  Warnings warnings;
  EXPECT_THROW(film_options(entity("image", {integer("xresolution", 0)}), Dialect::v2, warnings),
               SceneError);
  EXPECT_THROW(film_options(entity("image", {integer("yresolution", -3)}), Dialect::v2, warnings),
               SceneError);
  EXPECT_EQ(warnings.list().size(), 0u);
  EXPECT_EQ(film_options(entity("image", {reals("cropwindow", {0, 1})}), Dialect::v2, warnings).frame.pixels(), 640u * 480);
  EXPECT_EQ(warnings.list().size(), 1u);
}

TEST(FilmOptions, NamesAFileThatCanBeWritten) {
  Warnings warnings;
  EXPECT_EQ(film_options(entity("image", {string("filename", "a/b.jpg")}), Dialect::v2, warnings)
                .filename,
            "a/b.exr");
  EXPECT_EQ(warnings.list().size(), 1u);
  EXPECT_EQ(film_options(entity("image", {string("filename", "a/b.tga")}), Dialect::v2, warnings)
                .filename,
            "a/b.tga");
  EXPECT_EQ(warnings.list().size(), 1u);
}

TEST(Features, AreMeansOverAllSamplesOrOverThoseThatSeeSomething) {
  constexpr int kLength = 20;
  PixelFeatures a, b, nothing;
  a.samples = 2;
  a.hits = 1;
  a.ids = {4, 5, 6};
  a.sum[kAlbedo + 1] = Int128{1} << kFeatureK;
  a.sum[kNormal + 2] = -(Int128{1} << kFeatureK);
  a.sum[kDepth] = Int128{6} << kLength;
  b.samples = 2;
  b.hits = 2;
  b.sum[kDepth] = Int128{3} << kLength;
  b.sum[kPosition] = Int128{12} << kLength;
  nothing.samples = 3;
  PixelFeatures other = b;
  other.merge(a);
  a.merge(b);
  EXPECT_EQ(a, other);
  const std::vector<PixelFeatures> pixels{a, nothing};
  const auto floats = [&](FeatureLayer layer, std::size_t channel) {
    return std::get<std::vector<float>>(feature_channels(pixels, layer, kLength)[channel].values);
  };
  EXPECT_EQ(floats(FeatureLayer::albedo, 1), (std::vector<float>{0.25f, 0.f}));
  EXPECT_EQ(floats(FeatureLayer::normal, 2), (std::vector<float>{-0.25f, 0.f}));
  EXPECT_EQ(floats(FeatureLayer::depth, 0), (std::vector<float>{3.f, 1e10f}));
  EXPECT_EQ(floats(FeatureLayer::position, 0), (std::vector<float>{4.f, 0.f}));
  const auto ids = feature_channels(pixels, FeatureLayer::ids, kLength);
  EXPECT_EQ(ids[2].name, "id.material");
  EXPECT_EQ(std::get<std::vector<std::uint32_t>>(ids[2].values), (std::vector<std::uint32_t>{6, 0}));
}

TEST(Features, HaveUnitsThatFollowTheSizeOfTheScene) {
  Bounds3 box;
  EXPECT_EQ(feature_length_k(box), 31);  // as one unit wide
  box.extend(Vec3(0.f));
  box.extend(Vec3(3.f, 0.f, 0.f));
  EXPECT_EQ(feature_length_k(box), 30);  // 2^-32 of 4
  box.extend(Vec3(3e9f, 0.f, 0.f));
  EXPECT_EQ(feature_length_k(box), 0);
  EXPECT_GT(feature_length_k({Vec3(0.f), Vec3(1e-6f)}), 45);
}

}  // namespace
}  // namespace cloudrenderer
