#pragma once
// Elementary functions in single precision made of IEEE +, -, *, / and sqrt only, so that every host and every C
// library gives the same bits. Inside they work in double (as fast as float in scalar code), so that the float results
// are within 1 ulp. Series: Taylor and atanh expansions, their lengths chosen for 1e-10.
#include <bit>
#include <cstdint>

#include "base/lanes.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer::portable {

namespace detail {
// x = quadrant * pi/2 + r, |r| <= pi/4 (Cody and Waite, pi/2 in two pieces; good for |x| up to 1e5).
inline double reduce_quarter(double x, std::int64_t& quadrant) {
  const double k = std::nearbyint(x * 0.63661977236758134308);
  quadrant = static_cast<std::int64_t>(k);
  return (x - k * 1.57079632673412561417e+00) - k * 6.07710050650619224932e-11;
}
inline double sin_series(double r) {
  const double z = r * r;
  return r + r * z * (-1.0 / 6 + z * (1.0 / 120 + z * (-1.0 / 5040 + z * (1.0 / 362880 + z * (-1.0 / 39916800)))));
}
inline double cos_series(double r) {
  const double z = r * r;
  return 1 + z * (-0.5 + z * (1.0 / 24 + z * (-1.0 / 720 + z * (1.0 / 40320 + z * (-1.0 / 3628800 + z * (1.0 / 479001600))))));
}
// 2^k * e^r for |r| <= ln(2)/2
inline double exp_core(double x) {
  const double k = std::nearbyint(x * 1.44269504088896340736);
  const double r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10;
  const double p =
      1 + r * (1 + r * (0.5 + r * (1.0 / 6 + r * (1.0 / 24 + r * (1.0 / 120 + r * (1.0 / 720 + r * (1.0 / 5040 + r * (1.0 / 40320))))))));
  return p * std::bit_cast<double>(static_cast<std::uint64_t>(static_cast<std::int64_t>(k) + 1023) << 52);
}
// ln x for finite x > 0 that is normal in double
inline double log_core(double x) {
  const auto bits = std::bit_cast<std::uint64_t>(x);
  auto e = static_cast<std::int64_t>(bits >> 52) - 1023;
  double m = std::bit_cast<double>((bits & 0x000fffffffffffffu) | 0x3ff0000000000000u);
  if (m > 1.41421356237309504880) {
    m *= 0.5;
    ++e;
  }
  const double f = (m - 1) / (m + 1), z = f * f;
  const double s = f * (2 + z * (2.0 / 3 + z * (2.0 / 5 + z * (2.0 / 7 + z * (2.0 / 9 + z * (2.0 / 11 + z * (2.0 / 13)))))));
  return static_cast<double>(e) * 0.69314718055994530942 + s;
}
// atan of a in [0, 1]
inline double atan_core(double a) {
  const bool far = a > 0.41421356237309504880;
  const double t = far ? (a - 1) / (a + 1) : a, z = t * t;
  double p = 1.0 / 25;
  p = -1.0 / 23 + z * p;
  p = 1.0 / 21 + z * p;
  p = -1.0 / 19 + z * p;
  p = 1.0 / 17 + z * p;
  p = -1.0 / 15 + z * p;
  p = 1.0 / 13 + z * p;
  p = -1.0 / 11 + z * p;
  p = 1.0 / 9 + z * p;
  p = -1.0 / 7 + z * p;
  p = 1.0 / 5 + z * p;
  p = -1.0 / 3 + z * p;
  const double s = t + t * z * p;
  return far ? 0.78539816339744830962 + s : s;
}
inline double atan2_double(double y, double x) {
  const double ax = std::fabs(x), ay = std::fabs(y);
  if (ax == 0 && ay == 0) return std::signbit(x) ? std::copysign(3.14159265358979323846, y) : y;
  double r = ay > ax ? 1.57079632679489661923 - atan_core(ax / ay) : atan_core(ay / ax);
  if (x < 0) r = 3.14159265358979323846 - r;
  return std::copysign(r, y);
}
}  // namespace detail

// |x| <= 1e5; 0 and 1 beyond that or for NaN, so that no caller gets NaN from a bad angle.
inline void sincos(float x, float& s, float& c) {
  if (!(std::fabs(x) <= 1e5f)) {
    s = 0;
    c = 1;
    return;
  }
  std::int64_t q;
  const double r = detail::reduce_quarter(static_cast<double>(x), q);
  const double sr = detail::sin_series(r), cr = detail::cos_series(r);
  const double a = q & 1 ? cr : sr, b = q & 1 ? sr : cr;
  s = static_cast<float>(q & 2 ? -a : a);
  c = static_cast<float>((q + 1) & 2 ? -b : b);
}
// sin and cos for |r| <= pi/4, absolute error below 1e-7: enough for directions, and half the time
// of sincos.
template <class F>
void sincos_eighth(F r, F& s, F& c) {
  using lanes::fma;
  const F z = r * r;
  const F z2 = z * z;
  s = fma(r * z, fma(z2, fma(z, 1.f / 362880, -1.f / 5040), fma(z, 1.f / 120, -1.f / 6)), r);
  c = fma(z, fma(z2, fma(z, 1.f / 40320, -1.f / 720), fma(z, 1.f / 24, -0.5f)), 1.f);
}
// Of 2 pi x, x in [0, 1]. The reduction is exact.
template <class F>
void sincos_turn(F x, F& s, F& c) {
  using lanes::has_bits, lanes::select;
  const F quarter = lanes::nearbyint(4.f * x);
  F a, b;
  sincos_eighth((x - 0.25f * quarter) * (2.f * kPi), a, b);
  const IntOf<F> q = lanes::to_int(quarter);
  const MaskOf<F> odd = has_bits(q, 1);
  s = select(odd, b, a);
  c = select(odd, a, b);
  s = select(has_bits(q, 2), -s, s);
  c = select(has_bits(q + 1, 2), -c, c);
}

