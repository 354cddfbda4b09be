#pragma once
// Loop subdivision on plain arrays (Loop 1987; limit positions and tangents after Hoppe et al.
// 1994, in pbrt's form).
#include <cstdint>
#include <span>
#include <vector>

#include "shapes/geometry.h"

namespace cloudrenderer {

// An oriented mesh in which every vertex has one fan of faces: face f has across its edge k (from
// corner k to corner k + 1) the face across[3 f + k], or kBorder.
struct LoopMesh {
  static constexpr std::uint32_t kBorder = 0xffffffffu;

  std::vector<Vec3> positions;
  std::vector<std::uint32_t> corners;  // three vertices a face
  std::vector<std::uint32_t> across;
  std::vector<std::uint32_t> first_face;  // some face of each vertex
  std::vector<std::uint8_t> on_border;    // of each vertex

  std::size_t faces() const { return corners.size() / 3; }
};

// What had to be done to make the input manifold.
struct LoopRepairs {
  std::size_t degenerate_faces = 0;  // left out: a corner occurs twice
  std::size_t cut_edges =
      0;  // edges of more than two faces, or of two faces that are oriented differently
  std::size_t split_vertices = 0;  // vertices where fans touch only in a point
};

// Indices must be in range. Vertices that no face uses are left out.
LoopMesh make_loop_mesh(std::span<const Vec3> positions, std::span<const std::int32_t> indices,
                        LoopRepairs& repairs);
// One level: four faces for one.
LoopMesh refine(const LoopMesh& mesh);
// Moves the vertices to the limit surface and returns pbrt's normals there: not unit, all scaled by
// the same factor.
std::vector<Vec3> push_to_limit(LoopMesh& mesh);

}  // namespace cloudrenderer
