// How wrong the picture is, from the two halves of its samples.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/lanes.h"
#include "film/film.h"

namespace cloudrenderer {
namespace {

// Quantiles of the normal distribution: 98 % for one look, since it is an approximation and 90 % are promised. Who looks
// after every round and stops at the first good one takes the luckiest of his looks: found with many seeds.
constexpr double kOnce = 2.326, kRepeatedly = 6;
// An error is never taken as relative to less than this share of the brightest neighbour: the edge of a light.
constexpr float kShareOfNeighbour = 0.02f;
constexpr float kBrightest = 1e15f;  // squares of sums of such stay finite

// One channel, row by row with a border: means of pixels, and the squared difference of their halves over 4. NaN: there
// is nothing, so that the pixel in the middle stands for it.
struct Plane {
  static constexpr std::size_t kPad = kLanes;  // on the right: groups of eight end in it
  std::size_t stride;
  std::vector<float> means, squares;
  Plane(std::size_t width, std::size_t height)
      : stride(width + 1 + kPad), means(stride * (height + 2), std::nanf("")), squares(means) {}
  std::size_t at(std::size_t x, std::size_t y) const { return (y + 1) * stride + x + 1; }
};

// What the error of eight pixels is relative to, in two ways: the true value has no fireflies, the pixel's mean has.
struct Levels {
  Float8 median, smoothed;
};

void sort2(Float8& a, Float8& b) {
  const Float8 low = lanes::min(a, b);
  b = lanes::max(a, b);
  a = low;
}
void sort4(Float8* v) {
  sort2(v[0], v[1]);
  sort2(v[2], v[3]);
  sort2(v[0], v[2]);
  sort2(v[1], v[3]);
  sort2(v[1], v[2]);
}

Levels levels(const Plane& p, std::size_t at) {
  const Float8 own = Float8::load(&p.means[at]), own_square = Float8::load(&p.squares[at]);
  Float8 n[8], noise = own_square;
  const std::size_t s = p.stride;
  const std::size_t around[8] = {at - 1, at + 1, at - s, at + s, at - s - 1, at - s + 1, at + s - 1, at + s + 1};
  for (std::size_t i = 0; i < 8; ++i) {
    const Float8 m = Float8::load(&p.means[around[i]]), q = Float8::load(&p.squares[around[i]]);
    n[i] = lanes::select(m == m, m, own);
    noise += lanes::select(q == q, q, own_square);
  }
  noise *= 1.f / 9;
  Levels out;
  {  // The median of five is that of `own`, the larger of the pairs' minima and the smaller of their maxima.
    const Float8 a = lanes::min(n[0], n[1]), b = lanes::max(n[0], n[1]), c = lanes::min(n[2], n[3]), d = lanes::max(n[2], n[3]);
    const Float8 low = lanes::max(a, c), high = lanes::min(b, d);
    const Float8 median = lanes::max(lanes::min(low, high), lanes::min(lanes::max(low, high), own));
    out.median = lanes::max(median, kShareOfNeighbour * lanes::max(b, d));
  }
  // Lee's filter (1980, "Digital image enhancement and noise filtering by use of local statistics") around the median of
  // the eight neighbours: the pixel counts as much as the neighbourhood varies by more than its noise.
  sort4(n);
  sort4(n + 4);
  const Float8 below = lanes::max(lanes::max(lanes::min(n[0], n[7]), lanes::min(n[1], n[6])),
                                  lanes::max(lanes::min(n[2], n[5]), lanes::min(n[3], n[4])));
  const Float8 above = lanes::min(lanes::min(lanes::max(n[0], n[7]), lanes::max(n[1], n[6])),
                                  lanes::min(lanes::max(n[2], n[5]), lanes::max(n[3], n[4])));
  const Float8 median = 0.5f * (below + above);
  Float8 spread = 0.f;
  for (const Float8& v : n) spread += (v - median) * (v - median);
  const Float8 signal = lanes::max(spread * 0.125f - noise, Float8(0.f));
  out.smoothed = lanes::max(median + signal / (signal + noise + 1e-30f) * (own - median), Float8(0.f));
  return out;
}

// Each pixel's share of the relMSE, relative to either level; -1: a pixel without both halves.
struct PixelErrors {
  std::vector<double> by_median, by_smoothed;
};

PixelErrors pixel_errors(const Film& film, float scale) {
  const double unit = fixed_units(-film.k()) * static_cast<double>(scale);
  const std::size_t pixels = film.frame().pixels(), width = film.frame().crop_width(), height = width ? pixels / width : 0;
  PixelErrors out{std::vector<double>(pixels, 0), std::vector<double>(pixels, 0)};
  for (std::size_t channel = 0; channel < 3; ++channel) {
    Plane plane(width, height);
    std::vector<double> lower(pixels), squares(pixels, -1);
    for (std::size_t y = 0; y < height; ++y) {
      for (std::size_t x = 0; x < width; ++x) {
        const std::size_t at = plane.at(x, y), pixel = y * width + x;
        const bool even = film.samples(pixel, 0) != 0, odd = film.samples(pixel, 1) != 0;
        if (!even && !odd) continue;
        plane.means[at] = std::clamp(static_cast<float>(film.mean(pixel, channel, unit)), -kBrightest, kBrightest);
        if (!even || !odd) continue;
        const double a = film.mean(pixel, channel, unit, 0), b = film.mean(pixel, channel, unit, 1);
        const double square = (a - b) * (a - b) / 4;
        plane.squares[at] = static_cast<float>(std::min(square, static_cast<double>(kBrightest) * static_cast<double>(kBrightest)));
        squares[pixel] = square;
        lower[pixel] = std::min(a, b);
      }
    }
    for (std::size_t y = 0; y < height; ++y) {
      for (std::size_t x = 0; x < width; x += kLanes) {
        const Levels l = levels(plane, plane.at(x, y));
        for (std::size_t i = 0; i < std::min(kLanes, width - x); ++i) {
          const std::size_t at = y * width + x + i;
          if (squares[at] < 0) {
            out.by_median[at] = out.by_smoothed[at] = -1;
            continue;
          }
          const double median = std::max(static_cast<double>(l.median.v[i]), lower[at]);
          const double smoothed = static_cast<double>(l.smoothed.v[i]);
          out.by_median[at] += squares[at] / (median * median + 0.01) / 3;
          out.by_smoothed[at] += squares[at] / (smoothed * smoothed + 0.01) / 3;
        }
      }
    }
  }
  return out;
}

struct Moments {
  double mean = 0, deviation = 0;  // of the mean from the true relMSE
};
Moments moments(std::span<const double> errors, std::size_t counted) {
  double sum = 0, squares = 0;
  for (const double e : errors) {
    if (e < 0) continue;
    sum += e;
    squares += e * e;
  }
  const auto n = static_cast<double>(counted);
  return {sum / n, std::sqrt(squares * 4 / 3) / n};
}

}  // namespace

std::vector<double> Film::pixel_errors(float scale) const {
  return cloudrenderer::pixel_errors(*this, scale).by_median;
}

std::vector<ImageChannel> error_layer(const Film& film, float scale) {
  const double unit = fixed_units(-film.k()) * static_cast<double>(scale);
  std::vector<ImageChannel> out;
  for (std::size_t channel = 0; channel < 3; ++channel) {
    std::vector<float> deviations(film.frame().pixels());
    for (std::size_t p = 0; p < deviations.size(); ++p) {
      if (film.samples(p, 0) == 0 || film.samples(p, 1) == 0) continue;
      const double a = film.mean(p, channel, unit, 0), b = film.mean(p, channel, unit, 1);
      deviations[p] = static_cast<float>(std::fabs(a - b) / 2);
    }
    out.push_back({std::string("error.") + "RGB"[channel], std::move(deviations)});
  }
  const std::vector<double> relative = film.pixel_errors(scale);
  std::vector<float> shares(relative.size());
  std::ranges::transform(relative, shares.begin(), [](double e) { return static_cast<float>(std::max(e, 0.0)); });
  out.push_back({"error.relmse", std::move(shares)});
  return out;
}

ImageChannel samples_layer(const Film& film) {
  std::vector<float> counts(film.frame().pixels());
  for (std::size_t p = 0; p < counts.size(); ++p) counts[p] = static_cast<float>(film.samples(p));
  return {"samples", std::move(counts)};
}

Film::ErrorEstimate Film::estimated_error(float scale, Looks looks) const {
  PixelErrors all = cloudrenderer::pixel_errors(*this, scale);
  const auto counted =
      static_cast<std::size_t>(std::count_if(all.by_median.begin(), all.by_median.end(), [](double e) { return e >= 0; }));
  if (counted == 0) return {};
  const Moments by_median = moments(all.by_median, counted), by_smoothed = moments(all.by_smoothed, counted);
  ErrorEstimate out;
  out.relmse = by_median.mean;
  const double quantile = looks == Looks::once ? kOnce : kRepeatedly;
  const auto bound = [&](double sign) {
    const double a = by_median.mean + sign * quantile * by_median.deviation;
    const double b = by_smoothed.mean + sign * quantile * by_smoothed.deviation;
    return std::max(0.0, sign < 0 ? std::min(a, b) : std::max(a, b));
  };
  out.low = bound(-1);
  out.high = bound(1);
  std::erase_if(all.by_median, [](double e) { return e < 0; });
  std::vector<double>& errors = all.by_median;
  const auto kept = std::max<std::size_t>(1, counted * 999 / 1000);
  const auto end = errors.begin() + static_cast<std::ptrdiff_t>(kept);
  std::nth_element(errors.begin(), end - 1, errors.end());
  out.trimmed = std::accumulate(errors.begin(), end, 0.0) / static_cast<double>(kept);
  return out;
}

}  // namespace cloudrenderer
