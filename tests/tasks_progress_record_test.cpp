#include <gtest/gtest.h>

#include "tasks/progress_record.h"

namespace cloudrenderer {
namespace {

TEST(ProgressRecord, KnowsHowLongTheLastPathsTook) {
  ProgressRecord r;
  EXPECT_EQ(r.tail(0, 0, 0.1), 0) << "nothing was done";
  r.add(11, 50);
  r.add(12, 89);
  r.add(13, 90);
  r.add(18, 99);
  r.add(20, 100);
  EXPECT_DOUBLE_EQ(r.tail(10, 0, 0.1), 0.7) << "from 13 to 20 of 10 to 20";
  EXPECT_DOUBLE_EQ(r.tail(10, 0, 0.01), 0.2);
  EXPECT_DOUBLE_EQ(r.tail(10, 90, 0.1), 0.2) << "of what an earlier run had done nothing counts";
  EXPECT_EQ(r.tail(10, 100, 0.1), 0);
}

TEST(ProgressRecord, OfThingsAtOneTimeTheLastCounts) {
  ProgressRecord r;
  r.add(1, 10);
  r.add(1, 95);
  r.add(2, 100);
  EXPECT_DOUBLE_EQ(r.tail(0, 0, 0.1), 0.5);
  EXPECT_EQ(r.size(), 2u);
}

TEST(ProgressRecord, StaysSmallHoweverLongTheJob) {
  ProgressRecord r;
  for (std::uint64_t i = 1; i <= 1'000'000; ++i) r.add(static_cast<double>(i), 512 * i);
  EXPECT_LE(r.size(), 8192u);
  EXPECT_NEAR(r.tail(0, 0, 0.1), 0.1, 0.001);
}

}  // namespace
}  // namespace cloudrenderer
