#include "film/film.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

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

Rgb Film::colour(const PixelSums& s, float scale) const {
  const double unit = fixed_units(-k_) * static_cast<double>(scale);
  const std::uint32_t n = s.count[0] + s.count[1];
  Rgb c(0.f);
  for (std::size_t i = 0; n && i < 3; ++i)
    c[static_cast<int>(i)] = static_cast<float>(mean(s.sum[0][i] + s.sum[1][i], n, unit));
  return c;
}

Image Film::image(float scale) const {
  Image out{frame_.crop_width(), frame_.crop_height(), std::vector<Rgb>(sums_.size())};
  for (std::size_t p = 0; p < sums_.size(); ++p) out.pixels[p] = colour(sums_[p], scale);
  return out;
}

Film::ErrorEstimate Film::estimated_error(float scale) const {
  const double unit = fixed_units(-k_) * static_cast<double>(scale);
  const std::size_t width = frame_.crop_width(), height = width ? sums_.size() / width : 0;
  const Image means = image(scale);
  const auto seen = [&](std::size_t at) { return sums_[at].count[0] + sums_[at].count[1] != 0; };
  const auto level = [&](std::size_t x, std::size_t y, int channel) {
    const std::size_t at = y * width + x;
    const float own = means.pixels[at][channel];
    // Beyond the border, and where nothing is yet, the pixel stands for its neighbour.
    const auto near = [&](bool inside, std::size_t other) { return inside && seen(other) ? means.pixels[other][channel] : own; };
    const float a = near(x > 0, at - 1), b = near(x + 1 < width, at + 1), c = near(y > 0, at - width),
                d = near(y + 1 < height, at + width);
    // The median of five is that of `own`, the larger of the pairs' minima and the smaller of their maxima.
    const float low = std::max(std::min(a, b), std::min(c, d)), high = std::min(std::max(a, b), std::max(c, d));
    const float median = std::max(std::min(low, high), std::min(std::max(low, high), own));
    return static_cast<double>(std::max(median, 0.02f * std::max(std::max(a, b), std::max(c, d))));
  };
  std::vector<double> errors;  // of each pixel
  errors.reserve(sums_.size());
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      const PixelSums& s = sums_[y * width + x];
      if (s.count[0] == 0 || s.count[1] == 0) continue;
      double error = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const double a = mean(s.sum[0][i], s.count[0], unit), b = mean(s.sum[1][i], s.count[1], unit);
        const double d = a - b, m = std::max(level(x, y, static_cast<int>(i)), std::min(a, b));
        error += d * d / 4 / (m * m + 0.01) / 3;
      }
      errors.push_back(error);
    }
  }
  if (errors.empty()) return {};
  const auto kept = std::max<std::size_t>(1, errors.size() * 999 / 1000);
  const auto end = errors.begin() + static_cast<std::ptrdiff_t>(kept);
  std::nth_element(errors.begin(), end - 1, errors.end());
  const double trimmed = std::accumulate(errors.begin(), end, 0.0);
  const double rest = std::accumulate(end, errors.end(), 0.0);
  return {(trimmed + rest) / static_cast<double>(errors.size()), trimmed / static_cast<double>(kept)};
}

}  // namespace cloudrenderer
