#pragma once
#include "parts/part.h"
#include "shapes/triangle.h"

namespace cloudrenderer {

// The vertices of a triangle of a part, in the part's space. `chunk` is the one that holds it; normals and uvs are 0 where
// it has none, or is asked for no uvs.
inline TriangleVertices vertices_of(const Part& part, const MeshChunk& chunk, std::uint32_t triangle, bool uvs = true) {
  TriangleVertices out{};
  out.has_normals = chunk.first_normal != kNone;
  out.has_uvs = uvs && chunk.first_uv != kNone;
  const Triangle index = part.triangles[triangle];
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const std::uint32_t own = index[i] - chunk.first_vertex;
    out.p[k] = part.positions[index[i]];
    if (out.has_normals) out.n[k] = part.normals[chunk.first_normal + own];
    if (out.has_uvs) out.uv[k] = part.uvs[chunk.first_uv + own];
  }
  return out;
}

}  // namespace cloudrenderer
