#include "film/film.h"

#include <bit>
#include <cmath>

namespace cloudrenderer {
namespace {

double power_of_two(int k) {
  return std::bit_cast<double>(static_cast<std::uint64_t>(std::clamp(k, -1000, 1000) + 1023) << 52);
}

double mean(Int128 sum, std::uint32_t count, double unit) {
  return static_cast<double>(sum) * unit / static_cast<double>(count);
}

}  // namespace

Fixed3 quantise(const Rgb& c, int k, bool& clamped) {
  constexpr double kLimit = 0x1p62;
  const double scale = power_of_two(k);
  Fixed3 out;
  for (int i = 0; i < 3; ++i) {
    double v = static_cast<double>(c[i]) * scale;  // exact: only the exponent changes
    if (!(std::fabs(v) <= kLimit)) {
      v = v < 0 ? -kLimit : kLimit;
      clamped = true;
    }
    // nearbyint rounds ties to even in the default mode, which nothing here changes.
    out[static_cast<std::size_t>(i)] = static_cast<std::int64_t>(std::nearbyint(v));
  }
  return out;
}

void PixelSums::add(const Fixed3& v, std::uint32_t sample) {
  const std::size_t h = sample & 1;
  for (std::size_t i = 0; i < 3; ++i) sum[h][i] += v[i];
  ++count[h];
}

void PixelSums::merge(const PixelSums& other) {
  for (std::size_t h = 0; h < 2; ++h) {
    for (std::size_t i = 0; i < 3; ++i) sum[h][i] += other.sum[h][i];
    count[h] += other.count[h];
  }
}

Image Film::image(float scale) const {
  Image out{frame_.crop_width(), frame_.crop_height(), std::vector<Rgb>(sums_.size(), Rgb(0.f))};
  const double unit = power_of_two(-k_) * static_cast<double>(scale);
  for (std::size_t p = 0; p < sums_.size(); ++p) {
    const PixelSums& s = sums_[p];
    const std::uint32_t n = s.count[0] + s.count[1];
    if (n == 0) continue;
    for (std::size_t i = 0; i < 3; ++i)
      out.pixels[p][static_cast<int>(i)] =
          static_cast<float>(mean(s.sum[0][i] + s.sum[1][i], n, unit));
  }
  return out;
}

double Film::estimated_relmse(float scale) const {
  const double unit = power_of_two(-k_) * static_cast<double>(scale);
  double total = 0;
  std::uint64_t values = 0;
  for (const PixelSums& s : sums_) {
    if (s.count[0] == 0 || s.count[1] == 0) continue;
    for (std::size_t i = 0; i < 3; ++i) {
      const double d = mean(s.sum[0][i], s.count[0], unit) - mean(s.sum[1][i], s.count[1], unit);
      const double m = mean(s.sum[0][i] + s.sum[1][i], s.count[0] + s.count[1], unit);
      total += d * d / 4 / (m * m + 0.01);
    }
    values += 3;
  }
  return values == 0 ? 0 : total / static_cast<double>(values);
}

}  // namespace cloudrenderer
