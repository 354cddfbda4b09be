// Shape "bilinearmesh" of pbrt-v4: indices (four a patch), P, N, uv. A patch whose corners make a parallelogram is two
// triangles exactly. Others are cut into triangles with the patch's own normals, as fine as their twist asks for: they
// stream, split and fit in memory like all triangles, which patches with an intersection of their own would not.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "shapes/mesh_builder.h"

namespace cloudrenderer {

namespace {

// How far triangles may be from their patch, in its diagonals.
constexpr float kTolerance = 1.f / 2000;
constexpr float kMostCuts = 32;

// Corners in pbrt's order: (u, v) = (0, 0), (1, 0), (0, 1), (1, 1).
template <class T>
struct Corners {
  std::array<T, 4> c;

  // i nths of the way from a to b. Edges get the same bits from either patch that they belong to, whichever way it runs
  // along them.
  static T between(const T& a, const T& b, std::uint32_t i, std::uint32_t n) {
    if (i == 0 || i == n) return i == 0 ? a : b;
    return (static_cast<float>(n - i) * a + static_cast<float>(i) * b) / static_cast<float>(n);
  }
  T at(std::uint32_t x, std::uint32_t y, std::uint32_t n) const {
    return between(between(c[0], c[1], x, n), between(c[2], c[3], x, n), y, n);
  }
};

// Triangles touch the patch at their corners; in between they are off by at most a quarter of its twist, cut^2 times
// less when cut.
std::uint32_t cuts(const Corners<Vec3>& p, bool maps_bend) {
  const float twist = glm::length(p.c[0] - p.c[1] - p.c[2] + p.c[3]);
  const float size = std::max(glm::length(p.c[3] - p.c[0]), glm::length(p.c[2] - p.c[1]));
  if (!(size > 0.f)) return 1;
  const float n = std::ceil(std::sqrt(0.25f * twist / (kTolerance * size)));
  // Where uvs or normals of the corners are no plane over it, triangles must not be as large as the patch either.
  return static_cast<std::uint32_t>(std::clamp(n, maps_bend ? 4.f : 1.f, kMostCuts));
}

template <class T>
bool bends(const Corners<T>& x) {
  const T twist = x.c[0] - x.c[1] - x.c[2] + x.c[3];
  float largest = 0, size = 0;
  for (int i = 0; i < T::length(); ++i) {
    largest = std::max(largest, std::abs(twist[i]));
    for (const T& c : x.c) size = std::max(size, std::abs(c[i] - x.c[0][i]));
  }
  return largest > 1e-4f * size;
}

}  // namespace

ShapeGeometry make_bilinearmesh(const ShapeDesc& shape, Dialect dialect, Warnings& warnings) {
  const ParamSet& params = shape.params;
  if (!params.has("P")) throw SceneError(shape.location, "a bilinearmesh needs \"P\"");
  const BulkArray<float> numbers = params.reals("P");
  if (numbers.size() % 3)
    throw SceneError(location_of(shape, "P"), fmt::format("{} numbers do not make points", numbers.size()));
  const BulkArray<Vec3> points = regroup<Vec3>(numbers);
  BulkArray<std::int32_t> indices = params.integers("indices");
  if (!params.has("indices")) {
    if (points.size() != 4)
      throw SceneError(shape.location,
                       fmt::format("a bilinearmesh of {} points (not 4) needs \"indices\"", points.size()));
    indices = BulkArray<std::int32_t>(std::vector<std::int32_t>{0, 1, 2, 3});
  }
  if (indices.size() % 4)
    warnings.add(location_of(shape, "indices"),
                 fmt::format("{} indices: the last {} make no patch", indices.size(), indices.size() % 4));
  check_indices({.shape = shape}, indices.view(), points.size());
  const auto corner_values = [&](const char* name, auto values) {
    if (!values.empty() && values.size() != points.size()) {
      warnings.add(location_of(shape, name),
                   fmt::format("{} values of {} for {} points: left out", values.size(), name, points.size()));
      values = {};
    }
    return values;
  };
  const auto normals = corner_values("N", regroup<Vec3>(params.reals("N")));
  const auto uvs = corner_values("uv", regroup<Vec2>(params.reals("uv")));

  // All patches are cut alike, so that neighbours share their vertices.
  std::uint32_t n = 1;
  const auto corners = [&](std::size_t patch, const auto& values, auto& out) {
    for (std::size_t i = 0; i < 4; ++i) out.c[i] = values[static_cast<std::size_t>(indices[4 * patch + i])];
  };
  const std::size_t patches = indices.size() / 4;
  bool flat = true;
  for (std::size_t i = 0; i < patches; ++i) {
    Corners<Vec3> p, normal;
    Corners<Vec2> uv{{Vec2(0, 0), Vec2(1, 0), Vec2(0, 1), Vec2(1, 1)}};
    corners(i, points, p);
    const bool parallelogram = !bends(p);
    if (!uvs.empty()) corners(i, uvs, uv);
    bool maps_bend = !parallelogram || bends(uv);
    if (!normals.empty()) {
      corners(i, normals, normal);
      maps_bend = maps_bend || bends(normal);
    }
    flat = flat && parallelogram;
    n = std::max(n, cuts(p, maps_bend));
  }

  BulkWriter<Vec3> out_positions, out_normals;
  BulkWriter<Vec2> out_uvs;
  BulkWriter<Triangle> out_triangles;
  const std::uint64_t side = n + 1;
  if (patches * side * side >= 0xffffffffu)
    throw SceneError(shape.location, fmt::format("a bilinearmesh of {} patches is too large", patches));
  for (std::size_t i = 0; i < patches; ++i) {
    Corners<Vec3> p, normal;
    Corners<Vec2> uv{{Vec2(0, 0), Vec2(1, 0), Vec2(0, 1), Vec2(1, 1)}};
    corners(i, points, p);
    if (!uvs.empty()) corners(i, uvs, uv);
    if (!normals.empty()) corners(i, normals, normal);
    const auto first = static_cast<std::uint32_t>(i * side * side);
    for (std::uint32_t y = 0; y <= n; ++y)
      for (std::uint32_t x = 0; x <= n; ++x) {
        out_positions.push_back(p.at(x, y, n));
        out_uvs.push_back(uv.at(x, y, n));
        if (!normals.empty()) {
          out_normals.push_back(normal.at(x, y, n));
        } else if (!flat) {
          const Vec3 dpdu = Corners<Vec3>::between(p.c[1] - p.c[0], p.c[3] - p.c[2], y, n);
          const Vec3 dpdv = Corners<Vec3>::between(p.c[2] - p.c[0], p.c[3] - p.c[1], x, n);
          const float longest = std::max(glm::length(dpdu), 1e-30f), other = std::max(glm::length(dpdv), 1e-30f);
          out_normals.push_back(glm::cross(dpdu / longest, dpdv / other));
        }
        if (x == 0 || y == 0) continue;
        const auto d = static_cast<std::uint32_t>(first + y * side + x), c = d - 1;
        const auto b = static_cast<std::uint32_t>(d - side), a = b - 1;
        out_triangles.push_back({a, b, d});
        out_triangles.push_back({a, d, c});
      }
  }
  TriangleMesh mesh{out_positions.finish(), out_normals.finish(), out_uvs.finish(), out_triangles.finish()};
  return finish_mesh(std::move(mesh), {.shape = shape}, dialect, warnings);
}

}  // namespace cloudrenderer
