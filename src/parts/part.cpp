#include "parts/part.h"

#include <xxhash.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <system_error>

#include "parts/check.h"
#include "parts/mapped_file.h"
#include "parts/part_format.h"
#include "shapes/surface.h"

namespace cloudrenderer {
namespace {

using namespace part_format;

// Nothing of the value is believed: the file may come from anyone.
bool usable(float v) { return std::fabs(v) <= kLargest; }  // false for NaN
bool usable(const Transform& t) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!std::isfinite(t.matrix()[c][r]) || !std::isfinite(t.inverse_matrix()[c][r]))
        return false;
  return true;
}

template <class T>
bool all_usable(std::span<const T> values) {
  const auto* f = reinterpret_cast<const float*>(values.data());
  const std::size_t n = values.size_bytes() / sizeof(float);
  bool ok = true;
  for (std::size_t i = 0; i < n; ++i) ok &= usable(f[i]);
  return ok;
}

template <class T>
std::span<const T> section(std::span<const std::byte> bytes, const SectionEntry& e) {
  return {reinterpret_cast<const T*>(bytes.data() + e.offset), static_cast<std::size_t>(e.count)};
}

// [first, first + count) lies in an array of `size` elements.
bool inside(std::uint32_t first, std::uint32_t count, std::size_t size) {
  return std::uint64_t{first} + count <= size;
}

const char* bad_chunk(const Part& p, const MeshChunk& c, std::uint64_t expected_triangle) {
  if (c.first_triangle != expected_triangle || c.triangle_count == 0 ||
      !inside(c.first_triangle, c.triangle_count, p.triangles.size()))
    return "chunks do not follow each other";
  if (!inside(c.first_vertex, c.vertex_count, p.positions.size()))
    return "chunk vertices out of range";
  if (c.first_normal != kNone && !inside(c.first_normal, c.vertex_count, p.normals.size()))
    return "chunk normals out of range";
  if (c.first_uv != kNone && !inside(c.first_uv, c.vertex_count, p.uvs.size()))
    return "chunk uvs out of range";
  if (c.primitive_ids != kNone &&
      !inside(c.primitive_ids, c.triangle_count, p.primitive_ids.size()))
    return "chunk primitive ids out of range";
  if (c.primitive_ids == kNone && std::uint64_t{c.first_primitive} + c.triangle_count > kNone)
    return "chunk primitive numbers overflow";
  if (c.flip > 1) return "bad flip";
  bool ok = true;
  for (const Triangle& t : p.triangles.subspan(c.first_triangle, c.triangle_count))
    for (int i = 0; i < 3; ++i)  // unsigned differences: below first_vertex wraps to a large number
      ok &= t[i] - c.first_vertex < c.vertex_count;
  return ok ? nullptr : "vertex index out of range";
}

const char* bad_curves(const CurveArrays& c) {
  if (!all_usable(c.points)) return "a curve is not finite";
  if (!all_usable(c.normals)) return "a curve's normal is not finite";
  for (const CurveGroup& g : c.groups) {
    if (g.kind > static_cast<std::uint32_t>(CurveKind::ribbon)) return "unknown curve";
    if (g.log2_segments > kCurveSegmentBits || g.flip > 1 || g.placed > 1) return "bad curve";
    if (!usable(g.object_to_world)) return "a curve is not finite";
  }
  for (const CurveRecord& r : c.records) {
    if (r.group >= c.groups.size() || !inside(r.first_point, 4, c.points.size())) return "curve out of range";
    const CurveGroup& g = c.groups[r.group];
    const bool ribbon = g.kind == static_cast<std::uint32_t>(CurveKind::ribbon);
    if (ribbon != (r.first_normal != kNone) || (ribbon && !inside(r.first_normal, 2, c.normals.size())))
      return "curve normals out of range";
    if (std::uint64_t{r.piece} + 1 > (std::uint64_t{kNone} >> g.log2_segments)) return "curve numbers overflow";
    for (const float w : r.width)
      if (!usable(w) || w < 0.f) return "a curve's width is not usable";
  }
  for (const std::uint32_t s : c.segments)
    if (s >> kCurveSegmentBits >= c.records.size() ||
        (s & ((1u << kCurveSegmentBits) - 1)) >> c.groups[c.records[s >> kCurveSegmentBits].group].log2_segments)
      return "curve segment out of range";
  return nullptr;
}

const char* bad_motion(const Part& p) {
  std::uint32_t before = 0;
  for (const MotionRecord& r : p.motions) {
    if (r.instance < before || r.instance >= p.instances.size()) return "a movement of no instance";
    before = r.instance;
    if (!(r.start_time <= r.end_time) || !usable(r.start_time) || !usable(r.end_time))
      return "a movement's times are no times";
    std::uint32_t interpolates;
    std::memcpy(&interpolates, &r.interpolates, sizeof interpolates);
    if (interpolates > 1) return "an unknown kind of movement";
    for (const Mat4& m : {r.start, r.end})
      if (!usable(Transform(m))) return "a movement is not finite or cannot be inverted";
    if (!AnimatedTransform::can_move(r.start, r.end)) return "a movement turns its object inside out";
  }
  return nullptr;
}

