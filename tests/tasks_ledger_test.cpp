#include <gtest/gtest.h>

#include "tasks/work.h"

namespace cloudrenderer {
namespace {

using Outcome = RendererLedger::Outcome;
const RendererRange kRange{3, 10, 20, 14, 22, 4, 8};
constexpr std::uint32_t kWidth = 100;

PathEnd end_of(std::uint32_t x, std::uint32_t y, std::uint32_t sample, std::int64_t value,
               std::uint16_t flags = 0) {
  return {3, y * kWidth + x, sample, 1, flags, {value, 0, -value}};
}

TEST(Ledger, CountsASampleOnce) {
  RendererLedger l(kRange, kWidth);
  EXPECT_EQ(l.remaining(), 32u);
  EXPECT_EQ(l.record(end_of(10, 20, 4, 5)), Outcome::counted);
  EXPECT_EQ(l.record(end_of(10, 20, 4, 5)), Outcome::duplicate);
  EXPECT_EQ(l.record(end_of(10, 20, 5, 7)), Outcome::counted);
  EXPECT_EQ(l.remaining(), 30u);
  const auto r = std::move(l).reply();
  ASSERT_EQ(r.sums.size(), 8u);
  EXPECT_EQ(r.sums[0].count, (std::array<std::uint32_t, 2>{1, 1}));
  EXPECT_TRUE(r.sums[0].sum[0][0] == 5);
  EXPECT_TRUE(r.sums[0].sum[1][2] == -7);
}

TEST(Ledger, RefusesWhatIsOutsideOfItsRange) {
  RendererLedger l(kRange, kWidth);
  EXPECT_EQ(l.record(end_of(9, 20, 4, 5)), Outcome::foreign);
  EXPECT_EQ(l.record(end_of(14, 20, 4, 5)), Outcome::foreign);
  EXPECT_EQ(l.record(end_of(10, 22, 4, 5)), Outcome::foreign);
  EXPECT_EQ(l.record(end_of(10, 20, 8, 5)), Outcome::foreign);
  PathEnd other = end_of(10, 20, 4, 5);
  other.task = 4;
  EXPECT_EQ(l.record(other), Outcome::foreign);
  EXPECT_EQ(l.remaining(), 32u);
}

TEST(Ledger, DropsInvalidSamplesAndCountsThem) {
  RendererLedger l(kRange, kWidth);
  EXPECT_EQ(l.record(end_of(13, 21, 7, 5, kEndInvalid)), Outcome::counted);
  EXPECT_EQ(l.record(end_of(13, 21, 6, 5, kEndClamped)), Outcome::counted);
  const auto r = std::move(l).reply();
  EXPECT_EQ(r.invalid, 1u);
  EXPECT_EQ(r.clamped, 1u);
  EXPECT_EQ(r.sums[7].count, (std::array<std::uint32_t, 2>{1, 0}));
}

TEST(Ledger, SumsNegativeLobesApart) {
  RendererLedger l(kRange, kWidth, false, true);
  EXPECT_EQ(l.record(end_of(11, 20, 4, 5)), Outcome::counted);
  EXPECT_EQ(l.record(end_of(11, 20, 6, 7), true), Outcome::counted);
  EXPECT_EQ(l.record(end_of(11, 20, 6, 7), true), Outcome::duplicate);
  EXPECT_EQ(l.remaining(), 30u);
  const auto r = std::move(l).reply();
  ASSERT_EQ(r.sums.size(), 16u);
  EXPECT_TRUE(r.sums[2].sum[0][0] == 5 && r.sums[3].sum[0][0] == 7);
  EXPECT_EQ(r.sums[2].count, (std::array<std::uint32_t, 2>{1, 0}));
  EXPECT_EQ(r.sums[3].count, (std::array<std::uint32_t, 2>{1, 0}));
}

TEST(Ledger, NamesMissingPathsAsTheCameraNumbersThem) {
  RendererLedger l(kRange, kWidth);
  for (std::uint32_t s = 4; s < 8; ++s) (void)l.record(end_of(10, 20, s, 1));
  (void)l.record(end_of(11, 20, 5, 1));
  const auto runs = l.missing();
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].first, 4u);
  EXPECT_EQ(runs[0].count, 1u);
  EXPECT_EQ(runs[1].first, 6u);
  EXPECT_EQ(runs[1].count, 26u);
}

PathFeatures told(std::uint32_t x, std::uint32_t sample, std::int64_t value, std::uint16_t flags) {
  PathFeatures f{3, 20 * kWidth + x, sample, 1, flags, {}, {}};
  f.values.fill(value);
  if (flags & kTellsHit) f.ids = {7, 8, 9};
  return f;
}

