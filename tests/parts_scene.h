#pragma once
// Scenes made by calls of the sink, and the triangles of a split scene for comparison.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "parts/check.h"
#include "parts/part_builder.h"
#include "parts/split.h"
#include "parts/splitter.h"
#include "parts_support.h"

namespace cloudrenderer::parts_test {

inline Param reals(const char* name, ParamType type, std::vector<float> values) {
  Param p;
  p.type = type;
  p.name = name;
  p.reals = BulkArray<float>(std::move(values));
  return p;
}

inline Param integers(const char* name, std::vector<std::int32_t> values) {
  Param p;
  p.type = ParamType::integer;
  p.name = name;
  p.integers = BulkArray<std::int32_t>(std::move(values));
  return p;
}

inline ShapeDesc mesh(const std::vector<Vec3>& positions, const std::vector<Triangle>& triangles) {
  std::vector<float> flat;
  for (const Vec3& p : positions) flat.insert(flat.end(), {p.x, p.y, p.z});
  std::vector<std::int32_t> indices;
  for (const Triangle& t : triangles)
    for (int i = 0; i < 3; ++i) indices.push_back(static_cast<std::int32_t>(t[i]));
  ShapeDesc d;
  d.type = "trianglemesh";
  d.material = MaterialId(0);
  d.params.add(reals("P", ParamType::point3, std::move(flat)));
  d.params.add(integers("indices", std::move(indices)));
  return d;
}

// A wavy square of 2 n^2 triangles with its corner at `corner`.
inline ShapeDesc hills(int n, const Vec3& corner, float size) {
  std::vector<Vec3> p;
  std::vector<Triangle> t;
  for (int y = 0; y <= n; ++y)
    for (int x = 0; x <= n; ++x) {
      const Vec2 at = Vec2(x, y) * (size / static_cast<float>(n));
      p.push_back(
          corner +
          Vec3(at.x, at.y, 0.1f * size * std::sin(7 * at.x / size) * std::cos(9 * at.y / size)));
    }
  const auto w = static_cast<std::uint32_t>(n + 1);
  for (std::uint32_t y = 0; y + 1 < w; ++y)
    for (std::uint32_t x = 0; x + 1 < w; ++x) {
      const std::uint32_t i = y * w + x;
      t.push_back({i, i + 1, i + w});
      t.push_back({i + w, i + 1, i + w + 1});
    }
  return mesh(p, t);
}

inline ShapeDesc sphere(const Vec3& center, float radius) {
  ShapeDesc d;
  d.type = "sphere";
  d.material = MaterialId(0);
  d.params.add(reals("radius", ParamType::real, {radius}));
  d.object_to_world = Transform(glm::translate(Mat4(1.f), center));
  return d;
}

inline SceneDescription description() {
  SceneDescription scene;
  scene.materials.resize(1);
  scene.area_lights.resize(1);
  return scene;
}

// Feeds a scene and finishes it.
class Feeder {
 public:
  Feeder(const std::string& folder, std::uint64_t part_size, std::uint64_t large_object = 0)
      : splitter_(folder, options(part_size, large_object), warnings) {}
  void add(ShapeDesc d, ObjectId object = {}) {
    d.object = object;
    splitter_.sink().shape(std::move(d), scene);
  }
  void begin(ObjectId id) {
    splitter_.sink().begin_object(id, "object" + std::to_string(id.value));
  }
  void end(ObjectId id) { splitter_.sink().end_object(id); }
  void instance(ObjectId id, const Mat4& to_world) {
    splitter_.sink().instance({id, Transform(to_world), {}}, scene);
  }
  Manifest finish() { return splitter_.finish(scene); }

  Warnings warnings;
  SceneDescription scene = description();

 private:
  static SplitOptions options(std::uint64_t part_size, std::uint64_t large_object) {
    SplitOptions o;
    o.part_size = part_size;
    o.large_object = large_object ? large_object : 4 * part_size;
    return o;
  }
  SceneSplitter splitter_;
};

using TriangleKey = std::pair<std::uint32_t, std::uint32_t>;  // shape, primitive
using Corners = std::array<Vec3, 3>;

struct Collected {
  std::map<TriangleKey, Corners> triangles;  // instances moved into the world
  std::map<std::uint32_t, std::size_t> quadrics;
  std::size_t instances = 0, duplicates = 0;
};

inline bool holds(const Bounds3& b, const Vec3& p, float slack) {
  return glm::all(glm::lessThanEqual(b.min - slack, p)) &&
         glm::all(glm::lessThanEqual(p, b.max + slack));
}

// Reads all parts back and checks what must hold for each: it belongs to the manifest and lies in
// its boxes.
inline Collected collect(const std::string& folder, const Manifest& m,
                         bool expand_instances = true) {
  Collected all;
  std::vector<Part> prototypes;
  for (std::uint32_t p = 0; p < m.prototypes.size(); ++p) {
    Result<Part> part = read_part_file(prototype_path(folder, p));
    EXPECT_TRUE(part) << part.error();
    EXPECT_EQ(m.prototypes[p].triangles, part->triangles.size());
    EXPECT_FALSE(find_bad_reference(*part, m));
    prototypes.push_back(std::move(*part));
  }
  const auto add = [&](const Part& part, std::uint32_t first_shape, const Transform& to_world,
                       const std::vector<Bounds3>& boxes, float slack) {
    for (const MeshChunk& c : part.chunks)
      for (std::uint32_t i = c.first_triangle; i < c.first_triangle + c.triangle_count; ++i) {
        Corners corners;
        for (int k = 0; k < 3; ++k)
          corners[static_cast<std::size_t>(k)] =
              to_world.point(part.positions[part.triangles[i][k]]);
        bool inside = false;
        for (const Bounds3& b : boxes)
          inside |= holds(b, corners[0], slack) && holds(b, corners[1], slack) &&
                    holds(b, corners[2], slack);
        EXPECT_TRUE(inside);
        all.duplicates +=
            !all.triangles
                 .try_emplace({first_shape + c.shape, part.source_primitive(c, i)}, corners)
                 .second;
      }
  };
  for (std::uint32_t p = 0; p < m.parts.size(); ++p) {
    const Result<Part> part = read_part_file(part_path(folder, p));
    EXPECT_TRUE(part) << part.error();
    EXPECT_EQ(m.parts[p].triangles, part->triangles.size());
    const auto bad = find_bad_reference(*part, m);
    EXPECT_FALSE(bad) << *bad;
    EXPECT_EQ(m.parts[p].boxes.empty(), p == 0 && part->chunks.empty() && part->quadrics.empty());
    EXPECT_LE(m.parts[p].boxes.size(), 8u);
    add(*part, 0, Transform(), m.parts[p].boxes, 0.f);
    for (const QuadricRecord& q : part->quadrics) ++all.quadrics[q.shape];
    all.instances += part->instances.size();
    if (!expand_instances) continue;
    for (const InstanceRecord& i : part->instances) {
      const auto& needed = m.parts[p].prototypes;
      EXPECT_NE(std::find(needed.begin(), needed.end(), i.prototype), needed.end());
      add(prototypes[i.prototype], i.first_shape, i.to_world, m.parts[p].boxes, 1e-5f);
    }
  }
  return all;
}

}  // namespace cloudrenderer::parts_test
