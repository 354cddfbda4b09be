#pragma once
// Quadrics in long double, written down from their equations: what the renderer's own formulas are measured against.
#include <cmath>
#include <string>

#include "shapes/geometry.h"

namespace cloudrenderer::stability {

using Real = long double;
using Real3 = glm::vec<3, Real>;
using Real33 = glm::mat<3, 3, Real>;

// An affine map, as the floats of its matrix say.
struct RealAffine {
  Real33 linear{1};
  Real3 translation{0};

  RealAffine() = default;
  explicit RealAffine(const Mat4& m) : linear(Real33(glm::mat3(m))), translation(Real3(Vec3(m[3]))) {}
  RealAffine operator*(const RealAffine& inner) const {
    RealAffine out;
    out.linear = linear * inner.linear;
    out.translation = linear * inner.translation + translation;
    return out;
  }
  Real3 point(const Real3& p) const { return linear * p + translation; }
  Real3 inverse_point(const Real3& p) const { return glm::inverse(linear) * (p - translation); }
  Real3 inverse_vector(const Real3& v) const { return glm::inverse(linear) * v; }
};

// The unclipped surface f = 0 along the ray o + t w, in the quadric's own space: f(t) = quadratic t^2 + slope t + value.
struct AlongRay {
  Real quadratic = 0, slope = 0, value = 0;
  Real3 gradient{0};  // of f at o
};

inline AlongRay along(const Quadric& q, const Real3& o, const Real3& w) {
  AlongRay f;
  const Real radius = q.radius;
  const auto dot2 = [](const Real3& a, const Real3& b) { return a.x * b.x + a.y * b.y; };
  switch (q.kind) {
    case QuadricKind::sphere:
      f.quadratic = glm::dot(w, w);
      f.gradient = Real(2) * o;
      f.value = glm::dot(o, o) - radius * radius;
      break;
    case QuadricKind::cylinder:
      f.quadratic = dot2(w, w);
      f.gradient = Real3(2 * o.x, 2 * o.y, 0);
      f.value = dot2(o, o) - radius * radius;
      break;
    case QuadricKind::disk:
      f.gradient = Real3(0, 0, 1);
      f.value = o.z - Real(q.height);
      break;
    case QuadricKind::cone: {
      const Real k2 = (radius / q.height) * (radius / q.height), z = o.z - q.height;
      f.quadratic = dot2(w, w) - k2 * w.z * w.z;
      f.gradient = Real3(2 * o.x, 2 * o.y, -2 * k2 * z);
      f.value = dot2(o, o) - k2 * z * z;
      break;
    }
    case QuadricKind::paraboloid: {
      const Real k = Real(q.z_max) / (radius * radius);
      f.quadratic = k * dot2(w, w);
      f.gradient = Real3(2 * k * o.x, 2 * k * o.y, -1);
      f.value = k * dot2(o, o) - o.z;
      break;
    }
    case QuadricKind::hyperboloid: {
      // Of a segment that is nearest to the axis at z = 0, where pbrt's surface is the turned segment's.
      const Real3 p1(q.p1), step = (Real3(q.p2) - p1) / (Real(q.p2.z) - p1.z), at = p1 + (o.z - p1.z) * step;
      f.quadratic = dot2(w, w) - dot2(step, step) * w.z * w.z;
      f.gradient = Real3(2 * o.x, 2 * o.y, -2 * dot2(at, step));
      f.value = dot2(o, o) - dot2(at, at);
      break;
    }
  }
  f.slope = glm::dot(f.gradient, w);
  return f;
}

}  // namespace cloudrenderer::stability
