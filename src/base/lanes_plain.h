#pragma once
// The operations of lanes that no operator of the compiler's vectors has, for any processor. Those in lanes_avx2.h give the
// same bits (base_lanes_test.cpp); only which NaN comes out may differ.
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace cloudrenderer {

using Floats8 = float __attribute__((vector_size(32)));
using Bits8 = std::uint32_t __attribute__((vector_size(32)));
using Ints8 = std::int32_t __attribute__((vector_size(32)));  // as a mask: 0 or -1
using Floats4 = float __attribute__((vector_size(16)));

namespace plain {

inline bool any(Ints8 m) {
  std::int32_t all = 0;
  for (int i = 0; i < 8; ++i) all |= m[i];
  return all != 0;
}
// Bit i for lane i.
inline std::uint32_t to_bits(Ints8 m) {
  std::uint32_t out = 0;
  for (int i = 0; i < 8; ++i) out |= static_cast<std::uint32_t>(m[i] & 1) << i;
  return out;
}
inline Floats8 select(Ints8 m, Floats8 a, Floats8 b) { return m ? a : b; }
// As std::min and std::max, also for NaN and zeros.
inline Floats8 min(Floats8 a, Floats8 b) { return b < a ? b : a; }
inline Floats8 max(Floats8 a, Floats8 b) { return a < b ? b : a; }
inline Floats8 sqrt(Floats8 x) {
  for (int i = 0; i < 8; ++i) x[i] = std::sqrt(x[i]);
  return x;
}
inline Floats8 fma(Floats8 a, Floats8 b, Floats8 c) {
  for (int i = 0; i < 8; ++i) a[i] = std::fma(a[i], b[i], c[i]);
  return a;
}
inline Floats8 nearbyint(Floats8 x) {
  for (int i = 0; i < 8; ++i) x[i] = std::nearbyint(x[i]);
  return x;
}
inline Floats8 lookup(const float* table, Ints8 at) {
  Floats8 out;
  for (int i = 0; i < 8; ++i) out[i] = table[at[i]];
  return out;
}
inline Bits8 reverse_bits(Bits8 x) {
  x = (x << 16) | (x >> 16);
  x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

// Four 16 bit floats from any address. Exact, also where threads flush what is too small for a float.
inline Floats4 load_halves(const void* from) {
  std::uint16_t halves[4];
  std::memcpy(halves, from, sizeof halves);
  Floats4 out;
  for (int i = 0; i < 4; ++i) {
    const std::uint32_t sign = (halves[i] & 0x8000u) << 16, rest = halves[i] & 0x7fffu;
    std::uint32_t bits = (rest << 13) + (112u << 23);
    if (rest < 0x400u) bits = std::bit_cast<std::uint32_t>(static_cast<float>(rest) * 0x1p-24f);
    if (rest >= 0x7c00u) bits = rest << 13 | 0x7f800000u | (rest > 0x7c00u ? 0x400000u : 0u);
    out[i] = std::bit_cast<float>(sign | bits);
  }
  return out;
}
// N numbers, 2 to 4; the rest is 0. Reads nothing behind them.
template <std::size_t N>
Floats4 load_few(const float* from) {
  Floats4 out{};
  std::memcpy(&out, from, N * sizeof(float));
  return out;
}

}  // namespace plain
}  // namespace cloudrenderer
