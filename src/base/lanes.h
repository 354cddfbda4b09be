#pragma once
// Formulas that are written once and serve one number or eight: templates over F, which is `float` or `Float8`. Every
// operation here is the same IEEE operation for both, so that a lane has the bits that the formula gives for the one
// number. Branches become select(); `if (lanes::any(mask))` skips what no lane needs.
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "cloudrenderer/math.h"
#ifdef __AVX2__
#include "base/lanes_avx2.h"
#else
#include "base/lanes_plain.h"
#endif

namespace cloudrenderer {

inline constexpr std::size_t kLanes = 8;

namespace lanes {
#ifdef __AVX2__
namespace processor = avx2;
#else
namespace processor = plain;
#endif
}  // namespace lanes

// Eight truths. && and || look at both sides.
struct Mask8 {
  Ints8 v;  // 0 or -1
  Mask8() = default;
  explicit Mask8(bool b) : v(Ints8{} - static_cast<std::int32_t>(b)) {}
  static Mask8 of(Ints8 raw) {
    Mask8 m;
    m.v = raw;
    return m;
  }
  friend Mask8 operator&&(Mask8 a, Mask8 b) { return of(a.v & b.v); }
  friend Mask8 operator||(Mask8 a, Mask8 b) { return of(a.v | b.v); }
  friend Mask8 operator!=(Mask8 a, Mask8 b) { return of(a.v ^ b.v); }
  friend Mask8 operator==(Mask8 a, Mask8 b) { return of(~(a.v ^ b.v)); }
  friend Mask8 operator!(Mask8 a) { return of(~a.v); }
};

struct Float8 {
  using Raw = Floats8;
  Raw v;
  Float8() = default;
  Float8(float x) : v{x, x, x, x, x, x, x, x} {}  // NOLINT: literals mix with lanes
  static Float8 of(Raw raw) {
    Float8 f;
    f.v = raw;
    return f;
  }
  static Float8 load(const float* eight) {
    Float8 f;
    std::memcpy(&f.v, eight, sizeof v);
    return f;
  }
  void store(float* eight) const { std::memcpy(eight, &v, sizeof v); }

