#pragma once
// The surface at a hit on a triangle. In the hottest path of the renderer: inline, no memory, and
// nothing computed that the triangle has no data for.
#include <array>

#include "shapes/surface.h"

namespace cloudrenderer {

// The corners of one triangle, or of eight; normals and uvs are read only where the flags say so. In lanes without
// normals or uvs these are zero or (0,0) (1,0) (1,1).
template <class F>
struct TriangleVerticesOf {
  std::array<Vec3Of<F>, 3> p;
  std::array<Vec3Of<F>, 3> n;
  std::array<Vec2Of<F>, 3> uv;
  bool has_normals = false, has_uvs = false;
};
using TriangleVertices = TriangleVerticesOf<float>;

// What every vertex of a path needs of a triangle.
template <class F>
struct TrianglePointOf {
  Vec3Of<F> p, p_error, ng, ns;  // as in SurfacePoint
  Vec3Of<F> cross;               // unit, of the edges as they are
  Vec3Of<F> n;                   // interpolated normal as it is; unset without normals
};

namespace triangle_detail {

// The cross product of two edges, unit length; also for triangles so small that the product
// underflows.
inline Vec3 extreme_normal(const Vec3& e0, const Vec3& e1) {
  const auto largest = [](const Vec3& v) {
    return std::max(std::abs(v.x), std::max(std::abs(v.y), std::abs(v.z)));
  };
  const float s0 = largest(e0), s1 = largest(e1);
  if (!(s0 > 0.f && s1 > 0.f)) return {0.f, 0.f, 1.f};
  const Vec3 unit = safe_normalize(glm::cross(e0 / s0, e1 / s1));
  return unit == Vec3(0.f) ? Vec3(0.f, 0.f, 1.f) : unit;
}
template <class F>
Vec3Of<F> unit_normal(const Vec3Of<F>& e0, const Vec3Of<F>& e1, const Vec3Of<F>& cross) {
  return normalize_or(cross, [&](std::size_t i) { return extreme_normal(lanes::get(e0, i), lanes::get(e1, i)); });
}

// How far from the triangle a tracer may see its plane that computes the normal in float: where three long edges span
// little area, the products of two of them cancel to the area, and what is left of their rounding tilts the plane along
// the third. (The bound of a cross product's error, Higham 2002 section 3.1, times the longest way in the triangle.)
// Nothing where the triangle's circumcircle is not far larger than it. At most a quarter of its width, so that slivers
// that no float can tell from lines do not send rays from somewhere else. Squares first: one root.
template <class F>
F plane_error(const Vec3Of<F>& e0, const Vec3Of<F>& e1, const Vec3Of<F>& cross) {
  const Vec3Of<F> e2 = e0 - e1;
  const F d0 = glm::dot(e0, e0), d1 = glm::dot(e1, e1), d2 = glm::dot(e2, e2), area2 = glm::dot(cross, cross);
  const F longest2 = lanes::max(d0, lanes::max(d1, d2)) + 1e-37f;
  const F circle2 = d0 * (d1 / area2) * d2, width2 = area2 / longest2;
  const F error2 = lanes::min(0x1p-44f * circle2, 0.0625f * width2);
  return lanes::select(circle2 > 64.f * longest2, lanes::sqrt(error2), F(0.f));
}

}  // namespace triangle_detail

// u, v are Embree's: p = (1-u-v) a + u b + v c. `flip` is reverse_orientation xor swaps_handedness.
//   Sides. pbrt-v2's geometric normal is dpdu x dpdv, so it turns over where the uv map is mirrored
//   or degenerate;
// normals do not matter to it. pbrt-v3's is the cross product of the edges, and is then put on the
// side of the shading normal. (Mesh normals already carry their sign, see make_geometry.)
template <class F>
[[gnu::always_inline]] inline TrianglePointOf<F> triangle_basics(const TriangleVerticesOf<F>& tri, MaskOf<F> flip, Dialect dialect,
                                                                 F u, F v) {
  const Vec3Of<F>&a = tri.p[0], &b = tri.p[1], &c = tri.p[2];
  const F w = 1.f - u - v;
  const Vec3Of<F> pa = w * a, pb = u * b, pc = v * c;
  TrianglePointOf<F> s;
  s.p = pa + pb + pc;
  // "Physically Based Rendering", 3rd ed., section 3.9.4: seven roundings from the barycentrics to
  // p.
  s.p_error = F(rounding_gamma(7)) * (lanes::abs(pa) + lanes::abs(pb) + lanes::abs(pc));

  const Vec3Of<F> e0 = a - c, e1 = b - c, cross = glm::cross(e0, e1);
  s.cross = triangle_detail::unit_normal(e0, e1, cross);
  s.p_error += triangle_detail::plane_error(e0, e1, cross);
  MaskOf<F> turned = flip;
  if (tri.has_uvs && dialect == Dialect::v2) {
    const Vec2Of<F> d0 = tri.uv[0] - tri.uv[2], d1 = tri.uv[1] - tri.uv[2];
    const F determinant = d0.x * d1.y - d0.y * d1.x;
    turned = flip != !(determinant > 0.f);
  }
  s.ng = lanes::select(turned, -s.cross, s.cross);
  s.ns = s.ng;
  if (tri.has_normals) {
    s.n = w * tri.n[0] + u * tri.n[1] + v * tri.n[2];
    const Vec3Of<F> unit = safe_normalize(s.n);
    const MaskOf<F> given = !lanes::is_black(unit);
    s.ns = lanes::select(given, unit, s.ns);
    if (dialect != Dialect::v2) s.ng = lanes::select(given && glm::dot(s.ng, s.ns) < 0.f, -s.ng, s.ng);
  }
  return s;
}

// The whole surface point. Without `derivatives` the fields dpdu to shading_dpdv stay zero; any frame around ns serves
// an isotropic BSDF.
template <class F>
[[gnu::always_inline]] inline SurfacePointOf<F> triangle_point(const TriangleVerticesOf<F>& tri, MaskOf<F> flip, Dialect dialect,
                                                               F u, F v, bool derivatives = true) {
  using lanes::select;
  const TrianglePointOf<F> basics = triangle_basics<F>(tri, flip, dialect, u, v);
  SurfacePointOf<F> s;
  s.p = basics.p;
  s.p_error = basics.p_error;
  s.ng = basics.ng;
  s.ns = basics.ns;
  Vec2Of<F> d0(F(-1.f), F(-1.f)), d1(F(0.f), F(-1.f));  // uv differences of the default uvs (0,0) (1,0) (1,1)
  F determinant = 1.f;
  if (tri.has_uvs) {
    d0 = tri.uv[0] - tri.uv[2];
    d1 = tri.uv[1] - tri.uv[2];
    determinant = d0.x * d1.y - d0.y * d1.x;
    s.uv = (1.f - u - v) * tri.uv[0] + u * tri.uv[1] + v * tri.uv[2];
  } else {
    s.uv = {u + v, v};
  }
  if (!derivatives) return s;

  const Vec3Of<F>&a = tri.p[0], &b = tri.p[1], &c = tri.p[2];
  const Vec3Of<F> e0 = a - c, e1 = b - c;
  const F inverse = 1.f / determinant;
  const MaskOf<F> has_map = determinant != 0.f && lanes::is_finite(inverse);
  s.dpdu = (d1.y * e0 - d0.y * e1) * inverse;
  s.dpdv = (d0.x * e1 - d1.x * e0) * inverse;
  if (lanes::any(!has_map)) {
    Vec3Of<F> x, y;
    orthonormal_basis(-basics.cross, x, y);
    s.dpdu = select(has_map, s.dpdu, x);
    s.dpdv = select(has_map, s.dpdv, y);
  }
  s.shading_dpdu = s.dpdu;
  s.shading_dpdv = s.dpdv;
  if (!tri.has_normals) return s;

  const F length = glm::dot(basics.n, s.ns);
  const MaskOf<F> curved = has_map && length > 0.f;
  if (lanes::any(curved)) {
    const Vec3Of<F> n0 = tri.n[0] - tri.n[2], n1 = tri.n[1] - tri.n[2], flat(F(0.f));
    const F scale = inverse / length;
    const Vec3Of<F> du = (d1.y * n0 - d0.y * n1) * scale, dv = (d0.x * n1 - d1.x * n0) * scale;
    s.dndu = select(curved, du - s.ns * glm::dot(s.ns, du), flat);
    s.dndv = select(curved, dv - s.ns * glm::dot(s.ns, dv), flat);
  }
  // In pbrt-v4 dpdu keeps its length and its side, and gives dpdv its length.
  const Vec3Of<F> t = dialect == Dialect::v4 ? glm::cross(s.ns, s.dpdu) : safe_normalize(glm::cross(safe_normalize(s.dpdu), s.ns));
  s.shading_dpdu = glm::cross(t, s.ns);
  s.shading_dpdv = dialect == Dialect::v2 ? select(flip, -t, t) : t;
  const MaskOf<F> along = lanes::is_black(t);  // dpdu is along ns
  if (lanes::any(along)) {
    Vec3Of<F> x, y;
    orthonormal_basis(s.ns, x, y);
    s.shading_dpdu = select(along, x, s.shading_dpdu);
    s.shading_dpdv = select(along, y, s.shading_dpdv);
  }
  return s;
}

}  // namespace cloudrenderer
