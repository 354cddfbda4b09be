#pragma once
#include <algorithm>
#include <bit>
#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "base/bulk_array.h"
#include "parts/part.h"

namespace cloudrenderer {

// Predicted bytes of a loaded part: an upper bound, because hosts are filled up to their budget by
// it. Measured with Embree 3.13 at medium quality over surfaces, foliage, hair, random triangles of
// one and of all sizes; tests/trace_memory_test.cpp holds it to that. All predictions come from
// here.
namespace loaded_bytes {
inline constexpr std::uint64_t kBvhTriangle = 72;
// Leaves of a connected surface are fuller than those of loose triangles: 4.5 bytes for each vertex
// that a triangle has for itself.
inline constexpr std::uint64_t kBvhTwoVertices = 9;
inline constexpr std::uint64_t kBvhOther = 106;      // of one quadric or instance
inline constexpr std::uint64_t kQuadricSphere = 28;  // what the tracer keeps beside the quadric
inline constexpr std::uint64_t kInstanceObject = 88;    // what it keeps beside an instance's record
inline constexpr std::uint64_t kChunk = sizeof(MeshChunk) + 16;  // with its share of the guide to chunks
// Embree's objects, which its memory monitor does not count.
inline constexpr std::uint64_t kSceneObject = 4 << 10;  // of a part or prototype

inline constexpr std::uint64_t kQuadric = kBvhOther + kQuadricSphere + sizeof(QuadricRecord);
inline constexpr std::uint64_t kInstance = kBvhOther + kInstanceObject + sizeof(InstanceRecord);
// Of one segment with its share of a piece that it has for itself (three points, the fourth is its neighbour's).
inline constexpr std::uint64_t kCurveSegment = kBvhOther + sizeof(std::uint32_t);
inline constexpr std::uint64_t kCurvePiece = sizeof(CurveRecord) + 3 * sizeof(Vec3);
inline constexpr std::uint64_t kCurveGroup = sizeof(CurveGroup) + 2 * 9 * sizeof(double);  // and the tracer's inverse
// What a movement takes beside its instance: the record, and what the tracer makes of it.
inline constexpr std::uint64_t kMotion = sizeof(MotionRecord) + sizeof(AnimatedTransform) + 320;
inline constexpr std::uint64_t kBrick = kBvhOther + sizeof(BrickRecord);  // without its densities

// What a BVH takes beside its share a primitive: nodes that are not full, blocks of the allocator.
constexpr std::uint64_t bvh_base(std::uint64_t primitives) {
  return primitives == 0 ? 0 : std::min<std::uint64_t>(24 << 10, (3 << 10) + 16 * primitives);
}
// Beside `loaded` bytes, while the BVH is built: 32 bytes a primitive in an array that grows by
// doubling. A quarter of `loaded` is more than that for quadrics and instances.
constexpr std::uint64_t build(std::uint64_t triangles, std::uint64_t loaded) {
  return std::max(triangles == 0 ? 0 : 32 * std::bit_ceil(triangles), loaded / 4);
}
// At most, while and after a BVH of the passing form (trace/bvh_form.h) is built: it is larger than `loaded`, its build
// takes less than `build`.
constexpr std::uint64_t page(std::uint64_t triangles, std::uint64_t loaded, std::uint64_t build) {
  return loaded + build + 4 * triangles;
}
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
  // `motions`: how it moves, if it does; of these, `instance` is filled in.
  void add_instance(const InstanceRecord& instance, std::span<const MotionRecord> motions = {});
  // Segments of one curve: `group` is what its pieces share; of each record shape, piece and width count. `points` are
  // four a record, `normals` two for ribbons; `segments` the numbers within the piece, in order.
  void add_curve_piece(const CurveGroup& group, const CurveRecord& record, const CurvePiece& piece,
                       std::span<const std::uint32_t> segments);
  void add_brick(const BrickRecord& brick, std::span<const float> samples);

  std::uint64_t triangle_count() const { return triangles_.size(); }
  bool empty() const {
    return triangles_.size() + quadrics_.size() + instances_.size() + curve_segments_.size() + bricks_.size() == 0;
  }
  std::uint64_t predicted_bytes() const;
  std::uint32_t features() const;  // PartFeature bits

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
  BulkWriter<Vec3> curve_points_, curve_normals_;
  BulkWriter<CurveRecord> curves_;
  BulkWriter<std::uint32_t> curve_segments_;
  BulkWriter<CurveGroup> curve_groups_;
  std::map<std::string, std::uint32_t> group_of_;  // by the group's bytes
  Vec3 last_point_{}, last_normal_{};               // of the curve piece before
  BulkWriter<MotionRecord> motions_;
  BulkWriter<BrickRecord> bricks_;
  BulkWriter<float> densities_;
  bool alpha_ = false;
};

}  // namespace cloudrenderer
