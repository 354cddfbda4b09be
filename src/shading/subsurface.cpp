#include "shading/subsurface.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "base/portable_math.h"
#include "shading/bsdf_lobes.h"
#include "shading/bsdf_math.h"

namespace cloudrenderer {
namespace {

constexpr unsigned kBits = 20;       // of a coefficient: the upper ones of a float without its sign
constexpr float kGSteps = 127.f;
constexpr std::size_t kTable = 128;  // steps of sqrt(1 - albedo)
constexpr int kNodes = 12;           // of an interval in which Fresnel's formulas are smooth

std::uint64_t to_bits(float coefficient) {
  const auto bits = std::bit_cast<std::uint32_t>(std::clamp(coefficient, 0.f, 1e30f));
  return (bits + (1u << (30 - kBits))) >> (31 - kBits);
}
float from_bits(std::uint64_t bits) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(bits & ((1u << kBits) - 1u)) << (31 - kBits));
}

struct GaussNode {
  double x, weight;
};
// Nodes and weights in [0, 1], by Newton's iteration on Legendre's polynomial.
std::vector<GaussNode> gauss_legendre(int n) {
  std::vector<GaussNode> out;
  for (int i = 0; i < n; ++i) {
    double x = portable::cos(3.14159265358979323846 * (i + 0.75) / (n + 0.5)), slope = 1;
    for (int step = 0; step < 8; ++step) {
      double p = 1, before = 0;
      for (int k = 1; k <= n; ++k) {
        const double next = ((2 * k - 1) * x * p - (k - 1) * before) / k;
        before = p;
        p = next;
      }
      slope = n * (x * p - before) / (x * x - 1);
      x -= p / slope;
    }
    out.push_back({(1 - x) / 2, 1 / ((1 - x * x) * slope * slope)});
  }
  return out;
}

// Unpolarised; eta: index beyond over that on the light's side.
double reflected_share(double cosine, double eta) {
  const double sine2 = (1 - cosine * cosine) / (eta * eta);
  if (sine2 >= 1) return 1;
  const double t = std::sqrt(1 - sine2);
  const double parallel = (eta * cosine - t) / (eta * cosine + t), crossed = (cosine - eta * t) / (cosine + eta * t);
  return (parallel * parallel + crossed * crossed) / 2;
}

double critical_cosine(double eta) { return eta > 1 ? std::sqrt(1 - 1 / (eta * eta)) : 0; }

// x = b + A x for matrices of positive numbers with row sums below 1: no pivots are needed.
std::vector<double> solve(std::vector<double> a, std::vector<double> b) {
  const std::size_t n = b.size();
  for (std::size_t i = 0; i < n * n; ++i) a[i] = (i % (n + 1) == 0 ? 1 : 0) - a[i];
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t i = k + 1; i < n; ++i) {
      const double f = a[i * n + k] / a[k * n + k];
      for (std::size_t j = k; j < n; ++j) a[i * n + j] -= f * a[k * n + j];
      b[i] -= f * b[k];
    }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t j = i + 1; j < n; ++j) b[i] -= a[i * n + j] * b[j];
    b[i] /= a[i * n + i];
  }
  return b;
}

}  // namespace

std::array<std::uint32_t, 4> InteriorMedium::pack() const {
  const auto three = [](const Rgb& c) { return to_bits(c.x) | to_bits(c.y) << kBits | to_bits(c.z) << (2 * kBits); };
  const auto g_steps = static_cast<std::uint64_t>(std::nearbyint((g + 1.f) * kGSteps));  // 8 bits: 4 of them in each word
  const std::uint64_t a = three(sigma_a) | (g_steps & 15u) << 60, s = three(sigma_s) | (g_steps >> 4 & 15u) << 60;
  const auto half = [](std::uint64_t x) { return static_cast<std::uint32_t>(x); };
  return {half(a), half(a >> 32), half(s), half(s >> 32)};
}

InteriorMedium InteriorMedium::unpack(const std::array<std::uint32_t, 4>& bits) {
  const auto word = [&](std::size_t i) {
    return std::uint64_t{bits[i]} | std::uint64_t{bits[i + 1]} << 32;
  };
  const auto three = [](std::uint64_t x) { return Rgb(from_bits(x), from_bits(x >> kBits), from_bits(x >> (2 * kBits))); };
  const std::uint64_t a = word(0), s = word(2);
  return {three(a), three(s), static_cast<float>(a >> 60 | s >> 60 << 4) / kGSteps - 1.f};
}

