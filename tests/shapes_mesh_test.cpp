// Shapes as they are described: what each kind becomes, and what it says of bad parameters.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "shapes/geometry.h"
#include "shapes_desc_util.h"

namespace cloudrenderer {
namespace {

using namespace shapes_test;

const TriangleMesh& mesh_of(const ShapeGeometry& g) { return std::get<TriangleMesh>(g); }

ShapeDesc quad() {
  ShapeDesc s = shape("trianglemesh");
  add_ints(s, "indices", {0, 1, 2, 2, 3, 0});
  add_reals(s, "P", ParamType::point3, {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0});
  return s;
}

// The message that making the shape throws, "" if none.
std::string error_of(const ShapeDesc& s, Dialect dialect = Dialect::v2) {
  Warnings warnings;
  try {
    make_geometry(s, dialect, warnings);
  } catch (const SceneError& e) {
    return e.what();
  }
  return "";
}

TEST(TriangleMesh, ComesOutInWorldSpace) {
  ShapeDesc s = quad();
  add_reals(s, "N", ParamType::normal3, {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1});
  add_reals(s, "uv", ParamType::real, {0, 0, 1, 0, 1, 1, 0, 1});
  Mat4 m(1.f);
  m[0].x = 2.f;
  m[2].z = 4.f;
  m[3] = glm::vec4(10, 0, 0, 1);
  s.object_to_world = Transform(m);
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v2, warnings);
  const TriangleMesh& mesh = mesh_of(g);
  ASSERT_EQ(mesh.positions.size(), 4u);
  EXPECT_EQ(mesh.positions[1], Vec3(12, 0, 0));
  EXPECT_EQ(mesh.normals[0], Vec3(0, 0, 0.25f));
  EXPECT_EQ(mesh.uvs[2], Vec2(1, 1));
  ASSERT_EQ(mesh.triangles.size(), 2u);
  EXPECT_EQ(mesh.triangles[1], Triangle(2, 3, 0));
  EXPECT_TRUE(warnings.list().empty());
}

TEST(TriangleMesh, TurnsItsNormalsAsPbrtDoes) {
  Mat4 mirror(1.f);
  mirror[0].x = -1.f;
  for (const bool reversed : {false, true}) {
    for (const bool mirrored : {false, true}) {
      ShapeDesc s = quad();
      add_reals(s, "N", ParamType::normal3, {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1});
      s.reverse_orientation = reversed;
      if (mirrored) s.object_to_world = Transform(mirror);
      Warnings warnings;
      const ShapeGeometry v2 = make_geometry(s, Dialect::v2, warnings),
                          v3 = make_geometry(s, Dialect::v3, warnings);
      EXPECT_EQ(mesh_of(v2).normals[0].z, reversed != mirrored ? -1.f : 1.f);
      EXPECT_EQ(mesh_of(v3).normals[0].z, reversed ? -1.f : 1.f);
    }
  }
}

TEST(TriangleMesh, TakesStWhereThereIsNoUv) {
  ShapeDesc s = quad();
  add_reals(s, "st", ParamType::point2, {0, 0, 0.5f, 0, 0.5f, 0.5f, 0, 0.5f});
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v3, warnings);
  EXPECT_EQ(mesh_of(g).uvs[2], Vec2(0.5f, 0.5f));
}

TEST(TriangleMesh, LeavesOutArraysOfTheWrongLengthWithAWarning) {
  ShapeDesc s = quad();
  add_reals(s, "uv", ParamType::real, {0, 0, 1, 0});
  add_reals(s, "N", ParamType::normal3, {0, 0, 1});
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v2, warnings);
  EXPECT_TRUE(mesh_of(g).uvs.empty() && mesh_of(g).normals.empty());
  EXPECT_EQ(warnings.list().size(), 2u);
}

TEST(TriangleMesh, SaysWhereABadIndexIs) {
  ShapeDesc s = quad();
  add_ints(s, "indices", {0, 1, 2, 2, 4, 0});
  EXPECT_EQ(
      error_of(s),
      "test.pbrt:7:3: error: vertex index 4 (number 4 of the list) is not one of the 4 vertices");
  add_ints(s, "indices", {0, -1, 2});
  EXPECT_NE(error_of(s).find("vertex index -1"), std::string::npos);
}

TEST(TriangleMesh, RefusesPositionsThatAreNotFinite) {
  ShapeDesc s = quad();
  add_reals(s, "P", ParamType::point3, {0, 0, 0, NAN, 0, 0, 1, 1, 0, 0, 1, 0});
  EXPECT_NE(error_of(s).find("test.pbrt:7:3: error: vertex 1"), std::string::npos);
  add_reals(s, "P", ParamType::point3, {0, 0, 0, 1e12f, 0, 0, 1, 1, 0, 0, 1, 0});
  EXPECT_EQ(error_of(s), "");
  Mat4 large(1e12f);
  large[3].w = 1.f;
  s.object_to_world = Transform(large);
  EXPECT_NE(error_of(s).find("vertex 1"), std::string::npos);
}

