#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <stdexcept>

#include "film/film.h"

namespace cloudrenderer {
namespace {

// Linear interpolation between order statistics; q in [0, 1]. Reorders `values`.
double quantile(std::vector<double>& values, double q) {
  const double at = q * static_cast<double>(values.size() - 1);
  const auto i = static_cast<std::size_t>(at);
  const auto low = values.begin() + static_cast<std::ptrdiff_t>(i);
  std::nth_element(values.begin(), low, values.end());
  const double a = *low;
  if (i + 1 >= values.size()) return a;
  const double b = *std::min_element(low + 1, values.end());
  return a + (b - a) * (at - static_cast<double>(i));
}

std::string size_text(const Image& i) {
  return std::to_string(i.width) + "x" + std::to_string(i.height);
}

}  // namespace

ImageDifference compare_images(const Image& a, const Image& b, bool ignore_nonfinite_reference) {
  if (a.width != b.width || a.height != b.height || a.pixels.size() != b.pixels.size())
    throw std::runtime_error("the pictures have different sizes: " + size_text(a) + " and " +
                             size_text(b));
  ImageDifference out;
  out.identical = a.pixels.empty() ||
                  std::memcmp(a.pixels.data(), b.pixels.data(), a.pixels.size() * sizeof(Rgb)) == 0;

  std::vector<std::size_t> used;
  used.reserve(a.pixels.size());
  for (std::size_t p = 0; p < a.pixels.size(); ++p) {
    if (!is_finite(a.pixels[p])) throw std::runtime_error("NaN or infinity in the picture");
    if (is_finite(b.pixels[p]))
      used.push_back(p);
    else if (!ignore_nonfinite_reference)
      throw std::runtime_error("NaN or infinity in the reference");
  }
  if (used.empty()) throw std::runtime_error("the pictures have no pixels to compare");

  std::vector<double> errors, brightest;  // of each pixel: relative error, largest channel of b
  errors.reserve(used.size());
  brightest.reserve(used.size());
  for (const std::size_t p : used) {
    double relative = 0;
    for (int i = 0; i < 3; ++i) {
      const double va = static_cast<double>(a.pixels[p][i]),
                   vb = static_cast<double>(b.pixels[p][i]);
      const double square = (va - vb) * (va - vb);
      out.mse += square;
      relative += square / (vb * vb + 0.01);
      out.largest = std::max(out.largest, std::fabs(va - vb));
    }
    errors.push_back(relative / 3);
    brightest.push_back(static_cast<double>(max_component(b.pixels[p])));
  }
  const auto n = static_cast<double>(used.size());
  out.mse /= 3 * n;
  // A display shows values up to 1.
  out.psnr = out.mse > 0 ? -10 * std::log10(out.mse) : static_cast<double>(kInfinity);
  std::sort(errors.begin(), errors.end());
  out.relmse = std::accumulate(errors.begin(), errors.end(), 0.0) / n;
  const auto kept = std::max<std::size_t>(1, static_cast<std::size_t>(n * 0.999));
  out.relmse_trimmed =
      std::accumulate(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(kept), 0.0) /
      static_cast<double>(kept);

  std::vector<double> sorted = brightest;
  const double limit = quantile(sorted, 0.995);
  std::array<double, 3> sum_a{}, sum_b{};
  double counted = 0;
  for (std::size_t j = 0; j < used.size(); ++j) {
    if (brightest[j] > limit) continue;
    for (std::size_t i = 0; i < 3; ++i) {
      sum_a[i] += static_cast<double>(a.pixels[used[j]][static_cast<int>(i)]);
      sum_b[i] += static_cast<double>(b.pixels[used[j]][static_cast<int>(i)]);
    }
    ++counted;
  }
  const double least = 1e-9 * counted;  // below zero are means of pictures by filters with negative lobes
  for (std::size_t i = 0; i < 3; ++i) out.mean_ratio[i] = sum_a[i] / (std::fabs(sum_b[i]) > least ? sum_b[i] : least);
  return out;
}

}  // namespace cloudrenderer
