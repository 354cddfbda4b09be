#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/animated_transform.h"
#include "base/error.h"
#include "base/id.h"
#include "cloudrenderer/math.h"
#include "shapes/density_brick.h"
#include "shapes/geometry.h"

namespace cloudrenderer {

inline constexpr std::uint32_t kNone = 0xffffffffu;

// A run of triangles of one shape inside a part.
struct MeshChunk {
  std::uint32_t shape = 0;           // global shape id, from the order of the source file (inside a prototype: local)
  std::uint32_t material = kNone;    // index into SceneDescription::materials
  std::uint32_t light = kNone;       // running number of the emissive shape (main scene only), see Manifest
  std::uint32_t alpha_texture = kNone;  // index into SceneDescription::textures: a hit where it is 0 is no hit
  std::uint32_t shadow_alpha_texture = kNone;
  std::uint32_t first_triangle = 0, triangle_count = 0;
  std::uint32_t first_vertex = 0, vertex_count = 0;
  std::uint32_t first_normal = kNone;  // index of the first of vertex_count normals, or none
  std::uint32_t first_uv = kNone;      // likewise
  std::uint32_t first_primitive = 0;   // source triangle number of the first triangle, when they are consecutive ...
  std::uint32_t primitive_ids = kNone; // ... else the index of the first of triangle_count entries of primitive_ids
  std::uint32_t flip = 0;              // reverse_orientation xor swaps_handedness: the geometric normal is flipped
};

struct QuadricRecord {
  Quadric quadric;
  std::uint32_t shape = 0, material = kNone, light = kNone, alpha_texture = kNone;
  std::uint32_t flip = 0;
};

struct InstanceRecord {
  Transform to_world;             // of one that moves: what follows after its movements
  std::uint32_t prototype = 0;    // index of the prototype blob
  std::uint32_t first_shape = 0;  // global shape id of the prototype's local shape 0 in this instance
};

// What many curves have in common, often all hairs of a head.
struct CurveGroup {
  Transform object_to_world;
  std::uint32_t kind = 0;      // CurveKind
  std::uint32_t placed = 0;    // 0: object_to_world is the identity
  std::uint32_t log2_segments = 0;  // at most kCurveSegmentBits: a piece has 2^this segments
  std::uint32_t material = kNone, light = kNone, alpha_texture = kNone, shadow_alpha_texture = kNone;
  std::uint32_t flip = 0;
};

// One cubic piece of a curve; neighbours share points.
struct CurveRecord {
  std::uint32_t group = 0, shape = 0;
  std::uint32_t piece = 0;                 // of the source curve
  std::uint32_t first_point = 0;           // of four
  std::uint32_t first_normal = kNone;      // of two; ribbons only
  std::array<float, 2> width{};
};

// A segment of a curve, which is what rays and the splitter see: record << kCurveSegmentBits | number in the piece.
inline constexpr std::uint32_t kCurveSegmentBits = 3;

struct CurveArrays {
  std::span<const Vec3> points, normals;
  std::span<const CurveRecord> records;
  std::span<const std::uint32_t> segments;
  std::span<const CurveGroup> groups;

  const CurveRecord& record_of(std::uint32_t segment) const { return records[segments[segment] >> kCurveSegmentBits]; }
  const CurveGroup& group_of(std::uint32_t segment) const { return groups[record_of(segment).group]; }
  // Source primitive of a segment: numbered through the whole curve.
  std::uint32_t source_primitive(std::uint32_t segment) const {
    const CurveRecord& r = record_of(segment);
    return (r.piece << groups[r.group].log2_segments) + (segments[segment] & ((1u << kCurveSegmentBits) - 1));
  }
  CurvePiece piece(const CurveRecord& r) const {
    CurvePiece out;
    out.kind = static_cast<CurveKind>(groups[r.group].kind);
    std::copy_n(points.begin() + r.first_point, 4, out.p.begin());
    out.width = r.width;
    if (r.first_normal != kNone) std::copy_n(normals.begin() + r.first_normal, 2, out.n.begin());
    return out;
  }
  // Where the segment begins and ends on its piece.
  std::array<double, 2> range(std::uint32_t segment) const {
    const double count = 1u << group_of(segment).log2_segments;
    const double number = segments[segment] & ((1u << kCurveSegmentBits) - 1);
    return {number / count, (number + 1) / count};
  }
  std::size_t size_bytes() const {
    return points.size_bytes() + normals.size_bytes() + records.size_bytes() + segments.size_bytes() + groups.size_bytes();
  }
};

// The point that a ray along `direction` found on a segment.
SurfacePoint curve_point(const CurveArrays& curves, std::uint32_t segment, const Vec3& direction, float u, float v);
// A movement of an instance. An instance may have several (something moves in an object that moves), one record each:
// it takes prototype to world by to_world * first * second * ...
struct MotionRecord {
  Mat4 start, end;
  float start_time = 0, end_time = 1;
  std::uint32_t instance = 0;
  AnimatedTransform::Interpolates interpolates = AnimatedTransform::Interpolates::forward;

