#include "tasks/share_trial.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kSide = 8;         // of a square
constexpr std::uint32_t kSamples = 8;      // of each kind: whole groups
constexpr std::uint32_t kOneOf = 16;       // pixels of the frame, about
constexpr std::uint32_t kMostSquares = 256;
constexpr double kLeftOut = 0.01;          // of the pixels
constexpr double kDark = 0.05;             // of the mean: darker pixels count like such

std::array<double, 3> mean(const PixelSums& p, std::size_t half) {
  std::array<double, 3> m{};
  for (std::size_t c = 0; c < 3 && p.count[half] > 0; ++c) m[c] = static_cast<double>(p.sum[half][c]) / p.count[half];
  return m;
}

// Of the difference of the two halves.
double square(const PixelSums& p) {
  const auto even = mean(p, 0), odd = mean(p, 1);
  double sum = 0;
  for (std::size_t c = 0; c < 3; ++c) sum += (even[c] - odd[c]) * (even[c] - odd[c]);
  return sum;
}

double brightness(const PixelSums& p) {
  double sum = 0;
  for (std::size_t half = 0; half < 2; ++half)
    for (const double m : mean(p, half)) sum += m / 6;
  return sum;
}

}  // namespace

ShareTrial::ShareTrial(const FilmFrame& frame, std::size_t sums_per_pixel) : sums_per_pixel_(sums_per_pixel) {
  const std::uint32_t w = frame.crop_width(), h = frame.crop_height();
  const double wanted = std::clamp(static_cast<double>(frame.pixels()) / (kOneOf * kSide * kSide), 1.0, double{kMostSquares});
  const auto columns = static_cast<std::uint32_t>(std::round(std::clamp(std::sqrt(wanted * w / h), 1.0, wanted)));
  const auto rows = static_cast<std::uint32_t>(std::max(1.0, std::round(wanted / columns)));
  // In the middle of each cell of the lattice.
  const auto begin = [](std::uint32_t i, std::uint32_t n, std::uint32_t extent) {
    const auto middle = static_cast<std::uint32_t>(std::uint64_t{2 * i + 1} * extent / (2 * std::uint64_t{n}));
    return middle - std::min(middle, kSide / 2);
  };
  for (std::uint32_t j = 0; j < rows; ++j)
    for (std::uint32_t i = 0; i < columns; ++i) {
      RendererRange r;
      r.x0 = frame.x0 + begin(i, columns, w);
      r.y0 = frame.y0 + begin(j, rows, h);
      r.x1 = std::min(frame.x1, r.x0 + kSide);
      r.y1 = std::min(frame.y1, r.y0 + kSide);
      r.sample_end = kSamples;
      r.trial = true;
      squares_.push_back(r);
    }
  for (RendererRange r : squares_)
    for (const bool shares : {false, true}) {
      r.shares = shares;
      open_.push_back(r);
    }
  left_ = open_.size();
  pixels_.resize(squares_.size() * kSide * kSide);
}

std::optional<RendererRange> ShareTrial::next() {
  if (open_.empty()) return std::nullopt;
  const RendererRange r = open_.back();
  open_.pop_back();
  return r;
}

void ShareTrial::merge(const RendererRange& range, std::span<const PixelSums> sums) {
  const auto same_place = [&](const RendererRange& r) { return r.x0 == range.x0 && r.y0 == range.y0; };
  const auto found = std::ranges::find_if(squares_, same_place);
  if (found == squares_.end() || left_ == 0) return;
  auto pixel = pixels_.begin() + (found - squares_.begin()) * std::ptrdiff_t{kSide * kSide};
  // Samples in negative lobes are summed apart; here all count alike.
  for (std::size_t i = 0; i < sums.size(); ++i) (pixel + static_cast<std::ptrdiff_t>(i / sums_per_pixel_))->sums[range.shares].merge(sums[i]);
  --left_;
}

std::optional<double> ShareTrial::ratio() const {
  double average = 0;
  for (const Pixel& p : pixels_) average += (brightness(p.sums[0]) + brightness(p.sums[1])) / 2 / static_cast<double>(pixels_.size());
  struct Squares {
    double alone, shared;
  };
  std::vector<Squares> relative;
  for (const Pixel& p : pixels_) {
    const double bright = std::max((brightness(p.sums[0]) + brightness(p.sums[1])) / 2, kDark * average);
    if (bright > 0) relative.push_back({square(p.sums[0]) / (bright * bright), square(p.sums[1]) / (bright * bright)});
  }
  std::ranges::sort(relative, {}, [](const Squares& s) { return s.alone + s.shared; });
  relative.resize(relative.size() - static_cast<std::size_t>(static_cast<double>(relative.size()) * kLeftOut));
  double alone = 0, shared = 0;
  for (const Squares& s : relative) {
    alone += s.alone;
    shared += s.shared;
  }
  if (!(alone > 0)) return std::nullopt;
  return shared / alone;
}

}  // namespace cloudrenderer
