#pragma once
// Random quadrics and pbrt's parametrisation of them, written down a second time in double
// precision.
#include <cmath>
#include <cstdint>

#include "base/random.h"
#include "shapes/geometry.h"

namespace cloudrenderer::shapes_test {

class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double uniform() { return static_cast<double>(mix64(state_++) >> 11) * 0x1p-53; }
  double uniform(double lo, double hi) { return lo + (hi - lo) * uniform(); }
  float uniformf(double lo, double hi) { return static_cast<float>(uniform(lo, hi)); }
  bool flip() { return uniform() < 0.5; }
  glm::dvec3 direction() {
    const double z = uniform(-1, 1), phi = uniform(0, 2 * M_PI), r = std::sqrt(1 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
  }

 private:
  std::uint64_t state_;
};

inline Mat4 scaling(const Vec3& s) {
  Mat4 m(1.f);
  for (int i = 0; i < 3; ++i) m[i][i] = s[i];
  return m;
}
inline Mat4 translation(const Vec3& t) {
  Mat4 m(1.f);
  m[3] = glm::vec4(t, 1.f);
  return m;
}
inline Mat4 rotation(Random& r) {
  const glm::dvec3 a = r.direction();
  const glm::dvec3 b = glm::normalize(glm::cross(a, r.direction())), c = glm::cross(a, b);
  Mat4 m(1.f);
  m[0] = glm::vec4(Vec3(a), 0.f);
  m[1] = glm::vec4(Vec3(b), 0.f);
  m[2] = glm::vec4(Vec3(c), 0.f);
  return m;
}

inline constexpr QuadricKind kKinds[] = {QuadricKind::sphere,     QuadricKind::cylinder,
                                         QuadricKind::disk,       QuadricKind::cone,
                                         QuadricKind::paraboloid, QuadricKind::hyperboloid};

// A quadric of about the given size; `clipped`: with random phi_max and z range.
inline Quadric random_quadric(Random& r, QuadricKind kind, double size, bool clipped) {
  Quadric q;
  q.kind = kind;
  q.radius = static_cast<float>(size * r.uniform(0.5, 1));
  q.phi_max = clipped ? r.uniformf(0.5, 6) : 2 * kPi;
  switch (kind) {
    case QuadricKind::sphere:
      q.z_min = clipped ? -q.radius * r.uniformf(0.1, 0.9) : -q.radius;
      q.z_max = clipped ? q.radius * r.uniformf(0.1, 0.9) : q.radius;
      break;
    case QuadricKind::cylinder:
      q.z_min = static_cast<float>(-size * r.uniform(0.2, 1));
      q.z_max = static_cast<float>(size * r.uniform(0.2, 1));
      break;
    case QuadricKind::disk:
      q.inner_radius = clipped ? q.radius * r.uniformf(0.1, 0.8) : 0.f;
      q.height = q.z_min = q.z_max = static_cast<float>(size * r.uniform(-1, 1));
      break;
    case QuadricKind::cone:
      q.height = q.z_max = static_cast<float>(size * r.uniform(0.3, 2));
      q.z_min = 0.f;
      break;
    case QuadricKind::paraboloid:
      q.z_max = static_cast<float>(size * r.uniform(0.3, 2));
      q.z_min = clipped ? q.z_max * r.uniformf(0.1, 0.7) : 0.f;
      break;
    case QuadricKind::hyperboloid:
      // Nearest to the axis at z = 0: only then is pbrt's surface the turned segment's.
      q.p1 = static_cast<float>(size) * Vec3(r.uniformf(0.3, 1), 0, 0);
      q.p2 = q.p1;
      {
        const Vec3 along = static_cast<float>(size) * Vec3(0, r.uniformf(-1, 1), r.uniformf(0.2, 1));
        q.p1 -= 0.5f * along;
        q.p2 += (r.flip() ? 1.f : 0.25f) * along;
      }
      q.z_min = q.p1.z;
      q.z_max = q.p2.z;
      break;
  }
  return q;
}

inline glm::dvec3 object_point(const Quadric& q, double u, double v) {
  const double phi = u * static_cast<double>(q.phi_max), c = std::cos(phi), s = std::sin(phi);
  const double radius = q.radius, z_min = q.z_min, z_max = q.z_max;
  switch (q.kind) {
    case QuadricKind::sphere: {
      const double first = std::acos(z_min / radius), last = std::acos(z_max / radius);
      const double theta = first + v * (last - first);
      return {radius * std::sin(theta) * c, radius * std::sin(theta) * s, radius * std::cos(theta)};
    }
    case QuadricKind::cylinder:
      return {radius * c, radius * s, z_min + v * (z_max - z_min)};
    case QuadricKind::disk: {
      const double r = (1 - v) * radius + v * static_cast<double>(q.inner_radius);
      return {r * c, r * s, q.height};
    }
    case QuadricKind::cone:
      return {radius * (1 - v) * c, radius * (1 - v) * s, v * static_cast<double>(q.height)};
    case QuadricKind::paraboloid: {
      const double z = z_min + v * (z_max - z_min), r = radius * std::sqrt(z / z_max);
      return {r * c, r * s, z};
    }
    case QuadricKind::hyperboloid: {
      const glm::dvec3 p = (1 - v) * glm::dvec3(q.p1) + v * glm::dvec3(q.p2);
      return {p.x * c - p.y * s, p.x * s + p.y * c, p.z};
    }
  }
  return {};
}

inline glm::dvec3 world_point(const Quadric& q, double u, double v) {
  return glm::dvec3(glm::dmat4(q.object_to_world.matrix()) * glm::dvec4(object_point(q, u, v), 1));
}

// The normal that pbrt-v2 gives a shape that is not reversed: dpdu x dpdv, turned back where the
// transform mirrors.
inline glm::dvec3 world_normal(const Quadric& q, double u, double v) {
  const double h = 1e-6;
  const glm::dvec3 du = world_point(q, u + h, v) - world_point(q, u - h, v);
  const glm::dvec3 dv = world_point(q, u, v + h) - world_point(q, u, v - h);
  const glm::dvec3 n = glm::normalize(glm::cross(du, dv));
  return q.object_to_world.swaps_handedness() ? -n : n;
}

// The distance of a world point to the unclipped surface, to first order, in long double.
inline double distance_to_surface(const Quadric& q, const Vec3& p) {
  using V = glm::vec<3, long double>;
  using M = glm::mat<3, 3, long double>;
  const M m = M(glm::mat3(q.object_to_world.matrix())), inverse = glm::inverse(m);
  const V o = inverse * (V(p) - V(Vec3(q.object_to_world.matrix()[3])));
  const long double radius = q.radius;
  long double f = 0;
  V gradient(0);
  switch (q.kind) {
    case QuadricKind::sphere:
      f = glm::dot(o, o) - radius * radius;
      gradient = o + o;
      break;
    case QuadricKind::cylinder:
      f = o.x * o.x + o.y * o.y - radius * radius;
      gradient = V(2 * o.x, 2 * o.y, 0);
      break;
    case QuadricKind::disk:
      f = o.z - q.height;
      gradient = V(0, 0, 1);
      break;
    case QuadricKind::cone: {
      const long double k = radius / q.height, z = o.z - q.height;
      f = o.x * o.x + o.y * o.y - k * k * z * z;
      gradient = V(2 * o.x, 2 * o.y, -2 * k * k * z);
      break;
    }
    case QuadricKind::paraboloid: {
      const long double k = q.z_max / (radius * radius);
      f = k * (o.x * o.x + o.y * o.y) - o.z;
      gradient = V(2 * k * o.x, 2 * k * o.y, -1);
      break;
    }
    case QuadricKind::hyperboloid: {
      const V p1(q.p1), p2(q.p2), step = (p2 - p1) / (p2.z - p1.z), at = p1 + (o.z - p1.z) * step;
      f = o.x * o.x + o.y * o.y - at.x * at.x - at.y * at.y;
      gradient = V(2 * o.x, 2 * o.y, -2 * (at.x * step.x + at.y * step.y));
      break;
    }
  }
  const V world_gradient = glm::transpose(inverse) * gradient;
  const long double length = std::sqrt(glm::dot(world_gradient, world_gradient));
  return length > 0 ? static_cast<double>(std::abs(f) / length) : 0.0;
}

}  // namespace cloudrenderer::shapes_test
