#include "shapes/curve.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"
#include "shapes/surface.h"

namespace cloudrenderer {

namespace {

using glm::dvec2;
using glm::dvec3;

using Cubic = std::array<dvec3, 4>;

template <class V>
V lerp(const V& a, const V& b, double w) {
  return (1 - w) * a + w * b;
}

// The blossom of the cubic (Ramshaw 1987): blossoms at (a,a,a), (a,a,b), (a,b,b), (b,b,b) are the control points
// between a and b.
dvec3 blossom(const Cubic& c, double a, double b, double d) {
  const std::array<dvec3, 3> one = {lerp(c[0], c[1], a), lerp(c[1], c[2], a), lerp(c[2], c[3], a)};
  return lerp(lerp(one[0], one[1], b), lerp(one[1], one[2], b), d);
}
Cubic between(const Cubic& c, double a, double b) {
  return {blossom(c, a, a, a), blossom(c, a, a, b), blossom(c, a, b, b), blossom(c, b, b, b)};
}
Cubic cubic_of(const CurvePiece& c) { return {dvec3(c.p[0]), dvec3(c.p[1]), dvec3(c.p[2]), dvec3(c.p[3])}; }

struct Derivatives {
  dvec3 p, d1, d2;
};
Derivatives evaluate(const Cubic& c, double w) {
  const dvec3 a = lerp(c[0], c[1], w), b = lerp(c[1], c[2], w), d = lerp(c[2], c[3], w);
  const dvec3 e = lerp(a, b, w), f = lerp(b, d, w);
  return {lerp(e, f, w), 3.0 * (f - e), 6.0 * (d - 2.0 * b + a)};
}

void halve(const Cubic& c, Cubic& left, Cubic& right) {
  const dvec3 a = 0.5 * (c[0] + c[1]), b = 0.5 * (c[1] + c[2]), d = 0.5 * (c[2] + c[3]);
  const dvec3 e = 0.5 * (a + b), f = 0.5 * (b + d), m = 0.5 * (e + f);
  left = {c[0], a, e, m};
  right = {m, f, d, c[3]};
}

double width_at(const CurvePiece& c, double u) { return lerp(static_cast<double>(c.width[0]), static_cast<double>(c.width[1]), u); }

// The normal of a ribbon, on the arc between those of its ends (Shoemake 1985). pbrt takes angles beyond 90 degrees for
// 90.
dvec3 ribbon_normal(const CurvePiece& c, double u) {
  const dvec3 a(c.n[0]), b(c.n[1]);
  const double cosine = std::clamp(glm::dot(a, b), 0.0, 1.0), sine = std::sqrt(1 - cosine * cosine);
  if (sine < 1e-6) return a;
  const double angle = portable::atan2(static_cast<float>(sine), static_cast<float>(cosine));
  return (portable::sin((1 - u) * angle) * a + portable::sin(u * angle) * b) / sine;
}

// As wide as the ray along the unit vector `way` sees it.
double seen_width(const CurvePiece& c, const dvec3& way, double u) {
  const double width = width_at(c, u);
  return c.kind == CurveKind::ribbon ? width * std::abs(glm::dot(ribbon_normal(c, u), way)) : width;
}

dvec3 any_orthogonal(const dvec3& n) {
  return glm::normalize(std::abs(n.x) < 0.7 ? glm::cross(n, dvec3(1, 0, 0)) : glm::cross(n, dvec3(0, 1, 0)));
}

// Where the curve goes at its start (side 0) or end, seen along the ray. Control points may coincide.
dvec2 end_tangent(const Cubic& c, int side) {
  const std::size_t from = side ? 3 : 0;
  for (const std::size_t i : {1, 2, 3}) {
    const dvec2 t(c[side ? 3 - i : i] - c[from]);
    if (t.x != 0 || t.y != 0) return side ? -t : t;
  }
  return dvec2(0);
}

// Seen along its own direction a curve turns around within less than its width. Where it does, the distance to the ray
// has several minima, and their places are found only when they are taken apart.
bool turns(const Cubic& c) {
  const dvec2 a(c[1] - c[0]), b(c[2] - c[1]), d(c[3] - c[2]);
  return glm::dot(a, b) < 0 || glm::dot(b, d) < 0 || glm::dot(a, d) < 0;
}

// A cubic seen along the ray: z is the distance, (x, y) the offset from the ray.
struct Sight {
  const CurvePiece& curve;
  dvec3 way;  // unit
  double length, t_min, t_max;
  CurveHit* best;

