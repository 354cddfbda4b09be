// Points of triangles, what instances do to them, and where rays start.
#include <gtest/gtest.h>

#include "shapes/triangle.h"
#include "shapes_test_util.h"

namespace cloudrenderer {
namespace {

using namespace shapes_test;

TriangleVertices corner_triangle() {
  TriangleVertices t;
  t.p = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)};
  return t;
}

void expect_near(const Vec3& a, const Vec3& b, float tolerance = 1e-6f) {
  EXPECT_LE(glm::length(a - b), tolerance)
      << a.x << ' ' << a.y << ' ' << a.z << " for " << b.x << ' ' << b.y << ' ' << b.z;
}

TEST(TrianglePoint, HasPbrtsDefaultUvs) {
  const SurfacePoint s = triangle_point(corner_triangle(), false, Dialect::v2, 0.25f, 0.5f);
  expect_near(s.p, {0.25f, 0.5f, 0});
  EXPECT_EQ(s.uv, Vec2(0.75f, 0.5f));
  expect_near(s.dpdu, {1, 0, 0});   // b - a
  expect_near(s.dpdv, {-1, 1, 0});  // c - b
  expect_near(s.ng, {0, 0, 1});
  EXPECT_EQ(s.ns, s.ng);
  expect_near(triangle_point(corner_triangle(), true, Dialect::v3, 0.25f, 0.5f).ng, {0, 0, -1});
}

TEST(TrianglePoint, TurnsWithTheUvMapInV2Only) {
  TriangleVertices t = corner_triangle();
  t.has_uvs = true;
  t.uv = {Vec2(0, 0), Vec2(0, 1), Vec2(1, 0)};  // mirrored
  expect_near(triangle_point(t, false, Dialect::v2, 0.2f, 0.2f).ng, {0, 0, -1});
  expect_near(triangle_point(t, false, Dialect::v3, 0.2f, 0.2f).ng, {0, 0, 1});
  t.uv = {Vec2(3, 3), Vec2(3, 3), Vec2(3, 3)};  // degenerate
  const SurfacePoint s = triangle_point(t, false, Dialect::v2, 0.2f, 0.2f);
  expect_near(s.ng, {0, 0, -1});
  EXPECT_NEAR(glm::length(s.dpdu), 1.f, 1e-6f);
  EXPECT_NEAR(glm::dot(s.dpdu, s.dpdv), 0.f, 1e-6f);
  expect_near(triangle_point(t, false, Dialect::v3, 0.2f, 0.2f).ng, {0, 0, 1});
}

TEST(TrianglePoint, PutsTheGeometricNormalOnTheSideOfTheShadingNormalInV3Only) {
  TriangleVertices t = corner_triangle();
  t.has_normals = true;
  t.n = {Vec3(0, 0, -2), Vec3(0.2f, 0, -1), Vec3(0, 0.2f, -1)};
  const SurfacePoint v3 = triangle_point(t, false, Dialect::v3, 0.2f, 0.2f);
  expect_near(v3.ng, {0, 0, -1});
  EXPECT_LT(v3.ns.z, -0.9f);
  const SurfacePoint v2 = triangle_point(t, false, Dialect::v2, 0.2f, 0.2f);
  expect_near(v2.ng, {0, 0, 1});
  expect_near(v2.ns, v3.ns);
  t.n = {Vec3(0), Vec3(0), Vec3(0)};  // no direction at all
  const SurfacePoint none = triangle_point(t, false, Dialect::v3, 0.2f, 0.2f);
  EXPECT_EQ(none.ns, none.ng);
  EXPECT_TRUE(is_finite(none.dndu) && is_finite(none.shading_dpdu));
}

// pbrt's tangents with mesh normals run against dpdu and dpdv.
TEST(TrianglePoint, HasThePbrtShadingFrame) {
  TriangleVertices t = corner_triangle();
  t.has_normals = t.has_uvs = true;
  t.n = {Vec3(0, 0, 1), Vec3(0, 0, 1), Vec3(0, 0, 1)};
  t.uv = {Vec2(0, 0), Vec2(1, 0), Vec2(0, 1)};
  for (const Dialect dialect : {Dialect::v2, Dialect::v3}) {
    const SurfacePoint s = triangle_point(t, false, dialect, 0.2f, 0.2f);
    expect_near(s.dpdu, {1, 0, 0});
    expect_near(s.dpdv, {0, 1, 0});
    expect_near(s.shading_dpdu, {-1, 0, 0});
    expect_near(s.shading_dpdv, {0, -1, 0});
  }
}

