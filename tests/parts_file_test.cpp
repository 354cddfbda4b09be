#include <gtest/gtest.h>
#include <xxhash.h>

#include <cstring>
#include <fstream>
#include <limits>
#include <random>

#include "parts/check.h"
#include "parts/part_builder.h"
#include "parts/part_format.h"
#include "parts_support.h"

namespace cloudrenderer {
namespace {

using parts_test::TemporaryFolder;

// Two chunks, a quadric and an instance.
PartBuilder example() {
  PartBuilder b;
  const std::vector<Vec3> p = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0.5f}};
  const std::vector<Vec3> n(4, Vec3(0, 0, 1));
  const std::vector<Vec2> uv = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
  const std::vector<Triangle> t = {{0, 1, 2}, {2, 1, 3}};
  const std::vector<std::uint32_t> gaps = {3, 9}, run = {7, 8};
  MeshChunk c;
  c.shape = 5;
  c.material = 1;
  b.add_chunk(c, {p, n, uv, t, gaps});
  c.shape = 6;
  c.flip = 1;
  b.add_chunk(c, {p, {}, {}, t, run});
  QuadricRecord q;
  q.shape = 8;
  b.add_quadric(q);
  b.add_instance({Transform(glm::mat4(2.f)), 0, 9});
  return b;
}