  bool misses(const Cubic& q, double u0, double u1) const {
    const double half = 0.5 * std::max(width_at(curve, u0), width_at(curve, u1));
    for (int axis = 1; axis >= 0; --axis) {
      const double low = std::min({q[0][axis], q[1][axis], q[2][axis], q[3][axis]});
      const double high = std::max({q[0][axis], q[1][axis], q[2][axis], q[3][axis]});
      if (low - half > 0 || high + half < 0) return true;
    }
    const double near = std::min({q[0].z, q[1].z, q[2].z, q[3].z}), far = std::max({q[0].z, q[1].z, q[2].z, q[3].z});
    // t is compared as float below: a rounding more is let through.
    return near > t_max * length * (1 + 1e-6) || far < t_min * length;
  }

  // Halvings after which a cubic is straight to a twentieth of its width (the bound of pbrt; Nairn, Peters and
  // Lutterkort 1999 have the deviation from second differences, which a halving makes four times smaller).
  int depth(const Cubic& q) const {
    double second = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      const dvec2 d(q[i] - 2.0 * q[i + 1] + q[i + 2]);
      second = std::max({second, std::abs(d.x), std::abs(d.y)});
    }
    const double allowed = 0.05 * static_cast<double>(std::max(curve.width[0], curve.width[1]));
    int n = 0;
    for (double off = 1.06 * second; off > allowed && n < 10; off *= 0.25) ++n;
    return n;
  }

  // What the ray passes of an almost straight cubic. Its ends are cut at right angles, so that neighbours fit.
  void pass(const Cubic& q, double u0, double u1) const {
    constexpr double kSlack = 1e-13;  // rounding must not open a gap
    for (int side = 0; side < 2; ++side) {
      const dvec2 tangent = end_tangent(q, side), end(q[side ? 3 : 0]);
      const double inside = (side ? 1 : -1) * glm::dot(end, tangent);
      if (inside < -kSlack * (glm::dot(end, end) + glm::dot(tangent, tangent))) return;
    }
    const dvec2 chord(q[3] - q[0]);
    const double chord2 = glm::dot(chord, chord);
    if (!(chord2 > 0)) return;
    double w = std::clamp(-glm::dot(dvec2(q[0]), chord) / chord2, 0.0, 1.0);
    // To where the curve is nearest to the ray (Newton).
    Derivatives at = evaluate(q, w);
    for (int i = 0; i < 3; ++i) {
      const dvec2 p(at.p), d1(at.d1), d2(at.d2);
      const double slope = glm::dot(d1, d1) + glm::dot(p, d2);
      if (!(slope > 0)) break;
      const double next = std::clamp(w - glm::dot(p, d1) / slope, 0.0, 1.0);
      if (next == w) break;
      w = next;
      at = evaluate(q, w);
    }
    const double u = lerp(u0, u1, w), width = seen_width(curve, way, u);
    const dvec2 p(at.p), along(at.d1);
    const double distance2 = glm::dot(p, p);
    if (!(distance2 <= 0.25 * width * width && width > 0)) return;
    const auto t = static_cast<float>(at.p.z / length);
    if (!(static_cast<double>(t) > t_min && static_cast<double>(t) <= t_max) || t >= best->t) return;
    const double across = std::sqrt(distance2) / width;
    const bool left = along.y * p.x - along.x * p.y > 0;
    *best = {t, std::clamp(static_cast<float>(u), 0.f, 1.f), std::clamp(static_cast<float>(left ? 0.5 + across : 0.5 - across), 0.f, 1.f)};
  }
};

// Weights of a cubic's control points in those of a segment of it: lane j of weight i is that of point i in point j.
using Float4 = float __attribute__((vector_size(16)));
using SegmentWeights = std::array<Float4, 4>;

constexpr SegmentWeights segment_weights(float a, float b) {
  SegmentWeights w{};
  for (int j = 0; j < 4; ++j) {
    const float x = j < 3 ? a : b, y = j < 2 ? a : b, z = j < 1 ? a : b;
    w[0][j] = (1 - x) * (1 - y) * (1 - z);
    w[1][j] = x * (1 - y) * (1 - z) + (1 - x) * y * (1 - z) + (1 - x) * (1 - y) * z;
    w[2][j] = x * y * (1 - z) + x * (1 - y) * z + (1 - x) * y * z;
    w[3][j] = x * y * z;
  }
  return w;
}

// By 2^log2_segments + number. They are exact.
const std::array<SegmentWeights, 16> kSegmentWeights = [] {
  std::array<SegmentWeights, 16> all{};
  for (std::size_t log2 = 0; log2 < 4; ++log2)
    for (std::size_t i = 0; i < std::size_t{1} << log2; ++i) {
      const float count = static_cast<float>(1 << log2), number = static_cast<float>(i);
      all[(std::size_t{1} << log2) + i] = segment_weights(number / count, (number + 1) / count);
    }
  return all;
}();

bool all(Float4 x, bool (*holds)(float)) { return holds(x[0]) && holds(x[1]) && holds(x[2]) && holds(x[3]); }

}  // namespace

