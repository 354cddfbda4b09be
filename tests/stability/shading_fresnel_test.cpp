// Fresnel's formulas and refraction from index 1 to 3 and beyond, down to grazing angles, against double precision.
#include <complex>
#include <tuple>

#include "quadrature.h"
#include "record.h"
#include "shading/bsdf_lobes.h"
#include "shading/bsdf_math.h"

namespace cloudrenderer::stability {
namespace {

double exact_dielectric(double c, double eta) {
  const double g2 = (eta - 1) * (eta + 1) + c * c;
  if (g2 <= 0) return 1;
  const double g = std::sqrt(g2), rs = (c - g) / (c + g), rp = (g - eta * eta * c) / (g + eta * eta * c);
  return 0.5 * (rs * rs + rp * rp);
}

double exact_conductor(double c, double n, double k) {
  const std::complex<double> eta(n, k), t = std::sqrt(eta * eta - (1 - c * c));
  const std::complex<double> rs = (c - t) / (c + t), rp = (eta * eta * c - t) / (eta * eta * c + t);
  return 0.5 * (std::norm(rs) + std::norm(rp));
}

// How far f lies from its exact value, in units of what the rounding of its arguments would change of it (half a bit of
// each), and of 2^-24 for the result's own.
template <class Exact, class... Arguments>
double in_roundings(double found, Exact exact, Arguments... x) {
  std::array<double, sizeof...(x)> arguments{x...};
  const double value = std::apply(exact, arguments);
  double moved = 0x1p-24;
  for (double& argument : arguments)
    for (const double factor : {1 - 0x1p-24, 1 + 0x1p-24}) {
      const double given = argument;
      argument = given * factor;
      moved = std::max(moved, std::fabs(std::apply(exact, arguments) - value));
      argument = given;
    }
  return std::fabs(found - value) / moved;
}

constexpr float kIndices[] = {1.f, 1.000001f, 1.0001f, 1.33f, 1.5f, 3.f};

TEST(Fresnel, OfDielectricsIsExactToRounding) {
  double worst = 0, above = 0;
  std::uint64_t n = 0;
  for (const float index : kIndices)
    for (const float eta : {index, 1.f / index})
      for (double lc = -7; lc <= 0; lc += 0.0007, ++n) {
        const auto c = static_cast<float>(std::pow(10.0, lc));
        const float r = bsdf::fresnel_dielectric(c, eta);
        worst = std::max(worst, in_roundings(static_cast<double>(r), exact_dielectric, static_cast<double>(c), static_cast<double>(eta)));
        above = std::max({above, static_cast<double>(r) - 1, -static_cast<double>(r)});
      }
  record("dielectrics of index 1, 1+1e-6, 1+1e-4, 1.33, 1.5, 3 from both sides, cosines 1e-7 to 1", "error of the reflectance / that of rounded arguments", 8, worst, n);
  record("dielectrics of index 1, 1+1e-6, 1+1e-4, 1.33, 1.5, 3 from both sides, cosines 1e-7 to 1", "beyond [0, 1]", 0, above, n);
}

TEST(Fresnel, OfConductorsIsExactToRounding) {
  double worst = 0, below = 0, below_v2 = 0;
  std::uint64_t count = 0;
  for (double n = 1e-3; n < 20; n *= 1.31)
    for (double k = 1e-6; k < 50; k *= 1.47)
      for (double lc = -6; lc <= 0; lc += 0.03, ++count) {
        const auto cf = static_cast<float>(std::pow(10.0, lc)), nf = static_cast<float>(n), kf = static_cast<float>(k);
        const float r = bsdf::conductor_channel(cf, nf, kf);
        worst = std::max(worst, in_roundings(static_cast<double>(r), exact_conductor, static_cast<double>(cf), static_cast<double>(nf), static_cast<double>(kf)));
        below = std::max({below, -static_cast<double>(r), static_cast<double>(r) - 1});
        // The zeros of the approximation lie at n = 1 / c and n = c.
        for (const float at : {nf, 1.f / cf, cf}) below_v2 = std::max(below_v2, -static_cast<double>(bsdf::conductor_channel_v2(cf, at, at == nf ? kf : 0.f)));
        below = std::max(below, -static_cast<double>(bsdf::conductor_channel(cf, 1.f, 0.f)));
      }
  record("conductors of n 1e-3 to 20, k 1e-6 to 50, cosines 1e-6 to 1", "error of the reflectance / that of rounded arguments", 16, worst, count);
  record("conductors of n 1e-3 to 20, k 1e-6 to 50, cosines 1e-6 to 1", "beyond [0, 1]", 2e-7, below, count);
  record("pbrt-v2's conductors where they reflect nothing", "below 0", 0, below_v2, count);
}

// Snell's law by the sines, which for grazing rays says nothing: so the cosine too.
TEST(Refraction, IsExactToRounding) {
  double sine = 0, cosine = 0;
  std::uint64_t n = 0;
  for (const float index : kIndices)
    for (const float eta : {index, 1.f / index})
      for (double lc = -6; lc <= 0; lc += 0.0011, ++n) {
        const double c = std::pow(10.0, lc);
        const Vec3 wo = direction(c, 0.7);
        const double co = static_cast<double>(wo.z), e = static_cast<double>(eta);
        const double t2 = ((e - 1) * (e + 1) + co * co) / (e * e);
        Vec3 wi;
        const bool passes = bsdf::refract(wo, {0, 0, 1}, eta, wi);
        if (std::fabs(t2) > 1e-12) {
          EXPECT_EQ(passes, t2 > 0) << "cosine " << c << ", index " << eta;
        }
        if (!passes || !(t2 > 0)) continue;
        const glm::dvec3 w = glm::normalize(glm::dvec3(wi)), from(wo);
        sine = std::max(sine, std::hypot(w.x + from.x / e, w.y + from.y / e));
        const auto exact = [](double cosine_in, double ratio) {
          return std::sqrt(std::max(0.0, ((ratio - 1) * (ratio + 1) + cosine_in * cosine_in) / (ratio * ratio)));
        };
        cosine = std::max(cosine, in_roundings(-w.z, exact, co, e));
      }
  record("refraction at index 1, 1+1e-6, 1+1e-4, 1.33, 1.5, 3 from both sides, cosines 1e-6 to 1", "error of the direction along the surface", 4e-7, sine, n);
  record("refraction at index 1, 1+1e-6, 1+1e-4, 1.33, 1.5, 3 from both sides, cosines 1e-6 to 1", "error of the cosine / that of rounded arguments", 8, cosine, n);
}

// What goes in and what comes out of a smooth or thin sheet of glass of index 1 to 3 sums to 1, and index 1 changes nothing.
TEST(Refraction, KeepsAllLight) {
  double worst = 0, bent = 0;
  std::uint64_t n = 0;
  for (const float index : kIndices)
    for (const bool thin : {false, true})
      for (double lc = -6; lc <= 0; lc += 0.01)
        for (const double side : {1.0, -1.0}) {
          Bsdf b(Frame(), Vec3(0, 0, 1));
          b.add(thin ? bsdf::thin_dielectric(index) : bsdf::specular_dielectric(Rgb(1.f), Rgb(1.f), index, false));
          const Vec3 wo = direction(side * std::pow(10.0, lc), 2.1);
          b.finish(wo);
          for (int i = 0; i < 64; ++i, ++n) {
            BsdfSample s;
            if (!b.sample(wo, (static_cast<float>(i) + 0.5f) / 64, Vec2(0.5f), s)) {
              worst = 1;
              continue;
            }
            worst = std::max(worst, std::fabs(static_cast<double>(s.weight.x) - 1));
            if (index == 1.f) bent = std::max(bent, static_cast<double>(glm::length(s.wi + wo)));
          }
        }
  record("smooth and thin glass of index 1 to 3, cosines 1e-6 to 1", "error of a sample's weight of 1", 1e-6, worst, n);
  record("smooth and thin glass of index 1, cosines 1e-6 to 1", "bend of the ray", 1e-6, bent, n);
}

}  // namespace
}  // namespace cloudrenderer::stability