const char* bad_content(const Part& p) {
  if (!all_usable(p.positions)) return "a position is not finite";
  if (!all_usable(p.normals)) return "a normal is not finite";
  if (!all_usable(p.uvs)) return "a uv is not finite";
  std::uint64_t triangle = 0;
  for (const MeshChunk& c : p.chunks) {
    if (const char* why = bad_chunk(p, c, triangle)) return why;
    triangle += c.triangle_count;
  }
  if (triangle != p.triangles.size()) return "triangles without a chunk";
  for (const QuadricRecord& r : p.quadrics) {
    const Quadric& q = r.quadric;
    std::uint32_t kind;
    std::memcpy(&kind, &q.kind, sizeof kind);
    if (kind > static_cast<std::uint32_t>(QuadricKind::hyperboloid)) return "unknown quadric";
    for (const float v : {q.radius, q.inner_radius, q.height, q.z_min, q.z_max, q.phi_max})
      if (!usable(v)) return "a quadric is not finite";
    if (!is_finite(q.p1) || !is_finite(q.p2) || !usable(q.object_to_world))
      return "a quadric is not finite";
    if (r.flip > 1 || q.inside_out > 1) return "bad flip";
  }
  for (const InstanceRecord& r : p.instances)
    if (!usable(r.to_world)) return "an instance is not finite";
  if (const char* why = bad_curves(p.curves)) return why;
  for (const BrickRecord& r : p.bricks) {
    const DensityBrick& b = r.brick;
    if (!usable(b.object_to_world) || !is_finite(b.first) || !is_finite(b.scale)) return "a brick is not finite";
    for (int a = 0; a < 3; ++a)
      if (!(usable(b.low[a]) && usable(b.high[a]) && b.low[a] <= b.high[a])) return "a brick has no box";
    for (const std::uint32_t n : b.size)
      if (n < 2 || n > kBrickCells + 1) return "a brick has a wrong number of samples";
    if (b.channels < 1 || b.channels > kMostBrickChannels || (b.densities != 1 && b.densities != 3) || b.densities > b.channels)
      return "a brick has a wrong number of channels";
    if (!inside(r.first_sample, static_cast<std::uint32_t>(r.sample_count()), p.densities.size()))
      return "brick samples out of range";
    const std::span<const float> samples = p.densities.subspan(r.first_sample, r.sample_count());
    for (const float d : samples.first(b.channel_samples() * b.densities))
      if (!(d >= 0.f && d <= b.majorant && b.majorant <= kLargest)) return "a density is out of range";
    for (const float v : samples)
      if (!usable(v)) return "a sample of a brick is not finite";
  }
  return bad_motion(p);
}

}  // namespace

SurfacePoint curve_point(const CurveArrays& curves, std::uint32_t segment, const Vec3& direction, float u, float v) {
  const CurveRecord& record = curves.record_of(segment);
  const CurveGroup& group = curves.groups[record.group];
  glm::dvec3 way(direction);
  if (group.placed) way = glm::inverse(glm::dmat3(Mat4(group.object_to_world.matrix()))) * way;
  const SurfacePoint s = surface_point(curves.piece(record), group.flip != 0, way, u, v);
  return group.placed ? transformed(s, group.object_to_world) : s;
}

std::span<const MotionRecord> motions_of(std::span<const MotionRecord> all, std::uint32_t instance) {
  const auto found = std::ranges::equal_range(all, instance, {}, &MotionRecord::instance);
  return {found.begin(), found.end()};
}

void Part::guide_chunks() {
  if (chunks.size() < 2 || triangles.empty()) return;
  chunk_block = static_cast<unsigned>(std::bit_width(triangles.size() / (4 * chunks.size())));
  chunk_guide.clear();
  std::uint32_t chunk = 0;
  for (std::size_t first = 0; first < triangles.size(); first += std::size_t{1} << chunk_block) {
    while (chunk + 1 < chunks.size() && chunks[chunk + 1].first_triangle <= first) ++chunk;
    chunk_guide.push_back(chunk);
  }
  chunk_guide.push_back(static_cast<std::uint32_t>(chunks.size() - 1));
}