InteriorMedium rounded_g(InteriorMedium m) {
  const float g = std::clamp(std::nearbyint((m.g + 1.f) * kGSteps), 1.f, 2 * kGSteps - 1.f) / kGSteps - 1.f;
  m.sigma_s *= (1.f - m.g) / (1.f - g);
  m.g = g;
  return m;
}

HalfSpaceAlbedo::HalfSpaceAlbedo(float eta_entry, float eta_exit) {
  const double entry = static_cast<double>(eta_entry), exit = static_cast<double>(eta_exit);
  std::array<double, 4> cuts{0, critical_cosine(entry), critical_cosine(exit), 1};
  std::sort(cuts.begin(), cuts.end());
  const std::vector<GaussNode> gauss = gauss_legendre(kNodes);
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
    const double width = cuts[i + 1] - cuts[i];
    if (!(width > 0)) continue;
    for (const GaussNode& n : gauss) {
      const double c = cuts[i] + width * n.x;
      nodes_.push_back({c, width * n.weight, 1 - reflected_share(c, 1 / entry), reflected_share(c, 1 / exit)});
    }
  }
  for (std::size_t i = 0; i <= kTable; ++i) {
    const double root = static_cast<double>(i) / static_cast<double>(kTable);
    table_.push_back(reflectance(1 - root * root));
  }
}

double HalfSpaceAlbedo::reflectance(double albedo) const {
  const std::size_t n = nodes_.size();
  std::vector<double> kernel(n * n), h(n, 1.0), sums(n), b(n, 0.0);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j)
      kernel[i * n + j] = nodes_[j].cosine * nodes_[j].weight / (nodes_[i].cosine + nodes_[j].cosine);
  // Chandrasekhar's equation for H in the form that converges for an albedo of 1 too.
  const double root = std::sqrt(std::max(0.0, 1 - albedo));
  for (int step = 0; step < 50; ++step) {
    for (std::size_t i = 0; i < n; ++i) {
      sums[i] = 0;
      for (std::size_t j = 0; j < n; ++j) sums[i] += kernel[i * n + j] * h[j];
    }
    for (std::size_t i = 0; i < n; ++i) h[i] = 0.5 * (h[i] + 1 / (root + albedo / 2 * sums[i]));
  }
  // Upward radiance below the boundary: of what enters, and of what the boundary sends back.
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) {
      double& k = kernel[i * n + j];
      k *= albedo / 2 * h[i] * h[j];
      b[i] += k * nodes_[j].entering;
      k *= nodes_[j].reflected;
    }
  const std::vector<double> up = solve(std::move(kernel), std::move(b));
  double entered = 0, left = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const Node& m = nodes_[i];
    entered += m.weight * m.cosine * m.entering;
    left += m.weight * m.cosine * (1 - m.reflected) * up[i];
  }
  return left / entered;
}

float HalfSpaceAlbedo::single_scattering(float reflectance) const {
  const double wanted = static_cast<double>(reflectance);
  if (!(wanted > 0)) return 0.f;
  if (wanted >= table_.front()) return 1.f;
  // The table decreases.
  const auto after = static_cast<std::size_t>(
      std::find_if(table_.begin(), table_.end(), [&](double r) { return r <= wanted; }) - table_.begin());
  const double high = table_[after - 1], low = table_[after];
  const double root = (static_cast<double>(after) - (wanted - low) / (high - low)) / static_cast<double>(kTable);
  return static_cast<float>(1 - root * root);
}

float bsdf::diffuse_transmittance(float eta) {
  static const std::vector<GaussNode> nodes = gauss_legendre(2 * kNodes);  // walks ask at every exit
  // Radiance over the index squared is conserved both ways; from the dense side the integrand has a kink.
  if (eta < 1.f) return eta * eta * diffuse_transmittance(1.f / eta);
  double passed = 0;
  for (const GaussNode& n : nodes) passed += 2 * n.x * n.weight * (1 - reflected_share(n.x, static_cast<double>(eta)));
  return static_cast<float>(passed);
}

Lobe bsdf::diffuse_exit(float eta) {
  Lobe l = lambert(Rgb(1.f));
  l.kind = LobeKind::diffuse_exit;
  const float index = eta > 1e-4f && eta < 1e4f ? eta : 1.f;
  l.eta = {index, 1.f / index, 0.f};
  l.scale = Rgb(1.f / diffuse_transmittance(index));
  return l;
}

}  // namespace cloudrenderer
