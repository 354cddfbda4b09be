#pragma once
// What the builders of meshes share. Arrays go through BulkWriter, so that a big mesh never needs
// memory in proportion to its size; arrays that need no change are shared, not copied.
#include <string_view>
#include <type_traits>

#include "shapes/builders.h"

namespace cloudrenderer {

// The same bytes as values made of several elements, e.g. floats as points; a rest that fills no
// value is left out.
template <class To, class From>
BulkArray<To> regroup(const BulkArray<From>& values) {
  static_assert(std::is_trivially_copyable_v<To> && std::is_trivially_copyable_v<From>);
  static_assert(sizeof(To) % sizeof(From) == 0 && alignof(To) == alignof(From));
  const std::span<const From> v = values.view();
  return {std::make_shared<const BulkArray<From>>(values),
          {reinterpret_cast<const To*>(v.data()), v.size_bytes() / sizeof(To)}};
}

// What a message about a mesh says of where its numbers come from.
struct MeshSource {
  const ShapeDesc& shape;
  std::string_view positions = "P", normals = "N", uvs = "uv", indices = "indices";
};

// Moves positions and normals to world space and checks everything: throws SceneError for a
// position that is not finite or beyond 1e18, and for an index out of range; normals and uvs that
// are not finite become zero, with a warning; normals or uvs of another number than the positions
// are left out, with a warning, as in pbrt.
TriangleMesh finish_mesh(TriangleMesh mesh, const MeshSource& source, Dialect dialect,
                         Warnings& warnings);

// Throws SceneError at the parameter for an index that is negative or not below `vertices`.
void check_indices(const MeshSource& source, std::span<const std::int32_t> indices,
                   std::size_t vertices);

}  // namespace cloudrenderer
