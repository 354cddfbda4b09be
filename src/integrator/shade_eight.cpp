// Vertices eight at once: gathers what the formulas of shade.cpp need into lanes.
#include <algorithm>
#include <cstddef>
#include <utility>

#include "integrator/shader.h"
#include "shading/bsdf_lobes.h"
#include "shapes/triangle.h"

namespace cloudrenderer {
namespace {

// All of a lobe but its numbers; never 0. Lobes with tables are not for eight.
std::uint32_t kind_of(const Lobe& l) {
  return 1u + (static_cast<std::uint32_t>(l.kind) | static_cast<std::uint32_t>(l.distribution) << 8 |
               static_cast<std::uint32_t>(l.fresnel) << 16 | static_cast<std::uint32_t>(l.transmits) << 24 |
               static_cast<std::uint32_t>(l.scale_radiance) << 25);
}

constexpr std::size_t kPointsOnly = 4;  // groups before this: see EightShader::groups_

// What goes with a point, in as many numbers as a transposition takes.
template <class F>
struct AroundOf {
  Vec3Of<F> offset{};  // see ray_offset
  FootprintOf<F> print;
  Vec3Of<F> unused{};
};

}  // namespace

PathTracer::EightShader::EightShader(Shader& shader, SegmentBatch& batch)
    : shader_(shader), batch_(batch), groups_(4 * shader.tracer.shading_->kinds()) {}

bool PathTracer::EightShader::take(std::size_t i) {
  const Hit& hit = batch_.hits[i];
  const PathTracer& tracer = shader_.tracer;
  if (hit.part == kNone) return take_escape(i);
  // A vertex that tells what it is: lanes have no formulas for that.
  if (tracer.job_.features && !(batch_.segments[i].flags & kSurfaceTold)) return false;
  if (hit.geometry != 0 || hit.instance != kNone || tracer.job_.integrator == IntegratorKind::ambient_occlusion ||
      shader_.is_regularized(batch_.segments[i]))
    return false;
  if (part_number_ != hit.part || hit.index - chunk_->first_triangle >= chunk_->triangle_count) find_chunk(hit);
  if (alone_) return false;
  if (shader_.is_over(batch_.segments[i])) {
    shader_.begin(batch_.segments[i]);
    shader_.end();
    return true;
  }
  Group& group = groups_[group_];
  group.segments[group.count] = i;
  group.chunks[group.count] = chunk_;
  group.parts[group.count] = part_;
  if (++group.count < kLanes) return true;
  if (group_ < kPointsOnly) scatter_points(group_, group);
  else shade(group_, group);
  return true;
}

void PathTracer::EightShader::find_chunk(const Hit& hit) {
  part_number_ = hit.part;
  part_ = &shader_.set.part(hit.part);
  chunk_ = &part_->chunk_of(hit.index);
  const Shading& shading = *shader_.tracer.shading_;
  alone_ = chunk_->light != kNone || shading.is_null(chunk_->material);
  if (alone_) return;
  const std::size_t kind = shading.kind(chunk_->material);
  // pbrt-v2 takes the side of a triangle from its uv map; else constant materials need none.
  const bool uvs = chunk_->first_uv != kNone && (kind == 0 || shader_.tracer.dialect_ == Dialect::v2);
  group_ = 4 * kind + (chunk_->first_normal != kNone ? 2 : 0) + (uvs ? 1 : 0);
}

bool PathTracer::EightShader::take_textured(std::uint32_t material, const SurfacePoint& p, const Vec3& offset, const Footprint& print,
                                            const PathSegment& s) {
  // Filtered textures are those of camera rays, which are neighbours and find their texels in the cache.
  if (!print.empty() || !shader_.tracer.shading_->prefetch(material, p)) return false;
  textured_.push_back({static_cast<std::size_t>(&s - batch_.segments.data()), material, shader_.end_flags, p, offset, print});
  if (textured_.size() == kTextured) scatter_textured();
  return true;
}

void PathTracer::EightShader::scatter_textured() {
  for (Textured& t : textured_) {
    shader_.resume(batch_.segments[t.segment], t.end_flags);
    shader_.scatter_at(t.material, t.p, t.offset, t.print, batch_.hits[t.segment]);
  }
  textured_.clear();
}

void PathTracer::EightShader::finish() {
  for (std::size_t kind = 0; kind < kPointsOnly; ++kind)
    if (groups_[kind].count) scatter_points(kind, groups_[kind]);
  scatter_textured();
  for (std::size_t kind = kPointsOnly; kind < groups_.size(); ++kind)
    if (groups_[kind].count) shade(kind, groups_[kind]);
  for (const auto& waiting : waiting_)
    if (waiting->count) shade(*waiting);
  for (const bool weighted : {false, true})
    if (escapes_[weighted].count) shade(escapes_[weighted], weighted);
}

bool PathTracer::EightShader::take_escape(std::size_t i) {
  const PathSegment& s = batch_.segments[i];
  if (!shader_.finds_infinite(s) || shader_.shares_with_lights(s)) return false;
  const bool weighted = !(s.flags & kSpecularBounce);
  Escapes& e = escapes_[weighted];
  e.segments[e.count++] = i;
  if (e.count == kLanes) shade(e, weighted);
  return true;
}

void PathTracer::EightShader::shade(Escapes& e, bool weighted) {
  Columns<13> at;  // as EscapeOf has them
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const PathSegment& s = batch_.segments[e.segments[lane < e.count ? lane : 0]];
    at.put(0, lane, s.direction);
    at.put(3, lane, s.throughput);
    at.put(6, lane, s.scattered_at());
    if (!weighted) continue;
    at.put(9, lane, s.previous_normal);
    at.at[12][lane] = s.previous_pdf;
  }
  EscapeOf<Float8> escape{at.three(0), at.three(3), at.three(6), {}, {}};
  if (weighted) {
    escape.normal = at.three(9);
    escape.pdf = at.one(12);
  }
  const Vec3x8 light = shader_.escaped<Float8>(lanes::from_mask_bits((1u << e.count) - 1u), escape, weighted);
  for (std::size_t lane = 0; lane < e.count; ++lane) {
    shader_.begin(batch_.segments[e.segments[lane]]);
    shader_.add(lanes::get(light, lane) * shader_.times_seen(*shader_.path));
    shader_.end();
  }
  e.count = 0;
}

