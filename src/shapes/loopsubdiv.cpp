// Shape "loopsubdiv": indices, P, levels or nlevels (3).
#include <spdlog/fmt/fmt.h>

#include "shapes/loop_refine.h"
#include "shapes/mesh_builder.h"

namespace cloudrenderer {

namespace {

// The whole mesh is in memory while it is subdivided, about 100 bytes a triangle of the last level.
constexpr std::uint64_t kMostTriangles = std::uint64_t{1} << 26;

void report(const LoopRepairs& repairs, const FileLocation& location, Warnings& warnings) {
  if (repairs.degenerate_faces)
    warnings.add(location, fmt::format("{} faces with a vertex twice are left out",
                                       repairs.degenerate_faces));
  if (repairs.cut_edges)
    warnings.add(
        location,
        fmt::format("not manifold: {} edges belong to more than two faces, or to two that are "
                    "oriented differently; the surface is cut there",
                    repairs.cut_edges));
  if (repairs.split_vertices)
    warnings.add(
        location,
        fmt::format("not manifold: the surface touches itself in single points; {} vertices added",
                    repairs.split_vertices));
}

}  // namespace

ShapeGeometry make_loopsubdiv(const ShapeDesc& shape, Dialect dialect, Warnings& warnings) {
  const ParamSet& params = shape.params;
  for (const char* name : {"indices", "P"})
    if (!params.has(name))
      throw SceneError(shape.location, fmt::format("a loopsubdiv needs \"{}\"", name));
  const char* levels_name = dialect == Dialect::v3 && params.has("levels") ? "levels" : "nlevels";
  const int levels = params.integer(levels_name, 3);
  params.string("scheme", "loop");
  const BulkArray<float> positions = params.reals("P");
  const BulkArray<std::int32_t> indices = params.integers("indices");

  const MeshSource source{.shape = shape};
  if (positions.size() % 3)
    throw SceneError(location_of(shape, "P"),
                     fmt::format("{} numbers do not make points", positions.size()));
  if (indices.size() % 3)
    warnings.add(location_of(shape, "indices"),
                 fmt::format("{} indices: the last {} make no triangle", indices.size(),
                             indices.size() % 3));
  check_indices(source, indices.view(), positions.size() / 3);
  if (levels < 0)
    throw SceneError(location_of(shape, levels_name),
                     fmt::format("{} must be >= 0, got {}", levels_name, levels));
  if (levels > 13 || (indices.size() / 3) << (2 * levels) > kMostTriangles)
    throw SceneError(location_of(shape, levels_name),
                     fmt::format("{} levels of {} faces are more than {} triangles", levels,
                                 indices.size() / 3, kMostTriangles));
  const BulkArray<Vec3> points = regroup<Vec3>(positions);
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!is_finite(points[i]))
      throw SceneError(location_of(shape, "P"), fmt::format("vertex {} is not finite", i));

  LoopRepairs repairs;
  LoopMesh mesh = make_loop_mesh(points.view(), indices.view(), repairs);
  report(repairs, location_of(shape, "indices"), warnings);
  if (mesh.faces() == 0) {
    warnings.add(location_of(shape, "indices"), "a loopsubdiv without triangles");
    return TriangleMesh{};
  }
  for (int i = 0; i < levels; ++i) mesh = refine(mesh);

  TriangleMesh out;
  out.normals = BulkArray<Vec3>(push_to_limit(mesh));
  out.positions = BulkArray<Vec3>(std::move(mesh.positions));
  out.triangles = regroup<Triangle>(BulkArray<std::uint32_t>(std::move(mesh.corners)));
  return finish_mesh(std::move(out), source, dialect, warnings);
}

}  // namespace cloudrenderer
