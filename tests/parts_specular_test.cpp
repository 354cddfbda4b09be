// Boxes around what may be specular.
#include <gtest/gtest.h>

#include <random>

#include "parts/specular_boxes.h"
#include "parts_scene.h"
#include "scene/material_specular.h"

namespace cloudrenderer {
namespace {

using namespace parts_test;

constexpr std::uint32_t kGlass = 1;

MaterialDesc material(const std::string& type, std::vector<Param> params = {}) {
  MaterialDesc m;
  m.type = type;
  for (Param& p : params) m.params.add(std::move(p));
  return m;
}

Param text(const char* name, const std::string& value) {
  Param p;
  p.type = ParamType::string;
  p.name = name;
  p.strings = {value};
  return p;
}

bool covered(const std::vector<Bounds3>& boxes, const Vec3& p) {
  return std::ranges::any_of(boxes, [&](const Bounds3& b) { return holds(b, p, 1e-4f); });
}

ShapeDesc glass(ShapeDesc d) {
  d.material = MaterialId(kGlass);
  return d;
}

TEST(SpecularMaterials, AreThoseThatCanBe) {
  SceneDescription scene;
  const auto is = [&](Dialect dialect, const MaterialDesc& m) -> bool {
    scene.dialect = dialect;
    scene.materials = {material("matte"), material("none"), material("mirror"), m};
    return maybe_specular(scene).back();
  };
  const auto real = [](const char* name, float v) { return reals(name, ParamType::real, {v}); };
  const std::vector<Param> rough{real("uroughness", 0.1f), real("vroughness", 0.1f)};
  for (const Dialect d : {Dialect::v2, Dialect::v3}) {
    for (const char* type : {"", "none", "matte", "plastic", "uber", "metal", "hair"}) EXPECT_FALSE(is(d, material(type))) << type;
    for (const char* type : {"glass", "mirror", "shinymetal", "coatedconductor", "subsurface"}) EXPECT_TRUE(is(d, material(type))) << type;
    EXPECT_TRUE(is(d, material("uber", {reals("Kr", ParamType::rgb, {1, 1, 1})})));
    EXPECT_TRUE(is(d, material("uber", {text("opacity", "leaves")})));
    EXPECT_EQ(is(d, material("glass", rough)), d == Dialect::v2);  // which knows no rough glass
    EXPECT_TRUE(is(d, material("glass", {real("uroughness", 0)})));
    EXPECT_TRUE(is(d, material("glass", {real("uroughness", 0.1f), real("vroughness", 0.1f), real("eta", 1)}))) << "no facet bends a ray";
    const auto mix = [](const char* a, const char* b) { return material("mix", {text("namedmaterial1", a), text("namedmaterial2", b)}); };
    EXPECT_FALSE(is(d, mix("0", "0")));
    EXPECT_TRUE(is(d, mix("0", "1")));
    EXPECT_TRUE(is(d, mix("2", "0")));
    EXPECT_TRUE(is(d, mix("0", "9")));
    EXPECT_THROW(is(d, mix("3", "0")), SceneError);
  }
}

TEST(FewBoxes, CoverWhatTheyAreMadeOf) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> at(-10, 10), size(0, 1);
  for (const std::size_t n : {1, 5, 16, 17, 1000})
    for (const bool flat : {false, true}) {
      std::vector<Bounds3> boxes;
      for (std::size_t i = 0; i < n; ++i) {
        const Vec3 p(at(random), at(random), flat ? 0.f : at(random));
        boxes.push_back({p, p + Vec3(size(random), size(random), flat ? 0.f : size(random))});
      }
      const std::vector<Bounds3> few = few_boxes(boxes, 16);
      EXPECT_LE(few.size(), 16u);
      float sections = 0;
      for (const Bounds3& b : few) sections += glm::dot(b.diagonal(), b.diagonal());
      Bounds3 all;
      for (const Bounds3& b : boxes) {
        all.extend(b);
        for (int i = 0; i < 8; ++i) EXPECT_TRUE(covered(few, {i & 1 ? b.max.x : b.min.x, i & 2 ? b.max.y : b.min.y, i & 4 ? b.max.z : b.min.z}));
      }
      EXPECT_LE(sections, 1.5f * glm::dot(all.diagonal(), all.diagonal())) << "seed 7";
    }
  EXPECT_TRUE(few_boxes({}, 16).empty());
  EXPECT_EQ(few_boxes(std::vector<Bounds3>(100, Bounds3{Vec3(1), Vec3(1)}), 16).size(), 1u);
}

// Of things in the corners of a square, that none of its halves is smaller must not matter.
TEST(FewBoxes, AreCloseAroundThingsFarApart) {
  std::vector<Bounds3> corners;
  for (int i = 0; i < 200; ++i) {
    const Vec3 p((i & 1) * 100, (i >> 1 & 1) * 100, 0);
    corners.push_back({p, p + Vec3(1, 1, 0.01f * static_cast<float>(i))});
  }
  EXPECT_EQ(few_boxes(corners, 16).size(), 4u);
}

TEST(FewBoxes, KeepFarThingsApartAndCutLongOnes) {
  const std::vector<Bounds3> far = few_boxes({{Vec3(0), Vec3(1)}, {Vec3(1), Vec3(2)}, {Vec3(100), Vec3(101)}}, 2);
  ASSERT_EQ(far.size(), 2u);
  EXPECT_EQ(std::max(far[0].max.x, far[1].max.x), 101);
  EXPECT_EQ(std::min(far[0].max.x, far[1].max.x), 2);
  for (const Bounds3& b : few_boxes({{Vec3(0), Vec3(8, 1, 1)}}, 16)) EXPECT_LE(b.diagonal().x, 2) << "no more than twice as long as wide";
}

TEST(SpecularBoxes, AreThoseOfShapesAndInstances) {
  const auto split = [](std::uint64_t part_size, Manifest& out) {
    const TemporaryFolder folder;
    Feeder f(folder.path(), part_size);
    f.scene.materials.push_back(material("glass"));
    f.add(hills(40, Vec3(-50, -50, 0), 100));
    f.add(glass(sphere(Vec3(5, 0, 1), 1)));
    f.add(sphere(Vec3(30, 30, 1), 1));
    const ObjectId inner(1), outer(2), dull(3);
    f.begin(inner);
    f.add(glass(hills(30, Vec3(0), 2)), inner);
    f.add(hills(3, Vec3(9), 2), inner);
    f.end(inner);
    f.begin(outer);
    f.add(hills(3, Vec3(-9), 2), outer);
    f.instance(inner, glm::translate(Mat4(1.f), Vec3(0, 0, 3)));
    f.end(outer);
    f.begin(dull);
    f.add(hills(3, Vec3(0), 2), dull);
    f.end(dull);
    f.instance(outer, glm::translate(Mat4(1.f), Vec3(-40, 0, 0)));
    f.instance(inner, glm::translate(Mat4(1.f), Vec3(0, 40, 0)));
    f.instance(dull, glm::translate(Mat4(1.f), Vec3(40, 0, 0)));
    out = f.finish();
  };
  Manifest whole, cut;
  split(64 << 20, whole);
  split(64 << 10, cut);
  EXPECT_GT(cut.parts.size(), whole.parts.size());
  ASSERT_EQ(whole.specular_boxes.size(), cut.specular_boxes.size());
  for (std::size_t i = 0; i < whole.specular_boxes.size(); ++i) {
    EXPECT_EQ(whole.specular_boxes[i].min, cut.specular_boxes[i].min);
    EXPECT_EQ(whole.specular_boxes[i].max, cut.specular_boxes[i].max);
  }
  for (const Vec3& p : {Vec3(5, 0, 1), Vec3(-40, 0, 3), Vec3(-38, 2, 3), Vec3(0, 40, 0), Vec3(2, 42, 0)}) EXPECT_TRUE(covered(whole.specular_boxes, p));
  for (const Vec3& p : {Vec3(30, 30, 1), Vec3(-31, 9, 12), Vec3(9, 49, 9), Vec3(40, 0, 0), Vec3(-50, -50, 0)})
    EXPECT_FALSE(covered(whole.specular_boxes, p));
}

// Where it is at any time.
TEST(SpecularBoxes, FollowWhatMoves) {
  const TemporaryFolder folder;
  Feeder f(folder.path(), 64 << 20);
  f.scene.materials.push_back(material("mirror"));
  ShapeDesc d = glass(sphere(Vec3(0), 1));
  d.motion = Motion{Transform(glm::translate(Mat4(1.f), Vec3(10, 0, 0)))};
  f.add(std::move(d));
  const Manifest m = f.finish();
  for (const float x : {-1.f, 0.f, 5.f, 11.f}) EXPECT_TRUE(covered(m.specular_boxes, {x, 0, 0}));
  EXPECT_FALSE(covered(m.specular_boxes, {5, 3, 0}));
}

TEST(SpecularBoxes, OfManyInstancesAreFew) {
  const TemporaryFolder folder;
  Feeder f(folder.path(), 64 << 20);
  f.scene.materials.push_back(material("glass"));
  const ObjectId object(1);
  f.begin(object);
  f.add(glass(hills(1, Vec3(0), 0.5f)), object);
  f.end(object);
  constexpr int kSide = 300;  // more than are looked at together
  for (int i = 0; i < kSide * kSide; ++i) f.instance(object, glm::translate(Mat4(1.f), Vec3(i % kSide, i / kSide, 0)));
  const Manifest m = f.finish();
  EXPECT_LE(m.specular_boxes.size(), kMostSpecularBoxes);
  for (int i = 0; i < kSide; ++i) EXPECT_TRUE(covered(m.specular_boxes, Vec3(i, (i * 7) % kSide, 0)));
}

}  // namespace
}  // namespace cloudrenderer
