#pragma once
#include <cstdint>
#include <span>
#include <string>

#include "base/bulk_array.h"
#include "parts/part.h"

namespace cloudrenderer {

// Predicted bytes of a loaded part (Embree 3.13, medium quality, measured). All predictions come
// from here.
namespace loaded_bytes {
inline constexpr std::uint64_t kBvhTriangle = 67;
inline constexpr std::uint64_t kBvhUser = 72;  // BVH of one user geometry primitive: a quadric
inline constexpr std::uint64_t kInstance =
    200;  // Embree's instance object and its share of the BVH
}  // namespace loaded_bytes

// Triangles of one shape, with indices from 0 into the vertices given here.
struct ChunkData {
  std::span<const Vec3> positions;  // finite, at most 1e18
  std::span<const Vec3> normals;    // empty or one a position
  std::span<const Vec2> uvs;        // likewise
  std::span<const Triangle> triangles;
  std::span<const std::uint32_t>
      primitives;  // source number of every triangle; empty: 0, 1, 2, ...
};

// Collects the arrays of one part and writes them as a part file. Arrays spill to disk when large,
// so memory is bounded.
class PartBuilder {
 public:
  // Takes shape, material, light, textures and flip from `attributes`; the rest is filled in.
  // Normals and uvs that are not finite become 0. Throws std::invalid_argument for a position that
  // is not finite or a wrong index.
  void add_chunk(const MeshChunk& attributes, const ChunkData& data);
  void add_quadric(const QuadricRecord& quadric);
  void add_instance(const InstanceRecord& instance);

  std::uint64_t triangle_count() const { return triangles_.size(); }
  bool empty() const { return triangles_.size() + quadrics_.size() + instances_.size() == 0; }
  std::uint64_t predicted_bytes() const;

  struct File {
    std::uint64_t bytes = 0, checksum = 0;
  };
  // Either ends the builder: it is empty afterwards.
  File write(const std::string& path);  // throws std::system_error
  Part build();                         // the same in memory

 private:
  struct Layout;
  Layout finish();

  BulkWriter<Vec3> positions_, normals_;
  BulkWriter<Vec2> uvs_;
  BulkWriter<Triangle> triangles_;
  BulkWriter<std::uint32_t> primitive_ids_;
  BulkWriter<MeshChunk> chunks_;
  BulkWriter<QuadricRecord> quadrics_;
  BulkWriter<InstanceRecord> instances_;
};

}  // namespace cloudrenderer
