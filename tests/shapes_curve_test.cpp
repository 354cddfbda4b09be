#include "shapes/curve.h"

#include <gtest/gtest.h>

#include <cmath>

#include "shapes/geometry.h"
#include "shapes/surface.h"
#include "shapes_desc_util.h"
#include "shapes_test_util.h"

namespace cloudrenderer {
namespace {

using namespace shapes_test;
using glm::dvec3;

CurveChain chain_of(const ShapeDesc& s) {
  Warnings warnings;
  CurveChain chain = std::get<CurveChain>(make_geometry(s, Dialect::v3, warnings));
  EXPECT_TRUE(warnings.list().empty()) << warnings.list()[0];
  return chain;
}

std::string error_of(const ShapeDesc& s) {
  Warnings warnings;
  try {
    make_geometry(s, Dialect::v3, warnings);
  } catch (const SceneError& e) {
    return e.what();
  }
  return warnings.list().empty() ? "" : warnings.list()[0];
}

ShapeDesc curve(std::vector<float> points, float width = 1) {
  ShapeDesc s = shape("curve");
  add_reals(s, "P", ParamType::point3, std::move(points));
  add_reals(s, "width", ParamType::real, {width});
  return s;
}

void add_string(ShapeDesc& s, const std::string& name, const std::string& value) {
  Param p;
  p.type = ParamType::string;
  p.name = name;
  p.strings = {value};
  p.location = at(7, 3);
  s.params.add(std::move(p));
}

CurvePiece straight(float width) {
  return {CurveKind::flat, {Vec3(-3, 0, 0), Vec3(-1, 0, 0), Vec3(1, 0, 0), Vec3(3, 0, 0)}, {width, width}, {}};
}

CurvePiece random_piece(Random& r, CurveKind kind) {
  CurvePiece c;
  c.kind = kind;
  for (Vec3& p : c.p) p = Vec3(r.uniformf(-1, 1), r.uniformf(-1, 1), r.uniformf(-1, 1));
  c.width = {r.uniformf(0.01, 0.2), r.uniformf(0.01, 0.2)};
  c.n[0] = Vec3(r.direction());
  c.n[1] = glm::normalize(c.n[0] + 0.7f * Vec3(r.direction()));
  return c;
}

TEST(Curve, OfAStraightLineIsARectangleThatFacesTheRay) {
  const CurvePiece c = straight(0.5f);
  Random r(3);
  for (int i = 0; i < 20000; ++i) {
    const dvec3 way = r.direction();
    const double along = r.uniform(-3.5, 3.5), across = r.uniform(-0.4, 0.4);
    if (std::abs(way.x) > 0.95) continue;
    // Through a point beside the line, at a right angle to both the line and the ray.
    const dvec3 side = glm::normalize(glm::cross(way, dvec3(1, 0, 0)));
    const dvec3 p = dvec3(along, 0, 0) + across * side;
    const CurveRay ray{p - 5.0 * way, 2.0 * way};
    CurveHit hit;
    const bool found = intersect(c, 0, 1, ray, 0, kInfinity, hit);
    // Ends are cut where the ray passes them at a right angle.
    if (std::abs(std::abs(across) - 0.25) < 1e-6 || std::abs(std::abs(along) - 3) < 1e-6) continue;
    ASSERT_EQ(found, std::abs(across) < 0.25 && std::abs(along) < 3) << i;
    if (!found) continue;
    EXPECT_NEAR(hit.t, 2.5f, 1e-6);
    EXPECT_NEAR(hit.u, (along + 3) / 6, 1e-6);
    EXPECT_NEAR(hit.v, 0.5 + across / 0.5, 1e-5);
    const SurfacePoint s = surface_point(c, false, ray.direction, hit.u, hit.v);
    EXPECT_LT(glm::length(dvec3(s.p) - p), 1e-6);
  }
}

// Against a search of the nearest places in small steps.
TEST(Curve, IsHitWhereTheRayPassesNearIt) {
  const std::uint64_t seed = 17;
  Random r(seed);
  int hits = 0, near = 0;
  for (int i = 0; i < 3000; ++i) {
    const CurvePiece c = random_piece(r, CurveKind::flat);
    const dvec3 way = r.direction();
    const dvec3 origin = -4.0 * way + 0.3 * r.direction();
    CurveHit hit;
    const bool found = intersect(c, 0, 1, {origin, way}, 0, kInfinity, hit);
    hits += found;
    constexpr int kSteps = 4000;
    double best_t = 1e30, margin = 1e30;  // of the nearest stationary place inside; how near any such is to the border
    double before2 = 0, before1 = 0;
    for (int k = 0; k <= kSteps; ++k) {
      const double u = static_cast<double>(k) / kSteps, v = 1 - u;
      const dvec3 p = v * v * v * dvec3(c.p[0]) + 3 * u * v * v * dvec3(c.p[1]) + 3 * u * u * v * dvec3(c.p[2]) + u * u * u * dvec3(c.p[3]) - origin;
      const double z = glm::dot(p, way), d = glm::length(p - z * way);
      if (k >= 2 && before1 <= before2 && before1 <= d) {
        const double width = (1 - u) * static_cast<double>(c.width[0]) + u * static_cast<double>(c.width[1]);
        margin = std::min(margin, std::abs(before1 - width / 2));
        if (before1 < width / 2) best_t = std::min(best_t, z);
      }
      if ((k == 0 || k == kSteps) && d < 0.12) margin = 0;  // ends: their cut is not that of a stationary place
      before2 = before1;
      before1 = d;
    }
    if (margin < 2e-3) continue;
    ++near;
    ASSERT_EQ(found, best_t < 1e30) << "seed " << seed << " ray " << i;
    if (found) {
      EXPECT_NEAR(hit.t, best_t, 2e-3) << "seed " << seed << " ray " << i;
    }
  }
  EXPECT_GT(hits, 200);
  EXPECT_GT(near, 1000);
}

TEST(Curve, CutIntoSegmentsHasTheSameHits) {
  const std::uint64_t seed = 23;
  Random r(seed);
  int hits = 0;
  for (int i = 0; i < 20000; ++i) {
    const CurvePiece c = random_piece(r, static_cast<CurveKind>(i % 3));
    const dvec3 way = r.direction();
    const CurveRay ray{-4.0 * way + 0.2 * r.direction(), way};
    CurveHit whole, cut;
    intersect(c, 0, 1, ray, 0, kInfinity, whole);
    for (int k = 0; k < 8; ++k) {
      CurveHit hit;
      if (intersect(c, k / 8.0, (k + 1) / 8.0, ray, 0, kInfinity, hit) && hit.t < cut.t) cut = hit;
      // Rays that find a segment meet its box.
      if (hit.t < kInfinity) {
        const Bounds3 box = object_bounds(c, k / 8.0, (k + 1) / 8.0);
        const Vec3 p(ray.origin + static_cast<double>(hit.t) * way);
        for (int a = 0; a < 3; ++a) {
          EXPECT_GE(p[a], box.min[a] - 1e-6f);
          EXPECT_LE(p[a], box.max[a] + 1e-6f);
        }
      }
    }
    if (whole.t == kInfinity || cut.t == kInfinity) {
      EXPECT_EQ(whole.t, cut.t) << "seed " << seed << " ray " << i;
      continue;
    }
    ++hits;
    EXPECT_NEAR(whole.t, cut.t, 1e-5) << "seed " << seed << " ray " << i;
  }
  EXPECT_GT(hits, 1000);
}

TEST(Curve, LosesNoHitToTheQuickTest) {
  const std::uint64_t seed = 31;
  Random r(seed);
  int hits = 0, misses = 0, quick = 0;
  for (int i = 0; i < 200000; ++i) {
    CurvePiece c = random_piece(r, static_cast<CurveKind>(i % 3));
    const auto log2 = static_cast<std::uint32_t>(r.uniform(0, 3.999));
    const auto number = static_cast<std::uint32_t>(r.uniform(0, 0.999) * (1 << log2));
    const double u0 = static_cast<double>(number) / (1 << log2), u1 = static_cast<double>(number + 1) / (1 << log2);
    const auto size = static_cast<float>(std::exp(r.uniform(-12, 12)));
    for (Vec3& p : c.p) p *= size;
    for (float& w : c.width) w *= size;
    // Past the middle of the segment, near or far, from near or far.
    const CurvePiece part = part_of(c, u0, u1);
    const dvec3 way = r.direction(), middle = 0.5 * (dvec3(part.p[0]) + dvec3(part.p[3]));
    const double aside = static_cast<double>(size) * std::exp(r.uniform(-8, 0)), away = static_cast<double>(size) * std::exp(r.uniform(-3, 6));
    const Vec3 origin(middle + aside * r.direction() - away * way), direction(way * std::exp(r.uniform(-3, 3)));
    const float t_max = r.flip() ? kInfinity : static_cast<float>(away / glm::length(dvec3(direction)) * r.uniform(0.9, 1.1));
    CurveHit hit;
    const bool found = intersect(c, u0, u1, {dvec3(origin), dvec3(direction)}, 0, t_max, hit);
    const bool missed = surely_misses(c.p.data(), std::max(c.width[0], c.width[1]), log2, number, origin, direction, 0, t_max);
    ASSERT_FALSE(found && missed) << "seed " << seed << " ray " << i;
    hits += found;
    misses += !found;
    quick += missed;
  }
  EXPECT_GT(hits, 20000);
  EXPECT_GT(quick, misses / 3);
}

// Rays at the joints of segments and around them: no gap.
TEST(Curve, HasNoGapsBetweenItsSegments) {
  const std::uint64_t seed = 29;
  Random r(seed);
  for (int i = 0; i < 20000; ++i) {
    const CurvePiece c = random_piece(r, CurveKind::cylinder);
    const int joint = 1 + static_cast<int>(r.uniform(0, 6.999));
    const CurvePiece after = part_of(c, joint / 8.0, 1);
    const dvec3 way = r.direction();
    const CurveRay ray{dvec3(after.p[0]) - 3.0 * way + r.uniform(-1e-7, 1e-7) * r.direction(), way};
    bool found = false;
    for (int k = joint - 1; k <= joint; ++k) {
      CurveHit hit;
      found = found || intersect(c, k / 8.0, (k + 1) / 8.0, ray, 0, kInfinity, hit);
    }
    ASSERT_TRUE(found) << "seed " << seed << " ray " << i;
  }
}

TEST(Curve, RibbonsAreAsWideAsTheyAreSeen) {
  CurvePiece c = straight(0.5f);
  c.kind = CurveKind::ribbon;
  c.n = {Vec3(0, 0, 1), Vec3(0, 1, 0)};
  for (const double u : {0.05, 0.3, 0.5, 0.8}) {
    const double angle = u * M_PI / 2, half = 0.25 * std::cos(angle);  // seen along z
    for (const double y : {-1.01 * half, -0.99 * half, 0.0, 0.99 * half, 1.01 * half}) {
      CurveHit hit;
      EXPECT_EQ(intersect(c, 0, 1, {dvec3(6 * u - 3, y, 5), dvec3(0, 0, -1)}, 0, kInfinity, hit), std::abs(y) < half);
    }
    CurveHit hit;
    ASSERT_TRUE(intersect(c, 0, 1, {dvec3(6 * u - 3, 0, 5), dvec3(0, 0, -1)}, 0, kInfinity, hit));
    const SurfacePoint s = surface_point(c, false, dvec3(0, 0, -1), hit.u, hit.v);
    EXPECT_NEAR(std::abs(glm::dot(s.ng, Vec3(0, std::sin(angle), std::cos(angle)))), 1, 1e-6);
  }
}

TEST(Curve, NormalsAreThoseOfPbrt) {
  CurvePiece c = straight(1);
  const dvec3 way(0, 0, 1);
  // dpdu x dpdv with dpdv to the left of the curve as the ray sees it: away from the ray.
  EXPECT_LT(glm::length(surface_point(c, false, way, 0.5f, 0.2f).ng - Vec3(0, 0, 1)), 1e-6f);
  EXPECT_LT(glm::length(surface_point(c, true, way, 0.5f, 0.2f).ng - Vec3(0, 0, -1)), 1e-6f);
  c.kind = CurveKind::cylinder;
  EXPECT_LT(glm::length(surface_point(c, false, way, 0.5f, 0.5f).ng - Vec3(0, 0, 1)), 1e-6f);
  EXPECT_LT(glm::length(surface_point(c, false, way, 0.5f, 1.f).ng - Vec3(0, 1, 0)), 1e-6f);
  EXPECT_LT(glm::length(surface_point(c, false, way, 0.5f, 0.f).ng - Vec3(0, -1, 0)), 1e-6f);
  const SurfacePoint s = surface_point(c, false, way, 0.5f, 0.75f);
  EXPECT_NEAR(glm::dot(s.ns, s.shading_dpdu), 0, 1e-6);
  EXPECT_NEAR(glm::dot(s.ns, s.shading_dpdv), 0, 1e-6);
  EXPECT_NEAR(glm::dot(glm::cross(s.dpdu, s.dpdv), s.ng), 6, 1e-5);
}

TEST(CurveShape, OfEveryBasisBecomesBezierPieces) {
  EXPECT_EQ(chain_of(curve({0, 0, 0, 1, 0, 0, 2, 1, 0, 3, 0, 0, 4, 0, 0, 5, 1, 0, 6, 0, 0})).pieces(), 2u);
  ShapeDesc quadratic = curve({0, 0, 0, 3, 3, 0, 6, 0, 0});
  add_ints(quadratic, "degree", {2});
  const CurveChain q = chain_of(quadratic);
  EXPECT_LT(glm::length(q.points[1] - Vec3(2, 2, 0)), 1e-6f);
  EXPECT_LT(glm::length(q.points[2] - Vec3(4, 2, 0)), 1e-6f);
  // A uniform B-spline through its own definition: ends at (P0 + 4 P1 + P2) / 6.
  ShapeDesc bspline = curve({0, 0, 0, 1, 2, 0, 3, 1, 0, 4, 5, 2, 7, 7, 7});
  add_string(bspline, "basis", "bspline");
  const CurveChain b = chain_of(bspline);
  ASSERT_EQ(b.points.size(), 7u);
  EXPECT_LT(glm::length(b.points[0] - Vec3(7, 9, 0) / 6.f), 1e-6f);
  EXPECT_LT(glm::length(b.points[3] - Vec3(17, 11, 2) / 6.f), 1e-6f);
  EXPECT_LT(glm::length((b.points[4] - b.points[3]) - (b.points[3] - b.points[2])), 1e-6f);
}

TEST(CurveShape, IsPutIntoTheWorldIfItKeepsItsForm) {
  ShapeDesc s = curve({0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0}, 0.5f);
  s.object_to_world = Transform(scaling(Vec3(2)));
  CurveChain c = chain_of(s);
  EXPECT_TRUE(c.object_to_world.is_identity());
  EXPECT_EQ(c.width[1], 1.f);
  EXPECT_EQ(c.points[3], Vec3(6, 0, 0));
  for (const Vec3 scale : {Vec3(1, 2, 1), Vec3(-1, 1, 1)}) {
    s.object_to_world = Transform(scaling(scale));
    c = chain_of(s);
    EXPECT_EQ(c.object_to_world, s.object_to_world);
    EXPECT_EQ(c.points[3], Vec3(3, 0, 0));
  }
}

TEST(CurveShape, SaysWhatIsWrong) {
  EXPECT_EQ(error_of(curve({0, 0, 0, 1, 1, 1})), "test.pbrt:7:3: error: a bezier curve of degree 3 needs 4 + n * 3 points, got 2");
  ShapeDesc s = curve({0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0}, -1);
  EXPECT_EQ(error_of(s), "test.pbrt:7:3: error: width must be >= 0, got -1");
  s = curve({0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0}, 0);
  EXPECT_EQ(error_of(s), "test.pbrt:5:1: warning: a curve without width is left out");
  s = curve({0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0});
  add_string(s, "type", "ribbon");
  EXPECT_EQ(error_of(s), "test.pbrt:5:1: error: a ribbon of 1 pieces needs 2 normals N, got 0");
  add_string(s, "type", "tube");
  EXPECT_EQ(error_of(s), "test.pbrt:7:3: warning: unknown type \"tube\" of a curve (known: flat, cylinder, ribbon); cylinder is used");
  add_ints(s, "degree", {4});
  EXPECT_EQ(error_of(s), "test.pbrt:7:3: error: degree must be 2 or 3, got 4");
}

}  // namespace
}  // namespace cloudrenderer
