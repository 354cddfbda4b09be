// Curved patches that become triangles: nurbs and bilinear meshes.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <tuple>

#include "shapes/geometry.h"
#include "shapes/nurbs_surface.h"
#include "shapes_desc_util.h"

namespace cloudrenderer {
namespace {

using namespace shapes_test;

TriangleMesh mesh_of(const ShapeDesc& s, Dialect dialect = Dialect::v2) {
  Warnings warnings;
  TriangleMesh mesh = std::get<TriangleMesh>(make_geometry(s, dialect, warnings));
  EXPECT_TRUE(warnings.list().empty()) << warnings.list()[0];
  return mesh;
}

std::string error_of(const ShapeDesc& s) {
  Warnings warnings;
  try {
    make_geometry(s, Dialect::v2, warnings);
  } catch (const SceneError& e) {
    return e.what();
  }
  return "";
}

// Half circles from pole to pole, turned around z: nine quadratic points around, five along.
ShapeDesc nurbs_sphere() {
  ShapeDesc s = shape("nurbs");
  const float h = std::sqrt(0.5f);
  const float around[9][3] = {{1, 0, 1}, {1, 1, h}, {0, 1, 1}, {-1, 1, h}, {-1, 0, 1}, {-1, -1, h}, {0, -1, 1}, {1, -1, h}, {1, 0, 1}};
  const float along[5][3] = {{0, -1, 1}, {1, -1, h}, {1, 0, 1}, {1, 1, h}, {0, 1, 1}};  // distance to the axis, z, weight
  std::vector<float> points;
  for (const auto& v : along)
    for (const auto& u : around) {
      const float w = u[2] * v[2];
      points.insert(points.end(), {w * v[0] * u[0], w * v[0] * u[1], w * v[1], w});
    }
  add_ints(s, "nu", {9});
  add_ints(s, "nv", {5});
  add_ints(s, "uorder", {3});
  add_ints(s, "vorder", {3});
  add_reals(s, "uknots", ParamType::real, {0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4});
  add_reals(s, "vknots", ParamType::real, {0, 0, 0, 1, 1, 2, 2, 2});
  add_reals(s, "Pw", ParamType::real, points);
  return s;
}

TEST(Nurbs, OfARationalSphereLieOnIt) {
  const TriangleMesh mesh = mesh_of(nurbs_sphere());
  ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
  ASSERT_EQ(mesh.uvs.size(), mesh.positions.size());
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const Vec3 p = mesh.positions[i];
    ASSERT_NEAR(glm::length(p), 1, 1e-6);
    ASSERT_NEAR(glm::length(mesh.normals[i] - p), 0, 2e-3) << p.x << " " << p.y << " " << p.z;
    EXPECT_GE(mesh.uvs[i].x, 0.f);
    EXPECT_LE(mesh.uvs[i].x, 4.f);
    EXPECT_LE(mesh.uvs[i].y, 2.f);
  }
  double area = 0;
  for (const Triangle& t : mesh.triangles) {
    const Vec3 a = mesh.positions[t.x], b = mesh.positions[t.y], c = mesh.positions[t.z];
    area += 0.5 * static_cast<double>(glm::length(glm::cross(b - a, c - a)));
    EXPECT_GT(glm::length(a + b + c) / 3, 0.996f);
  }
  EXPECT_NEAR(area, 4 * M_PI, 0.05);
  EXPECT_LT(mesh.triangles.size(), 10000u);
}

// Inside of a patch, and across its creases, every edge of a triangle belongs to a second one, position by position.
TEST(Nurbs, HaveNoGapsInside) {
  const TriangleMesh mesh = mesh_of(nurbs_sphere());
  using Point = std::tuple<float, float, float>;
  std::map<std::pair<Point, Point>, int> sides;
  const auto key = [&](std::uint32_t i) { const Vec3 p = mesh.positions[i]; return Point(p.x + 0.f, p.y + 0.f, p.z + 0.f); };
  std::size_t open = 0;
  for (const Triangle& t : mesh.triangles)
    for (int i = 0; i < 3; ++i) {
      const Point a = key(t[i]), b = key(t[(i + 1) % 3]);
      if (a != b) ++sides[{std::min(a, b), std::max(a, b)}];
    }
  for (const auto& [edge, count] : sides)
    if (count == 1) {
      // The seam, whose two sides may differ in their last bits.
      ++open;
      EXPECT_NEAR(std::get<1>(edge.first), 0, 1e-6);
      EXPECT_GT(std::get<0>(edge.first), -1e-6);
    }
  EXPECT_LT(open, 200u);
}

TEST(Nurbs, DerivativesAreThoseOfTheSurface) {
  NurbsSurface s;
  s.u = {4, 5, {0, 0, 0, 0, 0.4, 1, 1, 1, 1}};
  s.v = {3, 3, {0, 0, 0, 2, 2, 2}};
  for (int i = 0; i < 15; ++i) s.points.push_back({i % 5, i / 5 + 0.1 * (i * 7 % 5), (i * 11 % 7) * 0.3, 1 + 0.2 * (i % 3)});
  const double h = 1e-6;
  for (const double u : {0.1, 0.3, 0.5, 0.9})
    for (const double v : {0.2, 1.0, 1.7}) {
      const std::size_t span = u < 0.4 ? 3 : 4;
      const NurbsPoint p = s.at(span, u, 2, v);
      const glm::dvec3 du = (s.at(span, u + h, 2, v).p - s.at(span, u - h, 2, v).p) / (2 * h);
      const glm::dvec3 dv = (s.at(span, u, 2, v + h).p - s.at(span, u, 2, v - h).p) / (2 * h);
      EXPECT_LT(glm::length(p.dpdu - du), 1e-7);
      EXPECT_LT(glm::length(p.dpdv - dv), 1e-7);
    }
}

TEST(Nurbs, PartOfAPlaneIsTwoTrianglesWithItsParameters) {
  ShapeDesc s = shape("nurbs");
  for (const char* name : {"nu", "nv", "uorder", "vorder"}) add_ints(s, name, {2});
  add_reals(s, "uknots", ParamType::real, {0, 0, 1, 1});
  add_reals(s, "vknots", ParamType::real, {0, 0, 1, 1});
  add_reals(s, "u1", ParamType::real, {0.5});
  add_reals(s, "P", ParamType::point3, {0, 0, 0, 2, 0, 0, 0, 2, 0, 2, 2, 0});
  const TriangleMesh mesh = mesh_of(s);
  ASSERT_EQ(mesh.triangles.size(), 2u);
  EXPECT_EQ(mesh.positions[3], Vec3(1, 2, 0));
  EXPECT_EQ(mesh.uvs[3], Vec2(0.5f, 1));
  EXPECT_EQ(mesh.normals[3], Vec3(0, 0, 1));
}

TEST(Nurbs, KeepTheEdgeOfADoubleKnot) {
  ShapeDesc s = shape("nurbs");
  add_ints(s, "nu", {3});
  for (const char* name : {"nv", "uorder", "vorder"}) add_ints(s, name, {2});
  add_reals(s, "uknots", ParamType::real, {0, 0, 1, 2, 2});
  add_reals(s, "vknots", ParamType::real, {0, 0, 1, 1});
  add_reals(s, "P", ParamType::point3, {0, 0, 0, 1, 0, 0, 1, 0, 1, 0, 1, 0, 1, 1, 0, 1, 1, 1});  // an angle of 90 degrees
  const TriangleMesh mesh = mesh_of(s);
  ASSERT_EQ(mesh.triangles.size(), 4u);
  std::set<std::pair<float, float>> normals;
  for (const Vec3& n : mesh.normals) normals.insert({n.x + 0.f, n.z + 0.f});
  EXPECT_EQ(normals, (std::set<std::pair<float, float>>{{0, 1}, {-1, 0}}));
}

TEST(Nurbs, SayWhatIsWrong) {
  ShapeDesc order = nurbs_sphere();
  add_ints(order, "uorder", {1});
  EXPECT_EQ(error_of(order), "test.pbrt:7:3: error: a nurbs needs uorder between 2 and 16, got 1");
  ShapeDesc knots = nurbs_sphere();
  add_reals(knots, "vknots", ParamType::real, {0, 0, 0, 1, 1, 2, 2});
  EXPECT_EQ(error_of(knots), "test.pbrt:7:3: error: a nurbs needs nv + vorder = 8 vknots, got 7");
  ShapeDesc falling = nurbs_sphere();
  add_reals(falling, "vknots", ParamType::real, {0, 0, 0, 1, 0.5, 2, 2, 2});
  EXPECT_EQ(error_of(falling), "test.pbrt:7:3: error: vknots must be finite numbers that do not fall, number 4 is 0.5");
  ShapeDesc range = nurbs_sphere();
  add_reals(range, "u1", ParamType::real, {5});
  EXPECT_EQ(error_of(range), "test.pbrt:7:3: error: u0 and u1 must be a range within the knots' 0 to 4, got 0 and 5");
  ShapeDesc few = nurbs_sphere();
  add_reals(few, "Pw", ParamType::real, {1, 2, 3, 4});
  EXPECT_EQ(error_of(few), "test.pbrt:7:3: error: a nurbs of nu x nv = 45 points needs 180 numbers in Pw, got 4");
  ShapeDesc flat_knots = nurbs_sphere();
  add_reals(flat_knots, "uknots", ParamType::real, std::vector<float>(12, 1));
  EXPECT_EQ(error_of(flat_knots), "test.pbrt:5:1: error: u0 and u1 must be a range within the knots' 1 to 1, got 1 and 1");
}

ShapeDesc patch(std::vector<float> points) {
  ShapeDesc s = shape("bilinearmesh");
  add_reals(s, "P", ParamType::point3, std::move(points));
  return s;
}

TEST(BilinearMesh, OfAParallelogramIsTwoTriangles) {
  const TriangleMesh mesh = mesh_of(patch({0, 0, 0, 2, 0, 0, 1, 1, 0, 3, 1, 0}), Dialect::v3);
  ASSERT_EQ(mesh.triangles.size(), 2u);
  EXPECT_TRUE(mesh.normals.empty());
  EXPECT_EQ(mesh.uvs[3], Vec2(1, 1));
  for (const Triangle& t : mesh.triangles)
    EXPECT_GT(glm::cross(mesh.positions[t.y] - mesh.positions[t.x], mesh.positions[t.z] - mesh.positions[t.x]).z, 0);
}

TEST(BilinearMesh, OfATwistedPatchFollowsIt) {
  // z = x y
  const TriangleMesh mesh = mesh_of(patch({-1, -1, 1, 1, -1, -1, -1, 1, -1, 1, 1, 1}), Dialect::v3);
  EXPECT_GT(mesh.triangles.size(), 100u);
  ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const Vec3 p = mesh.positions[i];
    EXPECT_NEAR(p.z, p.x * p.y, 1e-6);
    const Vec3 n = glm::normalize(Vec3(-p.y, -p.x, 1));
    EXPECT_NEAR(glm::length(glm::normalize(mesh.normals[i]) - n), 0, 1e-5);
    EXPECT_NEAR(mesh.uvs[i].x, 0.5f + 0.5f * p.x, 1e-6);
  }
  for (const Triangle& t : mesh.triangles) {
    const Vec3 p = (mesh.positions[t.x] + mesh.positions[t.y] + mesh.positions[t.z]) / 3.f;
    EXPECT_NEAR(p.z, p.x * p.y, 2e-3);
  }
}