TEST(TriangleMesh, ReplacesNormalsAndUvsThatAreNotFinite) {
  ShapeDesc s = quad();
  add_reals(s, "N", ParamType::normal3, {0, 0, 1, NAN, 0, 1, 0, 0, 1, 0, 0, 1});
  add_reals(s, "uv", ParamType::real, {0, 0, INFINITY, 0, 1, 1, 0, 1});
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v2, warnings);
  EXPECT_EQ(mesh_of(g).normals[1], Vec3(0));
  EXPECT_EQ(mesh_of(g).uvs[1], Vec2(0));
  EXPECT_EQ(warnings.list().size(), 2u);
}

TEST(TriangleMesh, MayBeEmptyButNotAbsent) {
  ShapeDesc s = shape("trianglemesh");
  EXPECT_NE(error_of(s).find("needs \"P\""), std::string::npos);
  add_reals(s, "P", ParamType::point3, {});
  EXPECT_NE(error_of(s).find("needs \"indices\""), std::string::npos);
  add_ints(s, "indices", {});
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v2, warnings);
  EXPECT_TRUE(mesh_of(g).triangles.empty());
  EXPECT_EQ(warnings.list().size(), 1u);
}

TEST(TriangleMesh, GoesThroughFilesWhenItIsLarge) {
  ShapeDesc s = shape("trianglemesh");
  const std::size_t vertices = 3'000'000;  // 36 MB, above the spill limit
  add_reals(s, "P", ParamType::point3, std::vector<float>(3 * vertices, 1.f));
  add_ints(s, "indices", {0, 1, static_cast<std::int32_t>(vertices) - 1});
  Mat4 m(1.f);
  m[3] = glm::vec4(1, 0, 0, 1);
  s.object_to_world = Transform(m);
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v2, warnings);
  ASSERT_EQ(mesh_of(g).positions.size(), vertices);
  EXPECT_EQ(mesh_of(g).positions[vertices - 1], Vec3(2, 1, 1));
}

// A plymesh of this text.
struct PlyFile {
  std::string path = ::testing::TempDir() + "/shapes_" + std::to_string(::getpid()) + ".ply";
  explicit PlyFile(const std::string& faces) {
    std::ofstream(path)
        << "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
           "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
           "property float u\nproperty float v\nelement face 1\n"
           "property list uchar int vertex_indices\nend_header\n"
           "0 0 0 0 0 2 0 0\n1 0 0 0 0 2 1 0\n1 1 0 0 0 2 1 1\n0 1 0 0 0 2 0 1\n"
        << faces;
  }
  ~PlyFile() { std::filesystem::remove(path); }
  ShapeDesc shape_desc() const {
    ShapeDesc s = shape("plymesh");
    Param p;
    p.type = ParamType::string;
    p.name = "filename";
    p.strings = {path};
    p.location = at(7, 3);
    s.params.add(std::move(p));
    return s;
  }
};

TEST(PlyMesh, ComesOutAsATriangleMesh) {
  const PlyFile file("4 0 1 2 3\n");
  ShapeDesc s = file.shape_desc();
  s.reverse_orientation = true;
  Mat4 m(2.f);
  m[3].w = 1.f;
  s.object_to_world = Transform(m);
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v3, warnings);
  const TriangleMesh& mesh = mesh_of(g);
  ASSERT_EQ(mesh.positions.size(), 4u);
  EXPECT_EQ(mesh.positions[2], Vec3(2, 2, 0));
  EXPECT_EQ(mesh.normals[2], Vec3(0, 0, -1));
  EXPECT_EQ(mesh.uvs[2], Vec2(1, 1));
  EXPECT_EQ(mesh.triangles.size(), 2u);
}

TEST(PlyMesh, RefusesBadFilesAtTheParameter) {
  const PlyFile file("3 0 1 9\n");
  EXPECT_NE(error_of(file.shape_desc(), Dialect::v3), "");
  EXPECT_NE(error_of(shape("plymesh"), Dialect::v3).find("needs \"filename\""), std::string::npos);
}

