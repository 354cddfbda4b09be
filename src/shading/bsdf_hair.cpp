#include "shading/bsdf_hair.h"

#include <algorithm>
#include <array>

#include "base/portable_math.h"
#include "shading/bsdf_math.h"

namespace cloudrenderer::bsdf {
namespace {

constexpr std::size_t kLast = 3;  // the lobe of all light that is reflected inside twice or more
constexpr double kPiDouble = 3.14159265358979323846;

double square(double x) { return x * x; }
double safe_root(double x) { return std::sqrt(std::max(0.0, x)); }

// ln of the modified Bessel function I0.
double log_bessel(double x) {
  if (x > 12) return x - 0.5 * portable::log(2 * kPiDouble * x) + portable::log(1 + (1 + 9 / (16 * x)) / (8 * x));
  const double quarter = 0.25 * x * x;
  double sum = 1, term = 1;
  for (int k = 1; term > 1e-9 * sum; ++k) {
    term *= quarter / (k * k);
    sum += term;
  }
  return portable::log(sum);
}

// An angle to the plane across the hair.
struct Inclination {
  double sine, cosine;
  Inclination turned(const Inclination& by) const {
    return {sine * by.cosine + cosine * by.sine, cosine * by.cosine - sine * by.sine};
  }
  Inclination back() const { return {-sine, cosine}; }
};

// d'Eon et al. 2011: energy-conserving scattering along the hair, density by solid angle times 2 pi.
double along(const Inclination& i, const Inclination& o, double v) {
  const double a = i.cosine * o.cosine / v, b = i.sine * o.sine / v;
  return portable::exp(log_bessel(a) - b - 1 / v) / (v * (1 - portable::exp(-2 / v)));
}

// The fiber as seen from one direction.
struct View {
  explicit View(const Lobe& l, const Vec3& wo);

  // Density by the angle around the hair, of lobe p < kLast.
  double around(std::size_t p, double phi) const {
    double d = phi - center(p);
    d -= 2 * kPiDouble * std::nearbyint(d / (2 * kPiDouble));
    const double e = portable::exp(-std::fabs(d) / scale), q = portable::exp(-kPiDouble / scale);
    return e / (scale * square(1 + e)) * (1 + q) / (1 - q);  // logistic, cut at pi
  }
  double sample_around(std::size_t p, double u) const {
    if (p == kLast) return 2 * kPiDouble * u;
    const double q = portable::exp(-kPiDouble / scale), low = q / (1 + q), high = 1 / (1 + q);
    const double t = std::clamp(low + u * (high - low), 1e-12, 1 - 1e-12);
    return center(p) + std::clamp(scale * portable::log(t / (1 - t)), -kPiDouble, kPiDouble);
  }
  double center(std::size_t p) const {
    const auto n = static_cast<double>(p);
    return 2 * n * gamma_t - 2 * gamma_o + n * kPiDouble;
  }

