// Loop subdivision: closed meshes, borders, meshes that are not manifold, and a real one.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>

#include "shapes/geometry.h"
#include "shapes_desc_util.h"

namespace cloudrenderer {
namespace {

using namespace shapes_test;

ShapeDesc loop_shape(std::vector<std::int32_t> indices, std::vector<float> positions, int levels) {
  ShapeDesc s = shape("loopsubdiv");
  add_ints(s, "indices", std::move(indices));
  add_reals(s, "P", ParamType::point3, std::move(positions));
  add_ints(s, "nlevels", {levels});
  return s;
}

ShapeDesc icosahedron(int levels) {
  const float g = 1.6180339887f;
  return loop_shape({0, 11, 5,  0, 5,  1, 0, 1, 7, 0, 7,  10, 0, 10, 11, 1, 5, 9, 5, 11,
                     4, 11, 10, 2, 10, 7, 6, 7, 1, 8, 3,  9,  4, 3,  4,  2, 3, 2, 6, 3,
                     6, 8,  3,  8, 9,  4, 9, 5, 2, 4, 11, 6,  2, 10, 8,  6, 7, 9, 8, 1},
                    {-1, g,  0,  1, g, 0,  -1, -g, 0,  1, -g, 0, 0,  -1, g,  0,  1, g,
                     0,  -1, -g, 0, 1, -g, g,  0,  -1, g, 0,  1, -g, 0,  -1, -g, 0, 1},
                    levels);
}

TriangleMesh made(const ShapeDesc& s, std::size_t expected_warnings = 0) {
  Warnings warnings;
  TriangleMesh mesh = std::get<TriangleMesh>(make_geometry(s, Dialect::v2, warnings));
  EXPECT_EQ(warnings.list().size(), expected_warnings)
      << (warnings.list().empty() ? "" : warnings.list()[0]);
  return mesh;
}

// Edges that do not have exactly one partner that runs the other way.
std::size_t open_edges(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> count;
  for (const Triangle& t : mesh.triangles)
    for (int k = 0; k < 3; ++k) ++count[{t[k], t[(k + 1) % 3]}];
  std::size_t open = 0;
  for (const auto& [edge, n] : count) {
    const auto other = count.find({edge.second, edge.first});
    open += n != 1 || other == count.end();
  }
  return open;
}

double volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (const Triangle& t : mesh.triangles)
    sum += glm::dot(glm::dvec3(mesh.positions[t.x]),
                    glm::cross(glm::dvec3(mesh.positions[t.y]), glm::dvec3(mesh.positions[t.z]))) /
           6;
  return sum;
}

TEST(LoopSubdivision, KeepsAClosedMeshClosedAndConverges) {
  std::vector<double> volumes;
  for (int levels = 0; levels <= 5; ++levels) {
    const TriangleMesh mesh = made(icosahedron(levels));
    ASSERT_EQ(mesh.triangles.size(), 20u << (2 * levels));
    ASSERT_EQ(mesh.positions.size(), mesh.triangles.size() / 2 + 2);  // Euler
    ASSERT_EQ(open_edges(mesh), 0u);
    volumes.push_back(volume(mesh));
  }
  for (std::size_t i = 2; i < volumes.size(); ++i)  // in the end a fourth of the error a level
    EXPECT_LT(std::abs(volumes[i] - volumes[i - 1]),
              (i < 4 ? 0.4 : 0.3) * std::abs(volumes[i - 1] - volumes[i - 2]));
  // Vertices are on the limit surface from level 0 on: the 12 first of all levels are the same
  // points.
  const TriangleMesh coarse = made(icosahedron(0)), fine = made(icosahedron(4));
  for (std::size_t v = 0; v < 12; ++v)
    EXPECT_LT(glm::distance(coarse.positions[v], fine.positions[v]), 2e-6f);
}

TEST(LoopSubdivision, HasNormalsAlongTheSurfaceNormal) {
  const TriangleMesh mesh = made(icosahedron(4));
  ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
  // pbrt's cross product points against the orientation of the faces.
  for (const Triangle& t : mesh.triangles) {
    const Vec3 face = glm::normalize(glm::cross(mesh.positions[t.y] - mesh.positions[t.x],
                                                mesh.positions[t.z] - mesh.positions[t.x]));
    for (int k = 0; k < 3; ++k)
      ASSERT_LT(glm::dot(glm::normalize(mesh.normals[t[k]]), face), -0.98f);
  }
}

TEST(LoopSubdivision, KeepsAFlatSheetFlatWithItsBorder) {
  std::vector<float> p;
  std::vector<std::int32_t> indices;
  for (int y = 0; y <= 3; ++y)
    for (int x = 0; x <= 3; ++x)
      p.insert(p.end(), {static_cast<float>(x), static_cast<float>(y), 2.f});
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 3; ++x) {
      const int i = 4 * y + x;
      indices.insert(indices.end(), {i, i + 1, i + 5, i, i + 5, i + 4});
    }
  const TriangleMesh mesh = made(loop_shape(indices, p, 3));
  EXPECT_EQ(mesh.triangles.size(), 18u * 64u);
  EXPECT_EQ(open_edges(mesh), 12u * 8u);
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    EXPECT_NEAR(mesh.positions[i].z, 2.f, 1e-6f);
    EXPECT_LT(glm::normalize(mesh.normals[i]).z, -0.9999f);
    EXPECT_GE(mesh.positions[i].x, -1e-6f);
    EXPECT_LE(mesh.positions[i].x, 3.f + 1e-6f);
  }
}