TEST(BilinearMesh, NeighboursShareTheirEdgesToTheBit) {
  ShapeDesc s = patch({0.1f, 0, 0.3f, 1.1f, 0.2f, -1, 0.3f, 1, 0.7f, 1, 1.7f, 1.3f, 2.3f, 0.1f, 0, 2.1f, 1.1f, 0.4f});
  add_ints(s, "indices", {0, 1, 2, 3, 3, 5, 1, 4});  // the common edge runs the other way in the second patch
  const TriangleMesh mesh = mesh_of(s, Dialect::v3);
  const std::size_t half = mesh.positions.size() / 2;
  const auto side = static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(half))));
  for (std::size_t i = 0; i < side; ++i)
    EXPECT_EQ(mesh.positions[i * side + side - 1], mesh.positions[half + (side - 1 - i) * side]) << i;
}

TEST(BilinearMesh, SaysWhatIsWrong) {
  EXPECT_EQ(error_of(patch({0, 0, 0, 1, 0, 0, 1, 1, 0})),
            "test.pbrt:5:1: error: a bilinearmesh of 3 points (not 4) needs \"indices\"");
  ShapeDesc s = patch({0, 0, 0, 1, 0, 0, 1, 1, 0});
  add_ints(s, "indices", {0, 1, 2, 3});
  EXPECT_EQ(error_of(s), "test.pbrt:7:3: error: vertex index 3 (number 3 of the list) is not one of the 3 vertices");
}

}  // namespace
}  // namespace cloudrenderer