std::vector<char> file_bytes(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

Result<Part> read(const std::vector<char>& bytes) {
  std::shared_ptr<char> block(new (std::align_val_t{64}) char[bytes.size() + 1],
                              [](char* p) { ::operator delete[](p, std::align_val_t{64}); });
  std::memcpy(block.get(), bytes.data(), bytes.size());
  return read_part({reinterpret_cast<const std::byte*>(block.get()), bytes.size()}, block);
}

void seal(std::vector<char>& bytes) {  // makes a changed file's checksum right again
  const std::uint64_t sum = XXH3_64bits(bytes.data() + 64, bytes.size() - 64);
  std::memcpy(bytes.data() + 24, &sum, sizeof sum);
}

BrickRecord brick(std::uint32_t number, float majorant) {
  BrickRecord b;
  b.brick.high = Vec3(1.f);
  b.brick.scale = Vec3(2.f);
  b.brick.size = {3, 2, 4};
  b.brick.majorant = majorant;
  b.primitive = number;
  return b;
}

TEST(PartFile, BricksOfDensityGrids) {
  std::vector<float> samples(24, .5f);
  samples[7] = 2;
  PartBuilder b = example();
  const std::uint64_t plain = b.predicted_bytes();
  b.add_brick(brick(3, 2), samples);
  b.add_brick(brick(4, 2), samples);
  EXPECT_GE(b.predicted_bytes(), plain + 2 * (sizeof(BrickRecord) + 24 * sizeof(float)));
  const Part p = b.build();
  ASSERT_EQ(p.bricks.size(), 2u);
  EXPECT_EQ(p.bricks[1].primitive, 4u);
  EXPECT_EQ(p.bricks[1].first_sample, 24u);
  EXPECT_EQ(p.densities[24 + 7], 2.f);
  EXPECT_EQ(p.instances.size(), 1u);
  EXPECT_EQ(example().build().bricks.size(), 0u);
}

TEST(PartFile, RefusesBricksThatAreWrong) {
  const std::vector<float> samples(24, .5f), negative(24, -1.f);
  const auto refused = [](const BrickRecord& wrong, std::span<const float> densities) {
    PartBuilder b;
    b.add_brick(wrong, densities);
    EXPECT_THROW(b.build(), std::invalid_argument);
  };
  refused(brick(0, .1f), samples);  // above its majorant
  refused(brick(0, 1), negative);
  refused(brick(0, 1), std::span(samples).first(23));
  BrickRecord b = brick(0, 1);
  b.brick.size[1] = 1;
  refused(b, samples);
  b = brick(0, 1);
  b.brick.low.x = 2;
  refused(b, samples);
  b = brick(0, 1);
  b.brick.scale.y = kInfinity;
  refused(b, samples);
}

TEST(PartFile, GivesBackWhatWasWritten) {
  const TemporaryFolder folder;
  PartBuilder b = example();
  EXPECT_EQ(b.triangle_count(), 4u);
  const PartBuilder::File file = b.write(folder.path("a.part"));
  EXPECT_TRUE(b.empty());
  EXPECT_EQ(file.bytes % 64, 0u);
  Result<Part> part = read_part_file(folder.path("a.part"));
  ASSERT_TRUE(part) << part.error();
  EXPECT_EQ(part->positions.size(), 8u);
  EXPECT_EQ(part->positions[7], Vec3(1, 1, 0.5f));
  EXPECT_EQ(part->normals.size(), 4u);
  EXPECT_EQ(part->uvs[3], Vec2(1, 1));
  ASSERT_EQ(part->chunks.size(), 2u);
  EXPECT_EQ(part->triangles[3], Triangle(6, 5, 7));
  EXPECT_EQ(part->chunks[1].first_normal, kNone);
  ASSERT_EQ(part->quadrics.size(), 1u);
  EXPECT_EQ(part->quadrics[0].shape, 8u);
  ASSERT_EQ(part->instances.size(), 1u);
  EXPECT_EQ(part->instances[0].to_world.matrix(), glm::mat4(2.f));
}

TEST(PartFile, FindsChunkAndSourceTriangle) {
  const Part part = example().build();
  EXPECT_EQ(part.chunk_of(0).shape, 5u);
  EXPECT_EQ(part.chunk_of(1).shape, 5u);
  EXPECT_EQ(part.chunk_of(2).shape, 6u);
  EXPECT_EQ(part.chunk_of(3).shape, 6u);
  EXPECT_EQ(part.source_primitive(part.chunks[0], 1), 9u);
  EXPECT_EQ(part.source_primitive(part.chunks[1], 3), 8u);
  EXPECT_EQ(part.chunks[1].primitive_ids, kNone);
}

TEST(PartFile, FindsTheSameChunkWithAGuide) {
  for (const std::vector<std::uint32_t>& sizes : std::vector<std::vector<std::uint32_t>>{
           {1}, {1, 1}, {1000, 1}, {1, 1000}, {3, 1, 400, 1, 1, 1, 1, 1, 7, 90}, std::vector<std::uint32_t>(300, 2), {1, 50000, 1, 1, 1, 3}}) {
    PartBuilder b;
    const std::vector<Vec3> positions{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    std::uint32_t shape = 0;
    for (const std::uint32_t n : sizes) {
      const std::vector<Triangle> triangles(n, Triangle(0, 1, 2));
      MeshChunk attributes;
      attributes.shape = shape++;
      b.add_chunk(attributes, {positions, {}, {}, triangles, {}});
    }
    const Part plain = b.build();
    Part guided = plain;
    guided.guide_chunks();
    EXPECT_LE(guided.chunk_guide.size() * sizeof(std::uint32_t), 16 * sizes.size() + 8) << sizes.size();
    for (std::uint32_t i = 0; i < plain.triangles.size(); ++i) ASSERT_EQ(guided.chunk_of(i).shape, plain.chunk_of(i).shape) << i;
  }
}

TEST(PartFile, LetsEmbreeReadBehindThePositions) {
  const Part part = example().build();
  const auto* end =
      reinterpret_cast<const std::byte*>(part.positions.data() + part.positions.size());
  EXPECT_LE(end + 16, reinterpret_cast<const std::byte*>(part.normals.data()));
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(part.positions.data()) % 64, 0u);
}

TEST(PartFile, AnEmptyPartIsAPart) {
  const Part part = PartBuilder().build();
  EXPECT_TRUE(part.triangles.empty());
  EXPECT_TRUE(part.chunks.empty());
}

TEST(PartFile, BuilderRefusesPositionsThatAreNotFinite) {
  const std::vector<Vec3> p = {
      {0, 0, 0}, {1, std::numeric_limits<float>::quiet_NaN(), 0}, {0, 1, 0}};
  const std::vector<Triangle> t = {{0, 1, 2}}, outside = {{0, 1, 3}};
  EXPECT_THROW(PartBuilder().add_chunk({}, {p, {}, {}, t, {}}), std::invalid_argument);
  EXPECT_THROW(PartBuilder().add_chunk({}, {std::span(p).first(1), {}, {}, outside, {}}),
               std::invalid_argument);
}

TEST(PartFile, RejectsContentThatIsWrongInItself) {
  const TemporaryFolder folder;
  example().write(folder.path("a.part"));
  const std::vector<char> good = file_bytes(folder.path("a.part"));
  const auto entry = [&](std::uint32_t section) {
    part_format::SectionEntry e;
    std::memcpy(&e, good.data() + 64 + section * sizeof e, sizeof e);
    return e;
  };
  const auto with = [&](std::size_t at, auto value) {
    std::vector<char> bytes = good;
    std::memcpy(bytes.data() + at, &value, sizeof value);
    seal(bytes);
    return read(bytes);
  };
  const auto at = [&](std::uint32_t section, std::size_t offset) {
    return static_cast<std::size_t>(entry(section).offset) + offset;
  };
  using namespace part_format;
  EXPECT_TRUE(with(at(kPositions, 4), 3.f));
  EXPECT_FALSE(with(at(kPositions, 4), std::numeric_limits<float>::quiet_NaN()));
  EXPECT_FALSE(with(at(kPositions, 4), 1e30f));
  EXPECT_FALSE(with(at(kTriangles, 0), std::uint32_t{4}));  // a vertex of the other chunk
  EXPECT_FALSE(with(at(kTriangles, 24), std::uint32_t{3}));
  EXPECT_FALSE(with(at(kChunks, 20), std::uint32_t{1}));   // first_triangle
  EXPECT_FALSE(with(at(kChunks, 24), std::uint32_t{0}));   // triangle_count
  EXPECT_FALSE(with(at(kChunks, 28), 0xfffffff0u));        // first_vertex
  EXPECT_FALSE(with(at(kChunks, 36), std::uint32_t{1}));   // first_normal
  EXPECT_FALSE(with(at(kChunks, 48), std::uint32_t{1}));   // primitive_ids
  EXPECT_FALSE(with(at(kQuadrics, 0), std::uint32_t{6}));  // kind
  EXPECT_FALSE(with(at(kInstances, 0), std::numeric_limits<float>::infinity()));
  EXPECT_FALSE(with(64 + 8, std::uint64_t{64}));        // offset of the positions
  EXPECT_FALSE(with(64 + 16, ~std::uint64_t{0} / 12));  // their count
  EXPECT_FALSE(with(16, std::uint64_t{1}));             // length of the file
}

TEST(PartFile, NoChangeOfBytesCrashesTheReader) {
  const TemporaryFolder folder;
  example().write(folder.path("a.part"));
  const std::vector<char> good = file_bytes(folder.path("a.part"));
  ASSERT_TRUE(read(good));
  std::mt19937 random(1);
  const auto below = [&](std::size_t n) { return random() % n; };
  for (std::size_t i = 0; i < good.size(); i += 7) {  // every flipped byte breaks the checksum
    std::vector<char> bytes = good;
    bytes[i] = static_cast<char>(bytes[i] ^ (1 << below(8)));
    EXPECT_FALSE(read(bytes)) << i;
  }
  int accepted = 0;
  for (int round = 0; round < 30000; ++round) {
    std::vector<char> bytes = good;
    if (round % 5 == 0) bytes.resize(below(bytes.size() + 1));
    if (bytes.size() < 32) {
      EXPECT_FALSE(read(bytes));
      continue;
    }
    for (std::size_t n = below(4) + 1; n > 0; --n) {
      const std::uint32_t values[] = {
          0, 1, 4, 64, 0x7fffffff, 0xffffffff, 0xfffffffe, static_cast<std::uint32_t>(random())};
      const std::uint32_t value = values[below(8)];
      const std::size_t words =
          round % 2 ? bytes.size() / 4 : std::min<std::size_t>(bytes.size() / 4, 80);
      std::memcpy(bytes.data() + 4 * below(words), &value, 4);
    }
    if (bytes.size() >= 64) {
      const std::uint64_t size = bytes.size();
      if (round % 3) std::memcpy(bytes.data() + 16, &size, 8);
      seal(bytes);
    }
    const Result<Part> part = read(bytes);
    if (!part) continue;
    ++accepted;  // then every access a reader makes must be good; the sanitizer builds watch
    double sum = 0;
    for (const MeshChunk& c : part->chunks)
      for (std::uint32_t t = 0; t < c.triangle_count; ++t) {
        const std::uint32_t triangle = c.first_triangle + t;
        sum += part->source_primitive(part->chunk_of(triangle), triangle);
        for (int k = 0; k < 3; ++k) {
          const std::uint32_t v = part->triangles[triangle][k];
          sum += part->positions[v].x;
          if (c.first_normal != kNone) sum += part->normals[c.first_normal + v - c.first_vertex].x;
          if (c.first_uv != kNone) sum += part->uvs[c.first_uv + v - c.first_vertex].x;
        }
      }
    EXPECT_FALSE(std::isnan(sum));
  }
  EXPECT_GT(accepted, 0);
}

TEST(PartFile, NamesAReferenceThatTheManifestDoesNotHave) {
  const Part part = example().build();
  Manifest m;
  m.scene.materials.resize(2);
  m.prototypes.resize(1);
  EXPECT_FALSE(find_bad_reference(part, m)) << *find_bad_reference(part, m);
  m.prototypes.clear();
  EXPECT_TRUE(find_bad_reference(part, m));
  m.prototypes.resize(1);
  m.scene.materials.resize(1);
  EXPECT_TRUE(find_bad_reference(part, m));
}

TEST(PartFile, AMissingFileIsAFailureWithItsName) {
  const Result<Part> part = read_part_file("/nonexistent/1.part");
  ASSERT_FALSE(part);
  EXPECT_NE(part.error().find("/nonexistent/1.part"), std::string::npos);
}

}  // namespace
}  // namespace cloudrenderer