bool surely_misses(const Vec3* points, float largest_width, std::uint32_t log2_segments, std::uint32_t number,
                   const Vec3& origin, const Vec3& direction, float t_min, float t_max) {
  const SegmentWeights& w = kSegmentWeights[(1u << log2_segments) + number];
  Float4 x{}, y{}, z{};
  float size = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Vec3 p = points[i] - origin;
    size = std::max(size, std::max(std::abs(p.x), std::max(std::abs(p.y), std::abs(p.z))));
    x += w[i] * p.x;
    y += w[i] * p.y;
    z += w[i] * p.z;
  }
  // Far above all rounding here.
  const float slack = 0.5f * largest_width + 1e-5f * size;
  const Vec3 chord(x[3] - x[0], y[3] - y[0], z[3] - z[0]);
  const Vec3 side = glm::cross(direction, chord);
  const float reach2 = slack * slack * glm::dot(side, side);
  if (!(reach2 > 1e-30f && reach2 < 1e30f)) return false;
  const auto outside = [](Float4 d, float r) {
    const Float4 above = d - r, below = d + r;
    return all(above, [](float v) { return v > 0.f; }) || all(below, [](float v) { return v < 0.f; });
  };
  if (outside(x * side.x + y * side.y + z * side.z, std::sqrt(reach2))) return true;
  const float length2 = glm::dot(direction, direction);
  const Vec3 along = glm::cross(side, direction);
  if (outside(x * along.x + y * along.y + z * along.z, std::sqrt(reach2 * length2))) return true;
  const Float4 depth = x * direction.x + y * direction.y + z * direction.z;
  const float margin = slack * std::sqrt(length2), low = t_min * length2 - margin, high = t_max * length2 + margin;
  return (depth[0] < low && depth[1] < low && depth[2] < low && depth[3] < low) ||
         (depth[0] > high && depth[1] > high && depth[2] > high && depth[3] > high);
}

bool intersect(const CurvePiece& c, double u0, double u1, const CurveRay& ray, float t_min, float t_max, CurveHit& hit) {
  const double length = std::sqrt(glm::dot(ray.direction, ray.direction));
  if (!(length > 0)) return false;
  const dvec3 way = ray.direction / length;
  Cubic q = cubic_of(c);
  for (dvec3& p : q) p -= ray.origin;
  if (u0 > 0 || u1 < 1) q = between(q, u0, u1);
  // Along the chord the curve has hardly any y: most rays miss in y.
  const dvec3 side = glm::cross(way, q[3] - q[0]);
  const double side2 = glm::dot(side, side);
  const dvec3 y = side2 > 0 ? side / std::sqrt(side2) : any_orthogonal(way), x = glm::cross(y, way);
  for (dvec3& p : q) p = {glm::dot(p, x), glm::dot(p, y), glm::dot(p, way)};

  CurveHit best;
  const Sight sight{c, way, length, t_min, t_max, &best};
  if (sight.misses(q, u0, u1)) return false;
  struct Part {
    Cubic q;
    double u0, u1;
    int depth;  // halvings to come
  };
  constexpr int kMostHalvings = 20;
  std::array<Part, kMostHalvings + 2> stack;
  std::size_t n = 0;
  const int first = sight.depth(q);
  stack[n++] = {q, u0, u1, first};
  while (n > 0) {
    const Part part = stack[--n];
    if (part.depth <= 0 && (first - part.depth == kMostHalvings || !turns(part.q))) {
      sight.pass(part.q, part.u0, part.u1);
      continue;
    }
    Cubic left, right;
    halve(part.q, left, right);
    const double middle = 0.5 * (part.u0 + part.u1);
    if (!sight.misses(right, middle, part.u1)) stack[n++] = {right, middle, part.u1, part.depth - 1};
    if (!sight.misses(left, part.u0, middle)) stack[n++] = {left, part.u0, middle, part.depth - 1};
  }
  if (!(best.t < kInfinity)) return false;
  hit = best;
  return true;
}

