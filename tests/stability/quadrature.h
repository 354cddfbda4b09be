#pragma once
// Integrals that sampling noise would not reach: adaptive Gauss quadrature in two dimensions.
#include <array>
#include <cmath>
#include <cstdint>
#include <queue>
#include <vector>

#include "cloudrenderer/math.h"

namespace cloudrenderer::stability {

inline constexpr double kPiDouble = 3.14159265358979323846;

inline Vec3 direction(double z, double phi) {
  const double r = std::sqrt(std::max(0.0, 1 - z * z));
  return {static_cast<float>(r * std::cos(phi)), static_cast<float>(r * std::sin(phi)), static_cast<float>(z)};
}

// Integrates f over the rectangle [x0, x1] x [y0, y1]. The piece whose rules of 4 and 9 points differ most is cut next,
// until the differences sum to less than the tolerance. Pieces that hold a point of `peaks` are cut beforehand: few points miss a
// narrow peak.
class Quadrature {
 public:
  struct Point {
    double x, y, width;
  };
  explicit Quadrature(double tolerance = 5e-5, std::size_t most = 60'000) : tolerance_(tolerance), most_(most) {}

  template <class F>
  double integrate(F&& f, double x0, double x1, double y0, double y1, const std::vector<Point>& peaks = {}, int nx = 4, int ny = 8) const {
    std::priority_queue<Piece> pieces;
    double errors = 0;
    const auto add = [&](const Piece& p) {
      errors += p.error;
      pieces.push(p);
    };
    const double w = (x1 - x0) / nx, h = (y1 - y0) / ny;
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j)
        at_peaks(f, x0 + w * i, y0 + h * j, w, h, peaks, add);
    while (errors > tolerance_ && pieces.size() < most_) {
      const Piece p = pieces.top();
      pieces.pop();
      errors -= p.error;
      for (int i = 0; i < 4; ++i) add(piece(f, p.x + (i / 2) * p.w / 2, p.y + (i % 2) * p.h / 2, p.w / 2, p.h / 2));
    }
    double sum = 0;
    for (; !pieces.empty(); pieces.pop()) sum += pieces.top().value;
    return sum;
  }

 private:
  struct Piece {
    double x, y, w, h, value, error;
    bool operator<(const Piece& o) const { return error < o.error; }
  };
  template <class F>
  static Piece piece(F& f, double x, double y, double w, double h) {
    constexpr std::array<double, 3> kNode{0.11270166537925831, 0.5, 0.88729833462074169}, kWeight{5.0 / 18, 8.0 / 18, 5.0 / 18};
    constexpr std::array<double, 2> kTwo{0.21132486540518711, 0.78867513459481289};
    double nine = 0, four = 0;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) nine += kWeight[i] * kWeight[j] * f(x + kNode[i] * w, y + kNode[j] * h);
    for (const double a : kTwo)
      for (const double b : kTwo) four += 0.25 * f(x + a * w, y + b * h);
    return {x, y, w, h, nine * w * h, std::fabs(nine - four) * w * h};
  }
  template <class F, class Add>
  static void at_peaks(F& f, double x, double y, double w, double h, const std::vector<Point>& peaks, Add& add) {
    for (const Point& p : peaks)
      if (p.x >= x && p.x <= x + w && p.y >= y && p.y <= y + h && std::max(w, h) > p.width) {
        for (int i = 0; i < 4; ++i) at_peaks(f, x + (i / 2) * w / 2, y + (i % 2) * h / 2, w / 2, h / 2, peaks, add);
        return;
      }
    add(piece(f, x, y, w, h));
  }

  double tolerance_;
  std::size_t most_;
};

// Over both hemispheres around z, by height and azimuth: so the horizon is an edge of pieces. Peaks: directions.
template <class Density>
double integrate_sphere(Density&& density, const std::vector<std::pair<Vec3, double>>& peaks = {}, const Quadrature& q = Quadrature()) {
  std::vector<Quadrature::Point> points;
  for (const auto& [w, width] : peaks) {
    const double phi = std::atan2(static_cast<double>(w.y), static_cast<double>(w.x));
    points.push_back({static_cast<double>(w.z), phi < 0 ? phi + 2 * kPiDouble : phi, width});
  }
  const auto f = [&](double z, double phi) { return static_cast<double>(density(direction(z, phi))); };
  return q.integrate(f, -1, 0, 0, 2 * kPiDouble, points, 16, 32) + q.integrate(f, 0, 1, 0, 2 * kPiDouble, points, 16, 32);
}

// Point i of a Kronecker sequence in three dimensions (powers of the plastic number's cousin, the root of x^4 = x + 1):
// even to about 1/N, without randomness.
inline glm::dvec3 even_point(std::uint64_t i) {
  constexpr double kRoot = 1.2207440846057596;
  const double n = static_cast<double>(i) + 0.5;
  const glm::dvec3 p = n * glm::dvec3(1 / kRoot, 1 / (kRoot * kRoot), 1 / (kRoot * kRoot * kRoot));
  return p - glm::floor(p);
}
inline float below_one(double x) { return std::min(static_cast<float>(x), 0x1.fffffep-1f); }

}  // namespace cloudrenderer::stability