  friend Float8 operator+(Float8 a, Float8 b) { return of(a.v + b.v); }
  friend Float8 operator-(Float8 a, Float8 b) { return of(a.v - b.v); }
  friend Float8 operator*(Float8 a, Float8 b) { return of(a.v * b.v); }
  friend Float8 operator/(Float8 a, Float8 b) { return of(a.v / b.v); }
  Float8 operator-() const { return of(-v); }
  Float8& operator+=(Float8 o) { return *this = *this + o; }
  Float8& operator-=(Float8 o) { return *this = *this - o; }
  Float8& operator*=(Float8 o) { return *this = *this * o; }
  Float8& operator/=(Float8 o) { return *this = *this / o; }
  friend Float8 copysign(Float8 x, Float8 sign) {
    const Bits8 bits = (reinterpret_cast<Bits8>(x.v) & 0x7fffffffu) | (reinterpret_cast<Bits8>(sign.v) & 0x80000000u);
    return of(reinterpret_cast<Raw>(bits));
  }
  friend Mask8 operator<(Float8 a, Float8 b) { return Mask8::of(a.v < b.v); }
  friend Mask8 operator>(Float8 a, Float8 b) { return Mask8::of(a.v > b.v); }
  friend Mask8 operator<=(Float8 a, Float8 b) { return Mask8::of(a.v <= b.v); }
  friend Mask8 operator>=(Float8 a, Float8 b) { return Mask8::of(a.v >= b.v); }
  friend Mask8 operator==(Float8 a, Float8 b) { return Mask8::of(a.v == b.v); }
  friend Mask8 operator!=(Float8 a, Float8 b) { return Mask8::of(a.v != b.v); }
};

template <class F>
struct LaneTypes;
template <>
struct LaneTypes<float> {
  using Mask = bool;
  using Int = std::int32_t;
};
template <>
struct LaneTypes<Float8> {
  using Mask = Mask8;
  using Int = Ints8;
};
template <class F>
using MaskOf = typename LaneTypes<F>::Mask;
template <class F>
using IntOf = typename LaneTypes<F>::Int;
template <class F>
using Vec3Of = glm::vec<3, F, glm::defaultp>;
template <class F>
using Vec2Of = glm::vec<2, F, glm::defaultp>;
using Vec3x8 = Vec3Of<Float8>;
using Vec2x8 = Vec2Of<Float8>;

namespace lanes {

inline bool any(bool m) { return m; }
inline bool any(Mask8 m) { return processor::any(m.v); }
template <class M>
bool none(M m) {
  return !any(m);
}
inline std::uint32_t to_bits(bool m) { return m; }
inline std::uint32_t to_bits(Mask8 m) { return processor::to_bits(m.v); }
// The lanes whose bit is set.
inline Mask8 from_mask_bits(std::uint32_t bits) {
  constexpr Ints8 kBit = {1, 2, 4, 8, 16, 32, 64, 128};
  return Mask8::of((static_cast<std::int32_t>(bits) & kBit) == kBit);
}

inline float select(bool m, float a, float b) { return m ? a : b; }
inline Float8 select(Mask8 m, Float8 a, Float8 b) { return Float8::of(processor::select(m.v, a.v, b.v)); }
inline bool select(bool m, bool a, bool b) { return m ? a : b; }
inline Mask8 select(Mask8 m, Mask8 a, Mask8 b) { return Mask8::of((m.v & a.v) | (~m.v & b.v)); }
template <class F>
Vec3Of<F> select(MaskOf<F> m, const Vec3Of<F>& a, const Vec3Of<F>& b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}

// As std::min and std::max, also for NaN and zeros.
inline float min(float a, float b) { return std::min(a, b); }
inline float max(float a, float b) { return std::max(a, b); }
inline Float8 min(Float8 a, Float8 b) { return Float8::of(processor::min(a.v, b.v)); }
inline Float8 max(Float8 a, Float8 b) { return Float8::of(processor::max(a.v, b.v)); }
inline float sqrt(float x) { return std::sqrt(x); }
inline Float8 sqrt(Float8 x) { return Float8::of(processor::sqrt(x.v)); }
inline float abs(float x) { return std::fabs(x); }
inline Float8 abs(Float8 x) { return Float8::of(reinterpret_cast<Floats8>(reinterpret_cast<Bits8>(x.v) & 0x7fffffffu)); }
template <class F>
Vec3Of<F> abs(const Vec3Of<F>& v) {
  return {abs(v.x), abs(v.y), abs(v.z)};
}
inline float fma(float a, float b, float c) { return std::fma(a, b, c); }
inline Float8 fma(Float8 a, Float8 b, Float8 c) { return Float8::of(processor::fma(a.v, b.v, c.v)); }
inline float nearbyint(float x) { return std::nearbyint(x); }
inline Float8 nearbyint(Float8 x) { return Float8::of(processor::nearbyint(x.v)); }

// Bits of floats, and whole numbers. to_int: of whole numbers within its range.
inline std::uint32_t bits(float x) { return std::bit_cast<std::uint32_t>(x); }
inline Bits8 bits(Float8 x) { return reinterpret_cast<Bits8>(x.v); }
inline float from_bits(std::uint32_t x) { return std::bit_cast<float>(x); }
inline Float8 from_bits(Bits8 x) { return Float8::of(reinterpret_cast<Float8::Raw>(x)); }
inline std::int32_t as_signed(std::uint32_t x) { return static_cast<std::int32_t>(x); }
inline Ints8 as_signed(Bits8 x) { return reinterpret_cast<Ints8>(x); }
inline std::uint32_t as_unsigned(std::int32_t x) { return static_cast<std::uint32_t>(x); }
inline Bits8 as_unsigned(Ints8 x) { return reinterpret_cast<Bits8>(x); }
inline std::int32_t to_int(float x) { return static_cast<std::int32_t>(x); }
inline Ints8 to_int(Float8 x) { return __builtin_convertvector(x.v, Ints8); }
inline float to_float(std::int32_t x) { return static_cast<float>(x); }
inline Float8 to_float(Ints8 x) { return Float8::of(__builtin_convertvector(x, Float8::Raw)); }
inline bool equal(std::int32_t a, std::int32_t b) { return a == b; }
inline Mask8 equal(Ints8 a, std::int32_t b) { return Mask8::of(a == b); }
inline bool greater(std::int32_t a, std::int32_t b) { return a > b; }
inline Mask8 greater(Ints8 a, std::int32_t b) { return Mask8::of(a > b); }
inline bool has_bits(std::int32_t x, std::int32_t b) { return (x & b) != 0; }
inline Mask8 has_bits(Ints8 x, std::int32_t b) { return Mask8::of((x & b) != 0); }

inline bool is_finite(float x) { return std::isfinite(x); }
inline Mask8 is_finite(Float8 x) { return abs(x) < kInfinity; }
template <class F>
MaskOf<F> is_finite(const Vec3Of<F>& v) {
  return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}
template <class F>
MaskOf<F> is_black(const Vec3Of<F>& c) {
  return c.x == 0.f && c.y == 0.f && c.z == 0.f;
}
template <class F>
F luminance(const Vec3Of<F>& c) {
  return 0.212671f * c.x + 0.715160f * c.y + 0.072169f * c.z;
}
// As glm::normalize.
template <class F>
Vec3Of<F> normalize(const Vec3Of<F>& v) {
  return v * (1.f / sqrt(glm::dot(v, v)));
}

// Numbers of a table.
inline Float8 lookup(const float* table, Ints8 at) { return Float8::of(processor::lookup(table, at)); }

// f(lane) for the lanes of m.
template <class Fn>
void for_each(bool m, Fn f) {
  if (m) f(std::size_t{0});
}
template <class Fn>
void for_each(Mask8 m, Fn f) {
  for (std::uint32_t left = to_bits(m); left; left &= left - 1) f(static_cast<std::size_t>(std::countr_zero(left)));
}

// One lane.
inline float get(float x, std::size_t) { return x; }
inline Vec3 get(const Vec3& x, std::size_t) { return x; }
inline Vec2 get(const Vec2& x, std::size_t) { return x; }
inline void put(float& x, std::size_t, float a) { x = a; }
inline void put(Vec2& x, std::size_t, const Vec2& a) { x = a; }
inline void put(Vec3& x, std::size_t, const Vec3& a) { x = a; }
inline float get(Float8 x, std::size_t i) { return x.v[i]; }
inline Vec2 get(const Vec2x8& x, std::size_t i) { return {x.x.v[i], x.y.v[i]}; }
inline Vec3 get(const Vec3x8& x, std::size_t i) { return {x.x.v[i], x.y.v[i], x.z.v[i]}; }
inline void put(Float8& x, std::size_t i, float a) { x.v[i] = a; }
inline void put(Vec2x8& x, std::size_t i, const Vec2& a) {
  x.x.v[i] = a.x;
  x.y.v[i] = a.y;
}
inline void put(Vec3x8& x, std::size_t i, const Vec3& a) {
  x.x.v[i] = a.x;
  x.y.v[i] = a.y;
  x.z.v[i] = a.z;
}

// Of two vectors, within each half: pairs of their first or of their last two numbers.
inline Floats8 pairs_low(Floats8 a, Floats8 b) { return __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13); }
inline Floats8 pairs_high(Floats8 a, Floats8 b) { return __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15); }

