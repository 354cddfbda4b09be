// Real scenes through the whole split, where they are at hand.
#include <gtest/gtest.h>

#include <filesystem>
#include <iostream>

#include "parts_scene.h"

namespace cloudrenderer {
namespace {

using namespace parts_test;

class RealScenes : public testing::Test {
 protected:
  // Splits a scene of the shared folder; false when it is not there.
  bool split(const std::string& name, std::uint64_t part_size) {
    const std::string path = std::string(CLOUDRENDERER_SHARED_DIR) + "/scenes/" + name;
    if (!std::filesystem::exists(path)) return false;
    SplitOptions options;
    options.part_size = part_size;
    Warnings warnings;
    manifest = split_scene(path, folder.path("split"), options, warnings);
    collected = collect(folder.path("split"), manifest, false);
    EXPECT_EQ(collected.duplicates, 0u);
    std::uint64_t triangles = 0;
    for (const PartInfo& p : manifest.parts) triangles += p.triangles;
    for (std::size_t p = 1; p < manifest.parts.size(); ++p)
      EXPECT_LE(manifest.parts[p].loaded_bytes, part_size);
    EXPECT_EQ(collected.triangles.size(), triangles);
    EXPECT_EQ(open_split(folder.path("split")).content_hash, manifest.content_hash);
    std::cout << name << ": " << manifest.total_triangles << " triangles, " << manifest.parts.size()
              << " parts, " << manifest.prototypes.size() << " prototypes, " << collected.instances
              << " instances, " << collected.quadrics.size() << " quadrics, "
              << warnings.list().size() << " warnings\n";
    return true;
  }
  TemporaryFolder folder;
  Manifest manifest;
  Collected collected;
};

TEST_F(RealScenes, KilleroosAreOnePart) {
  if (!split("v2/killeroo-simple.pbrt", 64 << 20)) GTEST_SKIP() << "no shared scenes here";
  EXPECT_EQ(manifest.parts.size(), 2u);
  EXPECT_EQ(manifest.total_triangles, 2u * 33264 + 4u) << "two killeroos and two walls";
}

TEST_F(RealScenes, ArcsphereIsMadeOfInstances) {
  if (!split("v2/arcsphere.pbrt", 256 << 10)) GTEST_SKIP() << "no shared scenes here";
  EXPECT_EQ(collected.instances, 10460u);
  EXPECT_GT(manifest.parts.size(), 8u);
}

TEST_F(RealScenes, BuddhaFractalStoresTheBuddhaOnce) {
  if (!split("v3/buddha-fractal/buddha-small.pbrt", 4 << 20))
    GTEST_SKIP() << "no shared scenes here";
  EXPECT_EQ(collected.instances, 25250u);
  EXPECT_EQ(manifest.prototypes.size(), 1u);
}

TEST_F(RealScenes, TheCarIsCutIntoManyParts) {
  if (!split("v3/bmw-m6/bmw-small.pbrt", 4 << 20)) GTEST_SKIP() << "no shared scenes here";
  EXPECT_GE(manifest.parts.size(), 9u);
  EXPECT_EQ(manifest.total_triangles, 792746u);
}

}  // namespace
}  // namespace cloudrenderer