bool PathTracer::EightShader::take(const Bsdf& bsdf, const SurfacePoint& p, const Vec3& offset, const PathSegment& s) {
  const int count = bsdf.lobe_count();
  if (count > Bsdf8::kMaxLobes) return false;
  LobeKinds kinds{};
  for (int i = 0; i < count; ++i) {
    if (!eight_wide(bsdf.lobe(i))) return false;
    kinds[static_cast<std::size_t>(i)] = kind_of(bsdf.lobe(i));
  }
  const auto is_same = [&](const auto& w) { return w->kinds == kinds; };
  if (last_waiting_ == waiting_.size() || !is_same(waiting_[last_waiting_])) {
    const auto found = std::find_if(waiting_.begin(), waiting_.end(), is_same);
    if (found == waiting_.end() && waiting_.size() == kMostWaiting) return false;
    last_waiting_ = static_cast<std::size_t>(found - waiting_.begin());
    if (found == waiting_.end()) waiting_.push_back(std::make_unique<Waiting>());
  }
  Waiting& w = *waiting_[last_waiting_];
  const std::size_t lane = w.count++;
  w.segments[lane] = static_cast<std::size_t>(&s - batch_.segments.data());
  w.end_flags[lane] = shader_.end_flags;
  w.at.put(0, lane, p.p);
  w.at.put(3, lane, p.ng);
  w.at.put(6, lane, offset);
  w.at.put(9, lane, bsdf.frame().s);
  w.at.put(12, lane, bsdf.frame().t);
  w.at.put(15, lane, bsdf.frame().n);
  w.at.put(18, lane, bsdf.ng());
  for (int i = 0; i < count; ++i) {
    LobeOf<Float8>& lobe = w.lobes[static_cast<std::size_t>(i)];
    // All lanes by the first, so that those stay of use that get no vertex.
    if (lane == 0) lobe = bsdf::in_all_lanes(bsdf.lobe(i));
    else bsdf::put(lobe, lane, bsdf.lobe(i));
  }
  if (lane == 0) {
    w.kinds = kinds;
    w.lobe_count = count;
  }
  if (w.count == kLanes) shade(w);
  return true;
}

