// Scenes with movement: what is in the parts, where the boxes are, and what a scene without any does not carry.
#include <gtest/gtest.h>
#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <random>

#include "parts/part_builder.h"
#include "parts/part_format.h"
#include "parts_scene.h"

namespace cloudrenderer {
namespace {

using namespace parts_test;
using Way = AnimatedTransform::Interpolates;

// Shapes, an instance, an object with a moving shape in it that stands and that moves itself.
constexpr const char* kMoving = R"(
TransformTimes 0 2
Camera "perspective" "float shutterclose" 2
WorldBegin
Shape "disk" "float radius" 9
ObjectBegin "thing"
Shape "cylinder" "float radius" 0.2 "float zmin" 0 "float zmax" 1
Translate 0.3 0 0
ActiveTransform EndTime Rotate 120 1 2 0.5 Translate 0 0 1 ActiveTransform All
Shape "cone" "float radius" 0.4 "float height" 1
ObjectEnd
Translate 3 0 0
ObjectInstance "thing"
ActiveTransform StartTime Rotate 150 0 1 1 Scale 2 1 1 ActiveTransform EndTime Translate 1 2 3 ActiveTransform All
Shape "trianglemesh" "integer indices" [ 0 1 2 2 1 3 ] "point P" [ 0 0 0  1 0 0.1  0 1 0.3333333  1 1 0 ]
ObjectInstance "thing"
WorldEnd
)";

struct SplitScene {
  TemporaryFolder folder;
  Warnings warnings;
  Manifest manifest;
  std::vector<Part> parts, prototypes;