// Row i becomes lane i.
inline void transpose(std::array<Float8, 8>& rows) {
  Floats8 a[8], b[8];
  for (std::size_t i = 0; i < 8; i += 2) {
    a[i] = pairs_low(rows[i].v, rows[i + 1].v);
    a[i + 1] = pairs_high(rows[i].v, rows[i + 1].v);
  }
  for (std::size_t i = 0; i < 8; i += 4) {
    b[i] = __builtin_shufflevector(a[i], a[i + 2], 0, 1, 8, 9, 4, 5, 12, 13);
    b[i + 1] = __builtin_shufflevector(a[i], a[i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    b[i + 2] = __builtin_shufflevector(a[i + 1], a[i + 3], 0, 1, 8, 9, 4, 5, 12, 13);
    b[i + 3] = __builtin_shufflevector(a[i + 1], a[i + 3], 2, 3, 10, 11, 6, 7, 14, 15);
  }
  for (std::size_t i = 0; i < 4; ++i) {
    rows[i].v = __builtin_shufflevector(b[i], b[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    rows[i + 4].v = __builtin_shufflevector(b[i], b[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

// Eight things of what holds them in lanes: both consist of nothing but numbers, a multiple of eight.
template <class One, class Eight>
void take_apart(const Eight& eight, std::array<One, 8>& out) {
  constexpr std::size_t kRow = 8 * sizeof(float);
  static_assert(std::is_trivially_copyable_v<One> && std::is_trivially_copyable_v<Eight>);
  static_assert(sizeof(Eight) == 8 * sizeof(One) && sizeof(One) % kRow == 0);
  for (std::size_t row = 0; row < sizeof(One) / kRow; ++row) {
    std::array<Float8, 8> numbers;
    std::memcpy(static_cast<void*>(&numbers), reinterpret_cast<const std::byte*>(&eight) + row * sizeof numbers, sizeof numbers);
    transpose(numbers);
    for (std::size_t i = 0; i < 8; ++i)
      std::memcpy(reinterpret_cast<std::byte*>(&out[i]) + row * kRow, &numbers[i], kRow);
  }
}

// Four numbers of one thing.
using Color4 = Floats4;
// Four 16 bit floats from any address.
inline Color4 load_halves(const void* from) { return processor::load_halves(from); }

// N numbers each from eight places; out[n] holds number n of all. Reads nothing behind them.
template <std::size_t N>
std::array<Float8, N> gather(const std::array<const float*, kLanes>& from) {
  std::array<Float8, N> out;
  if constexpr (N == 8) {
    for (std::size_t i = 0; i < kLanes; ++i) out[i] = Float8::load(from[i]);
    transpose(out);
  } else {
    static_assert(N >= 2 && N <= 4);
    Floats8 rows[4];
    for (std::size_t i = 0; i < 4; ++i)
      rows[i] = __builtin_shufflevector(processor::load_few<N>(from[i]), processor::load_few<N>(from[i + 4]), 0, 1, 2, 3, 4, 5, 6, 7);
    const Floats8 a = pairs_low(rows[0], rows[2]), b = pairs_low(rows[1], rows[3]);
    out[0].v = pairs_low(a, b);
    out[1].v = pairs_high(a, b);
    if constexpr (N > 2) {
      const Floats8 c = pairs_high(rows[0], rows[2]), d = pairs_high(rows[1], rows[3]);
      out[2].v = pairs_low(c, d);
      if constexpr (N == 4) out[3].v = pairs_high(c, d);
    }
  }
  return out;
}

}  // namespace lanes

// Numbers of eight things on their way into lanes, N of each, or out of them.
template <std::size_t N>
struct Columns {
  alignas(32) float at[N][kLanes];
  void put(std::size_t column, std::size_t lane, const Vec3& v) {
    at[column][lane] = v.x;
    at[column + 1][lane] = v.y;
    at[column + 2][lane] = v.z;
  }
  void put(std::size_t column, std::size_t lane, const Vec2& v) {
    at[column][lane] = v.x;
    at[column + 1][lane] = v.y;
  }
  Float8 one(std::size_t column) const { return Float8::load(at[column]); }
  Vec2x8 two(std::size_t column) const { return {one(column), one(column + 1)}; }
  Vec3x8 three(std::size_t column) const { return {one(column), one(column + 1), one(column + 2)}; }
  // And back.
  void store(std::size_t column, const Float8& v) { v.store(at[column]); }
  void store(std::size_t column, const Vec3x8& v) {
    v.x.store(at[column]);
    v.y.store(at[column + 1]);
    v.z.store(at[column + 2]);
  }
  Vec3 get(std::size_t column, std::size_t lane) const { return {at[column][lane], at[column + 1][lane], at[column + 2][lane]}; }
};

}  // namespace cloudrenderer

// glm asks whether its numbers are IEEE numbers.
template <>
struct std::numeric_limits<cloudrenderer::Float8> : std::numeric_limits<float> {};
