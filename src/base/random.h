#pragma once
// Every random number is a pure function of (seed, pixel, sample, dimension).
#include <array>
#include <cstdint>
#include <type_traits>

#include "base/lanes.h"

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
// T: a number, or lanes of them (Bits8).
template <class T>
constexpr T owen_hash_reversed(T x, T seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

// The second Sobol dimension of an index given as it is, bits reversed (the matrix is Pascal's triangle mod 2).
template <class T>
constexpr T sobol1_reversed(T i) {
  i ^= (i >> 16) & 0x0000ffffu;  // lower triangle by doubling: row r gets C(c, r) mod 2
  i ^= (i & 0xff00ff00u) >> 8;
  i ^= (i & 0xf0f0f0f0u) >> 4;
  i ^= (i & 0xccccccccu) >> 2;
  i ^= (i & 0xaaaaaaaau) >> 1;
  return i;
}

inline Bits8 reverse_bits(Bits8 x) { return lanes::processor::reverse_bits(x); }
// A 32-bit finaliser of low bias (Wellons 2018, "Prospecting for Hash Functions").
inline Bits8 mix32(Bits8 x) {
  x = (x ^ (x >> 16)) * 0x7feb352du;
  x = (x ^ (x >> 15)) * 0x846ca68bu;
  return x ^ (x >> 16);
}

inline Float8 to_unit(Bits8 bits) { return lanes::to_float(lanes::as_signed(bits >> 8)) * 0x1p-24f; }

// A pair of the sequence, from the index with its bits reversed. T: a number, or lanes of them.
template <class T>
auto sobol_pair(T index_reversed, T shuffle, T scramble_x, T scramble_y) {
  // Shuffling the index by an Owen scramble in reversed space and then reversing gives the radical inverse's bits.
  const T shuffled = reverse_bits(owen_hash_reversed(index_reversed, shuffle));
  const auto x = to_unit(reverse_bits(owen_hash_reversed(shuffled, scramble_x)));
  const auto y = to_unit(reverse_bits(owen_hash_reversed(sobol1_reversed(shuffled), scramble_y)));
  return glm::vec<2, std::remove_const_t<decltype(x)>>(x, y);
}

// The random numbers of one sample: an Owen-scrambled Sobol (0,2)-sequence per pair of dimensions, each pair with its
// own scramble and its own shuffle of the sample index (padding). With `random` plain independent numbers instead.
// Even and odd samples of a pixel are two independently scrambled sequences: the halves of the error estimate.
class SampleSequence {
 public:
  enum class Kind : std::uint8_t { sobol, independent };

  SampleSequence() = default;
  SampleSequence(Kind kind, std::uint32_t seed, std::uint32_t pixel, std::uint32_t sample)
      : key_(mix64((std::uint64_t{seed} << 32 | pixel) * 2 + (sample & 1) + 0x9e3779b97f4a7c15u)),
        index_(sample >> 1), kind_(kind) {}

  Vec2 get_2d(std::uint32_t dimension) const {
    const std::uint64_t h = pair_hash(dimension);
    const auto lo = static_cast<std::uint32_t>(h), hi = static_cast<std::uint32_t>(h >> 32);
    if (kind_ == Kind::independent) {
      const std::uint64_t r = mix64(h ^ index_);
      return {to_unit(static_cast<std::uint32_t>(r >> 32)), to_unit(static_cast<std::uint32_t>(r))};
    }
    return sobol_pair(reverse_bits(index_), lo, hi, hi * 0x9e3779b9u ^ lo);
  }

  // Four pairs at once for about the price of one; other numbers than get_2d's. `dimension` counts groups of four.
  struct Pairs {
    alignas(32) float numbers[8];
    Vec2 operator[](std::size_t i) const { return {numbers[i], numbers[4 + i]}; }
  };
  Pairs get_pairs(std::uint32_t dimension) const {
    const std::uint64_t h = group_hash(dimension);
    const auto lo = static_cast<std::uint32_t>(h), hi = static_cast<std::uint32_t>(h >> 32);
    constexpr Bits8 kLane = {0u, 1u, 2u, 3u, 4u, 5u, 6u, 7u};
    const Bits8 scramble = mix32(hi + kLane * 0x9e3779b9u);
    Bits8 bits;
    if (kind_ == Kind::independent) {
      bits = mix32(mix32(lo + kLane * 0x85ebca6bu + index_) ^ scramble);
    } else {
      const Bits8 seed = mix32(lo + (kLane & 3u) * 0x85ebca6bu);
      const Bits8 index = reverse_bits(index_) + Bits8{};
      const Bits8 shuffled = reverse_bits(owen_hash_reversed(index, seed));  // lanes 4 to 7 as 0 to 3
      const Bits8 second = sobol1_reversed(shuffled);
      bits = reverse_bits(owen_hash_reversed(
          __builtin_shufflevector(shuffled, second, 0, 1, 2, 3, 12, 13, 14, 15), scramble));
    }
    Pairs out;
    to_unit(bits).store(out.numbers);
    return out;
  }

  // Of eight samples, each lane as the above.
  using Eight = std::array<SampleSequence, kLanes>;
  static Vec2x8 get_2d(const Eight& of, std::uint32_t dimension) {
    if (of[0].kind_ == Kind::independent) {
      Columns<2> out;
      for (std::size_t i = 0; i < kLanes; ++i) out.put(0, i, of[i].get_2d(dimension));
      return out.two(0);
    }
    const Hashes8 h(of, [&](std::size_t i) { return of[i].pair_hash(dimension); });
    return sobol_pair(h.index_reversed, h.lo, h.hi, h.hi * 0x9e3779b9u ^ h.lo);
  }
  // dimension: of each lane. Only the pairs from `first` on and before `end` are wanted: the others may stay 0.
  static std::array<Vec2x8, 4> get_pairs(const Eight& of, const std::array<std::uint32_t, kLanes>& dimension,
                                         std::uint32_t first = 0, std::uint32_t end = 4) {
    std::array<Vec2x8, 4> out{};
    if (of[0].kind_ == Kind::independent) {
      std::array<Float8, 8> rows;
      for (std::size_t i = 0; i < kLanes; ++i) rows[i] = Float8::load(of[i].get_pairs(dimension[i]).numbers);
      lanes::transpose(rows);
      for (std::size_t k = 0; k < 4; ++k) out[k] = {rows[k], rows[4 + k]};
      return out;
    }
    const Hashes8 h(of, [&](std::size_t i) { return of[i].group_hash(dimension[i]); });
    for (std::uint32_t k = first; k < end; ++k)
      out[k] = sobol_pair(h.index_reversed, mix32(h.lo + k * 0x85ebca6bu), mix32(h.hi + k * 0x9e3779b9u),
                          mix32(h.hi + (4 + k) * 0x9e3779b9u));
    return out;
  }

 private:
  std::uint64_t pair_hash(std::uint32_t dimension) const {
    return mix64(key_ + std::uint64_t{dimension} * 0xd1342543de82ef95u);
  }
  std::uint64_t group_hash(std::uint32_t dimension) const {
    return mix64(key_ + 0x632be59bd9b4e019u + std::uint64_t{dimension} * 0xd1342543de82ef95u);
  }
  struct Hashes8 {
    Bits8 lo, hi, index_reversed;
    template <class Hash>
    Hashes8(const Eight& of, Hash hash) {
      alignas(32) std::uint32_t columns[3][kLanes];
      for (std::size_t i = 0; i < kLanes; ++i) {
        const std::uint64_t h = hash(i);
        columns[0][i] = static_cast<std::uint32_t>(h);
        columns[1][i] = static_cast<std::uint32_t>(h >> 32);
        columns[2][i] = of[i].index_;
      }
      const auto load = [](const std::uint32_t* c) {
        Bits8 b;
        std::memcpy(&b, c, sizeof b);
        return b;
      };
      lo = load(columns[0]);
      hi = load(columns[1]);
      index_reversed = reverse_bits(load(columns[2]));
    }
  };

  std::uint64_t key_ = 0;
  std::uint32_t index_ = 0;
  Kind kind_ = Kind::sobol;
};

}  // namespace cloudrenderer
