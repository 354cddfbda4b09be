// The sample sequence far out: many samples, high dimensions, many pixels.
#include "base/random.h"
#include "quadrature.h"
#include "record.h"

namespace cloudrenderer::stability {
namespace {

using Kind = SampleSequence::Kind;

// Which pair of numbers: of get_2d(), or of get_pairs()[lane].
struct Numbers {
  const char* name;
  Vec2 (*at)(const SampleSequence&, std::uint32_t dimension);
};
constexpr Numbers kNumbers[] = {
    {"single pairs", [](const SampleSequence& s, std::uint32_t d) { return s.get_2d(d); }},
    {"groups of pairs", [](const SampleSequence& s, std::uint32_t d) { return s.get_pairs(d)[d % 4]; }},
};

// The first 2^m points of each half of a pixel's samples have one point in every elementary interval of area 2^-m.
TEST(Sequences, AreStratifiedFarBeyond65536Samples) {
  const int m = full() ? 22 : 18;
  const std::uint32_t n = 1u << m;
  for (const Numbers& numbers : kNumbers)
    for (const std::uint32_t dimension : {3u, 5003u}) {
      std::vector<Vec2> points(n);
      for (std::uint32_t i = 0; i < n; ++i) points[i] = numbers.at(SampleSequence(Kind::sobol, 1, 77, 2 * i + 1), dimension);
      std::uint64_t wrong = 0;
      std::vector<std::uint8_t> seen(n);
      for (const int across : {0, 1, m / 2, m - 1, m}) {
        std::fill(seen.begin(), seen.end(), std::uint8_t{0});
        const auto columns = static_cast<float>(1u << across), rows = static_cast<float>(1u << (m - across));
        for (const Vec2& p : points) {
          const auto at = (static_cast<std::uint32_t>(p.y * rows) << across) + static_cast<std::uint32_t>(p.x * columns);
          wrong += seen[at]++ != 0;
        }
      }
      record(std::string("sequence of ") + numbers.name + ", dimension " + std::to_string(dimension),
             "points that share an elementary interval", 0, static_cast<double>(wrong), n);
    }
}

// A smooth integral: scrambled nets err like n^-1.5, up to what 24 bits of a number can tell.
TEST(Sequences, ConvergeFarBeyond65536Samples) {
  const std::uint32_t n = full() ? 1u << 23 : 1u << 19;
  double square = 0;
  constexpr std::uint32_t kPixels = 8;
  for (std::uint32_t pixel = 0; pixel < kPixels; ++pixel) {
    double sum = 0;
    for (std::uint32_t s = 0; s < n; ++s) {
      const Vec2 p = SampleSequence(Kind::sobol, 5, pixel, 2 * s).get_2d(1200);
      // The number stands for its interval of 2^-24.
      const double x = static_cast<double>(p.x) + 0x1p-25, y = static_cast<double>(p.y) + 0x1p-25;
      sum += x * x * y + std::sin(3 * x + y);
    }
    const double exact = 1.0 / 6 + (std::sin(3.0) + std::sin(1.0) - std::sin(4.0)) / 3;
    square += (sum / n - exact) * (sum / n - exact);
  }
  const double error = std::sqrt(square / kPixels);
  record("smooth integral by " + std::to_string(n) + " samples of dimension 1200", "error * n^1.5", 3.0,
         error * std::pow(n, 1.5), std::uint64_t{n} * kPixels);
}

double correlation(std::uint64_t n, const auto& a, const auto& b) {
  double sum = 0;
  for (std::uint64_t i = 0; i < n; ++i) sum += (a(i) - 0.5) * (b(i) - 0.5);
  return std::fabs(sum / static_cast<double>(n) * 12);
}

// Correlations are of independent numbers where they stay below 5 / sqrt(n): each is one of some dozens.
TEST(Sequences, OfPixelsAndDimensionsAreIndependent) {
  const std::uint64_t n = rays(1 << 16, 1 << 22);
  const double bound = 5 / std::sqrt(static_cast<double>(n));
  double pixels = 0, dimensions = 0, seeds = 0, halves = 0;
  for (const Numbers& numbers : kNumbers)
    for (const std::uint32_t d : {0u, 1001u, 65535u}) {
      const auto x = [&](std::uint64_t pixel, std::uint32_t sample, std::uint32_t dimension, std::uint32_t seed = 0) {
        return static_cast<double>(numbers.at(SampleSequence(Kind::sobol, seed, static_cast<std::uint32_t>(pixel), sample), dimension).x);
      };
      for (const std::uint32_t step : {1u, 2u, 640u, 1u << 16})
        pixels = std::max(pixels, correlation(n, [&](auto i) { return x(i, 0, d); }, [&](auto i) { return x(i + step, 0, d); }));
      for (const std::uint32_t step : {1u, 4u, 64u, 1000u})
        dimensions = std::max(dimensions, correlation(n, [&](auto i) { return x(i, 0, d); }, [&](auto i) { return x(i, 0, d + step); }));
      seeds = std::max(seeds, correlation(n, [&](auto i) { return x(i, 0, d); }, [&](auto i) { return x(i, 0, d, 1); }));
      halves = std::max(halves, correlation(n, [&](auto i) { return x(i, 6, d); }, [&](auto i) { return x(i, 7, d); }));
    }
  record("numbers of pixels 1, 2, 640 and 65536 apart", "largest correlation", bound, pixels, n);
  record("numbers of dimensions 1, 4, 64 and 1000 apart, up to 66535", "largest correlation", bound, dimensions, n);
  record("numbers of two seeds", "largest correlation", bound, seeds, n);
  record("numbers of the two halves of a pixel's samples", "largest correlation", bound, halves, n);
}

// The errors of many pixels are independent: their sum grows as the root of their number.
TEST(Sequences, GiveIndependentErrorsToPixels) {
  const std::uint32_t side = full() ? 512 : 128, block = 16;
  constexpr std::uint32_t kSamples = 16;
  double squares = 0, of_blocks = 0;
  for (std::uint32_t by = 0; by < side; by += block)
    for (std::uint32_t bx = 0; bx < side; bx += block) {
      double sum = 0;
      for (std::uint32_t y = by; y < by + block; ++y)
        for (std::uint32_t x = bx; x < bx + block; ++x) {
          double value = 0;
          for (std::uint32_t s = 0; s < kSamples; ++s) {
            const Vec2 p = SampleSequence(Kind::sobol, 0, y * side + x, s).get_pairs(7)[1];
            value += p.x + p.y < 0.77f ? 1.0 : 0.0;
          }
          const double error = value / kSamples - 0.77 * 0.77 / 2;
          squares += error * error;
          sum += error;
        }
      of_blocks += sum * sum;
    }
  // The variance of a block's sum over that of its pixels together: 1 but for chance, sqrt(2 / blocks).
  const double blocks = static_cast<double>(side / block) * (side / block);
  record("errors of blocks of 16 x 16 pixels", "variance of their sums / sum of their variances, off 1", 5 * std::sqrt(2 / blocks),
         std::fabs(of_blocks / squares - 1), static_cast<std::uint64_t>(side) * side);
}

// Beyond a thousand dimensions: two of them make no pattern. Pearson's test of 16 x 16 cells.
TEST(Sequences, FillPlanesOfHighDimensions) {
  const std::uint32_t n = full() ? 1u << 22 : 1u << 16;
  double worst = 0;
  for (const std::uint32_t d : {1000u, 4095u, 65000u}) {
    std::array<double, 256> cells{};
    for (std::uint32_t s = 0; s < n; ++s) {
      const SampleSequence q(Kind::sobol, 9, 123, 2 * s);
      const float x = q.get_pairs(d)[1].x, y = q.get_pairs(d + 1)[1].x;
      cells[static_cast<std::size_t>(y * 16) * 16 + static_cast<std::size_t>(x * 16)] += 1;
    }
    double chi2 = 0;
    for (const double c : cells) chi2 += (c - n / 256.0) * (c - n / 256.0) / (n / 256.0);
    worst = std::max(worst, chi2);
  }
  // 255 degrees of freedom: 400 is exceeded by chance once in 4e7; shuffled nets stay below their mean.
  record("planes of two dimensions beyond 1000", "chi squared of 256 cells", 400, worst, n);
}

}  // namespace
}  // namespace cloudrenderer::stability
