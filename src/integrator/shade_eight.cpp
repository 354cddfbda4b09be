// Vertices eight at once: gathers what the formulas of shade.cpp need into lanes.
#include "integrator/shader.h"
#include "shapes/triangle.h"

namespace cloudrenderer {

PathTracer::EightShader::EightShader(Shader& shader, SegmentBatch& batch)
    : shader_(shader), batch_(batch), groups_(4 * shader.tracer.shading_->kinds()) {}

bool PathTracer::EightShader::take(std::size_t i) {
  const Hit& hit = batch_.hits[i];
  const PathTracer& tracer = shader_.tracer;
  if (hit.part == kNone || hit.geometry != 0 || hit.instance != kNone || tracer.job_.integrator == IntegratorKind::ambient_occlusion)
    return false;
  const MeshChunk& chunk = chunk_of(hit);
  if (chunk.light != kNone) return false;
  const std::uint32_t material = tracer.shading_->kind(chunk.material);
  if (material == 0) return false;
  if (shader_.is_over(batch_.segments[i])) {
    shader_.begin(batch_.segments[i]);
    shader_.end();
    return true;
  }
  // pbrt-v2 takes the side of a triangle from its uv map; nothing else here needs one.
  const bool uvs = chunk.first_uv != kNone && tracer.dialect_ == Dialect::v2;
  const std::size_t kind = 4 * std::size_t{material} + (chunk.first_normal != kNone ? 2 : 0) + (uvs ? 1 : 0);
  __builtin_prefetch(&shader_.set.part(hit.part).triangles[hit.index]);
  Group& group = groups_[kind];
  group.segments[group.count] = i;
  group.chunks[group.count] = &chunk;
  if (++group.count == kLanes) shade(kind, group);
  return true;
}

const MeshChunk& PathTracer::EightShader::chunk_of(const Hit& hit) {
  if (part_ != hit.part || hit.index - chunk_->first_triangle >= chunk_->triangle_count) {
    part_ = hit.part;
    chunk_ = &shader_.set.part(hit.part).chunk_of(hit.index);
  }
  return *chunk_;
}

void PathTracer::EightShader::finish() {
  for (std::size_t kind = 0; kind < groups_.size(); ++kind)
    if (groups_[kind].count) shade(kind, groups_[kind]);
}

void PathTracer::EightShader::shade(std::size_t kind, Group& group) {
  const PathTracer& tracer = shader_.tracer;
  const JobSettings& job = tracer.job_;
  const bool normals = kind & 2u, uvs = kind & 1u;
  enum Column : std::size_t { kP = 0, kN = 9, kUv = 18, kBarycentric = 24, kWay = 26, kThroughput = 29, kColumns = 32 };
  Columns<kColumns> in;
  SampleSequence::Eight sequences;
  std::array<std::uint32_t, kLanes> vertices;
  std::array<std::uint32_t, kLanes> materials;
  std::uint32_t flips = 0;
  // What is missing to eight is filled up with the first.
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const std::size_t from = lane < group.count ? lane : 0, i = group.segments[from];
    const MeshChunk& chunk = *group.chunks[from];
    const PathSegment& s = batch_.segments[i];
    const Hit& hit = batch_.hits[i];
    const Part& part = shader_.set.part(hit.part);
    const Triangle corners = part.triangles[hit.index];
    for (int k = 0; k < 3; ++k) {
      const auto c = static_cast<std::size_t>(k);
      const std::uint32_t vertex = corners[k], own = vertex - chunk.first_vertex;
      in.put(kP + 3 * c, lane, part.positions[vertex]);
      if (normals) in.put(kN + 3 * c, lane, part.normals[chunk.first_normal + own]);
      if (uvs) in.put(kUv + 2 * c, lane, part.uvs[chunk.first_uv + own]);
    }
    in.put(kBarycentric, lane, Vec2(hit.u, hit.v));
    in.put(kWay, lane, s.direction);
    in.put(kThroughput, lane, s.throughput);
    sequences[lane] = SampleSequence(job.sequence, job.seed, s.pixel, s.sample);
    vertices[lane] = s.vertex;
    materials[lane] = chunk.material;
    flips |= static_cast<std::uint32_t>(chunk.flip != 0) << lane;
  }

  TriangleVerticesOf<Float8> triangle;
  triangle.has_normals = normals;
  triangle.has_uvs = uvs;
  for (std::size_t c = 0; c < 3; ++c) {
    triangle.p[c] = in.three(kP + 3 * c);
    if (normals) triangle.n[c] = in.three(kN + 3 * c);
    if (uvs) triangle.uv[c] = in.two(kUv + 2 * c);
  }
  const auto point = triangle_basics<Float8>(triangle, lanes::from_mask_bits(flips), tracer.dialect_, in.one(kBarycentric),
                                             in.one(kBarycentric + 1));
  ScatterOf<Float8> v;
  v.p = point.p;
  v.ng = point.ng;
  v.ns = point.ns;
  v.offset = ray_offset(point.p, point.p_error, point.ng);
  v.wo = -in.three(kWay);
  v.throughput = in.three(kThroughput);
  v.numbers = SampleSequence::get_pairs(sequences, vertices);
  const Bsdf8 bsdf = tracer.shading_->bsdf(materials, v.ns, v.ng, v.wo);
  shader_.scatter(bsdf, lanes::from_mask_bits((1u << group.count) - 1u), v);

  enum Result : std::size_t { kLightOrigin = 0, kLightWay = 3, kLight = 6, kLightDistance = 9, kOrigin = 10, kNextWay = 13,
                              kNextThroughput = 16, kSide = 19, kPdf = 22, kRoulette = 23, kResults = 24 };
  Columns<kResults> result;
  const std::uint32_t lit = lanes::to_bits(v.lit), goes_on = lanes::to_bits(v.goes_on), specular = lanes::to_bits(v.specular);
  if (lit) {
    result.store(kLightOrigin, v.light_origin);
    result.store(kLightWay, v.light_direction);
    result.store(kLight, v.light);
    result.store(kLightDistance, v.light_distance);
  }
  if (goes_on) {
    result.store(kOrigin, v.origin);
    result.store(kNextWay, v.direction);
    result.store(kNextThroughput, v.throughput);
    result.store(kPdf, v.pdf);
  }
  result.store(kSide, v.side);
  result.store(kRoulette, v.numbers[kLobeAndRoulette].y);
  for (std::size_t lane = 0; lane < group.count; ++lane) {
    ScatterOf<float> one;
    one.lit = lit >> lane & 1u;
    if (one.lit) {
      one.light_origin = result.get(kLightOrigin, lane);
      one.light_direction = result.get(kLightWay, lane);
      one.light = result.get(kLight, lane);
      one.light_distance = result.at[kLightDistance][lane];
    }
    one.goes_on = goes_on >> lane & 1u;
    one.specular = specular >> lane & 1u;
    if (one.goes_on) {
      one.origin = result.get(kOrigin, lane);
      one.direction = result.get(kNextWay, lane);
      one.throughput = result.get(kNextThroughput, lane);
      one.pdf = result.at[kPdf][lane];
    }
    one.side = result.get(kSide, lane);
    shader_.begin(batch_.segments[group.segments[lane]]);
    shader_.scattered(one, result.at[kRoulette][lane], batch_.hits[group.segments[lane]].t);
  }
  group.count = 0;
}

}  // namespace cloudrenderer
