#include "film/sample_plan.h"

#include <algorithm>
#include <cmath>

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kStep = 8;         // samples: both halves stay powers of the sequence's base apart
constexpr double kLeastOfAverage = 0.125;  // of the samples of a tile
constexpr double kLeastRound = 1.05, kLargestRound = 1.4, kMostOfTile = 2;
constexpr double kAim = 0.97;  // of the error asked for: another round costs more than a few samples
constexpr int kBisections = 50;

struct Tile {
  double pixels = 0, error = 0;  // the mean of its pixels' errors
  double weight = 0;             // square root of a sample's error around
  std::uint32_t samples = 0;
};

std::uint32_t goal(const Tile& t, double per_weight, std::uint32_t most) {
  const double wanted = std::min(t.weight * per_weight, kMostOfTile * static_cast<double>(t.samples));
  if (!(wanted > static_cast<double>(t.samples))) return t.samples;
  const auto steps = static_cast<std::uint32_t>(std::ceil(wanted / kStep));
  return std::max(t.samples, std::min(most, steps * kStep));
}

// The number `per_weight` at which a growing function reaches a value.
template <class F>
double solve(F f, double value) {
  double low = 0, high = 1;
  for (int i = 0; i < 200 && f(high) < value; ++i) high *= 2;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = (low + high) / 2;
    (f(middle) < value ? low : high) = middle;
  }
  return high;
}

std::vector<Tile> tiles_of(const Film& film, float scale, std::uint32_t size, std::span<const std::uint32_t> samples) {
  const std::uint32_t width = film.frame().crop_width(), height = film.frame().crop_height();
  const std::size_t columns = (width + size - 1) / size, rows = (height + size - 1) / size;
  std::vector<Tile> tiles(columns * rows);
  const std::vector<double> errors = film.pixel_errors(scale);
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) {
      Tile& t = tiles[y / size * columns + x / size];
      t.error += std::max(0.0, errors[std::size_t{y} * width + x]);
      ++t.pixels;
    }
  }
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    tiles[i].error /= tiles[i].pixels;
    tiles[i].samples = samples[i];
  }
  double total = 0, pixels = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      double around = 0, count = 0;
      for (std::size_t r = row - std::min<std::size_t>(row, 1); r < std::min(rows, row + 2); ++r) {
        for (std::size_t c = column - std::min<std::size_t>(column, 1); c < std::min(columns, column + 2); ++c) {
          const Tile& t = tiles[r * columns + c];
          if (r == row && c == column) continue;
          around += t.error * static_cast<double>(t.samples);
          ++count;
        }
      }
      Tile& t = tiles[row * columns + column];
      t.weight = std::sqrt(count > 0 ? around / count : t.error * static_cast<double>(t.samples));
      total += t.weight * t.pixels;
      pixels += t.pixels;
    }
  }
  const double least = kLeastOfAverage * total / pixels;
  for (Tile& t : tiles) t.weight = std::max(t.weight, least);
  return tiles;
}

}  // namespace

SamplePlan plan_samples(const Film& film, float scale, const Film::ErrorEstimate& estimate, std::uint32_t tile,
                        std::span<const std::uint32_t> samples, std::optional<double> max_error, std::uint32_t most) {
  std::vector<Tile> tiles = tiles_of(film, scale, tile, samples);
  double now = 0, error = 0, total_pixels = 0, weights = 0;
  for (Tile& t : tiles) {
    now += t.pixels * static_cast<double>(t.samples);
    error += t.pixels * t.error;
    total_pixels += t.pixels;
    weights += t.weight;
  }
  if (!(weights > 0))  // nothing is known: all alike
    for (Tile& t : tiles) t.weight = 1;
  const auto paths = [&](double per_weight, bool limited) {
    double sum = 0;
    for (const Tile& t : tiles)
      sum += t.pixels * (limited ? static_cast<double>(goal(t, per_weight, most))
                                 : std::clamp(t.weight * per_weight, static_cast<double>(t.samples), static_cast<double>(most)));
    return sum;
  };
  SamplePlan plan;
  double wanted = kLargestRound * now;
  if (max_error) {
    const double aim = estimate.high > 0 ? kAim * *max_error * estimate.relmse / estimate.high : 0;
    // What would be left, by 1/n.
    const auto gone = [&](double per_weight) {
      double left = 0;
      for (const Tile& t : tiles) {
        const auto had = static_cast<double>(t.samples);
        left += t.pixels * t.error * had / std::clamp(t.weight * per_weight, had, std::max(had, static_cast<double>(most)));
      }
      return 1 - left / error;
    };
    const double needed = error > 0 ? paths(solve(gone, 1 - aim * total_pixels / error), false) : now;
    plan.expected_paths = static_cast<std::uint64_t>(needed);
    wanted = std::clamp(needed, kLeastRound * now, kLargestRound * now);
  }
  const double per_weight = solve([&](double w) { return paths(w, true); }, wanted);
  for (const Tile& t : tiles) plan.goals.push_back(goal(t, per_weight, most));
  return plan;
}

}  // namespace cloudrenderer
