#pragma once
// Meshes whose every ray has a known answer.
#include <spdlog/fmt/fmt.h>

#include <map>
#include <vector>

#include "shapes/geometry.h"

namespace cloudrenderer::stability {

struct TestMesh {
  std::vector<Vec3> points;
  std::vector<Triangle> triangles;

  std::string text() const {
    std::string p, i;
    for (const Vec3& v : points) p += fmt::format("{:.9g} {:.9g} {:.9g}\n", v.x, v.y, v.z);
    for (const Triangle& t : triangles) i += fmt::format("{} {} {}\n", t.x, t.y, t.z);
    return "Shape \"trianglemesh\" \"point P\" [" + p + "] \"integer indices\" [" + i + "]\n";
  }
};

// A closed convex mesh: 20 4^levels triangles on a sphere.
inline TestMesh icosphere(int levels, float radius, const Vec3& center) {
  const double g = (1 + std::sqrt(5.0)) / 2;
  std::vector<glm::dvec3> p = {{-1, g, 0}, {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                               {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  std::vector<Triangle> t = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11}, {1, 5, 9},  {5, 11, 4},
                             {11, 10, 2}, {10, 7, 6}, {7, 1, 8},   {3, 9, 4},  {3, 4, 2},   {3, 2, 6},  {3, 6, 8},
                             {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (glm::dvec3& v : p) v = glm::normalize(v);
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [found, is_new] = middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(p.size()));
      if (is_new) p.push_back(glm::normalize(p[a] + p[b]));
      return found->second;
    };
    std::vector<Triangle> next;
    for (const Triangle& f : t) {
      const std::uint32_t a = middle(f.x, f.y), b = middle(f.y, f.z), c = middle(f.z, f.x);
      for (const Triangle& n : {Triangle{f.x, a, c}, Triangle{f.y, b, a}, Triangle{f.z, c, b}, Triangle{a, b, c}}) next.push_back(n);
    }
    t = std::move(next);
  }
  TestMesh mesh;
  for (const glm::dvec3& v : p) mesh.points.push_back(center + Vec3(static_cast<double>(radius) * v));
  mesh.triangles = std::move(t);
  return mesh;
}

}  // namespace cloudrenderer::stability
