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

}  // namespace
}  // namespace cloudrenderer