  Inclination o;
  double y, z;  // wo's direction around the hair
  double gamma_o, gamma_t, scale;
  std::array<double, kLast + 1> variance;
  std::array<Inclination, kLast + 1> tilt;  // of wi, before the lobe is evaluated; of wo the other way
  bool tilts_out;
  // wo as lobe p takes it.
  Inclination out(std::size_t p) const {
    if (!tilts_out) return o;
    const Inclination turned = o.turned(tilt[p].back());
    return {turned.sine, std::fabs(turned.cosine)};
  }
  std::array<Rgb, kLast + 1> attenuation;
  std::array<double, kLast + 1> chance;
};

View::View(const Lobe& l, const Vec3& wo) {
  const double h = static_cast<double>(l.k.x), eta = static_cast<double>(l.eta.x);
  const double length = std::sqrt(square(static_cast<double>(wo.y)) + square(static_cast<double>(wo.z)));
  o = {static_cast<double>(wo.x), std::max(length, 1e-5)};
  y = length > 0 ? static_cast<double>(wo.y) / length : 1;
  z = length > 0 ? static_cast<double>(wo.z) / length : 0;

  // Refraction along and around the hair (Marschner et al. 2003).
  const double cos_t = std::max(safe_root(1 - square(o.sine / eta)), 1e-5);
  const double eta_around = std::max(safe_root(square(eta) - square(o.sine)) / o.cosine, 1e-5);
  const double sin_gamma_t = std::clamp(h / eta_around, -1.0, 1.0), cos_gamma_t = safe_root(1 - square(sin_gamma_t));
  gamma_o = portable::atan2(h, safe_root(1 - square(h)));
  gamma_t = portable::atan2(sin_gamma_t, cos_gamma_t);
  const auto way = static_cast<float>(2 * cos_gamma_t / cos_t);
  const Rgb through(portable::exp(-l.scale2.x * way), portable::exp(-l.scale2.y * way), portable::exp(-l.scale2.z * way));
  const float f = fresnel_dielectric(static_cast<float>(o.cosine * safe_root(1 - square(h))), l.eta.x);
  attenuation = {Rgb(f), ((1.f - f) * (1.f - f)) * through, Rgb(0.f), Rgb(0.f)};
  attenuation[2] = attenuation[1] * through * f;
  attenuation[3] = attenuation[2] * through * f / glm::max(Rgb(1.f) - through * f, Rgb(1e-6f));
  double sum = 0;
  for (const Rgb& a : attenuation) sum += static_cast<double>(luminance(a));
  for (std::size_t p = 0; p <= kLast; ++p)
    chance[p] = sum > 0 ? static_cast<double>(luminance(attenuation[p])) / sum : 0.25;

  scale = static_cast<double>(l.k.y);
  const double v = static_cast<double>(l.k.z);
  variance = {v, 0.25 * v, 4 * v, 4 * v};
  const Inclination once{static_cast<double>(l.alpha_x), static_cast<double>(l.alpha_y)}, twice = once.turned(once);
  tilt = {twice, once.back(), twice.turned(twice).back(), {0, 1}};
  tilts_out = l.eta.y != 0.f;
}

}  // namespace

Lobe hair(const HairFiber& fiber) {
  const auto in = [](float x, float low, float high) { return x >= low ? std::min(x, high) : low; };  // also for NaN
  Lobe l{};
  l.kind = LobeKind::hair;
  l.transmits = true;
  l.scale = Rgb(1.f);
  l.scale2 = fiber.sigma_a;
  // The second says which direction is tilted.
  l.eta = Rgb(in(fiber.eta, 1e-3f, 1e3f), fiber.tilts_out ? 1.f : 0.f, 1.f);
  const auto power = [](float x, int n) {
    float r = 1.f;
    for (; n > 0; --n) r *= x;
    return r;
  };
  // The fits of Chiang et al. for roughness; none is exactly smooth.
  const float m = in(fiber.beta_m, 1e-2f, 1.f), n = in(fiber.beta_n, 1e-2f, 1.f);
  const float width = 0.726f * m + 0.812f * m * m + 3.7f * power(m, 20);
  constexpr float kRootOfEighthPi = 0.626657069f;
  l.k = {in(fiber.h, -1.f, 1.f), kRootOfEighthPi * (0.265f * n + 1.194f * n * n + 5.372f * power(n, 22)), width * width};
  portable::sincos(in(fiber.alpha, -90.f, 90.f) * (kPi / 180.f), l.alpha_x, l.alpha_y);
  return l;
}

// Per unit of concentration in red, green and blue: d'Eon et al. 2011.
Rgb hair_absorption(float eumelanin, float pheomelanin) {
  return std::max(0.f, eumelanin) * Rgb(0.419f, 0.697f, 1.37f) + std::max(0.f, pheomelanin) * Rgb(0.187f, 0.4f, 1.05f);
}

// The fit of Chiang et al. 2016, section 4.2.
Rgb hair_absorption_of(const Rgb& color, float beta_n) {
  const float b = std::clamp(beta_n, 0.f, 1.f), b2 = b * b;
  const float fit = 5.969f - 0.215f * b + 2.532f * b2 - 10.73f * b2 * b + 5.574f * b2 * b2 + 0.245f * b2 * b2 * b;
  Rgb sigma;
  for (int i = 0; i < 3; ++i) {
    const float root = portable::log(std::clamp(color[i], 1e-6f, 1.f)) / fit;
    sigma[i] = root * root;
  }
  return sigma;
}

Rgb hair_value(const Lobe& l, const Vec3& wo, const Vec3& wi, float& pdf) {
  const View view(l, wo);
  const double iy = static_cast<double>(wi.y), iz = static_cast<double>(wi.z);
  const Inclination i{static_cast<double>(wi.x), std::max(std::sqrt(square(iy) + square(iz)), 1e-9)};
  const double phi = portable::atan2(view.y * iz - view.z * iy, view.y * iy + view.z * iz);
  Rgb sum(0.f);
  double density = 0;
  for (std::size_t p = 0; p <= kLast; ++p) {
    const Inclination t = view.tilts_out ? i : i.turned(view.tilt[p]);
    const double m = along({t.sine, std::fabs(t.cosine)}, view.out(p), view.variance[p]) *
                     (p < kLast ? view.around(p, phi) : 0.5 / kPiDouble);
    sum += view.attenuation[p] * static_cast<float>(m);
    // The tilt stretches solid angles, and no sample comes over the end of the hair.
    density += view.chance[p] * m * std::max(0.0, t.cosine) / i.cosine;
  }
  pdf = density > 1e-20 ? static_cast<float>(density) : 0.f;  // where nothing is sampled, floats lose their bits
  return l.scale * sum * (1.f / std::max(std::fabs(wi.z), 1e-10f));
}

bool sample_hair(const Lobe& l, const Vec3& wo, float u, const Vec2& u2, Vec3& wi) {
  const View view(l, wo);
  std::size_t p = 0;
  double rest = static_cast<double>(u);
  while (p < kLast && rest >= view.chance[p]) rest -= view.chance[p++];
  rest = std::clamp(rest / std::max(view.chance[p], 1e-12), 0.0, 1.0);

  const double v = view.variance[p], e = portable::exp(-2 / v);
  const double from = static_cast<double>(u2.x);
  const double cosine = std::max(-1.0, 1 + v * portable::log(std::max(from + (1 - from) * e, 1e-300)));
  float s, c;
  portable::sincos_turn(u2.y, s, c);
  const Inclination o = view.out(p);
  Inclination i{-cosine * o.sine + safe_root(1 - square(cosine)) * static_cast<double>(c) * o.cosine, 0};
  i.sine = std::clamp(i.sine, -1.0, 1.0);
  i.cosine = safe_root(1 - square(i.sine));
  if (!view.tilts_out) i = i.turned(view.tilt[p].back());
  if (!(i.cosine > 0)) return false;
  const double phi = view.sample_around(p, rest);
  const double ci = portable::cos(phi), si = portable::sin(phi);
  wi = Vec3(i.sine, i.cosine * (ci * view.y - si * view.z), i.cosine * (si * view.y + ci * view.z));
  return true;
}

}  // namespace cloudrenderer::bsdf
