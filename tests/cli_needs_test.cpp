// Only what a scene needs is modelled: what a feature adds to parts and to paths on the wire is there with it, and not
// without it.
#include <gtest/gtest.h>

#include <filesystem>

#include "cli_scene_support.h"
#include "cluster/job_start.h"
#include "parts/features.h"

namespace cloudrenderer {
namespace {

struct Cost {
  std::uint64_t part_bytes = 0, loaded_bytes = 0, segment_bytes = 0;
  std::uint32_t features = 0;
  SceneNeeds needs;
};

constexpr const char* kMesh = R"("integer indices" [0 1 2 0 2 3] "point P" [0 0 0 1 0 0 1 1 0 0 1 0])";

// A scene of one mesh of two triangles and four vertices, with more text in its world.
Cost cost_of(const std::string& options, const std::string& world, const std::string& mesh = kMesh) {
  const parts_test::TemporaryFolder folder;
  const std::string scene = folder.path() + "/scene.pbrt";
  write_file(scene, options + "\nWorldBegin\nLightSource \"point\"\n" + world + "\nShape \"trianglemesh\" " + mesh + "\nWorldEnd\n");
  Warnings warnings;
  std::filesystem::create_directory(folder.path() + "/split");
  const Manifest m = split_scene(scene, folder.path() + "/split", {}, warnings);
  Cost c;
  for (const PartInfo& p : m.parts) {
    c.part_bytes += p.file_bytes;
    c.loaded_bytes += p.loaded_bytes;
    c.features |= p.features;
  }
  c.needs = scene_needs(m.scene, job_settings(m.scene, {}, warnings), warnings);
  c.segment_bytes = wire::segment_bytes(columns_of(m, c.needs), 3);
  return c;
}

Cost plain() { return cost_of("", ""); }

// A section of a part file has an entry of 16 bytes, and it and the next one begin at multiples of 16.
void expect_more(std::uint64_t more, std::uint64_t less, std::uint64_t bytes) {
  EXPECT_GE(more, less + bytes);
  EXPECT_LE(more, less + bytes + 16 + 2 * 15);
}

TEST(OnlyWhatIsNeeded, APlainSceneNeedsNothing) {
  const Cost c = plain();
  EXPECT_EQ(c.features, kHasTriangles);
  EXPECT_FALSE(c.needs.shading.footprint || c.needs.shading.uv || c.needs.shading.subsurface || c.needs.shading.null);
  EXPECT_FALSE(c.needs.infinite_light || c.needs.media || c.needs.inside_media || c.needs.lens || c.needs.moving_camera);
  // Ray, throughput, density, radiance, task, pixel, sample, owner, vertex, flags and passed: no more.
  EXPECT_EQ(c.segment_bytes, 24 + 12 + 4 + 3 * 3 + 12 + 8u);
}

TEST(OnlyWhatIsNeeded, NormalsAndUvsArePaidForByTheMeshThatHasThem) {
  const std::string with_normals = std::string(kMesh) + R"( "normal N" [0 0 1 0 0 1 0 0 1 0 0 1])";
  const std::string with_uvs = std::string(kMesh) + R"( "float uv" [0 0 1 0 1 1 0 1])";
  expect_more(cost_of("", "", with_normals).part_bytes, plain().part_bytes, 4 * 12);
  expect_more(cost_of("", "", with_uvs).part_bytes, plain().part_bytes, 4 * 8);
}

TEST(OnlyWhatIsNeeded, UnusedTexturesAndMediaOfAFileCostNoPathAnything) {
  const Cost c = cost_of("", R"(Texture "unused" "color" "checkerboard" Material "matte" "color Kd" [.1 .2 .3])");
  EXPECT_EQ(c.segment_bytes, plain().segment_bytes);
  EXPECT_EQ(c.part_bytes, plain().part_bytes);
}

TEST(OnlyWhatIsNeeded, FootprintsTravelWithFilteredTexturesOnly) {
  const parts_test::TemporaryFolder folder;
  write_image(folder.path() + "/a.exr", {2, 2, std::vector<Rgb>(4, Rgb(0.5f))}, {2, 2, 0, 0, 2, 2}, {});
  const std::string image = R"(Texture "t" "color" "imagemap" "string filename" ")" + folder.path() +
                            R"(/a.exr" Material "matte" "texture Kd" "t")";
  const Cost filtered = cost_of("", image);
  EXPECT_TRUE(filtered.needs.shading.footprint && filtered.needs.shading.uv);
  EXPECT_EQ(filtered.segment_bytes, plain().segment_bytes + 8);
  EXPECT_EQ(filtered.part_bytes, plain().part_bytes);
  const Cost constant = cost_of("", R"(Texture "t" "color" "constant" Material "matte" "texture Kd" "t")");
  EXPECT_EQ(constant.segment_bytes, plain().segment_bytes);
}

TEST(OnlyWhatIsNeeded, WhereARayStartedTravelsWithLightsThatRaysFind) {
  const Cost sky = cost_of("", R"(LightSource "infinite" "color L" [1 1 1])");
  EXPECT_TRUE(sky.needs.infinite_light);
  EXPECT_EQ(sky.segment_bytes, plain().segment_bytes + 12);
  const Cost lamp = cost_of("", R"(AttributeBegin AreaLightSource "diffuse" Shape "sphere" AttributeEnd)");
  EXPECT_EQ(lamp.segment_bytes, plain().segment_bytes + 12);
  EXPECT_EQ(lamp.features, kHasTriangles | kHasQuadrics);
}

TEST(OnlyWhatIsNeeded, MediaAlphaAndMotionAreThereWhereTheyAreUsed) {
  const Cost fog = cost_of("MakeNamedMedium \"fog\" \"string type\" \"homogeneous\"\nMediumInterface \"\" \"fog\"\nCamera "
                           "\"perspective\"\nIntegrator \"volpath\"", "");
  EXPECT_TRUE(fog.needs.media && fog.needs.inside_media);
  EXPECT_EQ(fog.segment_bytes, plain().segment_bytes + 8 + 2);
  const Cost masked = cost_of("", R"(Texture "a" "float" "checkerboard")", std::string(kMesh) + R"( "texture alpha" "a")");
  EXPECT_EQ(masked.features, kHasTriangles | kHasAlpha);
  const Cost moving = cost_of("", "ActiveTransform EndTime Translate 1 0 0 ActiveTransform All");
  EXPECT_EQ(moving.features & kHasMotion, kHasMotion);
  EXPECT_EQ(moving.segment_bytes, plain().segment_bytes) << "a path's time is a function of its sample";
  EXPECT_GT(moving.part_bytes, plain().part_bytes);
}

TEST(OnlyWhatIsNeeded, ALensOrAMovingCameraIsSeen) {
  EXPECT_TRUE(cost_of(R"(Camera "perspective" "float lensradius" [1])", "").needs.lens);
  EXPECT_FALSE(cost_of(R"(Camera "perspective")", "").needs.lens);
  EXPECT_TRUE(cost_of("ActiveTransform EndTime Translate 1 0 0 ActiveTransform All Camera \"perspective\"", "").needs.moving_camera);
}

}  // namespace
}  // namespace cloudrenderer
