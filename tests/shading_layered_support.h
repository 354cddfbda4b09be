#pragma once
// Light through a coat and back, in the plainest way: rays of light with places in a slab, in double precision. Microfacets are
// drawn from their distribution itself and weighed (Walter et al., "Microfacet Models for Refraction through Rough
// Surfaces", 2007), at a facet a coin tells reflection from refraction, and what leaves is counted in cells.
#include <cmath>
#include <complex>
#include <random>
#include <vector>

#include "cloudrenderer/math.h"
#include "shading/bsdf_layered.h"

namespace cloudrenderer::testing {

struct ReferenceBase {
  bool diffuse = true;
  glm::dvec3 reflectance{0.5};
  glm::dvec3 eta{1}, k{0};  // of a conductor, relative to the coat
  double alpha_x = 0, alpha_y = 0;
};

class LayerReference {
 public:
  static constexpr int kRows = 4, kColumns = 8, kCells = kRows * kColumns;
  using V = glm::dvec3;

  LayerReference(const bsdf::Coat& coat, const ReferenceBase& base, std::uint32_t seed)
      : eta_(coat.eta), ax_(coat.alpha_x), ay_(coat.alpha_y), thickness_(coat.thickness), g_(coat.g), albedo_(coat.albedo),
        base_(base), random_(seed) {}

  struct Cell {
    V mean{0}, error{0};  // power that leaves through the cell, its standard error
  };
  // Light that comes along wo (outside, away from the slab), of which what the coat reflects at once is left out unless asked.
  std::vector<Cell> trace(const V& wo, int rays, bool first_reflection = false) {
    std::vector<V> sum(kCells, V(0)), squares(kCells, V(0));
    for (int i = 0; i < rays; ++i) {
      V out, weight;
      if (!follow(wo, first_reflection, out, weight)) continue;
      const auto cell = static_cast<std::size_t>(cell_of(out));
      sum[cell] += weight;
      squares[cell] += weight * weight;
    }
    std::vector<Cell> cells(kCells);
    for (std::size_t i = 0; i < kCells; ++i) {
      const V mean = sum[i] / static_cast<double>(rays);
      cells[i] = {mean, glm::sqrt(glm::max(V(0), squares[i] / static_cast<double>(rays) - mean * mean) / static_cast<double>(rays))};
    }
    return cells;
  }
  // Cells of equal projected solid angle; `u`, `v` in [0, 1).
  static Vec3 direction_in(int cell, double u, double v) {
    const double s2 = (cell / kColumns + u) / kRows, phi = 2 * kPiDouble * ((cell % kColumns + v) / kColumns - 0.5);
    const double s = std::sqrt(s2);
    return {static_cast<float>(s * std::cos(phi)), static_cast<float>(s * std::sin(phi)), static_cast<float>(std::sqrt(1 - s2))};
  }

  static int cell_of(const V& w) {
    const double s2 = w.x * w.x + w.y * w.y;
    const int row = std::min(static_cast<int>(s2 * kRows), kRows - 1);
    const int column = std::clamp(static_cast<int>((std::atan2(w.y, w.x) / (2 * kPiDouble) + 0.5) * kColumns), 0, kColumns - 1);
    return row * kColumns + column;
  }

 private:
  static constexpr double kPiDouble = 3.14159265358979323846;

  double uniform() { return uniform_(random_); }

  // Of the share of light in s and in p polarisation, by Snell and Fresnel.
  static double fresnel(double c, double n1, double n2) {
    const double s = n1 / n2 * std::sqrt(std::max(0.0, 1 - c * c));
    if (s >= 1) return 1;
    const double t = std::sqrt(1 - s * s);
    const double rs = (n1 * c - n2 * t) / (n1 * c + n2 * t), rp = (n1 * t - n2 * c) / (n1 * t + n2 * c);
    return 0.5 * (rs * rs + rp * rp);
  }
  static double fresnel_metal(double c, double n, double k) {
    const std::complex<double> m(n, k), t = std::sqrt(1.0 - (1 - c * c) / (m * m));
    return 0.5 * (std::norm((c - m * t) / (c + m * t)) + std::norm((m * c - t) / (m * c + t)));
  }