Result<Part> read_part(std::span<const std::byte> bytes, std::shared_ptr<const void> owner) {
  const auto failure = [](const char* why) {
    return Result<Part>::failure(std::string("part: ") + why);
  };
  if (bytes.size() < sizeof(Header)) return failure("too short");
  if (reinterpret_cast<std::uintptr_t>(bytes.data()) % 16 != 0)
    return failure("bytes are not aligned");
  Header header;
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.magic != kMagic) return failure("not a part file");
  if (header.version != kVersion) return failure("unknown version");
  if (header.section_count < kBaseSections || header.section_count > kSectionCount)
    return failure("wrong number of sections");
  const std::size_t table_bytes = header.section_count * sizeof(SectionEntry);
  const std::size_t table_end = sizeof(Header) + table_bytes;
  if (bytes.size() < table_end) return failure("too short");
  if (header.reserved != Header().reserved) return failure("reserved bytes are not 0");
  if (header.file_bytes != bytes.size()) return failure("wrong length");
  if (XXH3_64bits(bytes.data() + sizeof header, bytes.size() - sizeof header) != header.checksum)
    return failure("wrong checksum");

  std::array<SectionEntry, kSectionCount> table;
  std::memcpy(table.data(), bytes.data() + sizeof header, table_bytes);
  for (std::uint32_t s = 0; s < header.section_count; ++s) {
    const SectionEntry& e = table[s];
    if (e.section != s || e.element_bytes != kElementBytes[s]) return failure("unknown section");
    const std::uint64_t padding = s == kPositions ? kPadding : 0;
    if (e.offset % kAlignment != 0 || e.offset < table_end || e.offset > bytes.size())
      return failure("section out of range");
    if (e.count > (bytes.size() - e.offset) / e.element_bytes || e.count >= kNone ||
        e.count * e.element_bytes + padding > bytes.size() - e.offset)
      return failure("section out of range");
  }
  Part p;
  p.positions = section<Vec3>(bytes, table[kPositions]);
  p.normals = section<Vec3>(bytes, table[kNormals]);
  p.uvs = section<Vec2>(bytes, table[kUvs]);
  p.triangles = section<Triangle>(bytes, table[kTriangles]);
  p.primitive_ids = section<std::uint32_t>(bytes, table[kPrimitiveIds]);
  p.chunks = section<MeshChunk>(bytes, table[kChunks]);
  p.quadrics = section<QuadricRecord>(bytes, table[kQuadrics]);
  p.instances = section<InstanceRecord>(bytes, table[kInstances]);
  p.curves.points = section<Vec3>(bytes, table[kCurvePoints]);
  p.curves.normals = section<Vec3>(bytes, table[kCurveNormals]);
  p.curves.records = section<CurveRecord>(bytes, table[kCurves]);
  p.curves.segments = section<std::uint32_t>(bytes, table[kCurveSegments]);
  p.curves.groups = section<CurveGroup>(bytes, table[kCurveGroups]);
  p.motions = section<MotionRecord>(bytes, table[kMotions]);
  p.bricks = section<BrickRecord>(bytes, table[kBricks]);
  p.densities = section<float>(bytes, table[kDensities]);
  p.owner = std::move(owner);
  p.checksum = header.checksum;
  if (const char* why = bad_content(p)) return failure(why);
  return p;
}

Result<Part> read_part_file(const std::string& path) {
  try {
    MappedFile file = map_file(path);
    Result<Part> part = read_part(file.bytes, std::move(file.owner));
    return part ? std::move(part) : Result<Part>::failure(path + ": " + part.error());
  } catch (const std::system_error& e) {
    return Result<Part>::failure(e.what());
  }
}

std::optional<std::string> find_bad_reference(const Part& part, const Manifest& manifest) {
  const auto outside = [](std::uint32_t id, std::size_t size) { return id != kNone && id >= size; };
  const SceneDescription& scene = manifest.scene;
  for (const MeshChunk& c : part.chunks) {
    if (outside(c.material, scene.materials.size())) return "part: no such material";
    if (outside(c.light, manifest.shape_lights.size())) return "part: no such light";
    if (outside(c.alpha_texture, scene.textures.size()) ||
        outside(c.shadow_alpha_texture, scene.textures.size()))
      return "part: no such texture";
  }
  for (const QuadricRecord& q : part.quadrics) {
    if (outside(q.material, scene.materials.size())) return "part: no such material";
    if (outside(q.light, manifest.shape_lights.size())) return "part: no such light";
    if (outside(q.alpha_texture, scene.textures.size())) return "part: no such texture";
  }
  for (const CurveGroup& g : part.curves.groups) {
    if (outside(g.material, scene.materials.size())) return "part: no such material";
    if (outside(g.light, manifest.shape_lights.size())) return "part: no such light";
    if (outside(g.alpha_texture, scene.textures.size()) || outside(g.shadow_alpha_texture, scene.textures.size()))
      return "part: no such texture";
  }
  for (const InstanceRecord& i : part.instances)
    if (i.prototype >= manifest.prototypes.size()) return "part: no such prototype";
  for (const BrickRecord& b : part.bricks) {
    if (b.medium >= scene.media.size()) return "part: no such medium";
    const MediumDesc& medium = scene.media[b.medium];
    if (b.brick.channels != grid_channels(medium) || b.brick.densities != (medium.type == "rgbgrid" ? 3u : 1u))
      return "part: a brick has not the channels of its medium";
  }
  return std::nullopt;
}

}  // namespace cloudrenderer
