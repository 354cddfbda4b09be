#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>

#include "scene/ply.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

template <class T>
void put(std::string& out, T v, bool big) {
  std::array<char, sizeof(T)> bytes;
  std::memcpy(bytes.data(), &v, sizeof(T));
  if (big) std::reverse(bytes.begin(), bytes.end());
  out.append(bytes.data(), bytes.size());
}

// A quad and a triangle over five vertices with normals and uv, and properties that nobody reads.
std::string binary_ply(bool big) {
  std::string out =
      std::string("ply\nformat ") + (big ? "binary_big_endian" : "binary_little_endian") +
      " 1.0\ncomment made by hand\nobj_info x\nelement vertex 5\nproperty float x\nproperty double "
      "y\n"
      "property float z\nproperty uchar red\nproperty float nx\nproperty float ny\nproperty float "
      "nz\n"
      "property float u\nproperty float v\nelement extra 2\nproperty list uchar short things\n"
      "element face 2\nproperty uchar flag\nproperty list uchar int vertex_indices\n"
      "property list uint float weights\nend_header\n";
  for (int i = 0; i < 5; ++i) {
    put(out, static_cast<float>(i), big);
    put(out, 0.5 * i, big);
    put(out, 2.f, big);
    put(out, std::uint8_t{200}, big);
    for (const float n : {0.f, 0.f, 1.f}) put(out, n, big);
    put(out, 0.1f * static_cast<float>(i), big);
    put(out, 0.25f, big);
  }
  for (const int n : {2, 0}) {
    put(out, static_cast<std::uint8_t>(n), big);
    for (int i = 0; i < n; ++i) put(out, std::int16_t{-7}, big);
  }
  for (const std::vector<int>& face : {std::vector<int>{0, 1, 2, 3}, std::vector<int>{2, 3, 4}}) {
    put(out, std::uint8_t{1}, big);
    put(out, static_cast<std::uint8_t>(face.size()), big);
    for (const int i : face) put(out, i, big);
    put(out, std::uint32_t{1}, big);
    put(out, 1.5f, big);
  }
  return out;
}

const std::string kAscii =
    "ply\r\nformat ascii 1.0\r\nelement vertex 4\nproperty float x\nproperty float y\nproperty "
    "float z\n"
    "property float s\nproperty float t\nelement face 1\nproperty list uchar uint "
    "vertex_index\nend_header\n"
    "0 0 0 0 0\r\n1 0 0 1e0 0\n1 1 +0 1 1\n0 1. 0 0 1\n4 0 1 2 3\n";

PlyMesh read(const std::string& text) {
  static const TemporaryFolder folder;
  return read_ply(folder.write("mesh.ply", text), {});
}

std::string error_of(const std::string& text) {
  try {
    read(text);
  } catch (const SceneError& e) {
    return e.what();
  }
  return "";
}

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), with);
}

TEST(Ply, ReadsAsciiAndFansQuads) {
  const PlyMesh m = read(kAscii);
  ASSERT_EQ(m.positions.size(), 4u);
  EXPECT_EQ(m.positions[2], Vec3(1, 1, 0));
  EXPECT_TRUE(m.normals.empty());
  ASSERT_EQ(m.uvs.size(), 4u);
  EXPECT_EQ(m.uvs[1], Vec2(1, 0));
  ASSERT_EQ(m.triangles.size(), 2u);
  EXPECT_EQ(m.triangles[0], glm::u32vec3(0, 1, 2));
  EXPECT_EQ(m.triangles[1], glm::u32vec3(3, 0, 2)) << "as in pbrt-v3";
  EXPECT_EQ(m.faces[1], 0u);
  EXPECT_EQ(m.polygons, 0u);
}

TEST(Ply, TakesTheFirstOfPbrtsNamesForUvs) {
  const std::string head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string body = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1 2 3 4\n1 0 0 1 2 3 4\n1 1 0 1 2 3 4\n"
                           "0 1 0 1 2 3 4\n0 .5 0 1 2 3 4\n5 0 1 2 3 4\n";
  const auto uv = [&](const char* a, const char* b, const char* c, const char* d) {
    std::string names;
    for (const char* name : {a, b, c, d}) names += std::string("property float ") + name + "\n";
    const PlyMesh m = read(head + names + body);
    EXPECT_EQ(m.triangles.size(), 3u);
    EXPECT_EQ(m.polygons, 1u);
    return m.uvs.empty() ? Vec2(0) : m.uvs[0];
  };
  EXPECT_EQ(uv("u", "v", "s", "t"), Vec2(1, 2));
  EXPECT_EQ(uv("s", "t", "u", "v"), Vec2(3, 4));
  EXPECT_EQ(uv("texture_u", "texture_v", "texture_s", "texture_t"), Vec2(1, 2));
  EXPECT_EQ(uv("s", "v", "texture_s", "texture_t"), Vec2(3, 4)) << "half a pair is none";
}

