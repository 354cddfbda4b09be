#pragma once
// Every random number is a pure function of (seed, pixel, sample, dimension).
#include <cstdint>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// A 64-bit finaliser (Stafford's mix 13 of the splitmix family): a bijection with full avalanche.
constexpr std::uint64_t mix64(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

// Uniform in [0, 1): the 24 upper bits, so that 1 is never reached by rounding.
constexpr float to_unit(std::uint32_t bits) { return static_cast<float>(bits >> 8) * 0x1p-24f; }

constexpr std::uint32_t reverse_bits(std::uint32_t x) {
  x = __builtin_bswap32(x);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

// A hash on bit-reversed input whose every bit depends only on lower bits: an Owen scramble of the reversed value.
// Constants: Burley 2020, "Practical Hash-based Owen Scrambling" (after Laine and Karras), with Vegdahl's improvement.
constexpr std::uint32_t owen_hash_reversed(std::uint32_t x, std::uint32_t seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

// The second Sobol dimension of an index given as it is, bits reversed (the matrix is Pascal's triangle mod 2).
constexpr std::uint32_t sobol1_reversed(std::uint32_t i) {
  i ^= (i >> 16) & 0x0000ffffu;  // lower triangle by doubling: row r gets C(c, r) mod 2
  i ^= (i & 0xff00ff00u) >> 8;
  i ^= (i & 0xf0f0f0f0u) >> 4;
  i ^= (i & 0xccccccccu) >> 2;
  i ^= (i & 0xaaaaaaaau) >> 1;
  return i;
}

// The random numbers of one sample: an Owen-scrambled Sobol (0,2)-sequence per pair of dimensions, each pair with its
// own scramble and its own shuffle of the sample index (padding). With `random` plain independent numbers instead.
// Even and odd samples of a pixel are two independently scrambled sequences: the halves of the error estimate.
class SampleSequence {
 public:
  enum class Kind : std::uint8_t { sobol, independent };

  SampleSequence(Kind kind, std::uint32_t seed, std::uint32_t pixel, std::uint32_t sample)
      : key_(mix64((std::uint64_t{seed} << 32 | pixel) * 2 + (sample & 1) + 0x9e3779b97f4a7c15u)),
        index_(sample >> 1), kind_(kind) {}

  float get_1d(std::uint32_t dimension) const {
    const std::uint64_t h = mix64(key_ + std::uint64_t{dimension} * 0xd1342543de82ef95u);
    const auto lo = static_cast<std::uint32_t>(h), hi = static_cast<std::uint32_t>(h >> 32);
    if (kind_ == Kind::independent) return to_unit(static_cast<std::uint32_t>(mix64(h ^ index_) >> 32));
    // Shuffling the index by an Owen scramble in reversed space and then reversing gives the radical inverse's bits.
    const std::uint32_t shuffled = owen_shuffle(index_, lo);
    return to_unit(reverse_bits(owen_hash_reversed(shuffled, hi)));
  }
  Vec2 get_2d(std::uint32_t dimension) const {
    const std::uint64_t h = mix64(key_ + std::uint64_t{dimension} * 0xd1342543de82ef95u);
    const auto lo = static_cast<std::uint32_t>(h), hi = static_cast<std::uint32_t>(h >> 32);
    if (kind_ == Kind::independent) {
      const std::uint64_t r = mix64(h ^ index_);
      return {to_unit(static_cast<std::uint32_t>(r >> 32)), to_unit(static_cast<std::uint32_t>(r))};
    }
    const std::uint32_t shuffled = owen_shuffle(index_, lo);
    const std::uint32_t x = owen_hash_reversed(shuffled, hi);
    const std::uint32_t y = owen_hash_reversed(sobol1_reversed(shuffled), hi * 0x9e3779b9u ^ lo);
    return {to_unit(reverse_bits(x)), to_unit(reverse_bits(y))};
  }

 private:
  static std::uint32_t owen_shuffle(std::uint32_t i, std::uint32_t seed) {
    return reverse_bits(owen_hash_reversed(reverse_bits(i), seed));
  }
  std::uint64_t key_;
  std::uint32_t index_;
  Kind kind_;
};

}  // namespace cloudrenderer
