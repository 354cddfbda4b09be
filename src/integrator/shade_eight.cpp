// Vertices eight at once: gathers what the formulas of shade.cpp need into lanes.
#include <cstddef>

#include "integrator/shader.h"
#include "shapes/triangle.h"

namespace cloudrenderer {

PathTracer::EightShader::EightShader(Shader& shader, SegmentBatch& batch)
    : shader_(shader), batch_(batch), groups_(4 * shader.tracer.shading_->kinds()) {}

bool PathTracer::EightShader::take(std::size_t i) {
  const Hit& hit = batch_.hits[i];
  const PathTracer& tracer = shader_.tracer;
  // A vertex that tells what it is: lanes have no formulas for that.
  if (tracer.job_.features && !(batch_.segments[i].flags & kSurfaceTold)) return false;
  if (hit.part == kNone || hit.geometry != 0 || hit.instance != kNone || tracer.job_.integrator == IntegratorKind::ambient_occlusion)
    return false;
  if (part_number_ != hit.part || hit.index - chunk_->first_triangle >= chunk_->triangle_count) find_chunk(hit);
  if (group_ == 0) return false;
  if (shader_.is_over(batch_.segments[i])) {
    shader_.begin(batch_.segments[i]);
    shader_.end();
    return true;
  }
  Group& group = groups_[group_];
  group.segments[group.count] = i;
  group.chunks[group.count] = chunk_;
  group.parts[group.count] = part_;
  if (++group.count == kLanes) shade(group_, group);
  return true;
}

void PathTracer::EightShader::find_chunk(const Hit& hit) {
  part_number_ = hit.part;
  part_ = &shader_.set.part(hit.part);
  chunk_ = &part_->chunk_of(hit.index);
  // pbrt-v2 takes the side of a triangle from its uv map; nothing else here needs one.
  const bool uvs = chunk_->first_uv != kNone && shader_.tracer.dialect_ == Dialect::v2;
  const std::uint32_t material = chunk_->light == kNone ? shader_.tracer.shading_->kind(chunk_->material) : 0;
  group_ = material ? 4 * std::size_t{material} + (chunk_->first_normal != kNone ? 2 : 0) + (uvs ? 1 : 0) : 0;
}

void PathTracer::EightShader::finish() {
  for (std::size_t kind = 0; kind < groups_.size(); ++kind)
    if (groups_[kind].count) shade(kind, groups_[kind]);
}

void PathTracer::EightShader::shade(std::size_t kind, Group& group) {
  const PathTracer& tracer = shader_.tracer;
  const JobSettings& job = tracer.job_;
  const bool normals = kind & 2u, uvs = kind & 1u;
  // Places of what is to be gathered. What is missing to eight is filled up with the first.
  using Places = std::array<const float*, kLanes>;
  std::array<Places, 3> positions, corner_normals, corner_uvs;
  Places barycentric, ways;
  SampleSequence::Eight sequences;
  std::array<std::uint32_t, kLanes> vertices;
  std::array<std::uint32_t, kLanes> materials;
  Ints8 scattered_at;
  std::uint32_t flips = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const std::size_t from = lane < group.count ? lane : 0, i = group.segments[from];
    const MeshChunk& chunk = *group.chunks[from];
    const PathSegment& s = batch_.segments[i];
    const Hit& hit = batch_.hits[i];
    const Part& part = *group.parts[from];
    const Triangle corners = part.triangles[hit.index];
    for (int k = 0; k < 3; ++k) {
      const auto c = static_cast<std::size_t>(k);
      const std::uint32_t vertex = corners[k], own = vertex - chunk.first_vertex;
      positions[c][lane] = &part.positions[vertex].x;
      if (normals) corner_normals[c][lane] = &part.normals[chunk.first_normal + own].x;
      if (uvs) corner_uvs[c][lane] = &part.uvs[chunk.first_uv + own].x;
    }
    barycentric[lane] = &hit.u;
    ways[lane] = &s.direction.x;
    sequences[lane] = SampleSequence(job.sequence, job.seed, s.pixel, s.sample);
    vertices[lane] = s.vertex;
    scattered_at[lane] = s.vertex;
    materials[lane] = chunk.material;
    flips |= static_cast<std::uint32_t>(chunk.flip != 0) << lane;
  }

  TriangleVerticesOf<Float8> triangle;
  triangle.has_normals = normals;
  triangle.has_uvs = uvs;
  const auto three = [](const Places& at) {
    const auto g = lanes::gather<3>(at);
    return Vec3x8(g[0], g[1], g[2]);
  };
  const auto two = [](const Places& at) {
    const auto g = lanes::gather<2>(at);
    return Vec2x8(g[0], g[1]);
  };
  for (std::size_t c = 0; c < 3; ++c) {
    triangle.p[c] = three(positions[c]);
    if (normals) triangle.n[c] = three(corner_normals[c]);
    if (uvs) triangle.uv[c] = two(corner_uvs[c]);
  }
  const Vec2x8 b = two(barycentric);
  // A segment's direction and throughput lie side by side.
  static_assert(offsetof(PathSegment, throughput) == offsetof(PathSegment, direction) + sizeof(Vec3));
  const auto way = lanes::gather<8>(ways);
  const auto point = triangle_basics<Float8>(triangle, lanes::from_mask_bits(flips), tracer.dialect_, b.x, b.y);
  ScatterOf<Float8> v;
  v.p = point.p;
  v.ng = point.ng;
  v.ns = point.ns;
  v.offset = ray_offset(point.p, point.p_error, point.ng);
  v.wo = {-way[0], -way[1], -way[2]};
  v.throughput = {way[3], way[4], way[5]};
  v.vertex = scattered_at;
  v.numbers = SampleSequence::get_pairs(sequences, vertices, tracer.first_pair_);
  const Bsdf8 bsdf = tracer.shading_->bsdf(materials, v.ns, v.ng, v.wo);
  shader_.scatter(bsdf, lanes::from_mask_bits((1u << group.count) - 1u), v);

  const ScatterResults results(v);
  for (std::size_t lane = 0; lane < group.count; ++lane) {
    const std::size_t i = group.segments[lane];
    shader_.begin(batch_.segments[i]);
    shader_.scattered(results, lane, batch_.hits[i].t);
  }
  group.count = 0;
}

}  // namespace cloudrenderer