TEST(LoopSubdivision, SurvivesMeshesThatAreNotManifold) {
  const std::vector<float> p = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, -1, 0, -1, 0, 0, 9, 9, 9};
  // Three faces on one edge.
  EXPECT_EQ(made(loop_shape({0, 1, 2, 1, 0, 3, 0, 1, 4}, p, 3), 2).triangles.size(), 3u * 64u);
  // Two faces that run along their edge in the same direction.
  EXPECT_EQ(made(loop_shape({0, 1, 2, 0, 1, 3}, p, 3), 2).triangles.size(), 2u * 64u);
  // Two fans that touch in vertex 0; vertex 6 is not used.
  EXPECT_EQ(made(loop_shape({0, 1, 2, 0, 5, 4}, p, 2), 1).triangles.size(), 2u * 16u);
  // A face with a vertex twice, and nothing else.
  EXPECT_EQ(made(loop_shape({0, 0, 1, 0, 1, 2}, p, 2), 1).triangles.size(), 16u);
  EXPECT_EQ(made(loop_shape({0, 0, 1}, p, 2), 2).triangles.size(), 0u);
  // The same face twice, once from each side: closed, and flat.
  EXPECT_EQ(made(loop_shape({0, 1, 2, 0, 2, 1}, p, 2)).triangles.size(), 32u);
  // Random garbage.
  std::uint32_t x = 1;
  for (int i = 0; i < 300; ++i) {
    std::vector<std::int32_t> indices;
    for (int k = 0; k < 3 * (1 + i % 12); ++k) {
      x = x * 1664525u + 1013904223u;
      indices.push_back(static_cast<std::int32_t>((x >> 16) % 7));
    }
    Warnings warnings;
    const TriangleMesh mesh =
        std::get<TriangleMesh>(make_geometry(loop_shape(indices, p, 2), Dialect::v3, warnings));
    for (const Vec3& v : mesh.positions) ASSERT_TRUE(is_finite(v));
    for (const Vec3& n : mesh.normals) ASSERT_TRUE(is_finite(n));
  }
}

TEST(LoopSubdivision, RefusesBadParameters) {
  const auto error = [](const ShapeDesc& s) {
    Warnings warnings;
    try {
      make_geometry(s, Dialect::v2, warnings);
    } catch (const SceneError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(error(icosahedron(30)),
            "test.pbrt:7:3: error: 30 levels of 20 faces are more than 67108864 triangles");
  EXPECT_NE(error(icosahedron(-1)), "");
  EXPECT_NE(error(loop_shape({0, 1, 3}, {0, 0, 0, 1, 0, 0, 0, 1, 0}, 1)).find("vertex index 3"),
            std::string::npos);
  EXPECT_NE(error(loop_shape({0, 1, 2}, {0, 0, 0, NAN, 0, 0, 0, 1, 0}, 1)).find("vertex 1"),
            std::string::npos);
  EXPECT_NE(error(shape("loopsubdiv")).find("needs \"indices\""), std::string::npos);
}

TEST(LoopSubdivision, TakesTheNameOfTheLevelsInV3) {
  ShapeDesc s = icosahedron(1);
  add_ints(s, "levels", {2});
  Warnings warnings;
  EXPECT_EQ(std::get<TriangleMesh>(make_geometry(s, Dialect::v3, warnings)).triangles.size(), 320u);
  EXPECT_EQ(std::get<TriangleMesh>(make_geometry(s, Dialect::v2, warnings)).triangles.size(), 80u) << "nlevels";
}

// Takes the loopsubdiv shapes of a scene.
class Collector : public SceneSink {
 public:
  void begin_object(ObjectId, const std::string&) override {}
  void end_object(ObjectId) override {}
  void shape(ShapeDesc&& s, const SceneDescription&) override { shapes.push_back(std::move(s)); }
  void instance(const InstanceDesc&, const SceneDescription&) override {}
  std::vector<ShapeDesc> shapes;
};

TEST(LoopSubdivision, RefinesTheKilleroo) {
  const std::string geometry =
      std::string(CLOUDRENDERER_SHARED_DIR) + "/scenes/v2/geometry/killeroo.pbrt";
  if (!std::filesystem::exists(geometry)) GTEST_SKIP() << geometry << " is not here";
  const std::string scene =
      ::testing::TempDir() + "/shapes_killeroo_" + std::to_string(::getpid()) + ".pbrt";
  std::ofstream(scene) << "WorldBegin\nInclude \"" << std::filesystem::canonical(geometry).string()
                       << "\"\nWorldEnd\n";
  Collector sink;
  Warnings warnings;
  parse_scene(scene, {}, sink, warnings);
  std::filesystem::remove(scene);
  ASSERT_FALSE(sink.shapes.empty());
  std::size_t faces = 0, triangles = 0;
  Bounds3 cage, surface;
  for (const ShapeDesc& s : sink.shapes) {
    ASSERT_EQ(s.type, "loopsubdiv");
    faces += s.params.integers("indices").size() / 3;
    const TriangleMesh mesh = made(s);
    triangles += mesh.triangles.size();
    for (const Vec3& p : mesh.positions) surface.extend(p);
    const BulkArray<float> p = s.params.reals("P");
    for (std::size_t i = 0; i + 2 < p.size(); i += 3)
      cage.extend(s.object_to_world.point({p[i], p[i + 1], p[i + 2]}));
    const int levels = s.params.integer("nlevels", 3);
    EXPECT_EQ(mesh.triangles.size(), (s.params.integers("indices").size() / 3) << (2 * levels));
  }
  EXPECT_GT(faces, 1000u);
  EXPECT_GT(triangles, faces);
  for (int a = 0; a < 3; ++a) {  // inside its control cage, and filling it
    EXPECT_GE(surface.min[a], cage.min[a]);
    EXPECT_LE(surface.max[a], cage.max[a]);
    EXPECT_GT(surface.diagonal()[a], 0.9f * cage.diagonal()[a]);
  }
}

}  // namespace
}  // namespace cloudrenderer
