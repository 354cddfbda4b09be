#include "film/sample_plan.h"

#include <gtest/gtest.h>

#include <numeric>
#include <random>

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kSide = 64, kTile = 8, kTiles = 64, kMost = 1u << 16;

// Uniform noise of this size around 1, in the left and in the right half of the picture.
Film film(double left, double right, std::uint32_t samples) {
  Film out({kSide, kSide, 0, 0, kSide, kSide}, 24);
  std::mt19937 random(11);
  std::uniform_real_distribution<double> value(-1, 1);
  for (std::uint32_t y = 0; y < kSide; ++y) {
    for (std::uint32_t x = 0; x < kSide; ++x) {
      for (std::uint32_t s = 0; s < samples; ++s) {
        bool clamped = false;
        const auto v = static_cast<float>(1 + (x < kSide / 2 ? left : right) * value(random));
        out.at(x, y).add(quantise(Rgb(v), fixed_units(24), clamped), s);
      }
    }
  }
  return out;
}

SamplePlan plan(const Film& f, const std::vector<std::uint32_t>& samples, std::optional<double> error, std::uint32_t most = kMost) {
  return plan_samples(f, 1, f.estimated_error(1), kTile, samples, error, most);
}

double paths(const std::vector<std::uint32_t>& samples) {
  return kTile * kTile * std::accumulate(samples.begin(), samples.end(), 0.0);
}

TEST(SamplePlan, SamplesGoWhereTheErrorIs) {
  const std::vector<std::uint32_t> had(kTiles, 16);
  const SamplePlan p = plan(film(0.02, 0.8, 16), had, 1e-5);
  ASSERT_EQ(p.goals.size(), kTiles);
  EXPECT_EQ(p.goals[8 * 4 + 1], 16u) << "the quiet half waits";
  EXPECT_GT(p.goals[8 * 4 + 6], 24u);
  EXPECT_GT(p.expected_paths, paths(p.goals)) << "it takes more than this round";
  for (std::size_t i = 0; i < kTiles; ++i) {
    EXPECT_GE(p.goals[i], had[i]);
    EXPECT_LE(p.goals[i], 2 * had[i]);
    EXPECT_EQ(p.goals[i] % 2, 0u) << "both halves get the same";
  }
}

TEST(SamplePlan, EvenNoiseGetsEvenSamples) {
  const SamplePlan p = plan(film(0.5, 0.5, 16), std::vector<std::uint32_t>(kTiles, 16), std::nullopt);
  EXPECT_EQ(p.expected_paths, 0u) << "without an error to reach there is no end";
  EXPECT_GE(paths(p.goals), 1.4 * paths(std::vector<std::uint32_t>(kTiles, 16)));
  EXPECT_LE(paths(p.goals), 2 * paths(std::vector<std::uint32_t>(kTiles, 16)));
}

TEST(SamplePlan, ATilesOwnSamplesDoNotDecideHowManyItGets) {
  Film f = film(0.5, 0.5, 16);
  const std::vector<std::uint32_t> had(kTiles, 16);
  const SamplePlan before = plan(f, had, std::nullopt);
  bool clamped = false;
  f.at(20, 20).add(quantise(Rgb(1000.f), fixed_units(24), clamped), 16);  // a firefly in tile (2, 2)
  const SamplePlan after = plan(f, had, std::nullopt);
  EXPECT_LE(after.goals[2 * 8 + 2], before.goals[2 * 8 + 2]);
  EXPECT_GE(after.goals[2 * 8 + 3], before.goals[2 * 8 + 3]) << "its neighbours look closer";
}

TEST(SamplePlan, ExpectsWhatItTakes) {
  // Uniform noise of size a has the variance a^2/3: 0.25 / 3 / n relative to 1.01.
  const SamplePlan p = plan(film(0.5, 0.5, 64), std::vector<std::uint32_t>(kTiles, 64), 0.0005);
  const double needed = 0.25 / 3 / 1.01 / 0.0005 * kSide * kSide;
  EXPECT_NEAR(static_cast<double>(p.expected_paths) / needed, 1.1, 0.12) << "a little more, for the upper end of the interval";
}

TEST(SamplePlan, NoPixelGetsMoreThanItMay) {
  const SamplePlan p = plan(film(0.02, 0.8, 16), std::vector<std::uint32_t>(kTiles, 16), 1e-6, 20);
  for (const std::uint32_t g : p.goals) EXPECT_LE(g, 20u);
  const SamplePlan at_end = plan(film(0.02, 0.8, 16), std::vector<std::uint32_t>(kTiles, 16), 1e-6, 16);
  EXPECT_EQ(at_end.goals, std::vector<std::uint32_t>(kTiles, 16));
}

TEST(SamplePlan, ABlackFilmIsNoReasonToStop) {
  Film f({kSide, kSide, 0, 0, kSide, kSide}, 24);
  for (PixelSums& s : f.sums()) s.count = {8, 8};
  const SamplePlan p = plan(f, std::vector<std::uint32_t>(kTiles, 16), std::nullopt);
  for (const std::uint32_t g : p.goals) EXPECT_GT(g, 16u);
}

}  // namespace
}  // namespace cloudrenderer
