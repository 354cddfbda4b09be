// The split as text, read back and split again: the same scene.
#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <tuple>

#include "parts_scene.h"

namespace cloudrenderer {
namespace {

using namespace parts_test;

constexpr const char* kWorld = R"(
WorldBegin
Texture "holes" "float" "constant" "float value" [ 1 ]
MakeNamedMaterial "red" "string type" "matte" "rgb Kd" [ 1 0 0 ]
AttributeBegin
  AreaLightSource "%AREA%" "rgb L" [ 2 2 2 ]
  Translate 0 0 5
  Shape "sphere" "float radius" 0.1 "float phimax" 180
AttributeEnd
AttributeBegin
  NamedMaterial "red"
  ReverseOrientation
  Scale -1 1 1
  Shape "trianglemesh" "integer indices" [ 0 1 2 2 1 3 ] "point P" [ 0 0 0  1 0 0.1  0 1 0.3333333  1 1 0 ]
    "normal N" [ 0 0 1  0 0 1  0.1 0 1  0 0 1 ] "float uv" [ 0 0  1 0  0 1  1 1 ] "texture alpha" "holes"
  Shape "cone" "float radius" 0.3 "float height" 2
AttributeEnd
ObjectBegin "thing"
  Shape "cylinder" "float radius" 0.2 "float zmin" 0 "float zmax" 1
  Translate 0.3 0 0
  Shape "trianglemesh" "integer indices" [ 0 1 2 ] "point P" [ 0 0 0  1 0 0  0 1 0 ]
ObjectEnd
AttributeBegin
  Translate 1 2 3
  ObjectInstance "thing"
  Rotate 30 1 0 0
  ObjectInstance "thing"
AttributeEnd
Shape "disk" "float radius" 0.5 "float innerradius" 0.25
Shape "paraboloid" "float radius" 0.5 "float zmin" 0.1 "float zmax" 0.7
Shape "hyperboloid" "point p1" [ 1 0 0 ] "point p2" [ 0.5 1 1 ]
WorldEnd
)";

std::string scene_text(Dialect d) {
  std::string s = kWorld;
  s.replace(s.find("%AREA%"), 6, d == Dialect::v2 ? "area" : "diffuse");
  const std::string head = "LookAt 0 -5 2  0 0 0  0 0 1\nCamera \"perspective\" \"float fov\" 40\n";
  return head + (d == Dialect::v2 ? "SurfaceIntegrator" : "Integrator") + " \"path\"\n" + s;
}

// What the parts hold, without the ids that a new reading gives anew.
struct Summary {
  std::multiset<std::array<float, 9>> triangles;
  std::multiset<
      std::tuple<std::uint32_t, float, float, float, float, float, std::uint32_t, bool, bool>>
      quadrics;
  std::multiset<std::array<float, 16>> instances;
  std::multiset<std::array<float, 3>> normals;
  std::multiset<std::tuple<std::uint32_t, bool, bool, bool, bool, std::string>> chunks;
};

void add(const Part& part, const Manifest& m, Summary& s) {
  const auto material = [&](std::uint32_t i) {
    return i == kNone ? "" : m.scene.materials[i].type;
  };
  for (const Triangle& t : part.triangles) {
    std::array<float, 9> a;
    for (int k = 0; k < 9; ++k) a[static_cast<std::size_t>(k)] = part.positions[t[k / 3]][k % 3];
    s.triangles.insert(a);
  }
  for (const Vec3& n : part.normals) s.normals.insert({n.x, n.y, n.z});
  for (const MeshChunk& c : part.chunks)
    s.chunks.insert({c.triangle_count, c.flip != 0, c.first_uv != kNone, c.alpha_texture != kNone,
                     c.light != kNone, material(c.material)});
  for (const QuadricRecord& r : part.quadrics) {
    const Quadric& q = r.quadric;
    s.quadrics.insert({static_cast<std::uint32_t>(q.kind), q.radius, q.inner_radius, q.z_min,
                       q.z_max, q.phi_max, r.flip ^ q.inside_out, r.light != kNone,
                       q.object_to_world.swaps_handedness()});
  }
  for (const InstanceRecord& i : part.instances) {
    std::array<float, 16> a;
    for (int k = 0; k < 16; ++k) a[static_cast<std::size_t>(k)] = i.to_world.matrix()[k / 4][k % 4];
    s.instances.insert(a);
  }
}

Summary summary(const std::string& folder, const Manifest& m) {
  Summary s;
  for (std::uint32_t p = 0; p < m.parts.size(); ++p)
    add(*read_part_file(part_path(folder, p)), m, s);
  for (std::uint32_t p = 0; p < m.prototypes.size(); ++p)
    add(*read_part_file(prototype_path(folder, p)), m, s);
  return s;
}

void expect_round_trip(Dialect dialect) {
  const TemporaryFolder folder;
  std::ofstream(folder.path("scene.pbrt")) << scene_text(dialect);
  SplitOptions options;
  options.text = true;
  Warnings warnings;
  const Manifest first =
      split_scene(folder.path("scene.pbrt"), folder.path("a"), options, warnings);
  EXPECT_EQ(first.scene.dialect, dialect);
  EXPECT_EQ(first.total_triangles, 3u);
  const Manifest second =
      split_scene(folder.path("a/main.pbrt"), folder.path("b"), options, warnings);
  for (const std::string& w : warnings.list()) ADD_FAILURE() << w;
  EXPECT_EQ(second.scene.dialect, dialect);
  EXPECT_EQ(second.total_triangles, first.total_triangles);
  EXPECT_EQ(second.parts.size(), first.parts.size());
  EXPECT_EQ(second.prototypes.size(), first.prototypes.size());
  EXPECT_EQ(second.shape_lights.size(), 1u);
  const Summary a = summary(folder.path("a"), first), b = summary(folder.path("b"), second);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.normals, b.normals);
  EXPECT_EQ(a.instances, b.instances);
  EXPECT_EQ(a.quadrics, b.quadrics);
  EXPECT_EQ(a.chunks, b.chunks);
  EXPECT_EQ(a.quadrics.size(), 6u);
}

TEST(SplitText, ReadsBackAsTheSameSceneInVersion2) { expect_round_trip(Dialect::v2); }
TEST(SplitText, ReadsBackAsTheSameSceneInVersion3) { expect_round_trip(Dialect::v3); }

TEST(SplitText, ACutMeshReadsBackWithTheSameTriangles) {
  const TemporaryFolder folder;
  {
    SplitOptions options;
    options.text = true;
    options.part_size = 100 << 10;
    Warnings warnings;
    SceneSplitter splitter(folder.path("a"), options, warnings);
    SceneDescription scene = description();
    scene.materials[0].type = "matte";
    scene.camera.type = "perspective";
    scene.film.type = "image";
    scene.sampler.type = "random";
    scene.filter.type = "box";
    scene.integrator.type = "path";
    splitter.sink().shape(hills(60, {0, 0, 0}, 1.f), scene);
    const Manifest first = splitter.finish(scene);
    ASSERT_GT(first.parts.size(), 5u);
    const Manifest second =
        split_scene(folder.path("a/main.pbrt"), folder.path("b"), SplitOptions(), warnings);
    EXPECT_EQ(summary(folder.path("a"), first).triangles,
              summary(folder.path("b"), second).triangles);
    EXPECT_EQ(first.bounds.min, second.bounds.min);
    EXPECT_EQ(first.bounds.max, second.bounds.max);
  }
}

}  // namespace
}  // namespace cloudrenderer
