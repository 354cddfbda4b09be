// The lanes' operations, those of this processor and those for any, against the formula of one number: the bits are equal.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "base/random.h"

namespace cloudrenderer {
namespace {

namespace processor = lanes::processor;
constexpr int kRounds = 20'000;

// Which NaN it is does not count.
std::uint32_t seen(float x) { return x != x ? 0x7fc00000u : std::bit_cast<std::uint32_t>(x); }

// Numbers of usual size, odd ones, and any bits at all.
struct Numbers {
  std::mt19937 random{7};
  std::uint32_t bits() { return static_cast<std::uint32_t>(random()); }
  float number() {
    constexpr float kInf = std::numeric_limits<float>::infinity();
    constexpr std::array<float, 12> kOdd = {0.f, -0.f, 1.f, -1.f, 0.5f, 1.5f, 2.5f, -0.5f, kInf, -kInf, 0x1p-149f, 0x1.fffffep127f};
    if (const std::uint32_t kind = bits() % 4; kind == 0) return kOdd[bits() % kOdd.size()];
    else if (kind == 1) return std::bit_cast<float>(bits());
    return std::ldexp(static_cast<float>(static_cast<std::int32_t>(bits())), static_cast<int>(bits() % 40) - 40);
  }
  Floats8 eight() {
    Floats8 v{};
    for (int i = 0; i < 8; ++i) v[i] = number();
    return v;
  }
  Ints8 mask() {
    const std::uint32_t chosen = bits();
    Ints8 v{};
    for (int i = 0; i < 8; ++i) v[i] = -static_cast<std::int32_t>(chosen >> i & 1);
    return v;
  }
};

template <class One>
void expect_lanes(Floats8 v, One one, const char* what) {
  for (int i = 0; i < 8; ++i) ASSERT_EQ(seen(v[i]), seen(one(i))) << what << ", lane " << i << ": " << v[i] << " " << one(i);
}

TEST(Lanes, ArithmeticIsThatOfOneNumber) {
  Numbers numbers;
  for (int n = 0; n < kRounds; ++n) {
    const Floats8 a = numbers.eight(), b = numbers.eight(), c = numbers.eight();
    const auto min = [&](int i) { return std::min(a[i], b[i]); };
    expect_lanes(plain::min(a, b), min, "plain min");
    expect_lanes(processor::min(a, b), min, "min");
    const auto max = [&](int i) { return std::max(a[i], b[i]); };
    expect_lanes(plain::max(a, b), max, "plain max");
    expect_lanes(processor::max(a, b), max, "max");
    const auto root = [&](int i) { return std::sqrt(a[i]); };
    expect_lanes(plain::sqrt(a), root, "plain sqrt");
    expect_lanes(processor::sqrt(a), root, "sqrt");
    const auto fma = [&](int i) { return std::fma(a[i], b[i], c[i]); };
    expect_lanes(plain::fma(a, b, c), fma, "plain fma");
    expect_lanes(processor::fma(a, b, c), fma, "fma");
    const auto whole = [&](int i) { return std::nearbyint(a[i]); };
    expect_lanes(plain::nearbyint(a), whole, "plain nearbyint");
    expect_lanes(processor::nearbyint(a), whole, "nearbyint");
    expect_lanes(copysign(Float8::of(a), Float8::of(b)).v, [&](int i) { return std::copysign(a[i], b[i]); }, "copysign");
    expect_lanes(lanes::abs(Float8::of(a)).v, [&](int i) { return std::fabs(a[i]); }, "abs");
    if (HasFatalFailure()) return;
  }
}

TEST(Lanes, MasksAreOneBitALane) {
  Numbers numbers;
  for (int n = 0; n < kRounds; ++n) {
    const Floats8 a = numbers.eight(), b = numbers.eight();
    const Ints8 m = n == 0 ? Ints8{} : numbers.mask();
    const auto chosen = [&](int i) { return m[i] ? a[i] : b[i]; };
    expect_lanes(plain::select(m, a, b), chosen, "plain select");
    expect_lanes(processor::select(m, a, b), chosen, "select");
    std::uint32_t bits = 0;
    for (int i = 0; i < 8; ++i) bits |= m[i] ? 1u << i : 0u;
    ASSERT_EQ(plain::to_bits(m), bits);
    ASSERT_EQ(processor::to_bits(m), bits);
    ASSERT_EQ(plain::any(m), bits != 0);
    ASSERT_EQ(processor::any(m), bits != 0);
    ASSERT_EQ(lanes::to_bits(lanes::from_mask_bits(bits)), bits);
    if (HasFatalFailure()) return;
  }
}

TEST(Lanes, BitsAreReversed) {
  Numbers numbers;
  for (int n = 0; n < kRounds; ++n) {
    Bits8 x{};
    for (int i = 0; i < 8; ++i) x[i] = numbers.bits();
    const Bits8 a = plain::reverse_bits(x), b = processor::reverse_bits(x);
    for (int i = 0; i < 8; ++i) {
      ASSERT_EQ(a[i], reverse_bits(std::uint32_t{x[i]}));
      ASSERT_EQ(b[i], reverse_bits(std::uint32_t{x[i]}));
    }
  }
}

TEST(Lanes, EveryHalfIsRead) {
  for (std::uint32_t h = 0; h < 0x10000u; ++h) {
    const int exponent = static_cast<int>(h >> 10 & 31), fraction = static_cast<int>(h & 1023);
    float value = std::ldexp(static_cast<float>(exponent == 0 ? fraction : 1024 + fraction), std::max(exponent, 1) - 25);
    if (exponent == 31)
      value = fraction == 0 ? std::numeric_limits<float>::infinity() : std::numeric_limits<float>::quiet_NaN();
    value = std::copysign(value, h & 0x8000u ? -1.f : 1.f);
    const std::array<std::uint16_t, 4> halves = {0, static_cast<std::uint16_t>(h), 0x3c00, 0};
    for (const Floats4 v : {plain::load_halves(halves.data()), processor::load_halves(halves.data())}) {
      ASSERT_EQ(seen(v[1]), seen(value)) << h;
      ASSERT_EQ(v[2], 1.f);
    }
  }
}

TEST(Lanes, TablesAreRead) {
  std::vector<float> table(64);
  for (std::size_t i = 0; i < table.size(); ++i) table[i] = static_cast<float>(i * i);
  // Where the table ends: the address sanitizer sees what reads behind it.
  for (const auto load : {plain::load_few<3>, processor::load_few<3>}) {
    const Floats4 v = load(table.data() + table.size() - 3);
    for (int i = 0; i < 4; ++i) ASSERT_EQ(v[i], i < 3 ? table[table.size() - 3 + static_cast<std::size_t>(i)] : 0.f);
  }
  const Ints8 at = {63, 0, 5, 5, 17, 1, 2, 40};
  for (const auto lookup : {plain::lookup, processor::lookup})
    expect_lanes(lookup(table.data(), at), [&](int i) { return table[static_cast<std::size_t>(at[i])]; }, "lookup");
}

}  // namespace
}  // namespace cloudrenderer