TEST(Ply, ReadsBothByteOrders) {
  for (const bool big : {false, true}) {
    SCOPED_TRACE(big);
    const PlyMesh m = read(binary_ply(big));
    ASSERT_EQ(m.positions.size(), 5u);
    EXPECT_EQ(m.positions[3], Vec3(3, 1.5f, 2));
    EXPECT_EQ(m.normals[4], Vec3(0, 0, 1));
    EXPECT_EQ(m.uvs[2], Vec2(0.2f, 0.25f));
    ASSERT_EQ(m.triangles.size(), 3u);
    EXPECT_EQ(m.triangles[2], glm::u32vec3(2, 3, 4));
    EXPECT_EQ((std::vector<std::uint32_t>{m.faces.begin(), m.faces.end()}),
              (std::vector<std::uint32_t>{0, 0, 1}));
  }
}

TEST(Ply, NormalsThatAreNoneAreNone) {
  const std::string head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                           "property float nx\nproperty float ny\nproperty float nz\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
  const PlyMesh m = read(head + "0 0 0 -nan NaN(ind) nan\n1 0 0 -1.#IND00 1.#QNAN inf\n1 1 0 0 0 1\n3 0 1 2\n");
  ASSERT_EQ(m.normals.size(), 3u);
  EXPECT_EQ(m.normals[0], Vec3(0));
  EXPECT_EQ(m.normals[1], Vec3(0));
  EXPECT_EQ(m.normals[2], Vec3(0, 0, 1));
  const std::string rest = "\n1 0 0 0 0 1\n1 1 0 0 0 1\n3 0 1 2\n";
  EXPECT_NE(error_of(head + "0 0 0 nanny 0 1" + rest).find("expected a number"), std::string::npos);
  EXPECT_NE(error_of(head + "0 -inf 0 0 0 1" + rest).find("not finite"), std::string::npos);
}

TEST(Ply, SaysWhatIsWrongAndWhere) {
  EXPECT_NE(error_of("plx\n").find("mesh.ply:1:1: error: a PLY file must begin"),
            std::string::npos);
  EXPECT_NE(
      error_of(replaced(kAscii, "float z", "floot z")).find("mesh.ply:6:1: error: unknown type"),
      std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "vertex 4", "vertex 400000000000")).find("too short"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "4 0 1 2 3", "4 0 1 2 4")).find("vertex 4"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "4 0 1 2 3", "4 0 1 -2 3")).find("-2"), std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "4 0 1 2 3", "4 0 1 2")).find("too early"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "4 0 1 2 3", "999999 0 1 2 3")).find("does not fit"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "1 1 +0", "1 x +0"))
                .find("mesh.ply:14:1: error: expected a number"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "1 1 +0", "1 1e99 +0")).find("not finite"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "format ascii", "format utf")).find("format"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "property float x", "property float w")).find("no x, y, z"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "vertex_index", "corners")).find("vertex_indices"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "element face 1\n", "element faces 1\n")).find("no element"),
            std::string::npos);
  EXPECT_NE(error_of(replaced(kAscii, "end_header", "end")).find("unknown line"),
            std::string::npos);
  EXPECT_NE(error_of("").find("does not end"), std::string::npos);
  EXPECT_THROW(read_ply("/nowhere/mesh.ply", {}), SceneError);
}

TEST(Ply, EveryCutFileIsAnError) {
  for (const std::string& whole : {binary_ply(false), binary_ply(true)})
    for (std::size_t n = 0; n < whole.size(); ++n) EXPECT_NE(error_of(whole.substr(0, n)), "") << n;
}

TEST(Ply, SurvivesDamage) {
  std::mt19937 random(7);
  for (int i = 0; i < 1500; ++i) {
    std::string text = i % 3 == 0 ? kAscii : binary_ply(i % 3 == 1);
    for (int j = 0; j < 3; ++j) text[random() % text.size()] = static_cast<char>(random());
    try {
      const PlyMesh m = read(text);
      for (const auto& t : m.triangles) ASSERT_LT(std::max({t.x, t.y, t.z}), m.positions.size());
    } catch (const SceneError&) {
    }
  }
}

TEST(Ply, ReadsEmptyMeshes) {
  const PlyMesh m = read(
      "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float "
      "z\n"
      "element face 0\nproperty list uchar int vertex_indices\nend_header\n");
  EXPECT_TRUE(m.positions.empty());
  EXPECT_TRUE(m.triangles.empty());
}

}  // namespace
}  // namespace cloudrenderer
