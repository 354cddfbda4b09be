#pragma once
// Where a ray meets the triangle that Embree says it meets, to the bit the same on every processor.
#include <array>

#include "base/lanes.h"

namespace cloudrenderer {

// p = (1-u-v) a + u b + v c, at origin + t direction.
template <class F>
struct TriangleHitOf {
  F t, u, v;
};

// Embree's robust test finds sides and distance by products of edges relative to the ray's origin (Pluecker coordinates);
// all of it is multiplications and additions, the same everywhere, up to the last step: it multiplies by a reciprocal that
// is an estimate of the processor's make and one step of Newton's. These are the same quantities, of the same operations in
// the same order, and divided. So t is within kEmbreeError of Embree's for any triangle, however thin or far away.
inline constexpr float kEmbreeError = 0x1p-20f;

template <class F>
TriangleHitOf<F> triangle_hit(const std::array<Vec3Of<F>, 3>& corners, const Vec3Of<F>& origin, const Vec3Of<F>& direction) {
  using lanes::fma, lanes::abs, lanes::select;
  const auto dot = [](const Vec3Of<F>& x, const Vec3Of<F>& y) { return fma(x.x, y.x, fma(x.y, y.y, x.z * y.z)); };
  const auto cross = [](const Vec3Of<F>& x, const Vec3Of<F>& y) {
    return Vec3Of<F>(fma(x.y, y.z, -(x.z * y.y)), fma(x.z, y.x, -(x.x * y.z)), fma(x.x, y.y, -(x.y * y.x)));
  };
  const Vec3Of<F> a = corners[0] - origin, b = corners[1] - origin, c = corners[2] - origin;
  const Vec3Of<F> ca = c - a, ab = a - b, bc = b - c;
  const F u = dot(cross(ca, c + a), direction), v = dot(cross(ab, a + b), direction), w = dot(cross(bc, b + c), direction);
  // Of the two pairs of edges whose product is the normal, in each component the one that cancels less.
  const auto component = [](F x0, F y0, F z0, F w0, F x1, F y1, F z1, F w1) {
    const F left0 = x0 * y0, left1 = x1 * y1;
    return select(abs(left0) < abs(left1), fma(z0, w0, -left0), fma(z1, w1, -left1));
  };
  const Vec3Of<F> n(component(ca.z, ab.y, ca.y, ab.z, ab.z, bc.y, ab.y, bc.z),
                    component(ca.x, ab.z, ca.z, ab.x, ab.x, bc.z, ab.z, bc.x),
                    component(ca.y, ab.x, ca.x, ab.y, ab.y, bc.x, ab.x, bc.y));
  const F sum = u + v + w;
  const auto none = abs(sum) < 1e-18f;  // as Embree, whose reciprocals end here
  const F divisor = select(none, F(1.f), sum);
  return {dot(a, n) / dot(n, direction), select(none, F(0.f), u / divisor), select(none, F(0.f), v / divisor)};
}

}  // namespace cloudrenderer
