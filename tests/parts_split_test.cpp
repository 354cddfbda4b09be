#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>

#include "parts/features.h"
#include "parts/part_maker.h"
#include "parts_scene.h"

namespace cloudrenderer {
namespace {

using namespace parts_test;

Mat4 moved(float x, float y, float z) { return glm::translate(Mat4(1.f), {x, y, z}); }

// The triangles of the shapes as they were given, by (shape, primitive).
void expect_triangle(const Collected& all, std::uint32_t shape, std::uint32_t primitive,
                     const ShapeDesc& d, const Transform& to_world = {}) {
  const auto found = all.triangles.find({shape, primitive});
  ASSERT_NE(found, all.triangles.end()) << shape << " " << primitive;
  const auto p = d.params.reals("P");
  const auto indices = d.params.integers("indices");
  for (std::size_t k = 0; k < 3; ++k) {
    const auto v = static_cast<std::size_t>(indices[3 * primitive + k]);
    ASSERT_EQ(found->second[k], to_world.point({p[3 * v], p[3 * v + 1], p[3 * v + 2]}));
  }
}

void expect_mesh(const Collected& all, std::uint32_t shape, const ShapeDesc& d,
                 const Transform& to_world = {}) {
  const std::size_t n = d.params.integers("indices").size() / 3;
  for (std::uint32_t i = 0; i < n; ++i) expect_triangle(all, shape, i, d, to_world);
}

TEST(Split, EveryTriangleAppearsOnceWithItsBits) {
  const TemporaryFolder folder;
  const std::uint64_t part_size = 200 << 10;
  Feeder feed(folder.path(), part_size);
  std::vector<ShapeDesc> shapes;
  for (int i = 0; i < 12; ++i) shapes.push_back(hills(10 + 10 * i, Vec3(i % 4, i / 4, 0), 0.9f));
  std::size_t triangles = 0;
  for (const ShapeDesc& s : shapes) {
    feed.add(s);
    triangles += s.params.integers("indices").size() / 3;
  }
  const Manifest m = feed.finish();
  const Collected all = collect(folder.path(), m);
  EXPECT_EQ(all.duplicates, 0u);
  EXPECT_EQ(all.triangles.size(), triangles);
  EXPECT_EQ(m.total_triangles, triangles);
  for (std::uint32_t s = 0; s < shapes.size(); ++s) expect_mesh(all, s, shapes[s]);

  ASSERT_GT(m.parts.size(), 10u);
  double fill = 0;
  for (std::size_t p = 1; p < m.parts.size(); ++p) {
    EXPECT_LE(m.parts[p].loaded_bytes, part_size);
    EXPECT_EQ(m.parts[p].features, kHasTriangles);
    fill += static_cast<double>(m.parts[p].loaded_bytes) / static_cast<double>(part_size);
  }
  EXPECT_GT(fill / static_cast<double>(m.parts.size() - 1), 0.6);
}

TEST(Split, PartsAreCompactInSpace) {
  const TemporaryFolder folder;
  Feeder feed(folder.path(), 1 << 20);
  feed.add(hills(300, {0, 0, 0}, 1.f));
  const Manifest m = feed.finish();
  ASSERT_GT(m.parts.size(), 14u);
  double area = 0;
  for (std::size_t p = 1; p < m.parts.size(); ++p)
    for (const Bounds3& b : m.parts[p].boxes) area += b.diagonal().x * b.diagonal().y;
  EXPECT_LT(area, 1.3);  // of the unit square that the hills stand on
}

TEST(Split, IsTheSameEveryTime) {
  const TemporaryFolder a, b;
  std::uint64_t hash[2];
  for (int i = 0; i < 2; ++i) {
    Feeder feed((i ? b : a).path(), 200 << 10);
    feed.add(hills(80, {0, 0, 0}, 1.f));
    hash[i] = feed.finish().content_hash;
  }
  EXPECT_EQ(hash[0], hash[1]);
  EXPECT_NE(hash[0], 0u);
}

TEST(Split, ASmallSceneIsOnePart) {
  const TemporaryFolder folder;
  Feeder feed(folder.path(), 64 << 20);
  for (int i = 0; i < 20; ++i) feed.add(hills(4, Vec3(i % 5, i / 5, 0), 0.2f));
  const Manifest m = feed.finish();
  EXPECT_EQ(m.parts.size(), 2u);
  EXPECT_TRUE(is_split_folder(folder.path()));
  const Manifest again = open_split(folder.path());
  EXPECT_EQ(again.content_hash, m.content_hash);
  ASSERT_EQ(again.parts.size(), 2u);
  EXPECT_EQ(again.parts[1].loaded_bytes, m.parts[1].loaded_bytes);
  EXPECT_EQ(again.bounds.max, m.bounds.max);
}

TEST(Split, LargeCheapShapesAndLampsStandInTheMainScene) {
  for (const bool one_part : {false, true}) {
    const TemporaryFolder folder;
    Feeder feed(folder.path(), one_part ? 64 << 20 : 100 << 10);
    feed.add(sphere({0, 0, 0}, 1000.f));      // the sky, shape 0
    feed.add(hills(1, {-20, -20, 0}, 40.f));  // the ground that it hides, 1
    for (int i = 0; i < 100; ++i) feed.add(hills(4, Vec3(i % 10, i / 10, 0), 0.2f));
    ShapeDesc lamp = sphere({0, 0, 5}, 0.1f);
    lamp.area_light = AreaLightId(0);
    feed.add(std::move(lamp));  // 102
    const Manifest m = feed.finish();
    const Result<Part> main = read_part_file(part_path(folder.path(), 0));
    ASSERT_TRUE(main);
    ASSERT_EQ(m.shape_lights.size(), 1u);
    EXPECT_EQ(m.shape_lights[0], AreaLightId(0));
    if (one_part) {  // a single part holds large shapes too: rays need not look at them apart
      ASSERT_EQ(m.parts.size(), 2u);
      EXPECT_EQ(m.parts[1].triangles, 3202u);
      ASSERT_EQ(main->quadrics.size(), 1u);
      EXPECT_EQ(main->quadrics[0].shape, 102u);
      EXPECT_TRUE(main->triangles.empty());
      continue;
    }
    ASSERT_EQ(main->quadrics.size(), 2u);
    EXPECT_EQ(main->quadrics[0].shape, 0u);
    EXPECT_EQ(main->quadrics[0].light, kNone);
    EXPECT_EQ(main->quadrics[1].shape, 102u);
    EXPECT_EQ(main->quadrics[1].light, 0u);
    ASSERT_EQ(main->chunks.size(), 1u);
    EXPECT_EQ(main->chunks[0].shape, 1u);
    ASSERT_GT(m.parts.size(), 2u);
    EXPECT_EQ(m.total_triangles, 3202u);
  }
}

TEST(Split, InstancesTakeAsManyShapeIdsAsTheirObjectHasShapes) {
  const TemporaryFolder folder;
  Feeder feed(folder.path(), 100 << 10);
  const ObjectId object(7), unused(8), empty(9);
  const ShapeDesc a = hills(5, {0, 0, 0}, 1.f), b = hills(3, {0, 0, 1}, 1.f),
                  between = hills(40, {0, 0, 9}, 30.f);
  feed.begin(object);
  feed.add(a, object);
  feed.add(b, object);
  feed.end(object);
  feed.begin(unused);
  feed.add(a, unused);
  feed.end(unused);
  feed.begin(empty);
  feed.end(empty);
  std::vector<Transform> places;
  for (int i = 0; i < 300; ++i) {
    places.emplace_back(moved(static_cast<float>(i % 20) * 2, static_cast<float>(i / 20) * 2, 0));
    feed.instance(object, places.back().matrix());
    if (i == 149) feed.add(between);
    feed.instance(empty, Mat4(1.f));
  }
  const Manifest m = feed.finish();
  EXPECT_EQ(m.prototypes.size(), 1u);
  EXPECT_EQ(m.prototypes[0].shapes, 2u);
  EXPECT_GT(m.parts.size(), 2u);
  const Collected all = collect(folder.path(), m);
  EXPECT_EQ(all.instances, 300u);
  EXPECT_EQ(all.duplicates, 0u);
  EXPECT_EQ(all.triangles.size(), 300u * (50 + 18) + 3200);
  for (std::uint32_t i = 0; i < 300; ++i) {
    const std::uint32_t first = i < 150 ? 2 * i : 2 * i + 1;
    expect_mesh(all, first, a, places[i]);
    expect_mesh(all, first + 1, b, places[i]);
  }
  expect_mesh(all, 300, between);
}

TEST(Split, ALargeObjectBecomesSeveralPrototypes) {
  const TemporaryFolder folder;
  const std::uint64_t part_size = 100 << 10;
  Feeder feed(folder.path(), part_size);
  const ObjectId object(0);
  const ShapeDesc a = hills(60, {0, 0, 0}, 1.f), b = hills(50, {0, 0, 1}, 1.f);
  feed.begin(object);
  feed.add(a, object);
  feed.add(b, object);
  feed.end(object);
  feed.instance(object, moved(0, 0, 0));
  feed.instance(object, moved(3, 0, 0));
  const Manifest m = feed.finish();
  EXPECT_GT(m.prototypes.size(), 8u);
  for (const PrototypeInfo& p : m.prototypes) {
    EXPECT_LE(p.loaded_bytes, part_size);
    EXPECT_EQ(p.shapes, 2u);
  }
  const Collected all = collect(folder.path(), m);
  EXPECT_EQ(all.duplicates, 0u);
  EXPECT_EQ(all.triangles.size(), 2u * (7200 + 5000));
  for (std::uint32_t i = 0; i < 2; ++i) {
    const Transform place(moved(3.f * static_cast<float>(i), 0, 0));
    expect_mesh(all, 2 * i, a, place);
    expect_mesh(all, 2 * i + 1, b, place);
  }
}

TEST(Split, TheOnlyInstanceOfALargeObjectBecomesTriangles) {
  const TemporaryFolder folder;
  Feeder feed(folder.path(), 100 << 10);
  const ObjectId object(0);
  const ShapeDesc a = hills(70, {0, 0, 0}, 1.f);
  feed.add(hills(2, {-1, -1, -1}, 0.1f));
  feed.begin(object);
  feed.add(a, object);
  feed.end(object);
  feed.instance(object, moved(3, 0, 0) * glm::scale(Mat4(1.f), {-1, 1, 1}));
  const Manifest m = feed.finish();
  EXPECT_TRUE(m.prototypes.empty());
  const Collected all = collect(folder.path(), m);
  EXPECT_EQ(all.instances, 0u);
  EXPECT_EQ(all.triangles.size(), 9800u + 8);
  expect_mesh(all, 1, a, Transform(moved(3, 0, 0) * glm::scale(Mat4(1.f), {-1, 1, 1})));
  for (std::uint32_t p = 0; p < m.parts.size(); ++p) {
    const Result<Part> part = read_part_file(part_path(folder.path(), p));
    for (const MeshChunk& c : part->chunks) EXPECT_EQ(c.flip, c.shape);  // mirrored: shape 1
  }
}

// Copies into the world or into an outer object are rounded, and the bounds are seen by light from infinity.
TEST(Split, WhatIsCopiedDoesNotFollowThePartSize) {
  const ObjectId leaf(0), tree(1), lone(2);
  std::vector<Bounds3> bounds;
  for (const std::uint64_t part_size : {100 << 10, 64 << 20}) {
    const TemporaryFolder folder;
    Feeder feed(folder.path(), part_size, 256 << 20);
    feed.add(hills(2, {-1, -1, -1}, 0.1f));
    feed.begin(leaf);
    feed.add(hills(70, {0, 0, 0}, 1.f), leaf);
    feed.end(leaf);
    feed.begin(tree);
    feed.instance(leaf, glm::rotate(moved(0, 0, 1), 1.f, Vec3(1, 1, 0)));
    feed.end(tree);
    feed.instance(tree, glm::rotate(moved(3, 0, 0), 1.f, Vec3(0, 1, 1)));
    feed.begin(lone);
    feed.add(hills(70, {0, 0, 0}, 1.f), lone);
    feed.end(lone);
    feed.instance(lone, glm::rotate(moved(0, 5, 0), 1.f, Vec3(0, 1, 1)));
    const Manifest m = feed.finish();
    std::uint64_t in_the_world = 0;
    for (std::uint32_t p = 0; p < m.parts.size(); ++p)
      in_the_world += read_part_file(part_path(folder.path(), p))->triangles.size();
    EXPECT_EQ(in_the_world, 8u) << part_size;
    bounds.push_back(m.bounds);
  }
  EXPECT_EQ(bounds[0].min, bounds[1].min);
  EXPECT_EQ(bounds[0].max, bounds[1].max);
}

TEST(Split, ObjectsInObjectsAreFlattened) {
  const TemporaryFolder folder;
  Feeder feed(folder.path(), 1 << 20);
  const ObjectId leaf(0), tree(1);
  const ShapeDesc a = hills(5, {0, 0, 0}, 1.f), trunk = hills(2, {0, 0, -1}, 1.f);
  feed.begin(leaf);
  feed.add(a, leaf);
  feed.end(leaf);
  feed.begin(tree);
  feed.instance(leaf, moved(0, 0, 1));
  feed.add(trunk, tree);
  feed.instance(leaf, moved(0, 0, 2));
  feed.end(tree);
  feed.instance(tree, moved(8, 0, 0));
  feed.instance(tree, moved(16, 0, 0));
  const Manifest m = feed.finish();
  EXPECT_EQ(m.prototypes.size(), 1u);
  EXPECT_EQ(m.parts[1].features, kHasInstances | kHasTriangles);  // its prototype's too
  const Collected all = collect(folder.path(), m);
  EXPECT_EQ(all.duplicates, 0u);
  EXPECT_EQ(all.triangles.size(), 2u * (50 + 8 + 50));
  expect_mesh(all, 0, a, Transform(moved(8, 0, 1)));
  expect_mesh(all, 1, trunk, Transform(moved(8, 0, 0)));
  expect_mesh(all, 5, a, Transform(moved(16, 0, 2)));
}

TEST(Split, ObjectsTooLargeToCopyBecomeInstancesOfTheirOwn) {
  const TemporaryFolder folder;
  Feeder feed(folder.path(), 100 << 10);
  const ObjectId leaf(0), tree(1), wood(2);
  const ShapeDesc a = hills(50, {0, 0, 0}, 1.f), trunk = hills(2, {0, 0, -1}, 1.f);
  feed.begin(leaf);
  feed.add(a, leaf);
  feed.end(leaf);
  feed.begin(tree);
  feed.instance(leaf, moved(0, 0, 1));
  feed.add(trunk, tree);
  feed.instance(leaf, moved(0, 0, 2));
  feed.end(tree);
  feed.begin(wood);
  feed.add(trunk, wood);
  feed.instance(tree, moved(0, 4, 0));
  feed.end(wood);
  feed.instance(wood, moved(8, 0, 0));
  feed.instance(tree, moved(16, 0, 0));
  const Manifest m = feed.finish();
  const Collected all = collect(folder.path(), m);
  EXPECT_EQ(all.duplicates, 0u);
  EXPECT_EQ(all.triangles.size(), 8u + 2 * (2 * 5000 + 8));
  EXPECT_LT(m.total_triangles, 11000u);  // the leaf is stored twice at most
  expect_mesh(all, 0, trunk, Transform(moved(8, 0, 0)));
  expect_mesh(all, 1, a, Transform(moved(8, 4, 1)));
  expect_mesh(all, 2, trunk, Transform(moved(8, 4, 0)));
  expect_mesh(all, 3, a, Transform(moved(8, 4, 2)));
  expect_mesh(all, 4, a, Transform(moved(16, 0, 1)));
  expect_mesh(all, 6, a, Transform(moved(16, 0, 2)));
}

TEST(Spool, LeavesOutTrianglesThatAreNotFinite) {
  const TemporaryFolder folder;
  Spool spool(folder.path());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Vec3> p = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {nan, 1, 1}, {1e30f, 0, 0}};
  const std::vector<Triangle> t = {{0, 1, 3}, {0, 1, 2}, {2, 1, 4}};
  ShapeRow row;
  std::uint64_t dropped = 0;
  EXPECT_EQ(spool.add_mesh(row, p, {}, {}, t, dropped), 0u);
  EXPECT_EQ(dropped, 2u);
  EXPECT_EQ(row.box.max, Vec3(1, 1, 0));
  const PartMaker maker(spool.map(), {}, {}, {}, 1 << 20);
  std::vector<Item> items;
  maker.items_of(0, [&](const Item& i) { items.push_back(i); });
  ASSERT_EQ(items.size(), 1u);
  EXPECT_EQ(items[0].primitive, 1u);
  EXPECT_EQ(spool.add_mesh(row, p, {}, {}, std::span(t).first(1), dropped), kNone);
}

TEST(Split, TakesAlongTheFilesThatTheSceneNames) {
  const TemporaryFolder folder, elsewhere;
  std::filesystem::create_directories(elsewhere.path("other"));
  for (const char* name : {"a.png", "other/a.png", "copy.png"})
    std::ofstream(elsewhere.path(name)) << (std::string(name).starts_with("other") ? "two" : "one");
  const auto texture = [&](const std::string& file) {
    TextureDesc t;
    Param p;
    p.type = ParamType::string;
    p.name = "filename";
    p.strings = {file};
    t.params.add(p);
    t.name = file;
    return t;
  };
  Feeder feed(folder.path("out"), 1 << 20);
  for (const char* name : {"a.png", "other/a.png", "copy.png", "missing.png"})
    feed.scene.textures.push_back(texture(elsewhere.path(name)));
  feed.finish();
  EXPECT_NE(feed.warnings.list().back().find("missing.png"), std::string::npos);
  std::filesystem::rename(folder.path("out"), folder.path("renamed"));
  const Manifest m = open_split(folder.path("renamed"));
  const auto name = [&](std::size_t i) {
    return m.scene.textures[i].params.string("filename", "");
  };
  EXPECT_EQ(name(0), folder.path("renamed/files/a.png"));
  EXPECT_EQ(name(1), folder.path("renamed/files/a-2.png"));
  EXPECT_EQ(name(2), name(0));
  EXPECT_EQ(name(3), elsewhere.path("missing.png"));
  std::string content;
  std::ifstream(name(1)) >> content;
  EXPECT_EQ(content, "two");
}

TEST(Split, ReplacesAnEarlierSplitAndNothingElse) {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder.path("parts"));
  std::ofstream(folder.path("parts/mine.pbrt")) << "# mine";
  std::ofstream(folder.path("main.pbrt")) << "# mine";
  SplitOptions text;
  text.text = true;
  Warnings warnings;
  EXPECT_THROW(SceneSplitter(folder.path(), text, warnings), UsageError);
  for (const std::uint64_t part_size : {100 << 10, 64 << 20}) {
    Feeder feed(folder.path(), part_size);
    EXPECT_EQ(std::filesystem::exists(folder.path("main.pbrt")), part_size == 100 << 10);
    feed.add(hills(80, {0, 0, 0}, 1.f));
    EXPECT_FALSE(is_split_folder(folder.path()));
    feed.finish();
    std::ofstream(folder.path("main.pbrt")) << "# of the split";
  }
  EXPECT_TRUE(std::filesystem::exists(part_path(folder.path(), 1)));
  EXPECT_FALSE(std::filesystem::exists(part_path(folder.path(), 2)));
  EXPECT_TRUE(std::filesystem::exists(folder.path("parts/mine.pbrt")));
  EXPECT_THROW(split_scene(folder.path("main.pbrt"), folder.path(), text, warnings), UsageError);
}

TEST(Split, WhatIsNoSplitFolderIsRefused) {
  const TemporaryFolder folder;
  EXPECT_FALSE(is_split_folder(folder.path()));
  EXPECT_THROW(open_split(folder.path()), SceneError);
  std::ofstream(folder.path("manifest.bin")) << "no manifest";
  EXPECT_THROW(open_split(folder.path()), SceneError);
}

TEST(Split, LeavesNoTemporaryFiles) {
  const TemporaryFolder folder;
  {
    Feeder feed(folder.path("out"), 100 << 10);
    feed.add(hills(80, {0, 0, 0}, 1.f));
    feed.finish();
  }
  for (const auto& e : std::filesystem::directory_iterator(folder.path("out"))) {
    const std::string name = e.path().filename().string();
    EXPECT_TRUE(name == "manifest.bin" || name == "parts" || name == "prototypes") << name;
  }
}

}  // namespace
}  // namespace cloudrenderer
