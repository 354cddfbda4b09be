#pragma once
// Points of surfaces, whatever they were made from: where new rays start, and what an instance does
// to them.
#include <bit>
#include <cstdint>

#include "base/lanes.h"
#include "shapes/geometry.h"

namespace cloudrenderer {

// Bound of the relative error of n float operations in a row (Higham 2002, section 3.1).
constexpr float rounding_gamma(int n) {
  constexpr float unit = 0x1p-24f;
  return static_cast<float>(n) * unit / (1.f - static_cast<float>(n) * unit);
}

inline float next_float_up(float x) {
  if (!(x < kInfinity)) return x;
  if (x == 0.f) return std::numeric_limits<float>::min();  // tracing threads flush denormals
  const auto bits = std::bit_cast<std::uint32_t>(x);
  return std::bit_cast<float>(x > 0.f ? bits + 1 : bits - 1);
}
inline float next_float_down(float x) { return -next_float_up(-x); }

// What takes p out of its error box along ng, rounding of the sum included: no ray that starts at p + this finds the
// surface it comes from (Pharr, Jakob and Humphreys, "Physically Based Rendering", 3rd ed., section 3.9.5).
template <class F>
Vec3Of<F> ray_offset(const Vec3Of<F>& p, const Vec3Of<F>& p_error, const Vec3Of<F>& ng) {
  const Vec3Of<F> size = lanes::abs(p);
  // A plane through a zero coordinate has no rounding error; but Embree accepts hits at a distance of 0, and a turn by 180
  // degrees leaves 1e-16 where the zero would be.
  const F least = 0x1p-40f * (size.x + size.y + size.z) + 1e-30f;
  return (glm::dot(lanes::abs(ng), p_error + F(0x1p-23f) * size) + least) * ng;
}
// Where a ray along `direction` starts: on that side of ng. `offset` as above.
template <class F>
Vec3Of<F> ray_start(const Vec3Of<F>& p, const Vec3Of<F>& offset, const Vec3Of<F>& ng, const Vec3Of<F>& direction) {
  return lanes::select(glm::dot(direction, ng) < 0.f, p - offset, p + offset);
}
inline Vec3 offset_ray_origin(const Vec3& p, const Vec3& p_error, const Vec3& ng, const Vec3& direction) {
  return ray_start(p, ray_offset(p, p_error, ng), ng, direction);
}

// A unit vector along v, also where the squared length leaves the range of floats; the zero vector for zero or NaN.
inline Vec3 normalize_extreme(const Vec3& v) {
  const float largest = std::max(std::abs(v.x), std::max(std::abs(v.y), std::abs(v.z)));
  if (!(largest > 0.f && largest < kInfinity)) return Vec3(0.f);
  const Vec3 scaled = v / largest;
  return scaled * (1.f / std::sqrt(glm::dot(scaled, scaled)));
}
// v * (1 / length), and where that leaves the range of floats what `extreme(lane)` says.
template <class F, class Extreme>
Vec3Of<F> normalize_or(const Vec3Of<F>& v, Extreme extreme) {
  const F length2 = glm::dot(v, v);
  const MaskOf<F> usual = length2 > 1e-30f && length2 < 1e30f;
  Vec3Of<F> out = v * (1.f / lanes::sqrt(length2));
  if (lanes::any(!usual)) lanes::for_each(!usual, [&](std::size_t i) { lanes::put(out, i, extreme(i)); });
  return out;
}
template <class F>
Vec3Of<F> safe_normalize(const Vec3Of<F>& v) {
  return normalize_or(v, [&](std::size_t i) { return normalize_extreme(lanes::get(v, i)); });
}

// A point of a prototype as a point of the world. Normals keep their side, as in pbrt, also when
// the instance is mirrored: they are transformed by the inverse transpose and normalised. The error
// of p grows by the rounding of the transform (same book, section 3.9.4).
inline SurfacePoint transformed(const SurfacePoint& s, const Transform& to_world) {
  SurfacePoint out;
  const Mat4& m = to_world.matrix();
  out.p = to_world.point(s.p);
  for (int i = 0; i < 3; ++i) {
    const Vec3 row = glm::abs(Vec3(m[0][i], m[1][i], m[2][i]));
    out.p_error[i] = (rounding_gamma(3) + 1.f) * glm::dot(row, s.p_error) +
                     rounding_gamma(3) * (glm::dot(row, glm::abs(s.p)) + std::abs(m[3][i]));
  }
  out.ng = safe_normalize(to_world.normal(s.ng));
  const Vec3 n = to_world.normal(s.ns);
  out.ns = safe_normalize(n);
  out.uv = s.uv;
  out.dpdu = to_world.vector(s.dpdu);
  out.dpdv = to_world.vector(s.dpdv);
  const auto in_plane = [&](const Vec3& v) { return v - out.ns * glm::dot(out.ns, v); };
  // The derivative of n / |n|.
  const float length = glm::dot(n, out.ns);
  const float inverse_length = length > 0.f ? 1.f / length : 0.f;
  out.dndu = in_plane(to_world.normal(s.dndu)) * inverse_length;
  out.dndv = in_plane(to_world.normal(s.dndv)) * inverse_length;
  out.shading_dpdu = in_plane(to_world.vector(s.shading_dpdu));
  out.shading_dpdv = in_plane(to_world.vector(s.shading_dpdv));
  return out;
}

// How far the ray that starts at a world point p may be from p once it is in a prototype's space and taken back again:
// by the rounding of the inverse transform, and of the point's way through it.
inline Vec3 inverse_error(const Vec3& p, const Transform& to_world) {
  const auto row = [](const Mat4& m, int i) { return glm::abs(Vec3(m[0][i], m[1][i], m[2][i])); };
  Vec3 local, world;
  for (int i = 0; i < 3; ++i)
    local[i] = rounding_gamma(5) * (glm::dot(row(to_world.inverse_matrix(), i), glm::abs(p)) +
                                    std::abs(to_world.inverse_matrix()[3][i]));
  for (int i = 0; i < 3; ++i) world[i] = glm::dot(row(to_world.matrix(), i), local);
  return world;
}

}  // namespace cloudrenderer