  AnimatedTransform transform() const { return {start, end, {start_time, end_time}, interpolates}; }
};

// The records of one instance, in a list that is in the order of the instances.
std::span<const MotionRecord> motions_of(std::span<const MotionRecord> all, std::uint32_t instance);

// A block of the density grid of a medium.
struct BrickRecord {
  DensityBrick brick;
  std::uint32_t first_sample = 0;  // in Part::densities
  std::uint32_t medium = 0;        // index into SceneDescription::media
  std::uint32_t shape = 0, primitive = 0;  // global id of the grid, number of the brick in it
  std::size_t sample_count() const { return brick.channel_samples() * brick.channels; }
};

// The geometry of one part or one prototype: arrays, nothing built. The spans point into `owner` (a mapped file or a
// block of memory), which the part shares. Triangle indices count from the part's first vertex. positions are
// followed by at least 16 readable bytes (Embree's rule for shared buffers).
struct Part {
  std::span<const Vec3> positions;
  std::span<const Vec3> normals;
  std::span<const Vec2> uvs;
  std::span<const Triangle> triangles;
  std::span<const std::uint32_t> primitive_ids;
  std::span<const MeshChunk> chunks;         // in the order of first_triangle
  std::span<const QuadricRecord> quadrics;
  std::span<const InstanceRecord> instances;
  CurveArrays curves;
  std::span<const MotionRecord> motions;     // of instances that move, in their order
  std::span<const BrickRecord> bricks;
  std::span<const float> densities;
  std::shared_ptr<const void> owner;
  std::uint64_t checksum = 0;  // of the file; 0: made in memory

  // The chunks that blocks of 2^chunk_block triangles begin in, and the last chunk: by guide_chunks(), at most 16 bytes a
  // chunk; empty: not made.
  std::vector<std::uint32_t> chunk_guide;
  unsigned chunk_block = 0;
  void guide_chunks();

  // The chunk that holds a triangle: a binary search, with a guide among those of its block.
  const MeshChunk& chunk_of(std::uint32_t triangle) const {
    std::size_t lo = 0, hi = chunks.size();
    if (!chunk_guide.empty()) {
      const std::size_t block = triangle >> chunk_block;
      lo = chunk_guide[block];
      hi = chunk_guide[block + 1] + 1;
    }
    while (hi - lo > 1) {
      const std::size_t mid = (lo + hi) / 2;
      (chunks[mid].first_triangle <= triangle ? lo : hi) = mid;
    }
    return chunks[lo];
  }
  std::uint32_t source_primitive(const MeshChunk& c, std::uint32_t triangle) const {
    const std::uint32_t i = triangle - c.first_triangle;
    return c.primitive_ids == kNone ? c.first_primitive + i : primitive_ids[c.primitive_ids + i];
  }
};

// Reads a part from the bytes of a part file (see src/parts/README.md), checking every length, index and the checksum.
// `owner` keeps `bytes` alive; bytes.data() is 16-byte aligned.
Result<Part> read_part(std::span<const std::byte> bytes, std::shared_ptr<const void> owner);
// Maps and reads a part file.
Result<Part> read_part_file(const std::string& path);

// What every host knows of a part.
struct PartInfo {
  std::vector<Bounds3> boxes;        // a few tight boxes that together hold the part (top of its BVH); never empty
  std::uint64_t file_bytes = 0;      // of the part file
  std::uint64_t loaded_bytes = 0;    // predicted: vertices, indices and BVH
  std::uint64_t triangles = 0;       // instanced ones not counted
  std::vector<std::uint32_t> prototypes;  // that its instances need
  std::uint32_t features = 0;             // PartFeature bits, of its prototypes too; 0: an older split does not tell
  std::uint64_t checksum = 0;             // of the part file; 0: likewise
};

struct PrototypeInfo {
  std::string name;
  Bounds3 bounds;
  std::uint64_t file_bytes = 0, loaded_bytes = 0, triangles = 0;
  std::uint32_t shapes = 0;
  std::uint64_t checksum = 0;
};

inline constexpr std::size_t kMostSpecularBoxes = 16;

// The whole of a split scene but its geometry.
struct Manifest {
  SceneDescription scene;
  std::vector<PartInfo> parts;            // [0] is the main scene's geometry (may be empty of shapes)
  std::vector<PrototypeInfo> prototypes;
  // AreaLightSource of every emissive shape, by running number (MeshChunk::light, QuadricRecord::light).
  std::vector<AreaLightId> shape_lights;
  std::uint64_t total_triangles = 0;      // distinct ones
  bool moves = false;                     // some instance does: rays have a time
  // Media of the scene that begin and end at surfaces of the main scene only, and that are without material: which parts of
  // a ray are in them is known from these surfaces. Ascending.
  std::vector<std::uint32_t> bounded_media;
  // Around all surfaces that may be specular (scene/material_specular.h), at most kMostSpecularBoxes; the same for every
  // split of the scene. Empty: there are none, or it is not told.
  std::vector<Bounds3> specular_boxes;
  Bounds3 bounds;                         // of the whole scene
  std::uint64_t content_hash = 0;         // of everything above and all part files: names this split
};

// Protobuf bytes of a manifest (schema: src/parts/manifest.proto) and back.
std::string encode(const Manifest& m);
Result<Manifest> decode_manifest(std::span<const std::byte> bytes);

}  // namespace cloudrenderer