TEST(Heightfield, MakesTwoTrianglesACellWithItsUv) {
  ShapeDesc s = shape("heightfield");
  add_ints(s, "nu", {3});
  add_ints(s, "nv", {2});
  add_reals(s, "Pz", ParamType::real, {0, 1, 2, 3, 4, 5});
  Warnings warnings;
  const ShapeGeometry g = make_geometry(s, Dialect::v2, warnings);
  const TriangleMesh& mesh = mesh_of(g);
  ASSERT_EQ(mesh.positions.size(), 6u);
  ASSERT_EQ(mesh.triangles.size(), 4u);
  EXPECT_EQ(mesh.positions[4], Vec3(0.5f, 1, 4));
  EXPECT_EQ(mesh.uvs[4], Vec2(0.5f, 1));
  EXPECT_EQ(mesh.triangles[3], Triangle(1, 5, 4));
  add_ints(s, "nv", {3});
  EXPECT_NE(error_of(s).find("needs 9 heights, got 6"), std::string::npos);
  add_ints(s, "nu", {1});
  EXPECT_NE(error_of(s).find("nu and nv >= 2"), std::string::npos);
}

TEST(QuadricShapes, ReadTheParametersOfPbrt) {
  ShapeDesc s = shape("sphere");
  add_reals(s, "radius", ParamType::real, {2});
  add_reals(s, "zmin", ParamType::real, {-9});
  add_reals(s, "phimax", ParamType::real, {90});
  Warnings warnings;
  const Quadric q = std::get<Quadric>(make_geometry(s, Dialect::v3, warnings));
  EXPECT_EQ(q.kind, QuadricKind::sphere);
  EXPECT_EQ(q.z_min, -2.f);
  EXPECT_EQ(q.z_max, 2.f);
  EXPECT_FLOAT_EQ(q.phi_max, kPi / 2);
  const Quadric disk = std::get<Quadric>(make_geometry(shape("disk"), Dialect::v2, warnings));
  EXPECT_EQ(disk.radius, 1.f);
  EXPECT_EQ(disk.phi_max, 2 * kPi);
  EXPECT_FLOAT_EQ(surface_area(disk), kPi);
  for (const char* kind : {"cylinder", "cone", "paraboloid", "hyperboloid"})
    EXPECT_TRUE(std::holds_alternative<Quadric>(make_geometry(shape(kind), Dialect::v2, warnings)))
        << kind;
  EXPECT_TRUE(warnings.list().empty());
}

TEST(QuadricShapes, RefuseWhatIsNoNumber) {
  const auto with = [](const char* kind, const char* name, float value) {
    ShapeDesc s = shape(kind);
    add_reals(s, name, ParamType::real, {value});
    return error_of(s);
  };
  EXPECT_EQ(with("sphere", "radius", NAN), "test.pbrt:7:3: error: radius must be a finite number, got nan");
  EXPECT_NE(with("cylinder", "zmax", INFINITY), "");
}

// pbrt's rays never hit them, and the rest of the scene is rendered.
TEST(QuadricShapes, OfWhichNothingIsThereAreLeftOut) {
  const auto with = [](ShapeDesc s, const char* name, ParamType type, std::vector<float> values) {
    add_reals(s, name, type, std::move(values));
    Warnings warnings;
    const ShapeGeometry geometry = make_geometry(s, Dialect::v3, warnings);
    const auto* mesh = std::get_if<TriangleMesh>(&geometry);
    EXPECT_TRUE(mesh && mesh->triangles.empty()) << name;
    return warnings.list().size() == 1 ? warnings.list()[0] : "not one warning";
  };
  const auto real = ParamType::real;
  EXPECT_EQ(with(shape("sphere"), "radius", real, {-2}), "test.pbrt:7:3: warning: radius must be > 0, got -2: the shape is left out");
  for (const std::string& warning :
       {with(shape("sphere"), "zmin", real, {1}), with(shape("sphere"), "zmin", real, {5}), with(shape("sphere"), "phimax", real, {0}),
        with(shape("cylinder"), "zmin", real, {1}), with(shape("disk"), "innerradius", real, {1}), with(shape("cone"), "height", real, {0}),
        with(shape("paraboloid"), "zmax", real, {-1}), with(shape("hyperboloid"), "p2", ParamType::point3, {1, 1, 0})})
    EXPECT_NE(warning.find("the shape is left out"), std::string::npos) << warning;
}

TEST(Shapes, RefuseSingularTransformsAndLeaveOutUnknownKinds) {
  ShapeDesc s = shape("sphere");
  Mat4 flat(1.f);
  flat[2].z = 0.f;
  s.object_to_world = Transform(flat);
  EXPECT_EQ(error_of(s), "test.pbrt:5:1: error: the transform of Shape \"sphere\" is singular");
  Warnings warnings;
  const ShapeGeometry g = make_geometry(shape("teapot"), Dialect::v2, warnings);
  EXPECT_TRUE(mesh_of(g).triangles.empty());
  ASSERT_EQ(warnings.list().size(), 1u);
  EXPECT_NE(warnings.list()[0].find("Shape \"teapot\" is left out"), std::string::npos);
}

}  // namespace
}  // namespace cloudrenderer