TEST(Ledger, WaitsForWhatAPathHasSeenInAnyOrderAndCountsItOnce) {
  const RendererRange range{3, 10, 20, 14, 21, 0, 2};
  RendererLedger l(range, kWidth, true);
  const auto end = [](std::uint32_t x, std::uint32_t sample, std::uint16_t flags) { return PathEnd{3, 20 * kWidth + x, sample, 1, flags, {1, 1, 1}}; };
  EXPECT_EQ(l.record(end(10, 0, 0)), Outcome::counted);
  EXPECT_EQ(l.record(told(10, 0, 5, kTellsSurface)), Outcome::counted);
  EXPECT_EQ(l.remaining(), 8u);
  EXPECT_EQ(l.missing()[0].first, 0u);  // made again, should the rest be lost
  EXPECT_EQ(l.record(told(10, 0, 5, kTellsSurface)), Outcome::duplicate);
  EXPECT_EQ(l.record(end(10, 0, 0)), Outcome::duplicate);
  EXPECT_EQ(l.record(told(10, 0, 3, kTellsHit)), Outcome::counted);
  EXPECT_EQ(l.remaining(), 7u);
  EXPECT_EQ(l.missing()[0].first, 1u);
  // One that saw nothing, and one that is not finite but saw something.
  EXPECT_EQ(l.record(end(11, 0, kEndWithoutHit | kEndWithoutSurface)), Outcome::counted);
  EXPECT_EQ(l.record(told(12, 1, 4, kTellsHit | kTellsSurface)), Outcome::counted);
  EXPECT_EQ(l.record(end(12, 1, kEndInvalid)), Outcome::counted);
  EXPECT_EQ(l.remaining(), 5u);
  EXPECT_EQ(l.record(told(12, 2, 4, kTellsHit)), Outcome::foreign);
  const auto r = std::move(l).reply();
  ASSERT_EQ(r.features.size(), 4u);
  EXPECT_TRUE(r.features[0].sum[kDepth] == 8);
  EXPECT_EQ(r.features[0].ids, (FeatureIds{7, 8, 9}));
  EXPECT_EQ(r.features[0].hits, 1u);
  EXPECT_EQ(r.features[1].samples, 1u);
  EXPECT_EQ(r.features[1].hits, 0u);
  EXPECT_EQ(r.features[2].samples, 1u);
  EXPECT_EQ(r.features[2].ids, FeatureIds{});  // not of sample 0
  EXPECT_EQ(r.sums[2].count, (std::array<std::uint32_t, 2>{0, 0}));
}

TEST(Ledger, SumsLightOfPathsFromLightsByPixel) {
  RendererLedger l(kRange, kWidth);
  const auto end = [](std::uint32_t sample, std::uint32_t target, std::int64_t light, std::uint16_t flags = 0) {
    return PathEnd{kRange.task, kRange.y0 * kWidth + kRange.x0, sample, 1, flags, {1, 1, 1}, target, {light, 2, -3}};
  };
  EXPECT_EQ(l.record(end(kRange.sample_begin, 9000, 5)), Outcome::counted);
  EXPECT_EQ(l.record(end(kRange.sample_begin, 9000, 5)), Outcome::duplicate);
  EXPECT_EQ(l.record(end(kRange.sample_begin + 1, 7, 6)), Outcome::counted);
  EXPECT_EQ(l.record(end(kRange.sample_begin + 2, 9000, 70)), Outcome::counted);
  EXPECT_EQ(l.record(end(kRange.sample_begin + 3, 8, 70, kEndInvalid)), Outcome::counted);
  const auto r = std::move(l).reply();
  ASSERT_EQ(r.splats.size(), 2u);
  EXPECT_EQ(r.splats[0].pixel, 7u);
  EXPECT_EQ(r.splats[1].pixel, 9000u);
  EXPECT_TRUE(r.splats[1].sum[kRange.sample_begin & 1][0] == 75);
  EXPECT_TRUE(r.splats[1].sum[kRange.sample_begin & 1][2] == -6);
  EXPECT_TRUE(r.splats[0].sum[(kRange.sample_begin + 1) & 1][0] == 6);
}

TEST(Ledger, TakesNoFeaturesInJobsWithoutThem) {
  RendererLedger l(kRange, kWidth);
  EXPECT_EQ(l.record(told(10, 4, 5, kTellsHit)), Outcome::foreign);
  EXPECT_TRUE(std::move(l).reply().features.empty());
}

}  // namespace
}  // namespace cloudrenderer
