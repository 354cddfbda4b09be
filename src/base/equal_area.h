#pragma once
#include <cmath>

#include "base/portable_math.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// The map between the unit square and the sphere that keeps areas, octahedral, with +z in the middle
// (Clarberg 2008, "Fast equal-area mapping of the (hemi)sphere using SIMD"): pbrt-v4's environment
// maps.
inline Vec3 equal_area_square_to_sphere(const Vec2& uv) {
  const Vec2 p = 2.f * uv - 1.f, a = glm::abs(p);
  const float side = 1.f - (a.x + a.y), r = 1.f - std::fabs(side);
  const float phi = (r == 0.f ? 1.f : (a.y - a.x) / r + 1.f) * (kPi / 4);
  float s, c;
  portable::sincos(phi, s, c);
  const float out = r * std::sqrt(std::max(0.f, 2.f - r * r));
  return {std::copysign(c, p.x) * out, std::copysign(s, p.y) * out,
          std::copysign(1.f - r * r, side)};
}

// Of a unit direction.
inline Vec2 equal_area_sphere_to_square(const Vec3& d) {
  const Vec3 a = glm::abs(d);
  const float r = std::sqrt((a.x * a.x + a.y * a.y) / (1.f + a.z));  // sqrt(1 - z) without cancellation
  const float phi = portable::atan2(a.y, a.x) * (2.f * kInvPi);
  Vec2 p(r - phi * r, phi * r);
  if (d.z < 0.f) p = {1.f - p.y, 1.f - p.x};
  return 0.5f * (Vec2(std::copysign(p.x, d.x), std::copysign(p.y, d.y)) + 1.f);
}

}  // namespace cloudrenderer