inline float sin(float x) {
  float s, c;
  sincos(x, s, c);
  return s;
}
inline float cos(float x) {
  float s, c;
  sincos(x, s, c);
  return c;
}
inline float tan(float x) {
  float s, c;
  sincos(x, s, c);
  return s / c;
}
inline float atan2(float y, float x) {
  return static_cast<float>(detail::atan2_double(static_cast<double>(y), static_cast<double>(x)));
}
// The same in single precision, absolute error below 5e-7: enough for places on maps. The polynomial is that of Cephes
// (S. Moshier, atanf).
template <class F>
F atan2_near(F y, F x) {
  using lanes::abs, lanes::select, lanes::fma, std::copysign;
  const F ax = abs(x), ay = abs(y);
  const F low = lanes::min(ax, ay), high = lanes::max(ax, ay);
  const MaskOf<F> far = low > 0.41421356f * high;
  const F below = select(far, low + high, high);
  const F t = select(below > 0.f, select(far, low - high, low) / below, F(0.f)), z = t * t;
  const F p = fma(fma(fma(fma(8.05374449538e-2f, z, -1.38776856032e-1f), z, 1.99777106478e-1f), z, -3.33329491539e-1f) * z, t, t);
  F r = select(far, kPi / 4 + p, p);
  r = select(ay > ax, kPi / 2 - r, r);
  r = select(x < 0.f, kPi - r, r);
  return copysign(r, y);
}
// Arguments are clamped to [-1, 1].
inline float asin(float x) {
  const double d = std::min(1.0, std::max(-1.0, static_cast<double>(x)));
  return static_cast<float>(detail::atan2_double(d, std::sqrt((1 - d) * (1 + d))));
}
inline float acos(float x) {
  const double d = std::min(1.0, std::max(-1.0, static_cast<double>(x)));
  return static_cast<float>(detail::atan2_double(std::sqrt((1 - d) * (1 + d)), d));
}
// 0 below -104, infinity above 88.8.
inline float exp(float x) {
  if (!(x >= -104.f)) return x != x ? x : 0.f;
  if (x > 88.8f) return kInfinity;
  return static_cast<float>(detail::exp_core(static_cast<double>(x)));
}
inline float exp2(float x) {
  if (!(x >= -150.f)) return x != x ? x : 0.f;
  if (x > 128.f) return kInfinity;
  return static_cast<float>(detail::exp_core(static_cast<double>(x) * 0.69314718055994530942));
}
// -infinity at 0, NaN below.
inline float log(float x) {
  if (x == 0.f) return -kInfinity;
  if (!(x > 0.f)) return std::numeric_limits<float>::quiet_NaN();
  if (x > std::numeric_limits<float>::max()) return x;
  return static_cast<float>(detail::log_core(static_cast<double>(x)));
}
inline float log2(float x) {
  if (x == 0.f) return -kInfinity;
  if (!(x > 0.f)) return std::numeric_limits<float>::quiet_NaN();
  if (x > std::numeric_limits<float>::max()) return x;
  return static_cast<float>(detail::log_core(static_cast<double>(x)) * 1.44269504088896340736);
}
// x >= 0 (a negative x counts as 0).
inline float pow(float x, float y) {
  if (y == 0.f || x == 1.f) return 1.f;
  if (!(x > 0.f)) return y > 0.f ? 0.f : kInfinity;
  if (x > std::numeric_limits<float>::max()) return y > 0.f ? kInfinity : 0.f;
  const double e = detail::log_core(static_cast<double>(x)) * static_cast<double>(y);
  if (!(e > -104)) return 0.f;
  if (e > 88.8) return kInfinity;
  return static_cast<float>(detail::exp_core(e));
}

// In double, for set-up code (tables, transforms): within about 1e-10 (exp, log, pow) and 1e-11 (sin, cos), same bits
// everywhere.
inline double sin(double x) {
  std::int64_t q;
  const double r = detail::reduce_quarter(x, q);
  const double v = q & 1 ? detail::cos_series(r) : detail::sin_series(r);
  return q & 2 ? -v : v;
}
inline double cos(double x) {
  std::int64_t q;
  const double r = detail::reduce_quarter(x, q);
  const double v = q & 1 ? detail::sin_series(r) : detail::cos_series(r);
  return (q + 1) & 2 ? -v : v;
}
inline double atan2(double y, double x) { return detail::atan2_double(y, x); }
inline double exp(double x) { return x < -700 ? 0 : x > 700 ? static_cast<double>(kInfinity) : detail::exp_core(x); }
inline double log(double x) { return x > 0 ? detail::log_core(x) : -static_cast<double>(kInfinity); }
inline double pow(double x, double y) {
  return y == 0 ? 1 : x > 0 ? portable::exp(detail::log_core(x) * y) : 0;
}

}  // namespace cloudrenderer::portable