void PathTracer::EightShader::shade(Waiting& w) {
  for (std::size_t lane = w.count; lane < kLanes; ++lane) {
    w.segments[lane] = w.segments[0];
    for (auto& column : w.at.at) column[lane] = column[0];
  }
  ScatterOf<Float8> v;
  v.p = w.at.three(0);
  v.ng = w.at.three(3);
  v.offset = w.at.three(6);
  v.ns = w.at.three(15);
  bring(w.segments, v);
  Bsdf8 bsdf(FrameOf<Float8>(w.at.three(9), w.at.three(12), v.ns), w.at.three(18));
  bsdf.add(std::span<const LobeOf<Float8>>(w.lobes.data(), static_cast<std::size_t>(w.lobe_count)));
  bsdf.finish(v.wo);
  scatter(bsdf, v, w.segments, w.count, w.end_flags.data());
  w.count = 0;
}

void PathTracer::EightShader::scatter(const Bsdf8& bsdf, ScatterOf<Float8>& v, const std::array<std::size_t, kLanes>& segments,
                                      std::size_t count, const std::uint16_t* end_flags) {
  const Vec3x8 throughput = v.throughput;
  shader_.scatter(bsdf, lanes::from_mask_bits((1u << count) - 1u), v);
  ScatterResults results(v);
  if (results.asks && shader_.plain_light) results.quantise_light(v.light, shader_.tracer.fixed_units_);
  std::uint32_t holding = 0;
  for (std::size_t lane = 0; lane < count; ++lane) {
    PathSegment& s = batch_.segments[segments[lane]];
    if (end_flags) shader_.resume(s, end_flags[lane]);
    else shader_.begin(s);
    if (s.flags & kHoldsGroup) {
      holding |= 1u << lane;
      s.flags = static_cast<std::uint16_t>(s.flags & ~kHoldsGroup);
    }
    shader_.scattered(results, lane, batch_.hits[segments[lane]].t);
  }
  if (holding) scatter_members(bsdf, v, segments, holding, throughput);
}

void PathTracer::EightShader::scatter_members(const Bsdf8& bsdf, ScatterOf<Float8>& v, const std::array<std::size_t, kLanes>& segments,
                                              std::uint32_t holding, const Vec3x8& throughput) {
  const JobSettings& job = shader_.tracer.job_;
  v.asks = Mask8(false);
  PathSegment member;
  for (std::uint32_t m = 1; m < shader_.tracer.shared_.group; ++m) {
    SampleSequence::Eight sequences;
    std::array<std::uint32_t, kLanes> vertices;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const PathSegment& s = batch_.segments[segments[lane]];
      sequences[lane] = SampleSequence(job.sequence, job.seed, s.pixel, s.sample + 2 * m);
      vertices[lane] = s.vertex;
    }
    v.numbers = SampleSequence::get_pairs(sequences, vertices, kLobeAndRoulette);
    v.throughput = throughput;
    shader_.choose_ray(bsdf, lanes::from_mask_bits(holding), v);
    const ScatterResults results(v);
    for (std::uint32_t left = holding; left; left &= left - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(left));
      shader_.begin_member(batch_.segments[segments[lane]], m, member);
      shader_.scattered(results, lane, batch_.hits[segments[lane]].t);
    }
  }
}

void PathTracer::EightShader::bring(const std::array<std::size_t, kLanes>& segments, ScatterOf<Float8>& v) const {
  const PathTracer& tracer = shader_.tracer;
  std::array<const float*, kLanes> ways;
  SampleSequence::Eight sequences;
  std::array<std::uint32_t, kLanes> vertices;
  bool shared = false;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const PathSegment& s = batch_.segments[segments[lane]];
    shared = shared || shader_.group_of(s) > 1;
    ways[lane] = &s.direction.x;
    sequences[lane] = SampleSequence(tracer.job_.sequence, tracer.job_.seed, s.pixel, s.sample);
    vertices[lane] = s.vertex;
    v.vertex[lane] = s.vertex;
    if (tracer.light_paths_ != LightPaths::none) lanes::put(v.ratio, lane, tracer.light_ratio(s, batch_.hits[segments[lane]]));
  }
  // A segment's direction and throughput lie side by side.
  static_assert(offsetof(PathSegment, throughput) == offsetof(PathSegment, direction) + sizeof(Vec3));
  const auto way = lanes::gather<8>(ways);
  v.wo = {-way[0], -way[1], -way[2]};
  v.throughput = {way[3], way[4], way[5]};
  v.numbers = SampleSequence::get_pairs(sequences, vertices, shared ? std::uint32_t{kLobeAndRoulette} : tracer.first_pair_);
  if (!shared) return;
  v.shares = true;
  std::uint32_t leads = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const PathSegment& s = batch_.segments[segments[lane]];
    const std::uint32_t group = shader_.group_of(s);
    sequences[lane] = SampleSequence(tracer.job_.sequence, tracer.job_.seed, s.pixel, group > 1 ? tracer.ray_sample(s) : s.sample);
    lanes::put(v.group, lane, static_cast<float>(group));
    leads |= static_cast<std::uint32_t>(group == 1 || shader_.leads(s)) << lane;
  }
  v.leads = lanes::from_mask_bits(leads);
  const auto lights = SampleSequence::get_pairs(sequences, vertices, tracer.first_pair_, kLobeAndRoulette);
  for (const std::size_t pair : {kLightChoice, kLightPoint}) v.numbers[pair] = lights[pair];
}

