// Shape "trianglemesh": indices, P, N, uv or st, discarddegenerateUVs. Tangents (S) are not taken: they are those of the uvs.
#include <spdlog/fmt/fmt.h>

#include "shapes/mesh_builder.h"

namespace cloudrenderer {

namespace {

// pbrt's test: a triangle that is not tiny has two corners with the same uv.
bool has_degenerate_uvs(const TriangleMesh& mesh) {
  for (const Triangle& t : mesh.triangles) {
    const Vec3 &a = mesh.positions[t.x], &b = mesh.positions[t.y], &c = mesh.positions[t.z];
    if (0.5f * glm::length(glm::cross(a - b, c - b)) < 1e-7f) continue;
    const Vec2 &ta = mesh.uvs[t.x], &tb = mesh.uvs[t.y], &tc = mesh.uvs[t.z];
    if (ta == tb || tb == tc || tc == ta) return true;
  }
  return false;
}

}  // namespace

ShapeGeometry make_trianglemesh(const ShapeDesc& shape, Dialect dialect, Warnings& warnings) {
  const ParamSet& params = shape.params;
  const char* uv_name = params.has("uv") || !params.has("st") ? "uv" : "st";
  const MeshSource source{.shape = shape, .uvs = uv_name};
  if (!params.has("P")) throw SceneError(shape.location, "a trianglemesh needs \"P\"");
  const BulkArray<float> positions = params.reals("P"), normals = params.reals("N"),
                         uvs = params.reals(uv_name);
  const bool one_triangle = positions.size() == 9;  // pbrt-v4: needs no indices
  if (!params.has("indices") && !one_triangle)
    throw SceneError(shape.location, "a trianglemesh needs \"indices\"");
  const BulkArray<std::int32_t> indices =
      params.has("indices") ? params.integers("indices") : BulkArray<std::int32_t>({0, 1, 2});
  const bool discard_degenerate_uvs = params.boolean("discarddegenerateUVs", false);
  if (positions.size() % 3)
    throw SceneError(location_of(shape, "P"),
                     fmt::format("{} numbers do not make points", positions.size()));
  if (indices.size() % 3)
    warnings.add(location_of(shape, "indices"),
                 fmt::format("{} indices: the last {} make no triangle", indices.size(),
                             indices.size() % 3));
  check_indices(source, indices.view(), positions.size() / 3);
  if (indices.size() < 3)
    warnings.add(location_of(shape, "indices"), "a trianglemesh without triangles");

  TriangleMesh mesh;
  mesh.positions = regroup<Vec3>(positions);
  mesh.normals = regroup<Vec3>(normals);
  mesh.uvs = regroup<Vec2>(uvs);
  mesh.triangles = regroup<Triangle>(indices);
  if (discard_degenerate_uvs && mesh.uvs.size() == mesh.positions.size() && !mesh.normals.empty() &&
      has_degenerate_uvs(mesh)) {
    warnings.add(location_of(shape, uv_name), "a triangle has degenerate uvs: all are left out");
    mesh.uvs = {};
  }
  return finish_mesh(std::move(mesh), source, dialect, warnings);
}

}  // namespace cloudrenderer
