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

void Splat::add(const Fixed3& v, std::uint32_t sample) {
  for (std::size_t i = 0; i < 3; ++i) sum[sample & 1][i] += v[i];
}

void Splat::merge(const Splat& other) {
  for (std::size_t h = 0; h < 2; ++h)
    for (std::size_t i = 0; i < 3; ++i) sum[h][i] += other.sum[h][i];
}

void Film::add(const Splat& splat) {
  const std::uint32_t width = frame_.crop_width();
  if (splats_.empty()) {
    splats_.resize(frame_.pixels());
    for (std::size_t i = 0; i < splats_.size(); ++i)
      splats_[i].pixel = static_cast<std::uint32_t>((frame_.y0 + i / width) * frame_.width + frame_.x0 + i % width);
  }
  const std::uint32_t x = splat.pixel % frame_.width - frame_.x0, y = splat.pixel / frame_.width - frame_.y0;
  splats_[std::size_t{y} * width + x].merge(splat);
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
