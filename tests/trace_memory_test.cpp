// What a part is predicted to take, against what it takes.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "parts/part_builder.h"
#include "trace/resident.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kMiB = 1u << 20;
constexpr std::array<std::size_t, 11> kSizes = {1,    3,    10,    33,    100,   465,
                                                1500, 3800, 20000, 90000, 300000};

struct Mesh {
  std::vector<Vec3> positions;
  std::vector<Triangle> triangles;

  void add_quad(const Vec3& o, const Vec3& a, const Vec3& b) {
    const auto i = static_cast<std::uint32_t>(positions.size());
    positions.insert(positions.end(), {o, o + a, o + a + b, o + b});
    triangles.push_back({i, i + 1, i + 2});
    triangles.push_back({i, i + 2, i + 3});
  }
  void add_triangle(const Vec3& a, const Vec3& b, const Vec3& c) {
    const auto i = static_cast<std::uint32_t>(positions.size());
    positions.insert(positions.end(), {a, b, c});
    triangles.push_back({i, i + 1, i + 2});
  }
};

class Random {
 public:
  explicit Random(std::size_t seed) : engine_(static_cast<std::uint32_t>(seed)) {}
  float unit() { return uniform_(engine_); }
  Vec3 in_cube() { return {unit(), unit(), unit()}; }
  Vec3 vector() { return {normal_(engine_), normal_(engine_), normal_(engine_)}; }

 private:
  std::mt19937 engine_;
  std::uniform_real_distribution<float> uniform_{0.f, 1.f};
  std::normal_distribution<float> normal_;
};

// At least `n` triangles; those above are cut off.
using MakeMesh = std::function<void(std::size_t n, Random& random, Mesh& mesh)>;

void surface(std::size_t n, Random& random, Mesh& mesh) {
  const auto side = static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<double>(n) / 2)));
  for (std::uint32_t y = 0; y <= side; ++y)
    for (std::uint32_t x = 0; x <= side; ++x)
      mesh.positions.emplace_back(static_cast<float>(x), 0.7f * random.unit(),
                                  static_cast<float>(y));
  for (std::uint32_t y = 0; y < side; ++y)
    for (std::uint32_t x = 0; x < side; ++x) {
      const std::uint32_t a = y * (side + 1) + x, b = a + side + 1;
      mesh.triangles.push_back({a, a + 1, b});
      mesh.triangles.push_back({a + 1, b + 1, b});
    }
}

void foliage(std::size_t n, Random& random, Mesh& mesh) {
  while (mesh.triangles.size() < n) {
    const Vec3 tree(100 * random.unit(), 0.f, 100 * random.unit());
    for (int i = 0; i < 3750 && mesh.triangles.size() < n; ++i)
      mesh.add_quad(tree + random.vector(), 0.03f * random.vector(), 0.03f * random.vector());
  }
}

void hair(std::size_t n, Random& random, Mesh& mesh) {
  while (mesh.triangles.size() < n) {
    Vec3 at = random.in_cube(), step = 0.004f * random.vector();
    for (int i = 0; i < 30; ++i, at += step, step += 0.0008f * random.vector())
      mesh.add_quad(at, step, Vec3(1e-4f, 0.f, 0.f));
  }
}

void loose(std::size_t n, Random& random, Mesh& mesh) {
  while (mesh.triangles.size() < n) {
    const Vec3 o = random.in_cube();
    mesh.add_triangle(o, o + 0.01f * random.in_cube(), o + 0.01f * random.in_cube());
  }
}

void all_sizes(std::size_t n, Random& random, Mesh& mesh) {
  while (mesh.triangles.size() < n) {
    const Vec3 o = random.in_cube();
    const float size = std::pow(10.f, -6.f * random.unit());
    mesh.add_triangle(o, o + size * random.in_cube(), o + size * random.in_cube());
  }
}

void slivers(std::size_t n, Random& random, Mesh& mesh) {
  while (mesh.triangles.size() < n) {
    const Vec3 o(random.unit(), 10 * random.unit(), 0.f);
    mesh.add_triangle(o, o + Vec3(100.f, 0.001f, 0.f), o + Vec3(0.f, 0.f, 0.001f));
  }
}

void tangle(std::size_t n, Random& random, Mesh& mesh) {  // a few vertices, joined at random
  for (int i = 0; i < 1000; ++i) mesh.positions.push_back(random.vector());
  const auto any = [&] { return static_cast<std::uint32_t>(999.f * random.unit()); };
  while (mesh.triangles.size() < n) mesh.triangles.push_back({any(), any(), any()});
}

Transform moved(const Vec3& by) {
  return Transform(Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, by.x, by.y, by.z, 1),
                   Mat4(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -by.x, -by.y, -by.z, 1));
}

void add_mesh(const MakeMesh& make, std::size_t n, PartBuilder& to) {
  Mesh mesh;
  Random random(n);
  make(n, random, mesh);
  mesh.triangles.resize(n);
  to.add_chunk({}, {mesh.positions, {}, {}, mesh.triangles, {}});
}

