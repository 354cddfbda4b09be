#include <gtest/gtest.h>

#include <random>

#include "parts/manifest_hash.h"
#include "parts/part.h"

namespace cloudrenderer {
namespace {

Manifest example() {
  Manifest m;
  m.scene.dialect = Dialect::v3;
  m.scene.source = "scene.pbrt";
  m.scene.materials.resize(3);
  m.scene.area_lights.resize(2);
  m.scene.materials[1].type = "matte";
  m.prototypes.push_back({"tree", {Vec3(0), Vec3(1)}, 100, 200, 300, 4});
  m.prototypes.push_back({"\xff", {}, 1, 2, 3, 0});
  m.parts.push_back({});
  m.parts.push_back({{{Vec3(-1), Vec3(1)}, {Vec3(2), Vec3(3)}}, 5, 6, 7, {0, 1}});
  m.shape_lights = {AreaLightId(1), AreaLightId(0)};
  m.total_triangles = std::uint64_t{1} << 40;
  m.bounds = {Vec3(-2), Vec3(5)};
  m.specular_boxes = {{Vec3(0), Vec3(1)}, {Vec3(2), Vec3(2)}};
  m.content_hash = 0x123456789abcdef0u;
  return m;
}

Result<Manifest> decode(const std::string& s) {
  return decode_manifest({reinterpret_cast<const std::byte*>(s.data()), s.size()});
}

TEST(Manifest, GivesBackWhatWasEncoded) {
  const Manifest m = example();
  const Result<Manifest> back = decode(encode(m));
  ASSERT_TRUE(back) << back.error();
  EXPECT_EQ(back->scene.dialect, Dialect::v3);
  ASSERT_EQ(back->scene.materials.size(), 3u);
  EXPECT_EQ(back->scene.materials[1].type, "matte");
  ASSERT_EQ(back->prototypes.size(), 2u);
  EXPECT_EQ(back->prototypes[0].name, "tree");
  EXPECT_EQ(back->prototypes[0].bounds.max, Vec3(1));
  EXPECT_EQ(back->prototypes[0].shapes, 4u);
  EXPECT_EQ(back->prototypes[1].name, "\xff");
  EXPECT_TRUE(back->prototypes[1].bounds.empty());
  ASSERT_EQ(back->parts.size(), 2u);
  EXPECT_TRUE(back->parts[0].boxes.empty());
  ASSERT_EQ(back->parts[1].boxes.size(), 2u);
  EXPECT_EQ(back->parts[1].boxes[1].max, Vec3(3));
  EXPECT_EQ(back->parts[1].file_bytes, 5u);
  EXPECT_EQ(back->parts[1].loaded_bytes, 6u);
  EXPECT_EQ(back->parts[1].triangles, 7u);
  EXPECT_EQ(back->parts[1].prototypes, (std::vector<std::uint32_t>{0, 1}));
  EXPECT_EQ(back->shape_lights, m.shape_lights);
  EXPECT_EQ(back->total_triangles, m.total_triangles);
  EXPECT_EQ(back->bounds.min, m.bounds.min);
  ASSERT_EQ(back->specular_boxes.size(), 2u);
  EXPECT_EQ(back->specular_boxes[1].max, Vec3(2));
  EXPECT_EQ(back->content_hash, m.content_hash);
  EXPECT_EQ(encode(*back), encode(m));
}

TEST(Manifest, HashTellsContentButNotPlace) {
  Manifest m = example();
  const std::uint64_t hash = manifest_hash(m);
  m.scene.source = "elsewhere/scene.pbrt";
  m.content_hash = 0;
  EXPECT_EQ(manifest_hash(m), hash);
  m.parts[1].triangles++;
  EXPECT_NE(manifest_hash(m), hash);
}

TEST(Manifest, RefusesReferencesToWhatIsNotThere) {
  EXPECT_FALSE(decode(""));
  Manifest m = example();
  m.parts[1].prototypes.push_back(2);
  EXPECT_FALSE(decode(encode(m)));
  m = example();
  m.shape_lights.push_back(AreaLightId(2));
  EXPECT_FALSE(decode(encode(m)));
  m = example();
  m.parts[1].boxes = {{Vec3(0), Vec3(kInfinity)}};
  EXPECT_FALSE(decode(encode(m)));
  m.parts[1].boxes.clear();
  EXPECT_FALSE(decode(encode(m)));
  m = example();
  m.specular_boxes[1].max.x = kInfinity;
  EXPECT_FALSE(decode(encode(m)));
  m = example();
  m.specular_boxes.resize(kMostSpecularBoxes + 1, m.specular_boxes[0]);
  EXPECT_FALSE(decode(encode(m)));
  m.parts.clear();
  EXPECT_FALSE(decode(encode(m)));
}

TEST(Manifest, NoChangeOfBytesCrashesTheDecoder) {
  const std::string good = encode(example());
  std::mt19937 random(1);
  int refused = 0;
  for (int round = 0; round < 20000; ++round) {
    std::string bytes = good;
    if (round % 4 == 0) bytes.resize(random() % bytes.size());
    for (std::uint32_t n = random() % 4; n > 0 && !bytes.empty(); --n)
      bytes[random() % bytes.size()] = static_cast<char>(random());
    refused += !decode(bytes);
  }
  EXPECT_GT(refused, 1000);
}

}  // namespace
}  // namespace cloudrenderer
