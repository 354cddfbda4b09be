// Normals, derivatives, areas, bounds and sampling of quadrics.
#include <gtest/gtest.h>

#include "shapes/surface.h"
#include "shapes_test_util.h"

namespace cloudrenderer {
namespace {

using namespace shapes_test;

glm::dvec3 d3(const Vec3& v) { return glm::dvec3(v); }

TEST(QuadricSurface, HasTheParametrisationDerivativesAndNormalsOfPbrt) {
  Random r(23);
  int compared = 0;
  for (int i = 0; i < 6000; ++i) {
    const QuadricKind kind = kKinds[i % 6];
    Quadric q = random_quadric(r, kind, 1, r.flip());
    const Vec3 scale(r.uniformf(0.5, 2) * (r.flip() ? 1.f : -1.f), r.uniformf(0.5, 2),
                     r.uniformf(0.5, 2));
    q.object_to_world =
        Transform(translation({r.uniformf(-3, 3), 1, 2}) * rotation(r) * scaling(scale));
    const double u = r.uniform(0.1, 0.9), v = r.uniform(0.15, 0.85);
    const glm::dvec3 target = world_point(q, u, v), n = world_normal(q, u, v);
    const Vec3 origin(target + 0.01 * n), direction(-n);
    QuadricHit hit;
    ASSERT_TRUE(intersect(q, origin, direction, 0.f, 0.1f, hit));
    const bool reversed = r.flip();
    const SurfacePoint s = surface_point(q, reversed != q.object_to_world.swaps_handedness(),
                                         origin, direction, hit.t);
    ASSERT_NEAR(s.uv.x, u, 2e-5);
    ASSERT_NEAR(s.uv.y, v, 2e-5);
    const double side = reversed ? -1 : 1, h = 1e-4;
    const glm::dvec3 du = (world_point(q, u + h, v) - world_point(q, u - h, v)) / (2 * h);
    const glm::dvec3 dv = (world_point(q, u, v + h) - world_point(q, u, v - h)) / (2 * h);
    ASSERT_LT(glm::length(d3(s.dpdu) - du), 1e-3 * (1 + glm::length(du)));
    ASSERT_LT(glm::length(d3(s.dpdv) - dv), 1e-3 * (1 + glm::length(dv)));
    ASSERT_LT(glm::length(d3(s.ng) - side * n), 1e-4);
    ASSERT_EQ(s.ng, s.ns);
    const glm::dvec3 nu = side * (world_normal(q, u + h, v) - world_normal(q, u - h, v)) / (2 * h);
    const glm::dvec3 nv = side * (world_normal(q, u, v + h) - world_normal(q, u, v - h)) / (2 * h);
    ASSERT_LT(glm::length(d3(s.dndu) - nu), 5e-3 * (1 + glm::length(nu)))
        << "kind " << static_cast<int>(kind);
    ASSERT_LT(glm::length(d3(s.dndv) - nv), 5e-3 * (1 + glm::length(nv)))
        << "kind " << static_cast<int>(kind);
    ++compared;
  }
  EXPECT_EQ(compared, 6000);
}

TEST(QuadricSurface, PointsOutwardUnlessReversed) {
  Quadric q;
  const SurfacePoint s = surface_point(q, false, {0, -3, 0}, {0, 1, 0}, 2.f);
  EXPECT_FLOAT_EQ(s.ng.y, -1.f);
  EXPECT_FLOAT_EQ(surface_point(q, true, {0, -3, 0}, {0, 1, 0}, 2.f).ng.y, 1.f);
  // Mirrored: pbrt-v2 keeps the outside outside, pbrt-v3 does not.
  q.object_to_world = Transform(scaling({-1, 1, 1}));
  EXPECT_FLOAT_EQ(surface_point(q, true, {0, -3, 0}, {0, 1, 0}, 2.f).ng.y, -1.f);
  q.inside_out = 1;
  EXPECT_FLOAT_EQ(surface_point(q, true, {0, -3, 0}, {0, 1, 0}, 2.f).ng.y, 1.f);
}

TEST(QuadricSurface, IsFiniteAtPolesAndAxes) {
  for (const float size : {1e-6f, 1.f, 1e9f}) {
    for (const QuadricKind kind : kKinds) {
      Random r(1);
      Quadric q = random_quadric(r, kind, 1, false);
      if (kind == QuadricKind::cylinder || kind == QuadricKind::hyperboloid) continue;
      q.object_to_world = Transform(scaling(Vec3(size)));
      const Vec3 origin(0, 0, 7 * size), direction(0, 0, -1);
      QuadricHit hit;
      ASSERT_TRUE(intersect(q, origin, direction, 0.f, kInfinity, hit));
      const SurfacePoint s = surface_point(q, false, origin, direction, hit.t);
      EXPECT_TRUE(is_finite(s.p) && is_finite(s.dpdu) && is_finite(s.dpdv) && is_finite(s.dndu) &&
                  is_finite(s.dndv));
      EXPECT_NEAR(glm::length(s.ng), 1.f, 1e-6f);
      EXPECT_GT(glm::dot(s.dpdu, s.dpdu), 0.f);
    }
  }
}

double area_by_sum(const Quadric& q) {
  const int n = 400;
  const double h = 1e-5;
  double sum = 0;
  for (int j = 0; j < n; ++j) {
    const double v = (j + 0.5) / n;
    const glm::dvec3 du = (world_point(q, 0.3 + h, v) - world_point(q, 0.3 - h, v)) / (2 * h);
    const glm::dvec3 dv = (world_point(q, 0.3, v + h) - world_point(q, 0.3, v - h)) / (2 * h);
    sum += glm::length(glm::cross(du, dv)) / n;
  }
  return sum;
}

TEST(QuadricSurface, KnowsItsArea) {
  Random r(31);
  for (int i = 0; i < 60; ++i) {
    Quadric q = random_quadric(r, kKinds[i % 6], 1, r.flip());
    q.object_to_world = Transform(rotation(r) * scaling(Vec3(-3.f)));
    EXPECT_NEAR(static_cast<double>(surface_area(q)) / area_by_sum(q), 1.0, 2e-3)
        << "kind " << i % 6;
  }
  EXPECT_FLOAT_EQ(surface_area(Quadric{}), 4 * kPi);
}

TEST(QuadricSurface, SamplesItsAreaUniformly) {
  Random r(37);
  for (const QuadricKind kind : {QuadricKind::sphere, QuadricKind::cylinder, QuadricKind::disk}) {
    for (const bool clipped : {false, true}) {
      for (const bool stretched : {false, true}) {
        Quadric q = random_quadric(r, kind, 1, clipped);
        const Vec3 scale = stretched ? Vec3(2, 0.5f, 1) : Vec3(2);
        q.object_to_world = Transform(translation({1, 2, 3}) * rotation(r) * scaling(scale));
        // Over any region the mean of 1/pdf is its area: the whole, and the half u < 1/2.
        double whole = 0, half = 0, lower = 0;
        const int n = 20000;
        for (int i = 0; i < n; ++i) {
          Vec3 p, normal;
          float pdf = 0;
          const Vec2 u(static_cast<float>((i + 0.5) / n),
                       to_unit(reverse_bits(static_cast<std::uint32_t>(i))));
          ASSERT_TRUE(sample_area(q, true, u, p, normal, pdf));
          ASSERT_GT(pdf, 0.f);
          ASSERT_LT(distance_to_surface(q, p), 1e-6);
          ASSERT_NEAR(area_pdf(q, normal), pdf, 1e-4f * pdf);
          ASSERT_NEAR(area_pdf(q, -normal), pdf, 1e-4f * pdf);
          whole += 1 / static_cast<double>(pdf) / n;
          const glm::dvec3 o =
              glm::inverse(glm::dmat4(q.object_to_world.matrix())) * glm::dvec4(p, 1);
          double phi = std::atan2(o.y, o.x);
          if (phi < -1e-4) phi += 2 * M_PI;
          ASSERT_LE(phi, static_cast<double>(q.phi_max) + 1e-5);
          if (phi < 0.5 * static_cast<double>(q.phi_max)) half += 1 / static_cast<double>(pdf) / n;
          const double r2 = o.x * o.x + o.y * o.y, outer = q.radius * q.radius,
                       inner = q.inner_radius * q.inner_radius;
          if (kind == QuadricKind::disk ? r2 < 0.5 * (outer + inner)
                                        : o.z < 0.5 * (q.z_min + q.z_max))
            lower += 1 / static_cast<double>(pdf) / n;
          if (i % 100 == 0) {  // the normal is that of a hit there
            const Vec3 origin = p + 0.01f * normal, direction = -normal;
            QuadricHit hit;
            if (!intersect(q, origin, direction, 0.f, 0.1f, hit)) continue;  // on the rim
            ASSERT_LT(glm::length(surface_point(q, true, origin, direction, hit.t).ng - normal),
                      1e-3f);
          }
        }
        if (!stretched) {
          EXPECT_NEAR(whole / static_cast<double>(surface_area(q)), 1.0, 1e-4);
          EXPECT_NEAR(half / whole, 0.5, 0.01);
          EXPECT_NEAR(lower / whole, 0.5, 0.01);
        } else if (kind == QuadricKind::disk) {
          EXPECT_NEAR(whole / static_cast<double>(surface_area(q)), 1.0, 1e-4);
        }
      }
    }
  }
  Vec3 p, n;
  float pdf = 0;
  Quadric cone = random_quadric(r, QuadricKind::cone, 1, false);
  EXPECT_FALSE(sample_area(cone, false, {0.5f, 0.5f}, p, n, pdf));
  EXPECT_EQ(area_pdf(cone, {0, 0, 1}), 0.f);
}

TEST(QuadricSurface, HasBoundsThatHoldItTightly) {
  Random r(41);
  for (int i = 0; i < 300; ++i) {
    const double size = std::pow(10.0, r.uniform(-6, 9));
    Quadric q = random_quadric(r, kKinds[i % 6], 1, r.flip());
    const Vec3 scale = static_cast<float>(size) *
                       Vec3(r.uniformf(0.5, 2), r.uniformf(0.5, 2), r.uniformf(-2, -0.5));
    q.object_to_world =
        Transform(translation(Vec3(r.direction() * size)) * rotation(r) * scaling(scale));
    const Bounds3 box = world_bounds(q);
    Bounds3 seen;
    for (int k = 0; k < 2000; ++k) {
      const Vec3 p(world_point(q, r.uniform(), r.uniform()));
      seen.extend(p);
      for (int a = 0; a < 3; ++a) {
        ASSERT_LE(box.min[a], p[a]);
        ASSERT_GE(box.max[a], p[a]);
      }
    }
    if (q.kind == QuadricKind::sphere && q.phi_max >= 2 * kPi && q.z_max == q.radius) {
      for (int a = 0; a < 3; ++a) ASSERT_LT(box.diagonal()[a], 1.05f * seen.diagonal()[a]);
    }
    ASSERT_LT(glm::length(box.diagonal()), 4.f * glm::length(seen.diagonal()));
  }
}

}  // namespace
}  // namespace cloudrenderer
