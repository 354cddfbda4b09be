#pragma once
#include <cmath>
#include <cstdint>

#include "base/random.h"

namespace cloudrenderer::sim {

// A stream of random numbers that is a function of its seed.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : state_(mix64(seed + 0x1234567)) {}
  std::uint64_t bits() { return mix64(state_ += 0x9e3779b97f4a7c15u); }
  std::uint64_t below(std::uint64_t n) { return bits() % n; }
  std::uint32_t between(std::uint32_t lo, std::uint32_t hi) {  // both included
    return lo + static_cast<std::uint32_t>(below(std::uint64_t{hi} - lo + 1));
  }
  double real() { return static_cast<double>(bits() >> 11) * 0x1p-53; }
  bool chance(double p) { return real() < p; }
  // Time until the next event of a Poisson process.
  double exponential(double rate) { return -std::log1p(-real()) / rate; }

 private:
  std::uint64_t state_;
};

}  // namespace cloudrenderer::sim