// In pbrt-v4 dpdu keeps its side, and what of its length lies across the normal, which dpdv gets, too.
TEST(TrianglePoint, HasTheShadingFrameOfPbrtV4) {
  TriangleVertices t = corner_triangle();
  t.has_normals = t.has_uvs = true;
  t.uv = {Vec2(0, 0), Vec2(0.25f, 0), Vec2(0, 1)};  // dpdu is (4, 0, 0)
  const auto with_normals = [&](const Vec3& n) {
    t.n = {n, n, n};
    return triangle_point(t, false, Dialect::v4, 0.2f, 0.2f);
  };
  const SurfacePoint flat = with_normals({0, 0, 1});
  expect_near(flat.shading_dpdu, {4, 0, 0});
  expect_near(flat.shading_dpdv, {0, 4, 0});
  const SurfacePoint turned = with_normals({0, 0, -1});
  expect_near(turned.shading_dpdu, {4, 0, 0});
  expect_near(turned.shading_dpdv, {0, -4, 0});
  expect_near(turned.ng, {0, 0, -1});
  const SurfacePoint tilted = with_normals(glm::normalize(Vec3(1, 0, 1)));
  expect_near(tilted.shading_dpdu, {2, 0, -2});
  expect_near(tilted.shading_dpdv, {0, std::sqrt(8.f), 0});
  const SurfacePoint along = with_normals({1, 0, 0});  // any frame will do
  EXPECT_NEAR(glm::dot(along.shading_dpdu, Vec3(1, 0, 0)), 0.f, 1e-6f);
}

TEST(TrianglePoint, HasDerivativesThatFiniteDifferencesConfirm) {
  Random r(3);
  for (int i = 0; i < 2000; ++i) {
    TriangleVertices t;
    t.has_normals = t.has_uvs = true;
    for (std::size_t k = 0; k < 3; ++k) {
      t.p[k] = Vec3(r.direction() * 2.0);
      t.n[k] = Vec3(r.direction() * 0.4 + glm::dvec3(0, 0, 1)) * r.uniformf(0.5, 3);
      t.uv[k] = {r.uniformf(-1, 1), r.uniformf(-1, 1)};
    }
    const Vec2 e1 = t.uv[1] - t.uv[0], e2 = t.uv[2] - t.uv[0];
    const float determinant = e1.x * e2.y - e1.y * e2.x;
    if (std::abs(determinant) < 0.2f) continue;
    const float h = 0.01f;
    const auto at = [&](float du, float dv) {  // the point whose uv is shifted
      return triangle_point(t, true, Dialect::v3, 0.3f + (du * e2.y - dv * e2.x) / determinant,
                            0.3f + (dv * e1.x - du * e1.y) / determinant);
    };
    const SurfacePoint s = at(0, 0);
    const SurfacePoint pu = at(h, 0), mu = at(-h, 0), pv = at(0, h), mv = at(0, -h);
    expect_near((pu.uv - mu.uv).x == 0.f ? Vec3(0) : Vec3(pu.uv - mu.uv, 0.f), Vec3(2 * h, 0, 0),
                1e-5f);
    expect_near(s.dpdu, (pu.p - mu.p) / (2 * h), 1e-3f * (1 + glm::length(s.dpdu)));
    expect_near(s.dpdv, (pv.p - mv.p) / (2 * h), 1e-3f * (1 + glm::length(s.dpdv)));
    const float tolerance = 2e-2f * (1 + glm::dot(s.dndu, s.dndu) + glm::dot(s.dndv, s.dndv));
    expect_near(s.dndu, (pu.ns - mu.ns) / (2 * h), tolerance);
    expect_near(s.dndv, (pv.ns - mv.ns) / (2 * h), tolerance);
    EXPECT_NEAR(glm::dot(s.ns, s.shading_dpdu), 0.f, 1e-6f);
    EXPECT_NEAR(glm::dot(s.ns, s.shading_dpdv), 0.f, 1e-6f);
  }
}

TEST(TrianglePoint, BoundsTheErrorOfItsPosition) {
  Random r(9);
  for (int i = 0; i < 100000; ++i) {
    TriangleVertices t;
    const double size = std::pow(10.0, r.uniform(-3, 3)), offset = std::pow(10.0, r.uniform(-3, 4));
    const glm::dvec3 place = r.direction() * offset;
    for (std::size_t k = 0; k < 3; ++k) t.p[k] = Vec3(place + r.direction() * size);
    float u = r.uniformf(0, 1), v = r.uniformf(0, 1);
    if (u + v > 1.f) u = 1.f - u, v = 1.f - v;
    const SurfacePoint s = triangle_point(t, false, Dialect::v2, u, v, false);
    const glm::dvec3 a(t.p[0]), b(t.p[1]), c(t.p[2]);
    const glm::dvec3 n = glm::cross(b - a, c - a);
    if (glm::length(n) < 1e-2 * size * size) continue;
    const glm::dvec3 unit = glm::normalize(n);
    const double distance = std::abs(glm::dot(unit, glm::dvec3(s.p) - a));
    ASSERT_LE(distance, glm::dot(glm::abs(unit), glm::dvec3(s.p_error)));
    // Both starting points are clear of the plane, each on its side.
    for (const float side : {1.f, -1.f}) {
      const Vec3 start = offset_ray_origin(s.p, s.p_error, s.ng, side * s.ng);
      ASSERT_GT(static_cast<double>(side) * glm::dot(unit, glm::dvec3(start) - a), 0.0);
    }
  }
}