SurfacePoint surface_point(const CurvePiece& c, bool flip, const dvec3& direction, float u, float v) {
  const dvec3 way = glm::normalize(direction);
  const Derivatives at = evaluate(cubic_of(c), u);
  dvec3 dpdu = at.d1;
  if (!(glm::dot(dpdu, dpdu) > 0)) dpdu = dvec3(c.p[3]) - dvec3(c.p[0]);
  dvec3 across = glm::cross(way, dpdu);
  const double across2 = glm::dot(across, across);
  across = across2 > 0 ? across / std::sqrt(across2) : any_orthogonal(way);
  const double width = seen_width(c, way, u), off = static_cast<double>(v) - 0.5;
  const dvec3 p = at.p + off * width * across;
  dvec3 dpdv = across;
  if (c.kind == CurveKind::ribbon) {
    dpdv = glm::cross(ribbon_normal(c, u), dpdu);
    const double l2 = glm::dot(dpdv, dpdv);
    dpdv = l2 > 0 ? dpdv / std::sqrt(l2) : across;
  } else if (c.kind == CurveKind::cylinder) {
    // Turned around the curve by -90 to 90 degrees, which gives the round side that the ray does not see: so it is in
    // pbrt.
    const double angle = off * static_cast<double>(kPi);
    dpdv = portable::cos(angle) * across - portable::sin(angle) * glm::cross(glm::normalize(dpdu), across);
  }
  dvec3 n = glm::cross(dpdu, dpdv);
  const double n2 = glm::dot(n, n);
  n = n2 > 0 ? n / std::sqrt(n2) : way;
  if (flip) n = -n;

  SurfacePoint s;
  s.p = Vec3(p);
  s.p_error = Vec3(static_cast<float>(2 * width)) + 0x1p-23f * glm::abs(s.p);
  s.ng = s.ns = Vec3(n);
  s.uv = {u, v};
  s.dpdu = Vec3(dpdu);
  s.dpdv = Vec3(width * dpdv);
  s.shading_dpdu = Vec3(dpdu - n * glm::dot(n, dpdu));
  s.shading_dpdv = Vec3(width * (dpdv - n * glm::dot(n, dpdv)));
  return s;
}

Bounds3 object_bounds(const CurvePiece& c, double u0, double u1) {
  Bounds3 box;
  for (const dvec3& p : between(cubic_of(c), u0, u1)) box.extend(Vec3(p));
  const auto half = static_cast<float>(0.5000001 * std::max(width_at(c, u0), width_at(c, u1)));
  box.min -= Vec3(half);
  box.max += Vec3(half);
  return box;
}

CurvePiece part_of(const CurvePiece& c, double u0, double u1) {
  if (u0 <= 0 && u1 >= 1) return c;
  CurvePiece out = c;
  const Cubic q = between(cubic_of(c), u0, u1);
  for (std::size_t i = 0; i < 4; ++i) out.p[i] = Vec3(q[i]);
  out.width = {static_cast<float>(width_at(c, u0)), static_cast<float>(width_at(c, u1))};
  if (c.kind == CurveKind::ribbon) out.n = {Vec3(ribbon_normal(c, u0)), Vec3(ribbon_normal(c, u1))};
  return out;
}

}  // namespace cloudrenderer
