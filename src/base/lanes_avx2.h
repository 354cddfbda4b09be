#pragma once
// lanes_plain.h in instructions of x86-64-v3.
#include <immintrin.h>

#include "base/lanes_plain.h"

namespace cloudrenderer::avx2 {

inline bool any(Ints8 m) { return !_mm256_testz_si256(reinterpret_cast<__m256i>(m), reinterpret_cast<__m256i>(m)); }
inline std::uint32_t to_bits(Ints8 m) { return static_cast<std::uint32_t>(_mm256_movemask_ps(reinterpret_cast<__m256>(m))); }
inline Floats8 select(Ints8 m, Floats8 a, Floats8 b) { return _mm256_blendv_ps(b, a, reinterpret_cast<__m256>(m)); }
inline Floats8 min(Floats8 a, Floats8 b) { return _mm256_min_ps(b, a); }
inline Floats8 max(Floats8 a, Floats8 b) { return _mm256_max_ps(b, a); }
inline Floats8 sqrt(Floats8 x) { return _mm256_sqrt_ps(x); }
inline Floats8 fma(Floats8 a, Floats8 b, Floats8 c) { return _mm256_fmadd_ps(a, b, c); }
inline Floats8 nearbyint(Floats8 x) { return _mm256_round_ps(x, _MM_FROUND_CUR_DIRECTION); }
inline Floats8 lookup(const float* table, Ints8 at) {
  return _mm256_i32gather_ps(table, reinterpret_cast<__m256i>(at), sizeof(float));
}
inline Bits8 reverse_bits(Bits8 x) {
  // Bytes turned round, and in each the two halves by a table of sixteen.
  const __m256i bytes = _mm256_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12, 3, 2, 1, 0, 7, 6, 5, 4, 11, 10,
                                         9, 8, 15, 14, 13, 12);
  const __m256i low = _mm256_setr_epi8(0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15, 0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5,
                                       13, 3, 11, 7, 15);
  const __m256i half = _mm256_set1_epi8(15), turned = _mm256_shuffle_epi8(reinterpret_cast<__m256i>(x), bytes);
  const __m256i high = _mm256_slli_epi16(_mm256_shuffle_epi8(low, _mm256_and_si256(turned, half)), 4);
  const __m256i rest = _mm256_shuffle_epi8(low, _mm256_and_si256(_mm256_srli_epi16(turned, 4), half));
  return reinterpret_cast<Bits8>(_mm256_or_si256(high, rest));
}
inline Floats4 load_halves(const void* from) { return _mm_cvtph_ps(_mm_loadl_epi64(static_cast<const __m128i*>(from))); }
template <std::size_t N>
Floats4 load_few(const float* from) {
  static_assert(N >= 2 && N <= 4);
  if constexpr (N == 2) return _mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(from)));
  if constexpr (N == 3) return _mm_maskload_ps(from, _mm_setr_epi32(-1, -1, -1, 0));
  return _mm_loadu_ps(from);
}

}  // namespace cloudrenderer::avx2
