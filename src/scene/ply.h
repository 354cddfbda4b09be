#pragma once
#include <cstdint>
#include <string>

#include "base/bulk_array.h"
#include "base/error.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// The triangles of a PLY file; polygons have become fans.
struct PlyMesh {
  BulkArray<Vec3> positions;
  BulkArray<Vec3> normals;            // one a vertex, or empty
  BulkArray<Vec2> uvs;                // one a vertex, or empty
  BulkArray<glm::u32vec3> triangles;  // every index < positions.size()
  BulkArray<std::uint32_t> faces;     // the face of the file that each triangle is of
  std::uint64_t polygons = 0;         // faces of more than four corners
};

// Reads an ASCII or binary PLY file of either byte order, gzipped or not. Throws SceneError: at
// `location` when the file cannot be opened, else with the place in the file.
PlyMesh read_ply(const std::string& path, const FileLocation& location);

}  // namespace cloudrenderer
