#pragma once
// Pearson's test of sampled directions against their density.
#include <algorithm>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>
#include <vector>

#include "cloudrenderer/math.h"

namespace cloudrenderer::testing {

// Chance of a false alarm in all tests of one executable together, whatever their number (Sidak 1967).
inline double corrected_level(int tests, double all = 0.001) { return 1 - std::pow(1 - all, 1.0 / tests); }

// The sphere in cells of equal solid angle: z and phi.
class SphereCells {
 public:
  explicit SphereCells(int rows = 16, int columns = 32)
      : rows_(rows), columns_(columns), seen_(static_cast<std::size_t>(rows * columns)), expected_(seen_.size()) {}

  static Vec3 direction(double z, double phi) {
    const double r = std::sqrt(std::max(0.0, 1 - z * z));
    return {static_cast<float>(r * std::cos(phi)), static_cast<float>(r * std::sin(phi)), static_cast<float>(z)};
  }

  void add(const Vec3& w) {
    const double phi = std::atan2(static_cast<double>(w.y), static_cast<double>(w.x)) / (2 * kPiDouble) + 0.5;
    const int row = std::clamp(static_cast<int>((static_cast<double>(w.z) * 0.5 + 0.5) * rows_), 0, rows_ - 1);
    const int column = std::clamp(static_cast<int>(phi * columns_), 0, columns_ - 1);
    ++seen_[static_cast<std::size_t>(row * columns_ + column)];
  }
  // Integrates the density over every cell, finer where it changes; returns the whole integral. Each cell begins as `parts` by
  // `parts` pieces: many for densities with edges, which few points may miss.
  template <class Density>
  double integrate(Density density, int parts = 2) {
    double sum = 0;
    for (int row = 0; row < rows_; ++row)
      for (int column = 0; column < columns_; ++column) {
        double& e = expected_[static_cast<std::size_t>(row * columns_ + column)];
        const double height = 2.0 / (rows_ * parts), width = 2 * kPiDouble / (columns_ * parts);
        for (int i = 0; i < parts * parts; ++i) {
          const double z = -1 + height * (row * parts + i / parts);
          const double phi = -kPiDouble + width * (column * parts + i % parts);
          e += refine(density, z, phi, height, width, four(density, z, phi, height, width), 7);
        }
        sum += e;
      }
    return sum;
  }
  // The chance of a worse fit of `samples` samples, those without direction included, if the density is theirs. Cells with
  // few are pooled.
  double p_value(int samples) const {
    constexpr double kFew = 8;
    double chi2 = 0, pooled_seen = 0, pooled_expected = 0;
    int cells = 0;
    const auto add_cell = [&](double seen, double expected) {
      chi2 += (seen - expected) * (seen - expected) / expected;
      ++cells;
    };
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      const double expected = expected_[i] * samples;
      if (expected >= kFew) {
        add_cell(seen_[i], expected);
      } else {
        pooled_seen += seen_[i];
        pooled_expected += expected;
      }
    }
    if (pooled_expected >= kFew)
      add_cell(pooled_seen, pooled_expected);
    else if (pooled_seen > pooled_expected + 30)
      return 0;  // samples where there is no density
    return cells > 0 ? boost::math::gamma_q(0.5 * cells, 0.5 * chi2) : 1;
  }

 private:
  static constexpr double kPiDouble = 3.14159265358979323846;

  // Gauss's rule of two by two points.
  template <class Density>
  static double four(Density& density, double z, double phi, double height, double width) {
    constexpr double kNode = 0.21132486540518711775;
    double sum = 0;
    for (const double a : {kNode, 1 - kNode})
      for (const double b : {kNode, 1 - kNode}) sum += static_cast<double>(density(direction(z + a * height, phi + b * width)));
    return 0.25 * sum * height * width;
  }
  template <class Density>
  static double refine(Density& density, double z, double phi, double height, double width, double coarse, int levels) {
    const double h = height / 2, w = width / 2;
    double pieces[4], fine = 0;
    for (int i = 0; i < 4; ++i) fine += pieces[i] = four(density, z + h * (i / 2), phi + w * (i % 2), h, w);
    if (levels == 0 || std::fabs(fine - coarse) < 1e-6 + 1e-4 * fine) return fine;
    fine = 0;
    for (int i = 0; i < 4; ++i) fine += refine(density, z + h * (i / 2), phi + w * (i % 2), h, w, pieces[i], levels - 1);
    return fine;
  }

  int rows_, columns_;
  std::vector<double> seen_, expected_;
};

}  // namespace cloudrenderer::testing
