// Shape "plymesh": filename.
#include "scene/ply.h"
#include "shapes/mesh_builder.h"

namespace cloudrenderer {

ShapeGeometry make_plymesh(const ShapeDesc& shape, Dialect dialect, Warnings& warnings) {
  const std::string path = shape.params.string("filename", "");
  if (path.empty()) throw SceneError(shape.location, "a plymesh needs \"filename\"");
  PlyMesh ply = read_ply(path, location_of(shape, "filename"));
  if (ply.polygons > 0)
    warnings.add(location_of(shape, "filename"), std::to_string(ply.polygons) + " faces have more than four corners, which pbrt leaves out: they are drawn");
  TriangleMesh mesh{std::move(ply.positions), std::move(ply.normals), std::move(ply.uvs),
                    std::move(ply.triangles)};
  if (mesh.triangles.empty())
    warnings.add(location_of(shape, "filename"), "no triangles in " + path);
  return finish_mesh(std::move(mesh), {shape, "filename", "filename", "filename", "filename"},
                     dialect, warnings);
}

}  // namespace cloudrenderer
