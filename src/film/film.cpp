#include "film/film.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace cloudrenderer {
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

std::uint32_t Film::samples(std::size_t pixel, std::size_t half) const {
  std::uint32_t n = 0;
  for (const PixelSums& s : std::span(sums_).subspan(pixel * sums_per_pixel(), sums_per_pixel())) n += s.count[half];
  return n;
}

namespace {

double mean_of(Int128 sum, std::uint32_t count, double unit) {
  return static_cast<double>(sum) * unit / static_cast<double>(count);
}

// A kind of lobes without samples is taken as the other one.
double weigh(const FilterLobes& lobes, double above, std::uint32_t n_above, double below, std::uint32_t n_below) {
  if (n_above == 0) return below;
  return n_below == 0 ? above : lobes.above * above - lobes.below * below;
}

}  // namespace

double Film::mean(std::size_t pixel, std::size_t channel, double unit) const {
  const auto one = [&](const PixelSums& s, std::uint32_t n) { return mean_of(s.sum[0][channel] + s.sum[1][channel], n, unit); };
  const auto count = [](const PixelSums& s) { return s.count[0] + s.count[1]; };
  if (sums_per_pixel() == 1) return one(sums_[pixel], count(sums_[pixel]));
  const PixelSums &above = sums_[2 * pixel], &below = sums_[2 * pixel + 1];
  return weigh(lobes_, one(above, count(above)), count(above), one(below, count(below)), count(below));
}

double Film::mean(std::size_t pixel, std::size_t channel, double unit, std::size_t half) const {
  const auto one = [&](const PixelSums& s) { return mean_of(s.sum[half][channel], s.count[half], unit); };
  if (sums_per_pixel() == 1) return one(sums_[pixel]);
  const PixelSums &above = sums_[2 * pixel], &below = sums_[2 * pixel + 1];
  return weigh(lobes_, one(above), above.count[half], one(below), below.count[half]);
}

Rgb Film::colour(std::size_t pixel, float scale) const {
  Rgb c(0.f);
  if (samples(pixel) == 0) return c;
  const double unit = fixed_units(-k_) * static_cast<double>(scale);
  for (std::size_t i = 0; i < 3; ++i) c[static_cast<int>(i)] = static_cast<float>(mean(pixel, i, unit));
  return c;
}

Image Film::image(float scale) const {
  Image out{frame_.crop_width(), frame_.crop_height(), std::vector<Rgb>(frame_.pixels())};
  for (std::size_t p = 0; p < out.pixels.size(); ++p) out.pixels[p] = colour(p, scale);
  return out;
}

}  // namespace cloudrenderer
