// Rays against quadrics of every size and place.
#include <gtest/gtest.h>

#include "shapes/surface.h"
#include "shapes_test_util.h"

namespace cloudrenderer {
namespace {

using namespace shapes_test;

struct Case {
  double size, offset, distance;  // offset and distance in units of the size
};
constexpr Case kCases[] = {{1, 0, 5},     {1e-6, 0, 3},     {1e9, 0, 10},  {1, 1e4, 5},
                           {1, 1e7, 1e3}, {1e-6, 1e7, 1e6}, {1e9, 1e7, 2}, {1, 0, 1e6},
                           {1, 1e5, 1e2}, {1e-3, 1e3, 1e6}, {1e6, 3, 0.1}, {20000, 0.9, 1e-4},
                           {1, 1, 0}};

Quadric placed(Random& r, QuadricKind kind, const Case& c, bool clipped) {
  Quadric q = random_quadric(r, kind, 1, clipped);
  const float scale = static_cast<float>(c.size) * (r.flip() ? 1.f : -1.f);
  const Vec3 stretch =
      r.flip() ? Vec3(scale) : scale * Vec3(1.f, r.uniformf(0.5, 2), r.uniformf(0.5, 2));
  q.object_to_world = Transform(translation(Vec3(r.direction() * (c.size * c.offset))) *
                                rotation(r) * scaling(stretch));
  return q;
}

TEST(Quadric, FindsRaysAimedAtItAndPutsThePointOnTheSurface) {
  int rays = 0, hits = 0;
  for (const Case& c : kCases) {
    for (const QuadricKind kind : kKinds) {
      for (int i = 0; i < 150; ++i) {
        Random r(static_cast<std::uint64_t>(rays) * 7919 + 1);
        const Quadric q = placed(r, kind, c, i % 2 == 1);
        for (int k = 0; k < 10; ++k) {
          ++rays;
          const double u = r.uniform(0.1, 0.9), v = r.uniform(0.1, 0.9);
          const glm::dvec3 target = world_point(q, u, v), n = world_normal(q, u, v);
          glm::dvec3 away = r.direction();
          if (std::abs(glm::dot(away, n)) < 0.2) away = n;
          const Vec3 origin(target + away * (c.size * c.distance * r.uniform(0.5, 1)));
          const Vec3 direction(target - glm::dvec3(origin));
          if (glm::dot(direction, direction) == 0.f) continue;
          QuadricHit hit;
          // What float coordinates of origin and direction do to the aim, in sizes.
          const double blur = 1e-7 * (c.offset + c.distance);
          const bool found = intersect(q, origin, direction, 0.f, kInfinity, hit);
          hits += found;
          if (blur < 1e-3 && c.distance > 0) {
            ASSERT_TRUE(found) << "kind " << static_cast<int>(kind) << " size " << c.size
                               << " offset " << c.offset << " distance " << c.distance;
            ASSERT_LE(hit.t, 1.001f + static_cast<float>(10 * blur / c.distance));
          }
          if (!found) continue;
          const SurfacePoint s = surface_point(q, false, origin, direction, hit.t);
          ASSERT_TRUE(is_finite(s.p) && is_finite(s.p_error) && is_finite(s.ng) &&
                      is_finite(s.dpdu) && is_finite(s.dpdv) && is_finite(s.dndu) &&
                      is_finite(s.dndv));
          const double bound = glm::dot(glm::abs(glm::dvec3(s.ng)), glm::dvec3(s.p_error));
          // (The measure is of first order: not for a p that rounding may move by the radius.)
          if (c.offset < 1e6) {
            ASSERT_LE(distance_to_surface(q, s.p), bound)
                << "kind " << static_cast<int>(kind) << " size " << c.size << " offset "
                << c.offset;
          }
          ASSERT_LE(bound, c.size * (2 + c.offset) * 1e-6);  // and the bound is not a lazy one
          // p lies on the ray, as far as t in float can say where.
          const glm::dvec3 on_ray =
              glm::dvec3(origin) + static_cast<double>(hit.t) * glm::dvec3(direction);
          const double slack =
              1e-6 * (c.size * (c.offset + 4) +
                      static_cast<double>(hit.t) * glm::length(glm::dvec3(direction)));
          ASSERT_LE(glm::length(glm::dvec3(s.p) - on_ray), slack);
        }
      }
    }
  }
  EXPECT_GT(rays, 100000);
  EXPECT_GT(hits, rays * 9 / 10);
}

TEST(Quadric, AgreesWithTheExactDiscriminantOfSpheres) {
  Random r(5);
  int hits = 0, undecided = 0;
  for (int i = 0; i < 100000; ++i) {
    const Case& c = kCases[i % std::size(kCases)];
    Quadric q = random_quadric(r, QuadricKind::sphere, c.size, false);
    const Vec3 center(r.direction() * (c.size * c.offset));
    q.object_to_world = Transform(translation(center));
    const Vec3 origin = center + Vec3(r.direction() * (c.size * (c.distance + 1)));
    const glm::dvec3 aim =
        glm::dvec3(center) + r.direction() * (static_cast<double>(q.radius) * r.uniform(0, 2));
    const Vec3 direction(glm::normalize(aim - glm::dvec3(origin)));
    using V = glm::vec<3, long double>;
    const V o = V(origin) - V(center), d(direction);
    const long double a = glm::dot(d, d), b = glm::dot(o, d);
    const V nearest = o - (b / a) * d;
    const long double radius = q.radius, gap = radius * radius - glm::dot(nearest, nearest);
    if (std::abs(gap) < 1e-7L * radius * radius) {
      ++undecided;
      continue;
    }
    const long double half = gap > 0 ? std::sqrt(gap / a) : 0;
    const long double t0 = -b / a - half, t1 = -b / a + half;
    const bool expected = gap > 0 && t1 > 0;
    QuadricHit hit;
    const bool found = intersect(q, origin, direction, 0.f, kInfinity, hit);
    ASSERT_EQ(found, expected) << i;
    hits += found;
    if (!found) continue;
    const long double t = t0 > 0 ? t0 : t1;
    ASSERT_NEAR(static_cast<double>(hit.t / t), 1.0, 1e-7 + 1e-9 * c.distance) << i;
  }
  EXPECT_GT(hits, 30000);
  EXPECT_LT(undecided, 100);
}

TEST(Quadric, LetsNoRayLeaveAConvexShapeAndHitItAgain) {
  Random r(17);
  for (const Case& c : kCases) {
    for (const QuadricKind kind :
         {QuadricKind::sphere, QuadricKind::cylinder, QuadricKind::disk, QuadricKind::cone}) {
      for (int i = 0; i < 300; ++i) {
        const Quadric q = placed(r, kind, c, false);
        const double u = r.uniform(), v = r.uniform(0.02, 0.98);
        const glm::dvec3 target = world_point(q, u, v);
        const Vec3 origin(target + world_normal(q, u, v) * (c.size * c.distance) +
                          r.direction() * (0.1 * c.size));
        const Vec3 direction(target - glm::dvec3(origin));
        QuadricHit hit;
        if (!intersect(q, origin, direction, 0.f, kInfinity, hit)) continue;
        const SurfacePoint s =
            surface_point(q, q.object_to_world.swaps_handedness(), origin, direction, hit.t);
        for (int k = 0; k < 4; ++k) {
          Vec3 d(r.direction());
          if (k == 1) d = glm::normalize(d - s.ng * (glm::dot(d, s.ng) - 1e-3f));  // grazing
          if (k == 2) d = glm::normalize(d - s.ng * (glm::dot(d, s.ng) - 1e-5f));
          if (glm::dot(d, s.ng) < 0.f) d = -d;
          const Vec3 start = offset_ray_origin(s.p, s.p_error, s.ng, d);
          QuadricHit again;
          ASSERT_FALSE(intersect(q, start, d, 0.f, kInfinity, again))
              << "kind " << static_cast<int>(kind) << " size " << c.size << " offset " << c.offset
              << " t " << again.t;
          if (kind != QuadricKind::sphere || c.offset > 1e4 || glm::dot(d, s.ng) < 0.01f) continue;
          // And from inside, a ray finds the far side.
          const Vec3 inner = offset_ray_origin(s.p, s.p_error, s.ng, -d);
          ASSERT_TRUE(intersect(q, inner, -d, 0.f, kInfinity, again));
          ASSERT_GT(again.t, 1e-3f * static_cast<float>(c.size));
        }
      }
    }
  }
}

// Rays that only just touch or miss a sphere, from up to 1e6 radii away.
TEST(Quadric, DecidesGrazingRaysFromFarAway) {
  Random r(29);
  int decided = 0;
  for (int i = 0; i < 50000; ++i) {
    Quadric q;
    const double distance = std::pow(10.0, r.uniform(0.1, 6));
    const Vec3 origin(r.direction() * distance);
    const glm::dvec3 forward = glm::normalize(-glm::dvec3(origin));
    const glm::dvec3 side = glm::normalize(glm::cross(forward, r.direction()));
    const Vec3 direction(forward * distance + side * (1 + r.uniform(-1e-5, 1e-5)));
    using V = glm::vec<3, long double>;
    const V o(origin), d(direction);
    const V nearest = o - (glm::dot(o, d) / glm::dot(d, d)) * d;
    const long double gap = 1 - glm::dot(nearest, nearest);
    if (std::abs(gap) < 1e-8L) continue;
    ++decided;
    QuadricHit hit;
    ASSERT_EQ(intersect(q, origin, direction, 0.f, kInfinity, hit), gap > 0) << distance;
    if (gap < 0) continue;
    const SurfacePoint s = surface_point(q, false, origin, direction, hit.t);
    ASSERT_NEAR(glm::length(glm::dvec3(s.p)), 1.0, 2e-7);
    ASSERT_LE(glm::dot(s.ng, glm::normalize(direction)), 1e-3f);
  }
  EXPECT_GT(decided, 20000);
}

TEST(Quadric, KeepsToTheRangeOfT) {
  Quadric q;
  q.object_to_world = Transform(translation({0, 0, 5}));
  QuadricHit hit;
  ASSERT_TRUE(intersect(q, {0, 0, 0}, {0, 0, 1}, 0.f, kInfinity, hit));
  EXPECT_EQ(hit.t, 4.f);
  ASSERT_TRUE(intersect(q, {0, 0, 0}, {0, 0, 1}, 0.f, 4.f, hit));
  EXPECT_FALSE(intersect(q, {0, 0, 0}, {0, 0, 1}, 0.f, 3.9f, hit));
  ASSERT_TRUE(intersect(q, {0, 0, 0}, {0, 0, 1}, 4.f, kInfinity, hit));
  EXPECT_EQ(hit.t, 6.f);
  ASSERT_TRUE(intersect(q, {0, 0, 0}, {0, 0, 2}, 0.f, kInfinity, hit));
  EXPECT_EQ(hit.t, 2.f);
  EXPECT_FALSE(intersect(q, {0, 0, 0}, {0, 0, -1}, 0.f, kInfinity, hit));
}

// pbrt's equation has no term linear in z: the surface goes through p2, not through p1.
TEST(Quadric, HyperboloidsHaveTheRadiusOfPbrt) {
  Quadric q;
  q.kind = QuadricKind::hyperboloid;
  q.p1 = {1, 0, 0};
  q.p2 = {0.8f, 1, 0.8f};
  q.z_min = 0;
  q.z_max = 0.8f;
  const auto radius_at = [&](float z) {
    QuadricHit hit;
    return intersect(q, {5, 0, z}, {-1, 0, 0}, 0, 10, hit) ? 5 - hit.t : -1.f;
  };
  // Through p2 and (0.6, 2, 1.6): r^2 = a + c z^2 with 1.64 and 4.36.
  EXPECT_NEAR(radius_at(0.7999f), std::sqrt(1.64f), 1e-3f);
  const float c = (4.36f - 1.64f) / (1.6f * 1.6f - 0.8f * 0.8f), a = 1.64f - c * 0.64f;
  EXPECT_NEAR(radius_at(0.f), std::sqrt(a), 1e-5f);
  EXPECT_NEAR(radius_at(0.4f), std::sqrt(a + c * 0.16f), 1e-5f);
  EXPECT_EQ(radius_at(0.81f), -1.f);
}

TEST(Quadric, ClipsByHeightAndAngle) {
  Quadric q;
  q.z_max = 0.5f;
  QuadricHit hit;
  ASSERT_TRUE(intersect(q, {0, 0, 5}, {0, 0, -1}, 0.f, kInfinity, hit));
  EXPECT_EQ(hit.t, 6.f);  // through the open top to the bottom
  q.z_max = 1.f;
  q.phi_max = kPi;  // the half with y > 0
  ASSERT_TRUE(intersect(q, {0, -5, 0.1f}, {0, 1, 0}, 0.f, kInfinity, hit));
  EXPECT_GT(hit.t, 5.f);
}

TEST(Quadric, IsRobustAgainstSenselessRays) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Random r(3);
  for (const QuadricKind kind : kKinds) {
    const Quadric q = random_quadric(r, kind, 1, true);
    QuadricHit hit;
    EXPECT_FALSE(intersect(q, {nan, 0, 0}, {0, 0, 1}, 0.f, kInfinity, hit));
    EXPECT_FALSE(intersect(q, {0, 0, 0}, {0, 0, 0}, 0.f, kInfinity, hit));
    EXPECT_FALSE(intersect(q, {0, 0, 0}, {0, nan, 1}, 0.f, kInfinity, hit));
    // A point asked for on a ray that misses is still some finite point of the surface.
    const SurfacePoint s = surface_point(q, false, {50, 60, 70}, {1, 0.3f, 0}, 1.f);
    EXPECT_TRUE(is_finite(s.p) && is_finite(s.ng));
  }
}

}  // namespace
}  // namespace cloudrenderer
