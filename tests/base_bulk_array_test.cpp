#include <gtest/gtest.h>

#include "base/bulk_array.h"

namespace cloudrenderer {
namespace {

TEST(BulkArray, SmallAndSpilledArraysReadBackTheSame) {
  for (const std::size_t n : {std::size_t{0}, std::size_t{10}, std::size_t{6'000'000}}) {
    BulkWriter<std::uint32_t> writer;
    for (std::size_t i = 0; i < n; ++i) writer.push_back(static_cast<std::uint32_t>(i * 7));
    ASSERT_EQ(writer.size(), n);
    const BulkArray<std::uint32_t> array = writer.finish();
    ASSERT_EQ(array.size(), n);
    for (std::size_t i = 0; i < n; ++i) ASSERT_EQ(array[i], i * 7);
    EXPECT_EQ(writer.size(), 0u);
  }
}

}  // namespace
}  // namespace cloudrenderer
