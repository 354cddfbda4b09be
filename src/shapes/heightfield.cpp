// Shape "heightfield": nu x nv heights Pz over the unit square, row v first; two triangles a cell,
// uv = (x, y).
#include <spdlog/fmt/fmt.h>

#include "shapes/mesh_builder.h"

namespace cloudrenderer {

ShapeGeometry make_heightfield(const ShapeDesc& shape, Dialect dialect, Warnings& warnings) {
  const int nu = shape.params.integer("nu", -1), nv = shape.params.integer("nv", -1);
  const BulkArray<float> heights = shape.params.reals("Pz");
  if (nu < 2 || nv < 2)
    throw SceneError(location_of(shape, nu < 2 ? "nu" : "nv"),
                     fmt::format("a heightfield needs nu and nv >= 2, got {} and {}", nu, nv));
  const auto columns = static_cast<std::uint32_t>(nu), rows = static_cast<std::uint32_t>(nv);
  const std::uint64_t count = std::uint64_t{columns} * rows;
  if (heights.size() != count)
    throw SceneError(location_of(shape, "Pz"),
                     fmt::format("a heightfield of {} x {} needs {} heights, got {}", nu, nv, count,
                                 heights.size()));

  BulkWriter<Vec3> positions;
  BulkWriter<Vec2> uvs;
  BulkWriter<Triangle> triangles;
  for (std::uint32_t y = 0, i = 0; y < rows; ++y) {
    for (std::uint32_t x = 0; x < columns; ++x, ++i) {
      const Vec2 uv{static_cast<float>(x) / static_cast<float>(columns - 1),
                    static_cast<float>(y) / static_cast<float>(rows - 1)};
      positions.push_back({uv.x, uv.y, heights[i]});
      uvs.push_back(uv);
      if (x + 1 == columns || y + 1 == rows) continue;
      triangles.push_back({i, i + 1, i + 1 + columns});
      triangles.push_back({i, i + 1 + columns, i + columns});
    }
  }
  TriangleMesh mesh;
  mesh.positions = positions.finish();
  mesh.uvs = uvs.finish();
  mesh.triangles = triangles.finish();
  return finish_mesh(std::move(mesh), {.shape = shape, .positions = "Pz"}, dialect, warnings);
}

}  // namespace cloudrenderer
