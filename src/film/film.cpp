#include "film/film.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace cloudrenderer {
namespace {

double mean(Int128 sum, std::uint32_t count, double unit) {
  return static_cast<double>(sum) * unit / static_cast<double>(count);
}

}  // namespace

double fixed_units(int k) {
  return std::bit_cast<double>(static_cast<std::uint64_t>(std::clamp(k, -1000, 1000) + 1023) << 52);
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

namespace {

Rgb colour_of(const PixelSums& s, double unit) {
  const std::uint32_t n = s.count[0] + s.count[1];
  Rgb c(0.f);
  for (std::size_t i = 0; n && i < 3; ++i)
    c[static_cast<int>(i)] = static_cast<float>(mean(s.sum[0][i] + s.sum[1][i], n, unit));
  return c;
}

}  // namespace

Rgb Film::colour(const PixelSums& pixel, float scale) const {
  return colour_of(pixel, fixed_units(-k_) * static_cast<double>(scale));
}

Image Film::image(float scale) const {
  const double unit = fixed_units(-k_) * static_cast<double>(scale);
  Image out{frame_.crop_width(), frame_.crop_height(), std::vector<Rgb>(sums_.size())};
  for (std::size_t p = 0; p < sums_.size(); ++p) out.pixels[p] = colour_of(sums_[p], unit);
  return out;
}

}  // namespace cloudrenderer
