#pragma once
// Fresnel terms and microfacet distributions in the shading frame (z = normal). Inline: one
// translation unit sees all.
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "base/portable_math.h"
#include "cloudrenderer/math.h"
#include "shading/bsdf.h"

namespace cloudrenderer::bsdf {

// Unpolarised reflectance for a cosine c >= 0; eta is the index beyond over the index on the
// incident side (the form of Cook and Torrance 1982: one square root).
inline float fresnel_dielectric(float c, float eta) {
  c = std::max(c, 1e-10f);
  // Total internal reflection needs no branch: with g = 0 the formula gives 1.
  const float g = std::sqrt(std::max(0.f, eta * eta - 1.f + c * c)), sum = g + c,
              difference = g - c;
  const float a = difference / sum, b = (c * sum - 1.f) / (c * difference + 1.f);
  return 0.5f * a * a * (1.f + b * b);
}

// Exact, for a metal of index eta + i k seen from vacuum.
inline Rgb fresnel_conductor(float c, const Rgb& eta, const Rgb& k) {
  const float c2 = c * c, s2 = std::max(0.f, 1.f - c2);
  // four lanes, so that the compiler makes vector instructions of it
  const std::array<float, 4> n{eta.x, eta.y, eta.z, eta.z}, absorption{k.x, k.y, k.z, k.z};
  std::array<float, 4> out;
  for (std::size_t i = 0; i < 4; ++i) {
    const float e2 = n[i] * n[i], k2 = absorption[i] * absorption[i];
    const float t0 = e2 - k2 - s2;
    const float ab = std::sqrt(t0 * t0 + 4.f * e2 * k2);  // a^2 + b^2
    const float a2 = 2.f * c * std::sqrt(std::max(0.f, 0.5f * (ab + t0)));
    const float t1 = ab + c2;
    const float t3 = c2 * ab + s2 * s2, t4 = a2 * s2;
    const float den = (t1 + a2) * (t3 + t4);
    // rs = (t1-a2)/(t1+a2), rp = rs (t3-t4)/(t3+t4); their mean over one denominator
    out[i] = (t1 - a2) * t3 / std::max(den, 1e-30f);
  }
  return {out[0], out[1], out[2]};
}

// The approximation for conductors that pbrt-v2 uses.
inline Rgb fresnel_conductor_v2(float c, const Rgb& eta, const Rgb& k) {
  const std::array<float, 4> n{eta.x, eta.y, eta.z, eta.z}, absorption{k.x, k.y, k.z, k.z};
  const float c2 = c * c;
  std::array<float, 4> out;
  for (std::size_t i = 0; i < 4; ++i) {
    const float s = n[i] * n[i] + absorption[i] * absorption[i], m = 2.f * n[i] * c,
                t = s * c2 + 1.f, q = s + c2;
    out[i] = 0.5f * ((t - m) / (t + m) + (q - m) / (q + m));
  }
  return {out[0], out[1], out[2]};
}

// Fresnel factor of a reflection lobe. `c` is the cosine against the half vector (or normal),
// `outside` tells its side.
inline Rgb fresnel(const Lobe& l, float c, bool outside) {
  switch (l.fresnel) {
    case Fresnel::none:
      break;
    case Fresnel::dielectric:
      return Rgb(fresnel_dielectric(c, outside ? l.eta.x : l.eta.y));
    case Fresnel::dielectric_one_sided:
      return Rgb(fresnel_dielectric(c, l.eta.x));
    case Fresnel::conductor:
      return fresnel_conductor(c, l.eta, l.k);
    case Fresnel::conductor_v2:
      return fresnel_conductor_v2(c, l.eta, l.k);
  }
  return Rgb(1.f);
}

inline float pow5(float x) {
  const float x2 = x * x;
  return x2 * x2 * x;
}
inline Rgb schlick(const Rgb& r, float c) {
  return r + pow5(std::max(0.f, 1.f - c)) * (Rgb(1.f) - r);
}

// (1 - s2)^(e/2) for s2 in [0, 1], that is cos^e from the squared sine: precise near the pole,
// where exponents of thousands matter. Relative error below 4e-6 for results above 1e-6. The
// polynomials interpolate log2(1 + d) / d and 2^r at Chebyshev nodes; explicit fma is exact on
// every host.
inline float cosine_power(float s2, float e) {
  if (s2 >= 1.f) return e > 0.f ? 0.f : 1.f;
  // log2(1 - s2) = shift + log2(mantissa in [sqrt(1/2), sqrt(2)))
  const float x = 1.f - s2;
  const auto bits = std::bit_cast<std::uint32_t>(x);
  const std::int32_t shift = static_cast<std::int32_t>(bits - 0x3f3504f3u) >> 23;
  const float m = std::bit_cast<float>(bits - (static_cast<std::uint32_t>(shift) << 23));
  // with no shift, m - 1 is -s2 without the rounding of 1 - s2
  const float d = shift == 0 ? -s2 : m - 1.f, d2 = d * d, d4 = d2 * d2;
  const float low =
      std::fma(d2, std::fma(d, -0.36069327f, 0.48091075f), std::fma(d, -0.72134747f, 1.44269500f));
  const float high =
      std::fma(d2, std::fma(d, -0.20586188f, 0.21607823f), std::fma(d, -0.23916988f, 0.28790326f));
  const float log2 = d * std::fma(d4, std::fma(d4, 0.12310968f, high), low);
  const float y = 0.5f * e * (static_cast<float>(shift) + log2);  // log2 of the result, <= 0
  if (!(y > -126.f)) return 0.f;
  const float whole = std::nearbyint(y), r = y - whole, r2 = r * r;
  const float p =
      std::fma(r2 * r2, std::fma(r, 0.0013390863f, 0.0096760319f),
               std::fma(r2, std::fma(r, 0.055503571f, 0.24022107f), std::fma(r, 0.69314719f, 1.f)));
  return p * std::bit_cast<float>(static_cast<std::uint32_t>(static_cast<std::int32_t>(whole) + 127)
                                  << 23);
}

// Density cos/pi around z by the concentric map (Shirley and Chiu 1997), without unpredictable
// branches.
inline Vec3 sample_cosine(const Vec2& u) {
  const float a = 2.f * u.x - 1.f, b = 2.f * u.y - 1.f;
  const bool first = a * a > b * b;
  const float r = first ? a : b, other = first ? b : a;
  float s, c;
  portable::sincos_eighth(r != 0.f ? (kPi / 4) * (other / r) : 0.f, s, c);
  return {r * (first ? c : s), r * (first ? s : c), std::sqrt(std::max(0.f, 1.f - r * r))};
}

inline float sine2(const Vec3& w) { return w.x * w.x + w.y * w.y; }

// Density of microfacet normals, times the solid angle's cosine = 1 (so that the projected integral
// is 1).
inline float normal_density(const Lobe& l, const Vec3& wh) {
  switch (l.distribution) {
    case Distribution::blinn:
      return l.norm * cosine_power(sine2(wh), l.alpha_x);
    case Distribution::blinn_anisotropic: {
      const float s2 = sine2(wh);
      if (s2 <= 0.f) return l.norm;
      return l.norm * cosine_power(s2, (l.alpha_x * wh.x * wh.x + l.alpha_y * wh.y * wh.y) / s2);
    }
    case Distribution::trowbridge_reitz:
      break;
  }
  const float x = wh.x / l.alpha_x, y = wh.y / l.alpha_y, q = x * x + y * y + wh.z * wh.z;
  return l.norm / (q * q);  // norm = 1 / (pi ax ay)
}

// sqrt(cos^2 + ax^2 x^2 + ay^2 y^2): Smith's masking is G1 = 2 c / (c + this).
inline float smith_root(const Lobe& l, const Vec3& w) {
  const float x = l.alpha_x * w.x, y = l.alpha_y * w.y;
  return std::sqrt(w.z * w.z + x * x + y * y);
}

// A normal of Trowbridge and Reitz's distribution as seen from wo, wo.z > 0 (Heitz 2018). Density
// D G1 (wo.wh) / wo.z.
inline Vec3 sample_visible_normal(const Lobe& l, const Vec3& wo, const Vec2& u) {
  // by a uniform point of a spherical cap (Dupuy and Benyoub 2023)
  const Vec3 v = glm::normalize(Vec3(l.alpha_x * wo.x, l.alpha_y * wo.y, wo.z));
  float s, c;
  portable::sincos_turn(u.y, s, c);
  const float z = (1.f - u.x) * (1.f + v.z) - v.z, r = std::sqrt(std::max(0.f, 1.f - z * z));
  return glm::normalize(
      Vec3(l.alpha_x * (r * c + v.x), l.alpha_y * (r * s + v.y), std::max(1e-6f, z + v.z)));
}

// A normal of Blinn's distribution or of its anisotropic form (Ashikhmin and Shirley 2000), z >= 0.
// Density D * cos.
inline Vec3 sample_blinn_normal(const Lobe& l, const Vec2& u) {
  float s, c, e = l.alpha_x;
  portable::sincos_turn(u.y, s, c);
  if (l.distribution == Distribution::blinn_anisotropic) {
    // tan(phi) = sqrt((ex + 2) / (ey + 2)) tan(uniform angle), without the tangent
    c *= std::sqrt(l.alpha_y + 2.f);
    s *= std::sqrt(l.alpha_x + 2.f);
    const float inverse = 1.f / std::sqrt(c * c + s * s);
    c *= inverse;
    s *= inverse;
    e = l.alpha_x * c * c + l.alpha_y * s * s;
  }
  const float z = cosine_power(u.x, 2.f / (e + 2.f)), r = std::sqrt(std::max(0.f, 1.f - z * z));
  return {r * c, r * s, z};
}

// The refracted direction of wo about wh (same side); eta is the index beyond over the one on wo's
// side. False on total internal reflection.
inline bool refract(const Vec3& wo, const Vec3& wh, float eta, Vec3& wi) {
  const float c = glm::dot(wo, wh), inverse = 1.f / eta;
  const float sin2 = std::max(0.f, 1.f - c * c) * inverse * inverse;
  if (sin2 >= 1.f) return false;
  wi = -inverse * wo + (inverse * c - std::sqrt(1.f - sin2)) * wh;
  return true;
}

}  // namespace cloudrenderer::bsdf