  // A normal by its density D cos, z > 0.
  V facet(double ax, double ay) {
    if (ax == 0) return {0, 0, 1};
    const double u = uniform(), r = std::sqrt(u / (1 - u)), phi = 2 * kPiDouble * uniform();
    return glm::normalize(V(-ax * r * std::cos(phi), -ay * r * std::sin(phi), 1));
  }
  static double lambda(const V& w, double ax, double ay) {
    const double t2 = (ax * ax * w.x * w.x + ay * ay * w.y * w.y) / (w.z * w.z);
    return 0.5 * (std::sqrt(1 + t2) - 1);
  }
  // What a facet drawn by D cos counts for light from `a` to `b`; masking of both together.
  static double weight(const V& a, const V& b, const V& m, double ax, double ay) {
    if (ax == 0) return 1;
    return std::fabs(glm::dot(a, m) / (a.z * m.z)) / (1 + lambda(a, ax, ay) + lambda(b, ax, ay));
  }

  // Light that goes along `w` meets the coat from above or from below. 0 where it ends.
  double meet_coat(V& w, bool& passes) {
    const bool from_above = w.z < 0;
    const V a = -w;  // towards where it comes from
    V m = facet(ax_, ay_);
    if (!from_above) m = -m;
    const double c = glm::dot(a, m), n1 = from_above ? 1 : eta_, n2 = from_above ? eta_ : 1;
    if (c <= 0) return 0;
    V b;
    passes = uniform() >= fresnel(c, n1, n2);
    if (passes) {
      const double r = n1 / n2;
      b = -r * a + (r * c - std::sqrt(std::max(0.0, 1 - r * r * (1 - c * c)))) * m;
      if (b.z * a.z >= 0) return 0;
    } else {
      b = 2 * c * m - a;
      if (b.z * a.z <= 0) return 0;
    }
    w = b;
    return weight(a, b, m, ax_, ay_);
  }
  V meet_base(V& w) {
    if (base_.diffuse) {
      const double s2 = uniform(), phi = 2 * kPiDouble * uniform(), s = std::sqrt(s2);
      w = {s * std::cos(phi), s * std::sin(phi), std::sqrt(1 - s2)};
      return base_.reflectance;
    }
    const V a = -w, m = facet(base_.alpha_x, base_.alpha_y);
    const double c = glm::dot(a, m);
    w = 2 * c * m - a;
    if (c <= 0 || w.z <= 0) return V(0);
    V f;
    for (int i = 0; i < 3; ++i) f[i] = fresnel_metal(c, base_.eta[i], base_.k[i]);
    return f * weight(a, w, m, base_.alpha_x, base_.alpha_y);
  }
  void scatter(V& w) {
    const double u = uniform(), phi = 2 * kPiDouble * uniform();
    double c = 1 - 2 * u;
    if (std::fabs(g_) > 1e-3) {
      const double q = (1 - g_ * g_) / (1 - g_ + 2 * g_ * u);
      c = (1 + g_ * g_ - q * q) / (2 * g_);
    }
    const V side = glm::normalize(glm::cross(w, std::fabs(w.x) < 0.5 ? V(1, 0, 0) : V(0, 1, 0))), other = glm::cross(w, side);
    const double s = std::sqrt(std::max(0.0, 1 - c * c));
    w = glm::normalize(c * w + s * (std::cos(phi) * side + std::sin(phi) * other));
  }

  bool follow(const V& wo, bool first_reflection, V& out, V& weight) {
    V w = -wo, p(0, 0, thickness_);
    bool passes = false;
    weight = V(meet_coat(w, passes));
    if (!passes) {
      out = w;
      return first_reflection && weight.x > 0;
    }
    while (weight.x + weight.y + weight.z > 0) {
      const double end = (w.z < 0 ? p.z : thickness_ - p.z) / std::fabs(w.z), free = -std::log(1 - uniform());
      if (free < end) {
        p += free * w;
        weight *= albedo_;
        scatter(w);
      } else {
        p += end * w;
        p.z = w.z < 0 ? 0 : thickness_;
        if (w.z < 0) {
          weight *= meet_base(w);
        } else {
          weight *= meet_coat(w, passes);
          if (passes && weight.x + weight.y + weight.z > 0) {
            out = w;
            return true;
          }
        }
      }
      const double most = std::max(weight.x, std::max(weight.y, weight.z));
      if (most < 0.1) {
        if (uniform() >= 10 * most) return false;
        weight *= 0.1 / most;
      }
    }
    return false;
  }

  double eta_, ax_, ay_, thickness_, g_;
  V albedo_;
  ReferenceBase base_;
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> uniform_{0, 1};
};

}  // namespace cloudrenderer::testing