PathTracer::EightShader::Gathered PathTracer::EightShader::gather(std::size_t kind, const Group& group) const {
  Gathered out;
  TriangleVerticesOf<Float8>& triangle = out.triangle;
  triangle.has_normals = kind & 2u;
  triangle.has_uvs = kind & 1u;
  // Places of what is to be gathered. What is missing to eight is filled up with the first.
  using Places = std::array<const float*, kLanes>;
  std::array<Places, 3> positions, normals, uvs;
  Places barycentric;
  std::uint32_t flips = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const std::size_t from = lane < group.count ? lane : 0, i = group.segments[from];
    const MeshChunk& chunk = *group.chunks[from];
    const Hit& hit = batch_.hits[i];
    const Part& part = *group.parts[from];
    const Triangle corners = part.triangles[hit.index];
    for (int k = 0; k < 3; ++k) {
      const auto c = static_cast<std::size_t>(k);
      const std::uint32_t vertex = corners[k], own = vertex - chunk.first_vertex;
      positions[c][lane] = &part.positions[vertex].x;
      if (triangle.has_normals) normals[c][lane] = &part.normals[chunk.first_normal + own].x;
      if (triangle.has_uvs) uvs[c][lane] = &part.uvs[chunk.first_uv + own].x;
    }
    barycentric[lane] = &hit.u;
    out.segments[lane] = i;
    out.materials[lane] = chunk.material;
    flips |= static_cast<std::uint32_t>(chunk.flip != 0) << lane;
  }
  out.flip = lanes::from_mask_bits(flips);
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
    if (triangle.has_normals) triangle.n[c] = three(normals[c]);
    if (triangle.has_uvs) triangle.uv[c] = two(uvs[c]);
  }
  out.at = two(barycentric);
  return out;
}

void PathTracer::EightShader::shade(std::size_t kind, Group& group) {
  const PathTracer& tracer = shader_.tracer;
  const Gathered g = gather(kind, group);
  const auto point = triangle_basics<Float8>(g.triangle, g.flip, tracer.dialect_, g.at.x, g.at.y);
  ScatterOf<Float8> v;
  v.p = point.p;
  v.ng = point.ng;
  v.ns = point.ns;
  v.offset = ray_offset(point.p, point.p_error, point.ng);
  bring(g.segments, v);
  const Bsdf8 bsdf = tracer.shading_->bsdf(g.materials, v.ns, v.ng, v.wo);
  scatter(bsdf, v, group.segments, group.count, nullptr);
  group.count = 0;
}

void PathTracer::EightShader::scatter_points(std::size_t kind, Group& group) {
  const PathTracer& tracer = shader_.tracer;
  const Gathered g = gather(kind, group);
  const auto points8 = triangle_point<Float8>(g.triangle, g.flip, tracer.dialect_, g.at.x, g.at.y, tracer.uv_);
  AroundOf<Float8> around8;
  around8.offset = ray_offset(points8.p, points8.p_error, points8.ng);
  if (tracer.footprint_) {
    Columns<4> rays;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const PathSegment& s = batch_.segments[g.segments[lane]];
      rays.put(0, lane, s.direction);
      rays.at[3][lane] = Shader::cone_at(s, batch_.hits[g.segments[lane]].t);
    }
    around8.print = Shader::footprint_of(points8, rays.three(0), rays.one(3));
  }
  std::array<SurfacePoint, kLanes> points;
  std::array<AroundOf<float>, kLanes> around;
  lanes::take_apart(points8, points);
  lanes::take_apart(around8, around);
  const std::size_t count = std::exchange(group.count, 0);
  for (std::size_t lane = 0; lane < count; ++lane) {
    shader_.begin(batch_.segments[g.segments[lane]]);
    shader_.scatter_or_wait(g.materials[lane], points[lane], around[lane].offset, around[lane].print, batch_.hits[g.segments[lane]]);
  }
}

}  // namespace cloudrenderer