  SplitScene(const std::string& text, Dialect dialect, std::uint64_t part_size = 64 << 20) {
    std::ofstream(folder.path("scene.pbrt")) << text;
    SplitOptions options;
    options.text = true;
    options.dialect = dialect;
    options.part_size = part_size;
    manifest = split_scene(folder.path("scene.pbrt"), folder.path("a"), options, warnings);
    read(folder.path("a"));
  }
  void read(const std::string& from) {
    for (std::uint32_t p = 0; p < manifest.parts.size(); ++p) parts.push_back(*read_part_file(part_path(from, p)));
    for (std::uint32_t p = 0; p < manifest.prototypes.size(); ++p)
      prototypes.push_back(*read_part_file(prototype_path(from, p)));
  }
};

Transform at(const Part& part, std::uint32_t instance, float time) {
  std::vector<AnimatedTransform> moves;
  for (const MotionRecord& m : motions_of(part.motions, instance)) moves.push_back(m.transform());
  return placed(Affine(part.instances[instance].to_world.matrix()), moves, time);
}

TEST(MovingParts, HoldEachMovementOnceAndInOrder) {
  for (const Dialect dialect : {Dialect::v2, Dialect::v3}) {
    const SplitScene s(kMoving, dialect);
    EXPECT_TRUE(s.warnings.list().empty()) << s.warnings.list()[0];
    EXPECT_TRUE(s.manifest.moves);
    EXPECT_EQ(s.prototypes.size(), 3u);  // the thing, its cone, the mesh
    std::multiset<std::size_t> movements;
    std::set<std::uint32_t> ids;
    for (const Part& part : s.parts) {
      for (std::uint32_t i = 0; i < part.instances.size(); ++i) {
        movements.insert(motions_of(part.motions, i).size());
        ids.insert(part.instances[i].first_shape);
      }
      for (const MotionRecord& m : part.motions) {
        EXPECT_EQ(m.interpolates, dialect == Dialect::v2 ? Way::inverse : Way::forward);
        EXPECT_EQ(m.start_time, 0.f);
        EXPECT_EQ(m.end_time, 2.f);
      }
    }
    // The thing stands, and its cone moves; the mesh; the thing moves, and its cone in it.
    EXPECT_EQ(movements, (std::multiset<std::size_t>{0, 1, 1, 1, 2}));
    EXPECT_EQ(ids, (std::set<std::uint32_t>{1, 2, 3, 4, 5}));
  }
}

TEST(MovingParts, BoxesHoldThePointsAtEveryTime) {
  constexpr unsigned kSeed = 17;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 rng(kSeed);
  const auto u = [&] { return std::uniform_real_distribution<float>(0, 1)(rng); };
  for (const Dialect dialect : {Dialect::v2, Dialect::v3}) {
    const SplitScene s(kMoving, dialect, 8 << 10);
    EXPECT_GT(s.parts.size(), 2u);
    for (std::size_t p = 0; p < s.parts.size(); ++p)
      for (std::uint32_t i = 0; i < s.parts[p].instances.size(); ++i) {
        const Bounds3& box = s.manifest.prototypes[s.parts[p].instances[i].prototype].bounds;
        for (int k = 0; k < 2000; ++k) {
          const Transform to_world = at(s.parts[p], i, 2.4f * u() - 0.2f);
          const Vec3 q = to_world.point(box.min + Vec3(u(), u(), u()) * (box.max - box.min));
          const auto inside = [&](const Bounds3& b) {
            return glm::all(glm::lessThanEqual(b.min, q)) && glm::all(glm::lessThanEqual(q, b.max));
          };
          ASSERT_TRUE(std::ranges::any_of(s.manifest.parts[p].boxes, inside));
          ASSERT_TRUE(inside(s.manifest.bounds));
        }
      }
  }
}

TEST(MovingParts, CostNothingWhereNothingMoves) {
  const SplitScene s("WorldBegin Shape \"sphere\" ActiveTransform EndTime Translate 1 0 0 Translate -1 0 0 Shape \"disk\" WorldEnd",
                     Dialect::v2);
  EXPECT_FALSE(s.manifest.moves);
  EXPECT_TRUE(s.prototypes.empty());
  std::ifstream in(part_path(s.folder.path("a"), 1), std::ios::binary);
  part_format::Header header;
  in.read(reinterpret_cast<char*>(&header), sizeof header);
  EXPECT_EQ(header.version, part_format::kVersion);
  EXPECT_EQ(header.section_count, part_format::kBaseSections);
}

TEST(MovingParts, ReadBackFromTextTheyMoveBetweenTheSameEnds) {
  for (const Dialect dialect : {Dialect::v2, Dialect::v3}) {
    const SplitScene a(kMoving, dialect);
    Warnings warnings;
    SplitOptions options;
    options.dialect = dialect;
    const std::string again = a.folder.path("b");
    const Manifest second = split_scene(a.folder.path("a/main.pbrt"), again, options, warnings);
    for (const std::string& w : warnings.list()) ADD_FAILURE() << w;
    EXPECT_EQ(second.scene.transform_end, 2.f);
    ASSERT_EQ(second.parts.size(), a.manifest.parts.size());
    using Ends = std::vector<std::array<float, 32>>;
    const auto ends = [](const Part& part) {
      Ends all;
      for (std::uint32_t i = 0; i < part.instances.size(); ++i)
        for (std::size_t k = 0; k < 32; ++k) {
          if (k == 0) all.emplace_back();
          const Mat4 m = at(part, i, k < 16 ? 0.f : 2.f).matrix();
          all.back()[k] = m[static_cast<int>(k % 16 / 4)][static_cast<int>(k % 4)];
        }
      std::ranges::sort(all);
      return all;
    };
    for (std::uint32_t p = 0; p < second.parts.size(); ++p) {
      const Ends one = ends(a.parts[p]), other = ends(*read_part_file(part_path(again, p)));
      ASSERT_EQ(one.size(), other.size());
      for (std::size_t i = 0; i < one.size(); ++i)
        for (std::size_t k = 0; k < 32; ++k) EXPECT_NEAR(one[i][k], other[i][k], 1e-5f);
    }
  }
}

TEST(MovingParts, BadMovementsAreRefused) {
  const auto bytes_of = [](const std::function<void(MotionRecord&)>& change) {
    const TemporaryFolder folder;
    PartBuilder b;
    MotionRecord m{Mat4(1.f), Mat4(2.f), 0, 1, 0, Way::forward};
    m.end[3][3] = 1;
    b.add_instance({Transform(), 0, 9}, std::span(&m, 1));
    b.write(folder.path("a.part"));
    std::ifstream in(folder.path("a.part"), std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(in), {}};
    const std::size_t place = bytes.size() - 192;  // the last section, in whole lines of 64 bytes
    std::memcpy(&m, bytes.data() + place, sizeof m);
    EXPECT_EQ(m.end[0][0], 2.f);
    change(m);
    std::memcpy(bytes.data() + place, &m, sizeof m);
    const std::uint64_t sum = XXH3_64bits(bytes.data() + 64, bytes.size() - 64);
    std::memcpy(bytes.data() + 24, &sum, sizeof sum);
    return bytes;
  };
  const auto error = [&](const std::function<void(MotionRecord&)>& change) {
    const std::string bytes = bytes_of(change);
    std::vector<Mat4> block(bytes.size() / sizeof(Mat4) + 1);
    auto* aligned = reinterpret_cast<char*>((reinterpret_cast<std::uintptr_t>(block.data()) + 15) / 16 * 16);
    std::memcpy(aligned, bytes.data(), bytes.size());
    const Result<Part> part = read_part({reinterpret_cast<const std::byte*>(aligned), bytes.size()}, nullptr);
    return part ? std::string() : part.error();
  };
  EXPECT_EQ(error([](MotionRecord&) {}), "");
  EXPECT_NE(error([](MotionRecord& m) { m.instance = 1; }), "");
  EXPECT_NE(error([](MotionRecord& m) { m.end_time = -1; }), "");
  EXPECT_NE(error([](MotionRecord& m) { m.start_time = std::nanf(""); }), "");
  EXPECT_NE(error([](MotionRecord& m) { m.end[1][1] = 0; }), "");
  EXPECT_NE(error([](MotionRecord& m) { m.end[1][1] = -1; }), "");
  EXPECT_NE(error([](MotionRecord& m) { m.start[3][0] = kInfinity; }), "");
  EXPECT_NE(error([](MotionRecord& m) { m.interpolates = static_cast<Way>(7); }), "");
}

}  // namespace
}  // namespace cloudrenderer