// `tight`: how much more than it takes a part of more than 1 MiB may be predicted to take.
void expect_bound(const std::string& what, PartBuilder& builder, double tight) {
  SCOPED_TRACE(what);
  const std::uint64_t predicted = builder.predicted_bytes();
  const std::uint64_t build = loaded_bytes::build(builder.triangle_count(), predicted);
  Part part = builder.build();
  Resident resident({});
  if (!part.instances.empty()) {
    PartBuilder prototype;
    add_mesh(surface, 2, prototype);
    resident.load_prototype(0, prototype.build());
  }
  const std::uint64_t before = resident.bytes();
  resident.load_part(PartId{1}, std::move(part));
  const std::uint64_t used = resident.bytes() - before;
  EXPECT_LE(used, predicted);
  EXPECT_LE(resident.peak_bytes() - before, predicted + build);
  if (used > kMiB) {
    EXPECT_LE(static_cast<double>(predicted), tight * static_cast<double>(used));
  }
}

// The peak of a part that is loaded for a while.
void expect_page_bound(const std::string& what, PartBuilder& builder) {
  SCOPED_TRACE(what);
  const std::uint64_t predicted = builder.predicted_bytes(), triangles = builder.triangle_count();
  Resident resident({});
  const std::uint64_t before = resident.bytes();
  resident.load_part(PartId{1}, builder.build(), BvhForm::passing);
  EXPECT_LE(resident.peak_bytes() - before,
            loaded_bytes::page(triangles, predicted, loaded_bytes::build(triangles, predicted)));
}

TEST(LoadedBytes, OfTrianglesAreBoundedTightly) {
  const std::vector<std::pair<std::string, MakeMesh>> kinds = {
      {"surface", surface}, {"foliage", foliage}, {"hair", hair},    {"loose", loose},
      {"sizes", all_sizes}, {"slivers", slivers}, {"tangle", tangle}};
  for (const auto& [name, make] : kinds)
    for (const std::size_t n : kSizes) {
      PartBuilder builder;
      add_mesh(make, n, builder);
      expect_bound(name + " " + std::to_string(n), builder, name == "slivers" ? 1.35 : 1.25);
    }
}

TEST(LoadedBytes, OfPassingTrianglesAreBounded) {
  const std::vector<std::pair<std::string, MakeMesh>> kinds = {
      {"surface", surface}, {"foliage", foliage}, {"hair", hair},    {"loose", loose},
      {"sizes", all_sizes}, {"slivers", slivers}, {"tangle", tangle}};
  for (const auto& [name, make] : kinds)
    for (const std::size_t n : {std::size_t{1}, std::size_t{2}, std::size_t{8}, std::size_t{64}, std::size_t{1024},
                                std::size_t{16384}, std::size_t{65536}, std::size_t{90000}, std::size_t{131072}}) {
      PartBuilder builder;
      add_mesh(make, n, builder);
      expect_page_bound(name + " " + std::to_string(n), builder);
    }
}

TEST(LoadedBytes, OfManySmallShapesAreBounded) {
  for (const std::size_t n : kSizes) {
    if (n > 20000) break;
    PartBuilder builder;
    for (std::size_t i = 0; i < n; ++i) add_mesh(surface, 2, builder);
    expect_bound(std::to_string(n), builder, 1.25);
  }
}

TEST(LoadedBytes, OfQuadricsAndInstancesAreBoundedTightly) {
  for (const std::size_t n : kSizes) {
    Random random(n);
    PartBuilder quadrics, instances, both;
    for (std::size_t i = 0; i < n; ++i) {
      QuadricRecord ball;
      ball.quadric.radius = 0.01f;
      ball.quadric.object_to_world = moved(random.in_cube());
      quadrics.add_quadric(ball);
      const InstanceRecord instance{moved(100.f * random.in_cube()), 0, 0};
      instances.add_instance(instance);
      if (i < 10000) both.add_quadric(ball), both.add_instance(instance);
    }
    add_mesh(loose, n, both);
    const std::string count = std::to_string(n);
    expect_bound("quadrics " + count, quadrics, 1.25);
    if (n <= 100000) expect_bound("instances " + count, instances, 1.25);
    expect_bound("mixed " + count, both, 1.25);
  }
}

TEST(LoadedBytes, OfMovingInstancesAreBounded) {
  for (const std::size_t n : {1u, 16u, 1000u, 20000u}) {
    Random random(n);
    PartBuilder instances;
    for (std::size_t i = 0; i < n; ++i) {
      const MotionRecord motion{moved(100.f * random.in_cube()).matrix(), moved(100.f * random.in_cube()).matrix()};
      instances.add_instance({}, std::span(&motion, 1));
    }
    expect_bound("moving instances " + std::to_string(n), instances, 1.5);
  }
}

}  // namespace
}  // namespace cloudrenderer
