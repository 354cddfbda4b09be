#include "parts/features.h"
#include "parts/part_builder.h"

#include <xxhash.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <new>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "parts/part_format.h"

namespace cloudrenderer {
namespace {

using namespace part_format;

constexpr std::array<std::byte, kAlignment> kZeros{};

std::uint32_t checked_u32(std::size_t n) {
  if (n >= kNone) throw std::length_error("a part holds at most 2^32 - 2 elements of a kind");
  return static_cast<std::uint32_t>(n);
}

template <class T>
T finite_or_zero(T v) {
  for (int i = 0; i < T::length(); ++i)
    if (!(std::fabs(v[i]) <= kLargest)) v[i] = 0.f;
  return v;
}

template <class T>
std::span<const std::byte> raw(const BulkArray<T>& a) {
  return std::as_bytes(a.view());
}

}  // namespace

// The finished arrays and where they go in the file.
struct PartBuilder::Layout {
  BulkArray<Vec3> positions, normals;
  BulkArray<Vec2> uvs;
  BulkArray<Triangle> triangles;
  BulkArray<std::uint32_t> primitive_ids;
  BulkArray<MeshChunk> chunks;
  BulkArray<QuadricRecord> quadrics;
  BulkArray<InstanceRecord> instances;
  BulkArray<Vec3> curve_points, curve_normals;
  BulkArray<CurveRecord> curves;
  BulkArray<std::uint32_t> curve_segments;
  BulkArray<CurveGroup> curve_groups;
  BulkArray<MotionRecord> motions;
  BulkArray<BrickRecord> bricks;
  BulkArray<float> densities;
  std::array<std::span<const std::byte>, kSectionCount> data;
  std::array<SectionEntry, kSectionCount> table;
  Header header;