TEST(TrianglePoint, IsFiniteForTinyAndDegenerateTriangles) {
  for (const float size : {1e-12f, 1e-18f, 1e12f}) {
    TriangleVertices t = corner_triangle();
    for (Vec3& p : t.p) p *= size;
    const SurfacePoint s = triangle_point(t, false, Dialect::v2, 0.3f, 0.3f);
    expect_near(s.ng, {0, 0, 1});
  }
  TriangleVertices line = corner_triangle();
  line.p[2] = line.p[1];
  const SurfacePoint s = triangle_point(line, false, Dialect::v2, 0.3f, 0.3f);
  EXPECT_NEAR(glm::length(s.ng), 1.f, 1e-6f);
  EXPECT_TRUE(is_finite(s.dpdu) && is_finite(s.dpdv));
}

TEST(TransformedPoint, EqualsThePointOfTheTransformedTriangle) {
  Random r(13);
  for (int i = 0; i < 2000; ++i) {
    const bool similar = i % 4 < 2;
    const Vec3 scale =
        similar ? Vec3(r.uniformf(0.3, 3)) : Vec3(r.uniformf(0.3, 3), r.uniformf(0.3, 3), 1);
    const Transform to_world(translation(Vec3(r.direction() * 10.0)) * rotation(r) *
                             scaling(scale * Vec3(1, 1, i % 2 ? 1.f : -1.f)));
    TriangleVertices t, moved;
    t.has_normals = t.has_uvs = moved.has_normals = moved.has_uvs = true;
    for (std::size_t k = 0; k < 3; ++k) {
      t.p[k] = Vec3(r.direction());
      t.n[k] = Vec3(r.direction() * 0.3) + Vec3(0, 0, 1);
      moved.p[k] = to_world.point(t.p[k]);
      moved.n[k] = to_world.normal(t.n[k]);
    }
    t.uv = moved.uv = {Vec2(0, 0), Vec2(1, 0), Vec2(0, 1)};
    const SurfacePoint s = transformed(triangle_point(t, false, Dialect::v3, 0.3f, 0.4f), to_world);
    const SurfacePoint w = triangle_point(moved, false, Dialect::v3, 0.3f, 0.4f);
    for (int a = 0; a < 3; ++a) ASSERT_LE(std::abs(s.p[a] - w.p[a]), s.p_error[a] + w.p_error[a]);
    // A transform that is no similarity may turn ng away from ns, after which pbrt-v3's rule gives
    // the other side.
    expect_near(similar || glm::dot(s.ng, w.ng) > 0.f ? s.ng : -s.ng, w.ng, 1e-3f);
    expect_near(s.ns, w.ns, 1e-5f);
    expect_near(s.dpdu, w.dpdu, 1e-4f);
    expect_near(s.dndu, w.dndu, 1e-3f * (1 + glm::length(w.dndu)));
    expect_near(s.dndv, w.dndv, 1e-3f * (1 + glm::length(w.dndv)));
  }
}

TEST(TransformedPoint, KeepsTheErrorBoundConservative) {
  Random r(19);
  for (int i = 0; i < 20000; ++i) {
    const Transform to_world(translation(Vec3(r.direction() * r.uniform(0, 1e4))) * rotation(r) *
                             scaling(Vec3(r.uniformf(0.1, 10))));
    SurfacePoint s;
    s.p = Vec3(r.direction() * r.uniform(0, 100));
    s.p_error = Vec3(r.uniformf(0, 1e-4), r.uniformf(0, 1e-4), r.uniformf(0, 1e-4));
    s.ng = s.ns = Vec3(r.direction());
    const glm::dvec3 exact = glm::dvec3(s.p) + glm::dvec3(s.p_error) * (r.flip() ? 1.0 : -1.0);
    const glm::dvec3 world(glm::dmat4(to_world.matrix()) * glm::dvec4(exact, 1));
    const SurfacePoint w = transformed(s, to_world);
    for (int a = 0; a < 3; ++a)
      ASSERT_LE(std::abs(world[a] - static_cast<double>(w.p[a])),
                static_cast<double>(w.p_error[a]));
  }
}

TEST(OffsetRayOrigin, MovesEveryCoordinateAwayFromTheSurface) {
  const Vec3 p(1, 0, -1), error(1e-7f), n = glm::normalize(Vec3(1, 1, 1));
  const Vec3 up = offset_ray_origin(p, error, n, {0, 0, 1}),
             down = offset_ray_origin(p, error, n, {0, 0, -1});
  for (int i = 0; i < 3; ++i) {
    EXPECT_GT(up[i], p[i]);
    EXPECT_LT(down[i], p[i]);
  }
  EXPECT_EQ(next_float_up(1.f), 1.f + 0x1p-23f);
  EXPECT_EQ(next_float_down(-1.f), -1.f - 0x1p-23f);
  EXPECT_GT(next_float_up(0.f), 0.f);
  EXPECT_LT(next_float_down(0.f), 0.f);
  EXPECT_EQ(next_float_up(kInfinity), kInfinity);
}

}  // namespace
}  // namespace cloudrenderer
