#include "shapes/mesh_builder.h"

#include <spdlog/fmt/fmt.h>

#include <array>
#include <cmath>

namespace cloudrenderer {

namespace {

constexpr float kLargestCoordinate = 1e18f;  // rays are checked against the same bound

// The values through a function, in blocks.
template <class T, class F>
BulkArray<T> map_values(const BulkArray<T>& values, F function) {
  BulkWriter<T> writer;
  std::array<T, 1024> block;
  const std::span<const T> in = values.view();
  for (std::size_t first = 0; first < in.size(); first += block.size()) {
    const std::size_t count = std::min(block.size(), in.size() - first);
    for (std::size_t i = 0; i < count; ++i) block[i] = function(in[first + i], first + i);
    writer.append({block.data(), count});
  }
  return writer.finish();
}

bool usable(const Vec3& p) {
  // Written so that NaN fails.
  return std::abs(p.x) < kLargestCoordinate && std::abs(p.y) < kLargestCoordinate &&
         std::abs(p.z) < kLargestCoordinate;
}

BulkArray<Vec3> world_positions(const BulkArray<Vec3>& positions, const MeshSource& source) {
  const Transform& to_world = source.shape.object_to_world;
  const auto fail = [&](const Vec3& p, std::size_t i) {
    throw SceneError(
        location_of(source.shape, source.positions),
        fmt::format("vertex {} at ({} {} {}) is not a finite point below 1e18", i, p.x, p.y, p.z));
  };
  if (to_world.is_identity()) {
    for (std::size_t i = 0; i < positions.size(); ++i)
      if (!usable(positions[i])) fail(positions[i], i);
    return positions;
  }
  return map_values(positions, [&](const Vec3& p, std::size_t i) {
    const Vec3 q = to_world.point(p);
    if (!usable(p)) fail(p, i);
    if (!usable(q)) fail(q, i);
    return q;
  });
}

BulkArray<Vec3> world_normals(const BulkArray<Vec3>& normals, const MeshSource& source,
                              Dialect dialect, Warnings& warnings) {
  const ShapeDesc& shape = source.shape;
  const bool mirrored = dialect == Dialect::v2 && shape.object_to_world.swaps_handedness();
  const float sign = shape.reverse_orientation != mirrored ? -1.f : 1.f;
  std::size_t bad = 0;
  BulkArray<Vec3> out = map_values(normals, [&](const Vec3& n, std::size_t) {
    const Vec3 m = sign * shape.object_to_world.normal(n);
    if (is_finite(m)) return m;
    ++bad;
    return Vec3(0.f);
  });
  if (bad)
    warnings.add(location_of(shape, source.normals),
                 fmt::format("{} normals are not finite; the triangle's own is used there", bad));
  return out;
}

BulkArray<Vec2> checked_uvs(const BulkArray<Vec2>& uvs, const MeshSource& source,
                            Warnings& warnings) {
  const auto finite = [](const Vec2& uv) { return std::isfinite(uv.x) && std::isfinite(uv.y); };
  std::size_t bad = 0;
  for (const Vec2& uv : uvs) bad += !finite(uv);
  if (!bad) return uvs;
  warnings.add(location_of(source.shape, source.uvs),
               fmt::format("{} uvs are not finite; (0 0) is used there", bad));
  return map_values(uvs, [&](const Vec2& uv, std::size_t) { return finite(uv) ? uv : Vec2(0.f); });
}

}  // namespace

void check_indices(const MeshSource& source, std::span<const std::int32_t> indices,
                   std::size_t vertices) {
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (indices[i] < 0 || static_cast<std::size_t>(indices[i]) >= vertices)
      throw SceneError(
          location_of(source.shape, source.indices),
          fmt::format("vertex index {} (number {} of the list) is not one of the {} vertices",
                      indices[i], i, vertices));
  }
}

TriangleMesh finish_mesh(TriangleMesh mesh, const MeshSource& source, Dialect dialect,
                         Warnings& warnings) {
  const std::size_t vertices = mesh.positions.size();
  const std::span<const Triangle> triangles = mesh.triangles.view();
  check_indices(source,
                {reinterpret_cast<const std::int32_t*>(triangles.data()), 3 * triangles.size()},
                vertices);
  if (!mesh.normals.empty() && mesh.normals.size() != vertices) {
    warnings.add(
        location_of(source.shape, source.normals),
        fmt::format("{} normals for {} vertices: left out", mesh.normals.size(), vertices));
    mesh.normals = {};
  }
  if (mesh.uvs.size() > vertices) {
    warnings.add(
        location_of(source.shape, source.uvs),
        fmt::format("{} uvs for {} vertices: the rest is not used", mesh.uvs.size(), vertices));
    const BulkArray<Vec2> all = mesh.uvs;
    mesh.uvs = {std::make_shared<const BulkArray<Vec2>>(all), all.view().first(vertices)};
  } else if (!mesh.uvs.empty() && mesh.uvs.size() < vertices) {
    warnings.add(location_of(source.shape, source.uvs),
                 fmt::format("{} uvs for {} vertices: left out", mesh.uvs.size(), vertices));
    mesh.uvs = {};
  }
  mesh.positions = world_positions(mesh.positions, source);
  if (!mesh.normals.empty()) mesh.normals = world_normals(mesh.normals, source, dialect, warnings);
  if (!mesh.uvs.empty()) mesh.uvs = checked_uvs(mesh.uvs, source, warnings);
  return mesh;
}

}  // namespace cloudrenderer
