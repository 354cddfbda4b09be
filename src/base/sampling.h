#pragma once
// Warps of the unit square with their densities, and piecewise constant distributions.
#include <cstdint>
#include <span>
#include <vector>

#include "base/lanes.h"
#include "base/portable_math.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Concentric map of the unit square to the unit disk (Shirley and Chiu 1997). Density 1/pi.
template <class F>
Vec2Of<F> sample_disk(const Vec2Of<F>& u) {
  using lanes::select;
  const F a = 2.f * u.x - 1.f, b = 2.f * u.y - 1.f;
  const MaskOf<F> first = a * a > b * b;
  const F r = select(first, a, b), other = select(first, b, a);
  F s, c;
  portable::sincos_eighth<F>(select(r != 0.f, (kPi / 4) * (other / r), F(0.f)), s, c);
  return {r * select(first, c, s), r * select(first, s, c)};  // the angle, or pi/2 minus it
}
// Density cos(theta)/pi over the hemisphere around z.
inline Vec3 sample_cosine_hemisphere(const Vec2& u) {
  const Vec2 d = sample_disk(u);
  return {d.x, d.y, std::sqrt(std::max(0.f, 1.f - d.x * d.x - d.y * d.y))};
}
// Density 1/(2 pi).
inline Vec3 sample_uniform_hemisphere(const Vec2& u) {
  const float z = u.x, r = std::sqrt(std::max(0.f, 1.f - z * z));
  float s, c;
  portable::sincos_turn(u.y, s, c);
  return {r * c, r * s, z};
}
// Density 1/(4 pi).
template <class F>
Vec3Of<F> sample_uniform_sphere(const Vec2Of<F>& u) {
  const F z = 1.f - 2.f * u.x, r = lanes::sqrt(lanes::max(0.f, 1.f - z * z));
  F s, c;
  portable::sincos_turn<F>(u.y, s, c);
  return {r * c, r * s, z};
}
// Barycentrics (b0, b1) of a uniform point of a triangle (Heitz 2019, low distortion).
template <class F>
Vec2Of<F> sample_triangle(const Vec2Of<F>& u) {
  const MaskOf<F> low = u.x < u.y;
  const F x = 0.5f * u.x, y = 0.5f * u.y;
  return {lanes::select(low, x, u.x - y), lanes::select(low, u.y - x, y)};
}

// A piecewise constant density over [0, 1). Non-negative values; all zero behaves as uniform. At most 2^24 pieces: their
// borders are multiples of 2^-24, as the numbers are that choose among them, and the density of a piece follows from its
// borders. So every piece comes exactly as often as its density says, however small it is beside others.
class Distribution1D {
 public:
  Distribution1D() = default;
  explicit Distribution1D(std::span<const float> values);
  std::size_t size() const { return size_; }
  float integral() const { return integral_; }  // mean of the values
  // u in [0, 1) -> x in [0, 1); pdf is the density at x; `cell` the index of the piece.
  float sample(float u, float& pdf, std::size_t& cell) const;
  float pdf(float x) const;
  float cell_probability(std::size_t cell) const { return cdf_[cell + 1] - cdf_[cell]; }
  // Bring what sample(u) reads into the cache: the first is waited for by the second.
  void prefetch_guide(float u) const { __builtin_prefetch(&guide_[block_of(u)]); }
  void prefetch_piece(float u) const { __builtin_prefetch(&cdf_[guide_[block_of(u)]]); }
  std::uint64_t bytes() const { return cdf_.size() * sizeof(float) + guide_.size() * sizeof(std::uint32_t); }

 private:
  static constexpr std::uint32_t kQuanta = 1u << 24;
  std::size_t block_of(float u) const {
    return std::min(static_cast<std::size_t>(u * static_cast<float>(guide_.size())), guide_.size() - 1);
  }
  std::size_t size_ = 0;
  std::vector<float> cdf_;  // first 0, that of size() is 1; then eight that are above every u
  // The piece that has i / n of n entries, one for about eight pieces: where to search from (Chen and Asau 1974).
  std::vector<std::uint32_t> guide_;
  float integral_ = 0;
};

// A piecewise constant density over the unit square, row v first.
class Distribution2D {
 public:
  Distribution2D() = default;
  Distribution2D(std::span<const float> values, std::size_t width, std::size_t height);
  Vec2 sample(const Vec2& u, float& pdf) const;
  Vec2 sample(bool, const Vec2& u, float& pdf) const { return sample(u, pdf); }
  // The same for the `active` ones of eight.
  Vec2x8 sample(Mask8 active, const Vec2x8& u, Float8& pdf) const;
  float pdf(const Vec2& p) const;
  std::uint64_t bytes() const;

 private:
  std::vector<Distribution1D> rows_;
  Distribution1D marginal_;
};

}  // namespace cloudrenderer
