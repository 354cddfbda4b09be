#include <gtest/gtest.h>

#include <array>
#include <random>
#include <vector>

#include "base/random.h"
#include "base/sampling.h"

namespace cloudrenderer {
namespace {

using Kind = SampleSequence::Kind;

// Each half of the samples of a pixel is a (0,2)-sequence in base 2: every elementary interval of area 1/n holds
// exactly one of the first n = 2^m points.
TEST(SampleSequence, PairsAreStratifiedInEveryElementaryInterval) {
  for (std::uint32_t pixel = 0; pixel < 20; ++pixel)
    for (std::uint32_t dimension = 0; dimension < 6; ++dimension)
      for (std::uint32_t half = 0; half < 2; ++half)
        for (int log_x = 0; log_x <= 6; ++log_x) {
          std::array<int, 64> count{};
          for (std::uint32_t i = 0; i < 64; ++i) {
            const Vec2 p = SampleSequence(Kind::sobol, 5, pixel, 2 * i + half).get_2d(dimension);
            const auto x = static_cast<unsigned>(p.x * static_cast<float>(1 << log_x));
            const auto y = static_cast<unsigned>(p.y * static_cast<float>(64 >> log_x));
            ++count[x * (64u >> log_x) + y];
          }
          for (const int c : count) ASSERT_EQ(c, 1) << "pixel " << pixel << " dimension " << dimension;
        }
}

TEST(SampleSequence, GroupsOfPairsAreStratifiedAndUncorrelated) {
  for (std::uint32_t pixel = 0; pixel < 20; ++pixel)
    for (std::uint32_t dimension = 0; dimension < 3; ++dimension)
      for (std::size_t pair = 0; pair < 4; ++pair)
        for (int log_x = 0; log_x <= 6; ++log_x) {
          std::array<int, 64> count{};
          for (std::uint32_t i = 0; i < 64; ++i) {
            const Vec2 p = SampleSequence(Kind::sobol, 5, pixel, 2 * i + 1).get_pairs(dimension)[pair];
            ++count[static_cast<unsigned>(p.x * static_cast<float>(1 << log_x)) * (64u >> log_x) +
                    static_cast<unsigned>(p.y * static_cast<float>(64 >> log_x))];
          }
          for (const int c : count) ASSERT_EQ(c, 1) << "pixel " << pixel << " dimension " << dimension << " pair " << pair;
        }
  // All numbers of two groups, against each other, over pixels and over the samples of one pixel.
  constexpr std::uint32_t kCount = 16384;
  for (const Kind kind : {Kind::sobol, Kind::independent})
    for (const bool samples : {false, true}) {
      std::array<std::array<double, 16>, 16> product{};
      for (std::uint32_t i = 0; i < kCount; ++i) {
        std::array<double, 16> v;
        for (std::uint32_t group = 0; group < 2; ++group) {
          const auto pairs = SampleSequence(kind, 3, samples ? 9 : i, samples ? i : 0).get_pairs(group);
          for (std::size_t k = 0; k < 8; ++k) v[8 * group + k] = static_cast<double>(pairs.numbers[k]) - 0.5;
        }
        for (std::size_t a = 0; a < 16; ++a)
          for (std::size_t b = 0; b <= a; ++b) product[a][b] += v[a] * v[b] * 12 / kCount;
      }
      for (std::size_t a = 0; a < 16; ++a) {
        EXPECT_NEAR(product[a][a], 1, 0.05);
        for (std::size_t b = 0; b < a; ++b) EXPECT_NEAR(product[a][b], 0, 0.04) << a << ' ' << b;
      }
    }
}

TEST(SampleSequence, PixelsHalvesDimensionsAndSeedsAreUncorrelated) {
  const int n = 20000;
  auto correlation = [&](auto a, auto b) {
    double sa = 0, sb = 0, sab = 0, saa = 0, sbb = 0;
    for (int i = 0; i < n; ++i) {
      const double x = static_cast<double>(a(static_cast<std::uint32_t>(i))), y = static_cast<double>(b(static_cast<std::uint32_t>(i)));
      sa += x, sb += y, sab += x * y, saa += x * x, sbb += y * y;
    }
    return (sab / n - sa * sb / n / n) / std::sqrt((saa / n - sa * sa / n / n) * (sbb / n - sb * sb / n / n));
  };
  for (const Kind kind : {Kind::sobol, Kind::independent}) {
    auto at = [&](std::uint32_t seed, std::uint32_t pixel, std::uint32_t sample, std::uint32_t dim) {
      return SampleSequence(kind, seed, pixel, sample).get_2d(dim).x;
    };
    EXPECT_LT(std::fabs(correlation([&](auto i) { return at(0, i, 0, 0); }, [&](auto i) { return at(0, i + 1, 0, 0); })), 0.03);
    EXPECT_LT(std::fabs(correlation([&](auto i) { return at(0, i, 0, 0); }, [&](auto i) { return at(0, i, 1, 0); })), 0.03);
    EXPECT_LT(std::fabs(correlation([&](auto i) { return at(0, i, 0, 0); }, [&](auto i) { return at(0, i, 0, 1); })), 0.03);
    EXPECT_LT(std::fabs(correlation([&](auto i) { return at(0, i, 0, 0); }, [&](auto i) { return at(1, i, 0, 0); })), 0.03);
    EXPECT_LT(std::fabs(correlation([&](auto i) { return at(0, i, 0, 3); }, [&](auto i) { return SampleSequence(kind, 0, i, 0).get_2d(3).y; })), 0.03);
  }
}

TEST(SampleSequence, ConvergesFasterThanIndependentNumbers) {
  auto error = [](Kind kind) {
    double e = 0;
    for (std::uint32_t pixel = 0; pixel < 200; ++pixel) {
      double sum = 0;
      for (std::uint32_t s = 0; s < 256; ++s) {
        const Vec2 p = SampleSequence(kind, 0, pixel, s).get_2d(4);
        sum += static_cast<double>(p.x * p.x * p.y);
      }
      e += (sum / 256 - 1.0 / 6) * (sum / 256 - 1.0 / 6);
    }
    return e;
  };
  EXPECT_LT(error(Kind::sobol) * 50, error(Kind::independent));
}

TEST(SampleSequence, EightAtOnceAreTheNumbersOfEach) {
  std::mt19937 rng(11);
  for (const auto kind : {Kind::sobol, Kind::independent}) {
    for (int round = 0; round < 200; ++round) {
      SampleSequence::Eight eight;
      std::array<std::uint32_t, kLanes> dimension;
      for (std::size_t i = 0; i < kLanes; ++i) {
        eight[i] = SampleSequence(kind, 7, static_cast<std::uint32_t>(rng()), static_cast<std::uint32_t>(rng() % 5000));
        dimension[i] = static_cast<std::uint32_t>(rng() % 20);
      }
      const auto pairs = SampleSequence::get_pairs(eight, dimension);
      const auto without_first = SampleSequence::get_pairs(eight, dimension, 1);
      const Vec2x8 single = SampleSequence::get_2d(eight, 3);
      for (std::size_t i = 0; i < kLanes; ++i) {
        ASSERT_EQ(lanes::get(single, i), eight[i].get_2d(3));
        for (std::size_t k = 0; k < 4; ++k) ASSERT_EQ(lanes::get(pairs[k], i), eight[i].get_pairs(dimension[i])[k]);
        for (std::size_t k = 1; k < 4; ++k) ASSERT_EQ(lanes::get(without_first[k], i), lanes::get(pairs[k], i));
      }
    }
  }
}

TEST(Distribution1D, DensityIntegratesToOneAndSamplesFollowIt) {
  const std::vector<float> values{0, 1, 3, 0, 4};
  const Distribution1D d(values);
  EXPECT_FLOAT_EQ(d.integral(), 8.f / 5);
  std::array<int, 5> count{};
  for (int i = 0; i < 8000; ++i) {
    float pdf;
    std::size_t cell;
    const float x = d.sample((static_cast<float>(i) + 0.5f) / 8000, pdf, cell);
    ASSERT_FLOAT_EQ(pdf, d.pdf(x));
    ASSERT_GT(pdf, 0.f);
    ++count[cell];
  }
  for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(count[i], 1000 * static_cast<int>(values[i]), 2);
}

TEST(Distribution2D, EverySampleHasTheDensityItReports) {
  std::vector<float> values(16 * 8);
  std::mt19937 rng(1);
  for (float& v : values) v = static_cast<float>(rng() % 5);
  const Distribution2D d(values, 16, 8);
  double integral = 0;
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 16; ++x)
      integral += static_cast<double>(d.pdf({(static_cast<float>(x) + 0.5f) / 16, (static_cast<float>(y) + 0.5f) / 8}));
  EXPECT_NEAR(integral / 128, 1, 1e-5);
  for (std::uint32_t i = 0; i < 1000; ++i) {
    float pdf;
    const Vec2 p = d.sample(SampleSequence(Kind::sobol, 0, 0, i).get_2d(0), pdf);
    ASSERT_FLOAT_EQ(pdf, d.pdf(p));
  }
}

}  // namespace
}  // namespace cloudrenderer
