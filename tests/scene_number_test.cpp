#include <gtest/gtest.h>

#include <bit>
#include <charconv>
#include <cstdint>
#include <random>
#include <string>
#include <string_view>

#include "scene/number.h"

namespace cloudrenderer {
namespace {

float parsed(std::string_view text) {
  const char* p = text.data();
  float v = -12345;
  EXPECT_TRUE(parse_float(p, text.data() + text.size(), v)) << text;
  EXPECT_EQ(p, text.data() + text.size()) << text;
  return v;
}

float reference(std::string_view text) {
  float v = 0;
  if (text.starts_with('+')) text.remove_prefix(1);
  std::from_chars(text.data(), text.data() + text.size(), v);
  return v;
}

TEST(Number, ReadsTheSpellingsOfRealFiles) {
  EXPECT_EQ(parsed("1e+006"), 1e6f);
  EXPECT_EQ(parsed(".5"), .5f);
  EXPECT_EQ(parsed("-2."), -2.f);
  EXPECT_EQ(parsed("+.25E-001"), .025f);
  EXPECT_EQ(parsed("0000012"), 12.f);
  EXPECT_TRUE(std::signbit(parsed("-0")));
}

TEST(Number, TooLargeIsInfiniteAndTooSmallIsZero) {
  EXPECT_EQ(parsed("1e39"), std::numeric_limits<float>::infinity());
  EXPECT_EQ(parsed("-1e400"), -std::numeric_limits<float>::infinity());
  EXPECT_EQ(parsed("1e-60"), 0.f);
  EXPECT_EQ(parsed("1e-4000000"), 0.f);
  EXPECT_EQ(parsed("1" + std::string(400, '0')), std::numeric_limits<float>::infinity());
  EXPECT_EQ(parsed("0." + std::string(400, '0') + "1"), 0.f);
  EXPECT_EQ(parsed("0." + std::string(50, '0') + "1e51"), 1.f);
}

TEST(Number, RejectsWhatIsNone) {
  for (const std::string_view text :
       {"", "-", "+", ".", "e5", "1e", "1e+", "-.e1", "+-1", "--1", "nan", "inf"}) {
    const char* p = text.data();
    float v;
    EXPECT_FALSE(parse_float(p, text.data() + text.size(), v)) << text;
  }
}

TEST(Number, NeverRoundsTwice) {
  // Decimals at and beside the middle of two floats, where a rounding to double first would go
  // wrong.
  for (const char* text :
       {"1.00000005960464477539", "1.000000059604644775390625", "1.0000000596046448", "16777217",
        "16777217.000000001", "8.589973e9", "9007199791611905e-9", "33554435", "1.1754943e-38"})
    EXPECT_EQ(parsed(text), reference(text)) << text;
}

TEST(Number, AgreesWithFromCharsOnRandomNumbers) {
  std::mt19937_64 random(1);
  const auto check = [](const std::string& text) {
    ASSERT_EQ(std::bit_cast<std::uint32_t>(parsed(text)),
              std::bit_cast<std::uint32_t>(reference(text)))
        << text;
  };
  for (int i = 0; i < 300000; ++i) {
    char buffer[80];
    const auto bits = static_cast<std::uint32_t>(random());
    const float f = std::bit_cast<float>(bits);
    if (std::isfinite(f)) {  // shortest, and the exact decimal of a middle between two floats
      check(std::string(buffer, std::to_chars(buffer, buffer + 80, f).ptr));
      const double middle =
          (static_cast<double>(f) + static_cast<double>(std::nextafter(f, 1e38f))) / 2;
      if (std::fabs(middle) > 1e-30)
        check(std::string(buffer, std::to_chars(buffer, buffer + 80, middle).ptr));
    }
    const double d = static_cast<double>(static_cast<std::int64_t>(random())) / 1e15;
    const int digits = static_cast<int>(random() % 18);
    check(std::string(buffer,
                      std::to_chars(buffer, buffer + 80, d, std::chars_format::fixed, digits).ptr));
    check(std::string(
        buffer, std::to_chars(buffer, buffer + 80, d, std::chars_format::scientific, digits).ptr));
  }
}

}  // namespace
}  // namespace cloudrenderer
