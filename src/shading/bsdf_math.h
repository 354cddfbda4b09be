#pragma once
// Fresnel terms and microfacet distributions in the shading frame (z = normal). Inline: one
// translation unit sees all. F: float or Float8 (see base/lanes.h).
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "base/portable_math.h"
#include "base/sampling.h"
#include "cloudrenderer/math.h"
#include "shading/bsdf.h"
#include "shading/bsdf_layered.h"

namespace cloudrenderer::bsdf {

// Unpolarised reflectance for a cosine c >= 0; eta is the index beyond over the index on the
// incident side (the form of Cook and Torrance 1982: one square root).
template <class F>
F fresnel_dielectric(F c, F eta) {
  c = lanes::max(c, 1e-10f);
  // Total internal reflection needs no branch: with g = 0 the formula gives 1.
  // The product is exact for indices near 1, where all depends on it.
  const F g = lanes::sqrt(lanes::max(0.f, (eta - 1.f) * (eta + 1.f) + c * c)), sum = g + c, difference = g - c;
  const F a = difference / sum, b = (c * sum - 1.f) / (c * difference + 1.f);
  return 0.5f * a * a * (1.f + b * b);
}

// The cosine of the direction into which a smooth surface refracts one with cosine c; 0 for none.
template <class F>
F refracted_cosine(F c, F eta) {
  return lanes::sqrt(lanes::max(0.f, (eta - 1.f) * (eta + 1.f) + c * c)) / eta;
}

// Exact, for a metal of index n + i k seen from vacuum; one channel. The refracted wave has the normal component a + i b,
// (a + i b)^2 = (n + i k)^2 - sin^2: of a^2 and b^2 the smaller one follows from the product a b = n k, or it would cancel.
template <class F>
F conductor_channel(F c, F n, F k) {
  const F c2 = c * c, s2 = lanes::max(0.f, 1.f - c2);
  const F nk2 = n * n * (k * k);
  const F t0 = (n - k) * (n + k) - s2;
  const F ab = lanes::sqrt(t0 * t0 + 4.f * nk2);  // a^2 + b^2
  const F larger = 0.5f * (ab + lanes::abs(t0)), smaller = nk2 / lanes::max(larger, 1e-30f);
  const MaskOf<F> first = t0 > 0.f;
  const F aa = lanes::select(first, larger, smaller), bb = lanes::select(first, smaller, larger);
  const F a = lanes::sqrt(aa), a2 = 2.f * c * a;
  const F t1 = ab + c2;
  const F t3 = c2 * ab + s2 * s2, t4 = a2 * s2;
  const F den = (t1 + a2) * (t3 + t4);
  // rs = ((a-c)^2 + b^2) / (t1+a2), rp = rs (t3-t4)/(t3+t4); their mean over one denominator
  return ((a - c) * (a - c) + bb) * t3 / lanes::max(den, 1e-30f);
}
// The approximation for conductors that pbrt-v2 uses.
template <class F>
F conductor_channel_v2(F c, F n, F k) {
  const F c2 = c * c, s = n * n + k * k, m = 2.f * n * c, t = s * c2 + 1.f, q = s + c2;
  return 0.5f * lanes::max(0.f, (t - m) / (t + m) + (q - m) / (q + m));
}
// A formula for each channel of a colour.
template <class Formula>
Rgb by_channel(const Rgb& n, const Rgb& k, Formula formula) {
  // four lanes, so that the compiler makes vector instructions of it
  const std::array<float, 4> n4{n.x, n.y, n.z, n.z}, k4{k.x, k.y, k.z, k.z};
  std::array<float, 4> out;
  for (std::size_t i = 0; i < 4; ++i) out[i] = formula(n4[i], k4[i]);
  return {out[0], out[1], out[2]};
}
template <class Formula>
Vec3x8 by_channel(const Vec3x8& n, const Vec3x8& k, Formula formula) {
  return {formula(n.x, k.x), formula(n.y, k.y), formula(n.z, k.z)};
}

template <class F>
F pow5(F x) {
  const F x2 = x * x;
  return x2 * x2 * x;
}
template <class F>
Vec3Of<F> schlick(const Vec3Of<F>& r, F c) {
  return r + pow5<F>(lanes::max(0.f, 1.f - c)) * (Vec3Of<F>(F(1.f)) - r);
}

// Fresnel factor of a reflection lobe. `c` is the cosine against the half vector (or normal),
// `outside` tells its side.
template <class F>
Vec3Of<F> fresnel(const LobeOf<F>& l, F c, MaskOf<F> outside) {
  switch (l.fresnel) {
    case Fresnel::none:
      break;
    case Fresnel::dielectric:
      return Vec3Of<F>(fresnel_dielectric<F>(c, lanes::select(outside, l.eta.x, l.eta.y)));
    case Fresnel::dielectric_one_sided:
      return Vec3Of<F>(fresnel_dielectric<F>(c, l.eta.x));
    case Fresnel::conductor:
      return by_channel(l.eta, l.k, [c](F n, F k) { return conductor_channel<F>(c, n, k); });
    case Fresnel::conductor_v2:
      return by_channel(l.eta, l.k, [c](F n, F k) { return conductor_channel_v2<F>(c, n, k); });
    case Fresnel::coated_conductor:
      if constexpr (std::is_same_v<F, float>) return coated_mirror(l, c);
      break;
    case Fresnel::disney: {
      // From inside pbrt-v3 has a negative cosine, for which Schlick's approximation is 1.
      const Vec3Of<F> smooth(fresnel_dielectric<F>(c, lanes::select(outside, l.eta.x, l.eta.y)));
      const Vec3Of<F> metal = schlick<F>(l.k, lanes::select(outside, c, F(0.f)));
      return smooth + l.eta.z * (metal - smooth);
    }
  }
  return Vec3Of<F>(F(1.f));
}

// 2^y for y <= 0: 0 below -126.
template <class F>
F exp2_near(F y) {
  using lanes::fma;
  const MaskOf<F> vanishes = !(y > -126.f);
  const F whole = lanes::nearbyint(lanes::max(-126.f, y)), r = y - whole, r2 = r * r;
  const F p = fma(r2 * r2, fma(r, 0.0013390863f, 0.0096760319f),
                  fma(r2, fma(r, 0.055503571f, 0.24022107f), fma(r, 0.69314719f, 1.f)));
  const F power = p * lanes::from_bits(lanes::as_unsigned(lanes::to_int(whole) + 127) << 23);
  return lanes::select(vanishes, F(0.f), power);
}
// What passes a medium `depth` mean free paths thick along a direction with cosine c.
template <class F>
F attenuation(F depth, F c) {
  return exp2_near<F>(-1.44269504f * depth / lanes::max(c, 1e-6f));
}

// (1 - s2)^(e/2) for s2 in [0, 1], that is cos^e from the squared sine: precise near the pole,
// where exponents of thousands matter; `c2`: 1 - s2, that is cos^2, for precision near the horizon. Relative error below
// 4e-6 for results above 1e-6. The
// polynomials interpolate log2(1 + d) / d and 2^r at Chebyshev nodes; explicit fma is exact on
// every host.
template <class F>
F cosine_power(F s2, F c2, F e) {
  using lanes::fma;
  // log2(1 - s2) = shift + log2(mantissa in [sqrt(1/2), sqrt(2)))
  const auto bits = lanes::bits(c2);
  const IntOf<F> shift = lanes::as_signed(bits - 0x3f3504f3u) >> 23;
  const F m = lanes::from_bits(bits - (lanes::as_unsigned(shift) << 23));
  // with no shift, m - 1 is -s2 without the rounding of 1 - s2
  const F d = lanes::select(lanes::equal(shift, 0), -s2, m - 1.f), d2 = d * d, d4 = d2 * d2;
  const F low = fma(d2, fma(d, -0.36069327f, 0.48091075f), fma(d, -0.72134747f, 1.44269500f));
  const F high = fma(d2, fma(d, -0.20586188f, 0.21607823f), fma(d, -0.23916988f, 0.28790326f));
  const F log2 = d * fma(d4, fma(d4, 0.12310968f, high), low);
  const F y = 0.5f * e * (lanes::to_float(shift) + log2);  // log2 of the result, <= 0
  const F power = exp2_near<F>(y);
  const F pole = lanes::select(e > 0.f, F(0.f), F(1.f));
  return lanes::select(c2 <= 0.f, pole, power);
}
template <class F>
F cosine_power(F s2, F e) {
  return cosine_power<F>(s2, 1.f - s2, e);
}

// Density cos/pi around z.
template <class F>
Vec3Of<F> sample_cosine(const Vec2Of<F>& u) {
  using lanes::select;
  const F a = 2.f * u.x - 1.f, b = 2.f * u.y - 1.f;
  const F r = select(a * a > b * b, a, b);  // of the point in the disk
  const Vec2Of<F> d = sample_disk(u);
  return {d.x, d.y, lanes::sqrt(lanes::max(0.f, 1.f - r * r))};
}

template <class F>
F sine2(const Vec3Of<F>& w) {
  return w.x * w.x + w.y * w.y;
}

// Density of microfacet normals, times the solid angle's cosine = 1 (so that the projected integral
// is 1).
template <class F>
F normal_density(const LobeOf<F>& l, const Vec3Of<F>& wh) {
  switch (l.distribution) {
    case Distribution::blinn:
      return l.norm * cosine_power<F>(sine2(wh), wh.z * wh.z, l.alpha_x);
    case Distribution::blinn_anisotropic: {
      const F s2 = sine2(wh);
      const F exponent = (l.alpha_x * wh.x * wh.x + l.alpha_y * wh.y * wh.y) / s2;
      return lanes::select(s2 <= 0.f, l.norm, l.norm * cosine_power<F>(s2, wh.z * wh.z, exponent));
    }
    case Distribution::trowbridge_reitz:
    case Distribution::trowbridge_reitz_separable:
      break;
  }
  const F x = wh.x / l.alpha_x, y = wh.y / l.alpha_y, q = x * x + y * y + wh.z * wh.z;
  return l.norm / (q * q);  // norm = 1 / (pi ax ay)
}

// sqrt(cos^2 + ax^2 x^2 + ay^2 y^2): Smith's masking is G1 = 2 c / (c + this).
template <class F>
F smith_root(const LobeOf<F>& l, const Vec3Of<F>& w) {
  const F x = l.alpha_x * w.x, y = l.alpha_y * w.y;
  return lanes::sqrt(w.z * w.z + x * x + y * y);
}

// A normal of Trowbridge and Reitz's distribution as seen from wo, wo.z > 0 (Heitz 2018). Density
// D G1 (wo.wh) / wo.z.
template <class F>
Vec3Of<F> sample_visible_normal(const LobeOf<F>& l, const Vec3Of<F>& wo, const Vec2Of<F>& u) {
  // by a uniform point of a spherical cap (Dupuy and Benyoub 2023)
  const Vec3Of<F> v = lanes::normalize(Vec3Of<F>(l.alpha_x * wo.x, l.alpha_y * wo.y, wo.z));
  F s, c;
  portable::sincos_turn<F>(u.y, s, c);
  const F z = (1.f - u.x) * (1.f + v.z) - v.z, r = lanes::sqrt(lanes::max(0.f, 1.f - z * z));
  return lanes::normalize(
      Vec3Of<F>(l.alpha_x * (r * c + v.x), l.alpha_y * (r * s + v.y), lanes::max(1e-6f, z + v.z)));
}

// A normal of Blinn's distribution or of its anisotropic form (Ashikhmin and Shirley 2000), z >= 0.
// Density D * cos.
template <class F>
Vec3Of<F> sample_blinn_normal(const LobeOf<F>& l, const Vec2Of<F>& u) {
  F s, c, e = l.alpha_x;
  portable::sincos_turn<F>(u.y, s, c);
  if (l.distribution == Distribution::blinn_anisotropic) {
    // tan(phi) = sqrt((ex + 2) / (ey + 2)) tan(uniform angle), without the tangent
    c *= lanes::sqrt(l.alpha_y + 2.f);
    s *= lanes::sqrt(l.alpha_x + 2.f);
    const F inverse = 1.f / lanes::sqrt(c * c + s * s);
    c *= inverse;
    s *= inverse;
    e = l.alpha_x * c * c + l.alpha_y * s * s;
  }
  const F z = cosine_power<F>(u.x, 2.f / (e + 2.f)), r = lanes::sqrt(lanes::max(0.f, 1.f - z * z));
  return {r * c, r * s, z};
}

// Turns normals with density D cos into those that wo (wo.z > 0) sees of Torrance and Sparrow's V-grooves: density D G1(wo) (wo.wh) / wo.z.
// Each groove has two walls, and the one that faces wo more fills more of the view (Heitz and d'Eon 2014). u: uniform.
template <class F>
Vec3Of<F> visible_in_groove(const Vec3Of<F>& wh, const Vec3Of<F>& wo, F u) {
  const F z = wh.z * wo.z, across = wh.x * wo.x + wh.y * wo.y;
  const F own = lanes::max(0.f, z + across), other = lanes::max(0.f, z - across);
  const F turn = lanes::select(u * (own + other) < other, F(-1.f), F(1.f));
  return {turn * wh.x, turn * wh.y, wh.z};
}

// The refracted direction of wo about wh (same side); eta is the index beyond over the one on wo's
// side. False on total internal reflection.
template <class F>
MaskOf<F> refract(const Vec3Of<F>& wo, const Vec3Of<F>& wh, F eta, Vec3Of<F>& wi) {
  const F c = glm::dot(wo, wh), inverse = 1.f / eta;
  const F g2 = (eta - 1.f) * (eta + 1.f) + c * c;  // eta^2 cos^2 of the refracted ray, as in fresnel_dielectric()
  wi = inverse * ((c - lanes::sqrt(lanes::max(0.f, g2))) * wh - wo);
  return g2 > 0.f;
}

}  // namespace cloudrenderer::bsdf