  std::span<const SectionEntry> entries() const { return std::span(table).first(header.section_count); }
  // Calls sink(bytes) with everything behind the header, in file order.
  template <class Sink>
  void content(const Sink& sink) const {
    const auto used = std::as_bytes(std::span(table).first(header.section_count));
    sink(used);
    std::uint64_t at = sizeof header + used.size();
    for (std::uint32_t s = 0; s < header.section_count; ++s) {
      sink(std::span(kZeros).first(static_cast<std::size_t>(table[s].offset - at)));
      if (!data[s].empty()) sink(data[s]);
      at = table[s].offset + data[s].size();
      if (s == kPositions) {
        sink(std::span(kZeros).first(kPadding));
        at += kPadding;
      }
    }
    sink(std::span(kZeros).first(static_cast<std::size_t>(header.file_bytes - at)));
  }
};

void PartBuilder::add_chunk(const MeshChunk& attributes, const ChunkData& data) {
  if (data.triangles.empty()) return;
  const std::size_t vertices = data.positions.size();
  if ((!data.normals.empty() && data.normals.size() != vertices) ||
      (!data.uvs.empty() && data.uvs.size() != vertices) ||
      (!data.primitives.empty() && data.primitives.size() != data.triangles.size()))
    throw std::invalid_argument("chunk arrays differ in length");
  MeshChunk c = attributes;
  c.first_triangle = checked_u32(triangles_.size());
  c.triangle_count = checked_u32(data.triangles.size());
  c.first_vertex = checked_u32(positions_.size());
  c.vertex_count = checked_u32(vertices);
  checked_u32(triangles_.size() + data.triangles.size());
  checked_u32(positions_.size() + vertices);
  c.flip = attributes.flip ? 1 : 0;

  for (const Vec3& p : data.positions)
    if (finite_or_zero(p) != p) throw std::invalid_argument("a position is not finite");
  positions_.append(data.positions);
  c.first_normal = data.normals.empty() ? kNone : checked_u32(normals_.size());
  for (const Vec3& n : data.normals) normals_.push_back(finite_or_zero(n));
  c.first_uv = data.uvs.empty() ? kNone : checked_u32(uvs_.size());
  for (const Vec2& uv : data.uvs) uvs_.push_back(finite_or_zero(uv));
  for (const Triangle& t : data.triangles) {
    if (t.x >= vertices || t.y >= vertices || t.z >= vertices)
      throw std::invalid_argument("a vertex index is out of range");
    triangles_.push_back(t + c.first_vertex);
  }

  c.first_primitive = data.primitives.empty() ? 0 : data.primitives[0];
  c.primitive_ids = kNone;
  for (std::size_t i = 0; i < data.primitives.size(); ++i)
    if (data.primitives[i] != std::uint64_t{c.first_primitive} + i) {
      c.primitive_ids = checked_u32(primitive_ids_.size());
      primitive_ids_.append(data.primitives);
      break;
    }
  chunks_.push_back(c);
  alpha_ = alpha_ || c.alpha_texture != kNone || c.shadow_alpha_texture != kNone;
}

void PartBuilder::add_quadric(const QuadricRecord& quadric) {
  quadrics_.push_back(quadric);
  alpha_ = alpha_ || quadric.alpha_texture != kNone;
}
void PartBuilder::add_instance(const InstanceRecord& instance, std::span<const MotionRecord> motions) {
  for (MotionRecord m : motions) {
    m.instance = checked_u32(instances_.size());
    motions_.push_back(m);
  }
  instances_.push_back(instance);
}

void PartBuilder::add_curve_piece(const CurveGroup& group, const CurveRecord& record, const CurvePiece& piece,
                                  std::span<const std::uint32_t> segments) {
  alpha_ = alpha_ || group.alpha_texture != kNone || group.shadow_alpha_texture != kNone;
  if (segments.empty()) return;
  CurveRecord r = record;
  const std::string key(reinterpret_cast<const char*>(&group), sizeof group);
  const auto [found, added] = group_of_.try_emplace(key, static_cast<std::uint32_t>(curve_groups_.size()));
  if (added) curve_groups_.push_back(group);
  r.group = found->second;
  for (const Vec3& p : piece.p)
    if (finite_or_zero(p) != p) throw std::invalid_argument("a curve is not finite");
  // A piece that goes on where the one before ended shares that point.
  const bool follows = curve_points_.size() > 0 && last_point_ == piece.p[0];
  if (!follows) curve_points_.push_back(piece.p[0]);
  r.first_point = checked_u32(curve_points_.size() - 1);
  for (std::size_t i = 1; i < 4; ++i) curve_points_.push_back(piece.p[i]);
  last_point_ = piece.p[3];
  r.first_normal = kNone;
  if (piece.kind == CurveKind::ribbon) {
    if (curve_normals_.size() == 0 || last_normal_ != piece.n[0]) curve_normals_.push_back(finite_or_zero(piece.n[0]));
    r.first_normal = checked_u32(curve_normals_.size() - 1);
    curve_normals_.push_back(finite_or_zero(piece.n[1]));
    last_normal_ = piece.n[1];
  }
  const std::uint32_t number = checked_u32(curves_.size());
  if (number >> (32 - kCurveSegmentBits)) throw std::length_error("a part holds at most 2^29 curve pieces");
  curves_.push_back(r);
  for (const std::uint32_t s : segments) curve_segments_.push_back(number << kCurveSegmentBits | s);
}

void PartBuilder::add_brick(const BrickRecord& brick, std::span<const float> samples) {
  BrickRecord b = brick;
  b.first_sample = checked_u32(densities_.size());
  checked_u32(densities_.size() + samples.size());
  bricks_.push_back(b);
  densities_.append(samples);
}

std::uint32_t PartBuilder::features() const {
  return (triangles_.size() ? kHasTriangles : 0u) | (quadrics_.size() ? kHasQuadrics : 0u) |
         (curve_segments_.size() ? kHasCurves : 0u) | (bricks_.size() ? kHasBricks : 0u) |
         (instances_.size() ? kHasInstances : 0u) | (alpha_ ? kHasAlpha : 0u) | (motions_.size() ? kHasMotion : 0u);
}

std::uint64_t PartBuilder::predicted_bytes() const {
  using namespace loaded_bytes;
  const std::uint64_t vertices = std::min<std::uint64_t>(positions_.size(), 3 * triangles_.size());
  return kSceneObject + bvh_base(triangles_.size()) + bvh_base(quadrics_.size()) +
         bvh_base(instances_.size()) + triangles_.size() * (kBvhTriangle + sizeof(Triangle)) +
         vertices * kBvhTwoVertices / 2 + (positions_.size() + normals_.size()) * sizeof(Vec3) +
         uvs_.size() * sizeof(Vec2) + primitive_ids_.size() * sizeof(std::uint32_t) +
         chunks_.size() * kChunk + quadrics_.size() * kQuadric +
         instances_.size() * kInstance + bvh_base(curve_segments_.size()) + curve_segments_.size() * kCurveSegment +
         curves_.size() * sizeof(CurveRecord) + (curve_points_.size() + curve_normals_.size()) * sizeof(Vec3) +
         curve_groups_.size() * kCurveGroup + motions_.size() * kMotion + bvh_base(bricks_.size()) +
         bricks_.size() * kBrick + densities_.size() * sizeof(float);
}

PartBuilder::Layout PartBuilder::finish() {
  Layout l{positions_.finish(),
           normals_.finish(),
           uvs_.finish(),
           triangles_.finish(),
           primitive_ids_.finish(),
           chunks_.finish(),
           quadrics_.finish(),
           instances_.finish(),
           curve_points_.finish(),
           curve_normals_.finish(),
           curves_.finish(),
           curve_segments_.finish(),
           curve_groups_.finish(),
           motions_.finish(),
           bricks_.finish(),
           densities_.finish(),
           {},
           {},
           {}};
  l.data = {raw(l.positions),     raw(l.normals), raw(l.uvs),      raw(l.triangles),
            raw(l.primitive_ids), raw(l.chunks),  raw(l.quadrics), raw(l.instances),
            raw(l.curve_points), raw(l.curve_normals), raw(l.curves), raw(l.curve_segments), raw(l.curve_groups),
            raw(l.motions),      raw(l.bricks),  raw(l.densities)};
  alpha_ = false;
  group_of_.clear();
  for (std::uint32_t s = kBaseSections; s < kSectionCount; ++s)
    if (!l.data[s].empty()) l.header.section_count = s + 1;
  std::uint64_t at = sizeof l.header + l.header.section_count * sizeof(SectionEntry);
  for (std::uint32_t s = 0; s < l.header.section_count; ++s) {
    at = align_up(at);
    l.table[s] = {s, kElementBytes[s], at, l.data[s].size() / kElementBytes[s]};
    at += l.data[s].size() + (s == kPositions ? kPadding : 0);
  }
  l.header.file_bytes = align_up(at);
  XXH3_state_t* state = XXH3_createState();
  XXH3_64bits_reset(state);
  l.content(
      [state](std::span<const std::byte> b) { XXH3_64bits_update(state, b.data(), b.size()); });
  l.header.checksum = XXH3_64bits_digest(state);
  XXH3_freeState(state);
  return l;
}

PartBuilder::File PartBuilder::write(const std::string& path) {
  const Layout l = finish();
  const auto close = [](std::FILE* f) { std::fclose(f); };
  std::unique_ptr<std::FILE, decltype(close)> file(std::fopen(path.c_str(), "wbe"), close);
  const auto put = [&](std::span<const std::byte> b) {
    if (!file || std::fwrite(b.data(), 1, b.size(), file.get()) != b.size())
      throw std::system_error(errno, std::generic_category(), path);
  };
  put(std::as_bytes(std::span(&l.header, 1)));
  l.content(put);
  if (std::fflush(file.get()) != 0) throw std::system_error(errno, std::generic_category(), path);
  return {l.header.file_bytes, l.header.checksum};
}

Part PartBuilder::build() {
  const Layout l = finish();
  const auto size = static_cast<std::size_t>(l.header.file_bytes);
  const std::align_val_t alignment{kAlignment};
  std::shared_ptr<std::byte> block(static_cast<std::byte*>(::operator new(size, alignment)),
                                   [alignment](std::byte* p) { ::operator delete(p, alignment); });
  std::byte* at = block.get();
  const auto put = [&at](std::span<const std::byte> b) { at = std::copy(b.begin(), b.end(), at); };
  put(std::as_bytes(std::span(&l.header, 1)));
  l.content(put);
  Result<Part> part = read_part({block.get(), size}, block);
  if (!part) throw std::invalid_argument(part.error());
  return std::move(*part);
}

}  // namespace cloudrenderer
