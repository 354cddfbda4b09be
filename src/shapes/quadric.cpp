#include "shapes/quadric.h"

#include <cmath>

#include "base/portable_math.h"
#include "shapes/surface.h"

namespace cloudrenderer {

namespace {

using DMat3 = glm::dmat3;

struct Local {
  DMat3 to_world;
  DVec3 translation;
  double determinant;
  DMat3 to_object;

  // Transform::inverse_matrix() is rounded to float, which moves a far shape by a good part of its
  // size.
  explicit Local(const Quadric& q)
      : to_world(Mat4(q.object_to_world.matrix())),
        translation(q.object_to_world.matrix()[3]),
        determinant(glm::determinant(to_world)),
        to_object(glm::inverse(to_world)) {}

  DVec3 origin(const Vec3& p) const { return to_object * (DVec3(p) - translation); }
  DVec3 direction(const Vec3& d) const { return to_object * DVec3(d); }
};

// a b - c d with one rounding error (Kahan; see Jeannerod, Louvet and Muller 2013).
double difference_of_products(double a, double b, double c, double d) {
  const double cd = c * d;
  const double error = std::fma(-c, d, cd);
  return std::fma(a, b, -cd) + error;
}

struct Roots {
  int count = 0;
  double t[2] = {0, 0};
  double nearest_approach = 0;
};

Roots solve(const Quadric& q, const QuadricOps& ops, const DVec3& origin, const DVec3& direction) {
  Roots roots;
  const double length2 = glm::dot(direction, direction);
  if (!(length2 > 0)) return roots;
  // From the point of the ray that is nearest to the centre, so that the coefficients do not cancel
  // for far origins (after Haines, Günther and Akenine-Möller 2019, "Precision Improvements for
  // Ray/Sphere Intersection").
  const double shift = -glm::dot(origin, direction) / length2;
  roots.nearest_approach = shift;
  const RayEquation e = ops.equation(q, origin + shift * direction, direction);
  const double discriminant = difference_of_products(e.b, e.b, e.a, e.c);
  // What rounding of a, b and c can make of 0: rays through the apex of a cone are such.
  if (!(discriminant >= -1e-15 * (e.b * e.b + std::abs(e.a * e.c)))) return roots;
  const double root = std::sqrt(std::max(discriminant, 0.0));
  const double s = e.b > 0 ? -(e.b + root) : root - e.b;
  double t0 = s / e.a, t1 = e.c / s;
  if (t1 < t0) std::swap(t0, t1);
  for (const double t : {t0, t1})
    if (std::isfinite(t)) roots.t[roots.count++] = shift + t;
  return roots;
}

// The angle around the axis from where u starts, in [0, 2 pi].
float azimuth(const Quadric& q, const DVec3& p) {
  double x = p.x, y = p.y;
  if (q.kind == QuadricKind::hyperboloid) {
    const DVec3 p1(q.p1), p2(q.p2);
    const DVec3 start = p1 + (p.z - p1.z) / (p2.z - p1.z) * (p2 - p1);
    x = p.x * start.x + p.y * start.y;
    y = start.x * p.y - start.y * p.x;
  }
  const double largest = std::max(std::abs(x), std::abs(y));
  if (!(largest > 0)) return 0.f;
  const float phi =
      portable::atan2(static_cast<float>(y / largest), static_cast<float>(x / largest));
  return phi < 0.f ? phi + 2 * kPi : phi;
}

bool is_clipped_away(const Quadric& q, const QuadricOps& ops, const DVec3& p) {
  return !ops.inside(q, p) || (q.phi_max < 2 * kPi && azimuth(q, p) > q.phi_max);
}

// The object-space point of the hit at t. intersect() found it, so some root rounds to t.
DVec3 hit_point(const Quadric& q, const QuadricOps& ops, const DVec3& o, const DVec3& d, float t) {
  const Roots roots = solve(q, ops, o, d);
  DVec3 best = ops.project(q, o + (roots.count ? roots.t[0] : roots.nearest_approach) * d);
  double best_distance = std::numeric_limits<double>::infinity();
  for (int i = 0; i < roots.count; ++i) {
    const DVec3 p = ops.project(q, o + roots.t[i] * d);
    const double distance =
        std::abs(static_cast<double>(static_cast<float>(roots.t[i])) - static_cast<double>(t));
    if (distance < best_distance && !is_clipped_away(q, ops, p)) {
      best_distance = distance;
      best = p;
    }
  }
  return best;
}

bool normal_is_turned(const Quadric& q, bool flip, double determinant) {
  // The normal below is transformed by the inverse transpose, which keeps its side where dpdu x
  // dpdv changes it.
  return (flip != (determinant < 0)) != (q.inside_out != 0);
}

double column_scale2(const DMat3& m) {
  return (glm::dot(m[0], m[0]) + glm::dot(m[1], m[1]) + glm::dot(m[2], m[2])) / 3;
}

// World area over object area at a point with the unit world normal n.
double area_ratio(const Local& local, const DVec3& n) {
  return std::abs(local.determinant) / glm::length(glm::transpose(local.to_world) * n);
}

}  // namespace

const QuadricOps& quadric_ops(QuadricKind kind) {
  switch (kind) {
    case QuadricKind::sphere:
      return kSphereOps;
    case QuadricKind::cylinder:
      return kCylinderOps;
    case QuadricKind::disk:
      return kDiskOps;
    case QuadricKind::cone:
      return kConeOps;
    case QuadricKind::paraboloid:
      return kParaboloidOps;
    case QuadricKind::hyperboloid:
      return kHyperboloidOps;
  }
  return kSphereOps;
}

bool intersect(const Quadric& q, const Vec3& origin, const Vec3& direction, float t_min,
               float t_max, QuadricHit& hit) {
  const QuadricOps& ops = quadric_ops(q.kind);
  const Local local(q);
  const DVec3 o = local.origin(origin), d = local.direction(direction);
  const Roots roots = solve(q, ops, o, d);
  for (int i = 0; i < roots.count; ++i) {
    const auto t = static_cast<float>(roots.t[i]);
    if (!(t > t_min && t <= t_max && t < kInfinity)) continue;
    if (is_clipped_away(q, ops, ops.project(q, o + roots.t[i] * d))) continue;
    hit.t = t;
    return true;
  }
  return false;
}

SurfacePoint surface_point(const Quadric& q, bool flip, const Vec3& origin, const Vec3& direction,
                           float t) {
  const QuadricOps& ops = quadric_ops(q.kind);
  const Local local(q);
  const DMat3& m = local.to_world;
  const DVec3 p = hit_point(q, ops, local.origin(origin), local.direction(direction), t);

  SurfacePoint s;
  s.p = Vec3(m * p + local.translation);
  for (int i = 0; i < 3; ++i) {
    // Rounding to float, and what double arithmetic may have lost (about 40 times its true bound).
    const double magnitude = std::abs(m[0][i] * p.x) + std::abs(m[1][i] * p.y) +
                             std::abs(m[2][i] * p.z) + std::abs(local.translation[i]);
    s.p_error[i] = 0x1p-23f * std::abs(s.p[i]) + static_cast<float>(1e-14 * magnitude) +
                   std::numeric_limits<float>::min();
  }
  // Its normal is not that of its surface (see hyperboloid.cpp), and rays are offset along the normal.
  if (q.kind == QuadricKind::hyperboloid) s.p_error = Vec3(4 * max_component(s.p_error));

  const double r = radius_of(p), clearance = kAxisClearance * ops.max_radius(q);
  const double c = r > 0 ? p.x / r : 1, sn = r > 0 ? p.y / r : 0;
  const double r_safe = std::max(r, clearance);
  const DVec3 er(c, sn, 0), ephi(-sn, c, 0), ez(0, 0, 1);
  const Meridian k = ops.meridian(q, p, r_safe);
  const double phi_max = q.phi_max;
  s.uv = {std::min(azimuth(q, p) / q.phi_max, 1.f), std::clamp(static_cast<float>(k.v), 0.f, 1.f)};

  const DVec3 dpdu = m * (phi_max * r_safe * ephi);
  const DVec3 dpdv = m * (k.r1 * er + k.phi1 * ephi + k.z1 * ez);
  const DVec3 d2uu = m * (-phi_max * phi_max * r_safe * er);
  const DVec3 d2uv = m * (phi_max * (k.r1 * ephi - k.phi1 * er));
  const DVec3 d2vv = m * (k.r2 * er + k.z2 * ez);

  DVec3 n = glm::normalize(glm::transpose(local.to_object) * (k.normal_r * er + k.normal_z * ez));
  if (normal_is_turned(q, flip, local.determinant)) n = -n;

  // Weingarten's equations, in world space: the derivatives of the unit normal under any affine
  // transform.
  const double E = glm::dot(dpdu, dpdu), F = glm::dot(dpdu, dpdv), G = glm::dot(dpdv, dpdv);
  const double e = glm::dot(n, d2uu), f = glm::dot(n, d2uv), g = glm::dot(n, d2vv);
  const double area2 = E * G - F * F;
  if (area2 > 0) {
    s.dndu = Vec3(((f * F - e * G) * dpdu + (e * F - f * E) * dpdv) / area2);
    s.dndv = Vec3(((g * F - f * G) * dpdu + (f * F - g * E) * dpdv) / area2);
  }
  s.ng = s.ns = Vec3(n);
  s.dpdu = s.shading_dpdu = Vec3(dpdu);
  s.dpdv = s.shading_dpdv = Vec3(dpdv);
  return s;
}

Bounds3 world_bounds(const Quadric& q) {
  const QuadricOps& ops = quadric_ops(q.kind);
  const Local local(q);
  const DMat3& m = local.to_world;
  const double radius = ops.max_radius(q);
  double z_min = q.z_min, z_max = q.z_max;
  // Extent of the arc [0, phi_max] of the circle; hyperboloids start anywhere.
  double x_min = -radius, y_min = -radius, y_max = radius;
  const bool whole = q.phi_max >= 2 * kPi || q.kind == QuadricKind::hyperboloid;
  if (!whole) {
    const double s = portable::sin(static_cast<double>(q.phi_max)),
                 c = portable::cos(static_cast<double>(q.phi_max));
    if (q.phi_max <= kPi) x_min = std::min(0.0, radius * c);
    if (q.phi_max <= kPi)
      y_min = 0;
    else if (q.phi_max <= 1.5f * kPi)
      y_min = radius * s;
    if (q.phi_max <= 0.5f * kPi) y_max = radius * s;
  }
  const double x_mid = 0.5 * (x_min + radius), x_half = 0.5 * (radius - x_min);
  const double y_mid = 0.5 * (y_min + y_max), y_half = 0.5 * (y_max - y_min);
  const double z_mid = 0.5 * (z_min + z_max), z_half = 0.5 * (z_max - z_min);
  Bounds3 bounds;
  for (int i = 0; i < 3; ++i) {
    const double ax = m[0][i], ay = m[1][i], az = m[2][i], t = local.translation[i];
    // Two boxes that hold the shape: around the object-space box, and around the solid of
    // revolution.
    const double center = t + ax * x_mid + ay * y_mid + az * z_mid;
    const double half = std::abs(ax) * x_half + std::abs(ay) * y_half + std::abs(az) * z_half;
    const double around = radius * std::sqrt(ax * ax + ay * ay);
    double lo = std::max(center - half, t + az * z_mid - std::abs(az) * z_half - around);
    double hi = std::min(center + half, t + az * z_mid + std::abs(az) * z_half + around);
    if (q.kind == QuadricKind::sphere) {
      const double reach = radius * std::sqrt(ax * ax + ay * ay + az * az);
      lo = std::max(lo, t - reach);
      hi = std::min(hi, t + reach);
    }
    const double slack = 4e-7 * std::max(std::abs(lo), std::abs(hi)) + 1e-6 * half;
    bounds.min[i] = next_float_down(static_cast<float>(lo - slack));
    bounds.max[i] = next_float_up(static_cast<float>(hi + slack));
  }
  return bounds;
}

float surface_area(const Quadric& q) {
  const DMat3 m(Mat4(q.object_to_world.matrix()));
  const double area = quadric_ops(q.kind).area(q);
  if (q.kind == QuadricKind::disk)
    return static_cast<float>(area * glm::length(glm::cross(m[0], m[1])));
  return static_cast<float>(area * column_scale2(m));
}

bool sample_area(const Quadric& q, bool flip, const Vec2& u, Vec3& p, Vec3& n, float& pdf_area) {
  const QuadricOps& ops = quadric_ops(q.kind);
  if (!ops.sample) return false;
  const Local local(q);
  DVec3 po, no;
  ops.sample(q, u, po, no);
  DVec3 nw = glm::normalize(glm::transpose(local.to_object) * no);
  pdf_area = static_cast<float>(1 / (ops.area(q) * area_ratio(local, nw)));
  if (normal_is_turned(q, flip, local.determinant)) nw = -nw;
  p = Vec3(local.to_world * po + local.translation);
  n = Vec3(nw);
  return true;
}

float area_pdf(const Quadric& q, const Vec3& n) {
  const QuadricOps& ops = quadric_ops(q.kind);
  if (!ops.sample) return 0.f;
  const Local local(q);
  return static_cast<float>(1 / (ops.area(q) * area_ratio(local, glm::normalize(DVec3(n)))));
}

}  // namespace cloudrenderer
