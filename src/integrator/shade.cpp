// The light transport. Everything that a path does at a surface is here and nowhere else.
#include <cmath>
#include <cstddef>
#include <cstring>

#include "base/sampling.h"
#include "integrator/shader.h"
#include "integrator/shadow_channel.h"
#include "integrator/timer.h"
#include "parts/part_triangle.h"

namespace cloudrenderer {

namespace {

constexpr std::int32_t kRouletteFrom = 1;    // vertex after which paths are thinned

// A path survives with this times its largest throughput, at most surely. Thinning paths that carry more costs more error
// than it saves time: src/README.md, decision 53.
constexpr float kRouletteScale = 12.f;

}  // namespace

// The geometric normal decides, as in Bsdf: with a shading normal
// that leans far from it, light from below the shading horizon is reflected too, and light along the surface strongly:
// then no side is preferred.
template <class F>
Vec3Of<F> PathTracer::Shader::lit_side(const BsdfOf<F>& bsdf, const Vec3Of<F>& ns, const Vec3Of<F>& ng, const Vec3Of<F>& wo) {
  const Vec3Of<F> none(F(0.f));
  for (int i = 0; i < bsdf.lobe_count(); ++i)
    if (bsdf.lobe(i).transmits || bsdf.lobe(i).kind == LobeKind::microfacet_dielectric) return none;
  const Vec3Of<F> side = lanes::select(glm::dot(ng, wo) < 0.f, -ng, ng);
  return lanes::select(lanes::abs(glm::dot(ns, ng)) < 0.5f, none, side);
}
template Vec3 PathTracer::Shader::lit_side<float>(const Bsdf&, const Vec3&, const Vec3&, const Vec3&);

SurfacePoint PathTracer::Shader::surface(const Vec3& origin, const Vec3& direction, const Hit& hit, std::uint32_t& material,
                                         std::uint32_t& light, bool derivatives) const {
  if (hit.geometry == kAnsweredHit) return surface(answered[hit.index], hit, material, light, derivatives);
  const float time = hit.instance != kNone && tracer.motion_ ? tracer.time_of(*path) : 0.f;
  return tracer.surface(set, origin, direction, time, hit, material, light, derivatives);
}

SurfacePoint PathTracer::surface(const ResidentSet& set, const Vec3& origin, const Vec3& direction, float time, const Hit& hit,
                                 std::uint32_t& material, std::uint32_t& light, bool derivatives) const {
  const Part& part = hit.instance == kNone ? set.part(hit.part) : set.prototype(hit.part, hit.instance);
  SurfacePoint p;
  const Transform* to_world = nullptr;
  Transform moved;
  if (hit.instance != kNone) to_world = &set.place(hit.part, hit.instance, time, moved);
  if (hit.geometry == 0) {
    const MeshChunk& c = part.chunk_of(hit.index);
    material = c.material;
    light = c.light;
    // pbrt-v2 takes the side of a triangle from its uv map.
    const TriangleVertices tri = vertices_of(part, c, hit.index, derivatives || dialect_ == Dialect::v2);
    p = triangle_point(tri, c.flip != 0, dialect_, hit.u, hit.v, derivatives);
  } else if (hit.geometry == kCurveHit) {
    const CurveGroup& g = part.curves.group_of(hit.index);
    material = g.material;
    light = g.light;
    p = curve_point(part.curves, hit.index, to_world ? to_world->inverse().vector(direction) : direction, hit.u, hit.v);
    if (dialect_ == Dialect::v4) p.p_error *= 0.5f;  // rays leave it one width away there
  } else {
    const QuadricRecord& q = part.quadrics[hit.index];
    material = q.material;
    light = q.light;
    Vec3 o = origin, d = direction;
    if (to_world) {
      const Affine inverse = Affine(to_world->matrix()).inverse();
      o = Vec3(inverse.point(o));
      d = Vec3(inverse.m * glm::dvec3(d));
    }
    p = surface_point(q.quadric, q.flip != 0, o, d, hit.t);
  }
  if (to_world) {
    p = transformed(p, *to_world);
    if (!set.enters_exactly(hit.part, hit.instance)) p.p_error += inverse_error(p.p, *to_world);
  }
  return p;
}

// The pixel's cone cut by the tangent plane: stretched along the ray by 1 / cos.
template <class F>
FootprintOf<F> PathTracer::Shader::footprint_of(const SurfacePointOf<F>& p, const Vec3Of<F>& direction, F width) {
  const MaskOf<F> known = width > 0.f;
  if (lanes::none(known)) return {};
  const F cosine = lanes::max(lanes::abs(glm::dot(-direction, p.ng)), F(0.01f));
  const Vec3Of<F> along = direction - p.ng * glm::dot(direction, p.ng), nothing(F(0.f));
  const F length = lanes::sqrt(glm::dot(along, along));
  Vec3Of<F> a = along / length, b = glm::cross(p.ng, a);
  const MaskOf<F> aslant = length > 1e-4f;
  if (lanes::any(!aslant)) {
    Vec3Of<F> x, y;
    orthonormal_basis(p.ng, x, y);
    a = lanes::select(aslant, a, x);
    b = lanes::select(aslant, b, y);
  }
  return {p, lanes::select(known, a * (width / cosine), nothing), lanes::select(known, b * width, nothing)};
}
template FootprintOf<float> PathTracer::Shader::footprint_of(const SurfacePoint&, const Vec3&, float);
template FootprintOf<Float8> PathTracer::Shader::footprint_of(const SurfacePointOf<Float8>&, const Vec3x8&, Float8);

void PathTracer::Shader::end() {
  const PathSegment& s = *path;
  if (tracer.light_paths_ != LightPaths::none && !(s.flags & kLightPath) && !(end_flags & kEndInvalid) && begin_light_path()) return;
  if (tracer.job_.features) {
    if (!(s.flags & kHitTold)) end_flags |= kEndWithoutHit;
    if (!(s.flags & kSurfaceTold)) end_flags |= kEndWithoutSurface;
  }
  if (s.flags & kHoldsGroup)
    for (std::uint32_t i = 1; i < group_of(s); ++i) {
      const auto untold = static_cast<std::uint16_t>(end_flags & (kEndWithoutHit | kEndWithoutSurface));
      out.ended.push_back({s.task, s.pixel, s.sample + 2 * i, s.owner, untold, {}, target});
    }
  out.ended.push_back({s.task, s.pixel, s.sample, s.owner, end_flags, s.radiance, target});
  const auto index = static_cast<std::uint32_t>(out.ended.size() - 1);
  for (std::size_t i = first_shadow; i < shadows.lights.size(); ++i) {
    shadows.lights[i].path = index;
    shadows.lights[i].path_ended = true;
  }
}

PathSegment& PathTracer::Shader::next() {
  PathSegment& s = out.continuing.emplace_back(*path);
  s.best = {};
  s.tested = 0;
  s.window = 0;
  s.flags = static_cast<std::uint16_t>(s.flags & ~(kMainTested | kCameraRay | kHoldsGroup));
  ++out.counts.bounce;
  const auto index = static_cast<std::uint32_t>(out.continuing.size() - 1);
  for (std::size_t i = first_shadow; i < shadows.lights.size(); ++i) {
    shadows.lights[i].path = index;
    shadows.lights[i].path_ended = false;
  }
  return s;
}

template <class F>
Vec3Of<F> PathTracer::Shader::escaped(MaskOf<F> active, const EscapeOf<F>& e, bool weighted) const {
  // Lanes that are off have no light, and one path is never off.
  const auto infinite = [&](auto&&... asked) {
    if constexpr (std::is_same_v<F, float>) return tracer.lights_->escaped(asked...);
    else return tracer.lights_->escaped(active, asked...);
  };
  if (!weighted) return e.throughput * infinite(e.from, e.direction);
  F pdf;
  const Vec3Of<F> radiance = infinite(e.from, e.normal, e.direction, pdf);
  return e.throughput * radiance * power_weight(e.pdf, pdf);
}
template Vec3x8 PathTracer::Shader::escaped<Float8>(Mask8, const EscapeOf<Float8>&, bool) const;

void PathTracer::Shader::escape() {
  const PathSegment& s = *path;
  if (finds_infinite(s) && shares_with_lights(s)) {
    float weight = 1, pdf;
    Rgb radiance;
    if (s.flags & kSpecularBounce) {
      radiance = tracer.lights_->escaped(s.scattered_at(), s.direction);
    } else {
      radiance = tracer.lights_->escaped(s.scattered_at(), s.previous_normal, s.direction, pdf);
      weight = power_weight(s.previous_pdf, pdf);
    }
    add(s.throughput * radiance * shared_weight(s, weight, tracer.lights_->infinite_emission(s.origin, s.direction)));
  } else if (finds_infinite(s)) {
    add(escaped<float>(true, {s.direction, s.throughput, s.scattered_at(), s.previous_normal, s.previous_pdf},
                       !(s.flags & kSpecularBounce)) * times_seen(s));
  }
  end();
}

// One ray of ambient occlusion over the hemisphere; pbrt-v2's begin 0.01 away.
void PathTracer::Shader::occlusion(const SurfacePoint& p, const Vec3& offset, const SampleSequence& sequence) {
  const PathSegment& s = *path;
  const Vec3 n = glm::dot(p.ng, s.direction) > 0.f ? -p.ng : p.ng;
  const Vec2 u = sequence.get_pairs(0)[kDirection];
  const Vec3 w = Frame(n).to_world(tracer.job_.ao_cosine ? sample_cosine_hemisphere(u) : sample_uniform_hemisphere(u));
  ++out.counts.shadow;
  // pbrt-v2 counts what is not hidden, later ones its cosines.
  const float cosine = tracer.dialect_ == Dialect::v2 || tracer.job_.ao_cosine ? 1.f : 2.f * glm::dot(w, n);
  if (OcclusionRay* const ray = shadow(s.throughput * cosine)) {
    const float from = tracer.dialect_ == Dialect::v2 ? 0.01f : 0.f;
    *ray = {ray_start(p.p, offset, p.ng, w) + from * w, w, std::max(0.f, std::min(tracer.job_.ao_distance, 1e18f) - from)};
    if (tracer.grids_) put_channel(*ray, tracer.channel_of(s));
  }
  end();
}

// Light that arrives from a chosen point of a light, weighted against finding it by the BSDF's sample (Veach 1995).
template <class F>
void PathTracer::Shader::direct(const BsdfOf<F>& bsdf, MaskOf<F> active, ScatterOf<F>& v) const {
  // From where the next ray starts: the density of the choice must be the same there when that ray finds a light, and
  // it jumps in the plane of an emitter.
  const Vec3Of<F> towards = lanes::select(lanes::is_black(v.side), v.wo, v.side);
  const Vec3Of<F> from = ray_start(v.p, v.offset, v.ng, towards);
  LightSampleOf<F> sample;
  MaskOf<F> arrives = sample_light(active, from, v.side, v.numbers[kLightChoice].x, v.numbers[kLightPoint], sample);
  if (!lanes::any(arrives)) return;
  F pdf;
  const Vec3Of<F> f = bsdf.eval_cos(v.wo, sample.wi, pdf);
  arrives = arrives && !lanes::is_black(f);
  if (tracer.even_lobes_) pdf = bsdf.even_pdf(v.wo, sample.wi);
  if (v.shares) pdf *= v.group;  // so many rays may find the light
  F weight = lanes::select(sample.delta, F(1.f), power_weight<F>(sample.weight_pdf, pdf));
  if (tracer.light_paths_ == LightPaths::all) weight = with_light_paths(weight, sample_ratio(bsdf, v, sample));
  v.asks = arrives;
  v.light_origin = ray_start(v.p, v.offset, v.ng, sample.wi);
  v.light_direction = sample.wi;
  v.light_distance = shadow_length(sample.distance);
  v.light = v.throughput * f * sample.radiance * (weight / sample.pdf);
  if (v.shares) v.light *= v.group;
}

// Ends paths that have come far enough, and some that carry little (Russian roulette).
template <class F>
void PathTracer::Shader::thin_out(ScatterOf<F>& v) const {
  const JobSettings& job = tracer.job_;
  const auto at_most = [](std::uint32_t n) { return static_cast<std::int32_t>(std::min(n, 0x7fffffffu)); };
  v.invalid = v.goes_on && !lanes::is_finite<F>(v.throughput);
  const IntOf<F> vertex = v.vertex + 1;
  const MaskOf<F> spent = lanes::greater(vertex, at_most(job.light_vertices) - 1);
  // The ray is only the other half of the light sample at this vertex.
  v.last = !v.specular && (spent || MaskOf<F>(job.integrator == IntegratorKind::direct));
  const MaskOf<F> over = (v.last && MaskOf<F>(!tracer.hittable_lights_)) ||
                         (v.specular && spent && lanes::greater(vertex, at_most(job.emission_vertex)));
  // Of the magnitudes: filters with negative lobes give paths of negative weight.
  const F largest = lanes::max(lanes::abs(v.throughput.x), lanes::max(lanes::abs(v.throughput.y), lanes::abs(v.throughput.z)));
  const F survive = lanes::min(1.f, largest * kRouletteScale);
  const MaskOf<F> thin = lanes::greater(vertex, kRouletteFrom) && survive < 1.f;
  v.goes_on = v.goes_on && !v.invalid && !over && !(thin && v.numbers[kLobeAndRoulette].y >= survive);
  if (lanes::any(thin)) v.throughput = lanes::select(thin, v.throughput / survive, v.throughput);
}

template <class F>
void PathTracer::Shader::scatter(const BsdfOf<F>& bsdf, MaskOf<F> active, ScatterOf<F>& v) const {
  v.side = lit_side(bsdf, v.ns, bsdf.ng(), v.wo);
  if (bsdf.has_smooth() && !tracer.lights_->empty()) direct(bsdf, active && v.leads, v);
  choose_ray(bsdf, active, v);
}

template <class F>
void PathTracer::Shader::choose_ray(const BsdfOf<F>& bsdf, MaskOf<F> active, ScatterOf<F>& v) const {
  v.invalid = MaskOf<F>(false);
  BsdfSampleOf<F> sample;
  v.goes_on = active && bsdf.sample(v.wo, v.numbers[kLobeAndRoulette].x, v.numbers[kDirection], sample);
  if (!lanes::any(v.goes_on)) return;
  v.goes_on = v.goes_on && !lanes::is_black(sample.weight);
  v.throughput *= sample.weight;
  v.specular = sample.specular;
  thin_out(v);
  v.origin = ray_start(v.p, v.offset, v.ng, sample.wi);
  v.direction = sample.wi;
  v.pdf = tracer.even_lobes_ ? bsdf.even_pdf(v.wo, sample.wi) : sample.pdf;
  if (v.shares) v.pdf *= v.group;
  if (tracer.light_paths_ != LightPaths::none) v.ratio = light_ratio_behind(bsdf, v, sample);
}
template void PathTracer::Shader::direct<float>(const Bsdf&, bool, ScatterOf<float>&) const;
template void PathTracer::Shader::thin_out<float>(ScatterOf<float>&) const;
template void PathTracer::Shader::scatter<float>(const Bsdf&, bool, ScatterOf<float>&) const;
template void PathTracer::Shader::scatter<Float8>(const Bsdf8&, Mask8, ScatterOf<Float8>&) const;
template void PathTracer::Shader::choose_ray<Float8>(const Bsdf8&, Mask8, ScatterOf<Float8>&) const;

void PathTracer::Shader::scatter_group(const Bsdf& bsdf, ScatterOf<float>& v, float t) {
  const PathSegment whole = *path;
  const JobSettings& job = tracer.job_;
  const auto numbers_of = [&](std::uint32_t sample) {
    return SampleSequence(job.sequence, job.seed, whole.pixel, sample).get_pairs(whole.vertex);
  };
  const std::uint32_t n = group_of(whole);
  const auto light_numbers = numbers_of(tracer.ray_sample(whole));
  v.numbers[kLightChoice] = light_numbers[kLightChoice];
  v.numbers[kLightPoint] = light_numbers[kLightPoint];
  v.shares = true;
  v.group = static_cast<float>(n);
  v.leads = leads(whole);
  const Vec3 throughput = v.throughput;
  path->flags = static_cast<std::uint16_t>(whole.flags & ~kHoldsGroup);
  scatter(bsdf, true, v);
  scattered(ScatterResults(v), 0, t);
  if (!(whole.flags & kHoldsGroup)) return;
  v.asks = false;
  PathSegment member;
  for (std::uint32_t i = 1; i < n; ++i) {
    begin_member(whole, i, member);
    const auto own = numbers_of(member.sample);
    for (const std::size_t pair : {kLobeAndRoulette, kDirection}) v.numbers[pair] = own[pair];
    v.throughput = throughput;
    choose_ray(bsdf, true, v);
    scattered(ScatterResults(v), 0, t);
  }
}

void PathTracer::Shader::ask_for_light(const ScatterResults& r, std::size_t lane) {
  using R = ScatterResults;
  if (!(r.asks >> lane & 1u)) return;
  const float* const row = r.rows[lane];
  ++out.counts.shadow;
  static_assert(sizeof(OcclusionRay) == (R::light_distance + 1 - R::light_origin) * sizeof(float));
  if (r.quantised >> lane & 1u) {
    shadows.lights.emplace_back().contribution = r.fixed(lane);
    std::memcpy(static_cast<void*>(&shadows.rays.emplace_back()), row + R::light_origin, sizeof(OcclusionRay));
    return;
  }
  Vec3 light = r.get(R::light, lane);
  if (tracer.media_) light *= shadow_transmittance(r.get(R::light_origin, lane), r.get(R::light_direction, lane), row[R::light_distance]);
  if (OcclusionRay* const ray = shadow(light)) {
    std::memcpy(static_cast<void*>(ray), row + R::light_origin, sizeof(*ray));
    if (tracer.grids_) put_channel(*ray, tracer.channel_of(*path));
  }
}

void PathTracer::Shader::scattered(const ScatterResults& r, std::size_t lane, float t) {
  using R = ScatterResults;
  const float* const row = r.rows[lane];
  ask_for_light(r, lane);
  if (!(r.goes_on >> lane & 1u)) {
    if (r.invalid >> lane & 1u) {
      ++out.counts.invalid;
      end_flags |= kEndInvalid;
    }
    return end();
  }
  PathSegment& s = next();
  constexpr std::size_t kRay = offsetof(PathSegment, previous_pdf) + sizeof(float);
  static_assert(offsetof(PathSegment, origin) == 0 && kRay == (R::pdf + 1 - R::origin) * sizeof(float));
  std::memcpy(static_cast<void*>(&s), row + R::origin, kRay);
  s.previous_normal = r.get(R::side, lane);
  s.medium = medium_towards(s.direction);
  ++s.vertex;
  if (r.last >> lane & 1u) s.flags |= kLastRay;
  if (r.specular >> lane & 1u) {
    s.flags |= kSpecularBounce;
    if (s.has_light_ratio())
      s.light_ratio() = row[R::ratio];
    else
      s.cone_width += s.cone_spread * t;
    s.previous_pdf = 0;
  } else {
    s.flags = static_cast<std::uint16_t>((s.flags & ~kSpecularBounce) | kAnyNonSpecular);
    // As in pbrt, textures seen by light that has scattered are not filtered.
    s.cone_width = 0;
    s.light_ratio() = row[R::ratio];
  }
}

void PathTracer::Shader::vertex(const Hit& hit) {
  PathSegment& s = *path;
  const JobSettings& job = tracer.job_;
  std::uint32_t material, light;
  SurfacePoint p = surface(s.origin, s.direction, hit, material, light, tracer.uv_);
  const Vec3 offset = ray_offset(p.p, p.p_error, p.ng);

  const bool is_null = tracer.shading_->is_null(material);
  if (is_null && group_of(s) > 1) return each_alone([&] { vertex(hit); });
  if (tells_features() && !is_null) tell_surface(hit, material, p);
  const bool sees_light = job.integrator != IntegratorKind::ambient_occlusion;
  if (!sees_light && !is_null) {
    occlusion(p, offset, SampleSequence(job.sequence, job.seed, s.pixel, s.sample));
    return;
  }
  if (light != kNone && sees_light) {
    const Rgb radiance = tracer.lights_->emitted(light, p.ng, s.direction, hit.primitive, p.uv);
    if (!is_black(radiance)) {
      const float emission = shares_with_lights(s) ? tracer.lights_->shape_emission(light, hit.primitive, p.p, s.direction) : 0.f;
      if (s.flags & kSpecularBounce) {
        // pbrt-v3's integrators of direct light go on from surfaces without material before they look whether these shine.
        const bool unseen = is_null && job.integrator == IntegratorKind::direct && tracer.dialect_ == Dialect::v3;
        if (s.vertex <= job.emission_vertex && !unseen) add(s.throughput * radiance * (shared_weight(s, 1.f, emission) * times_seen(s)));
      } else if (!tracer.lights_->is_only_seen(light)) {
        const float way = hit.t + std::max(0.f, -s.cone_width);
        const float pdf = tracer.lights_->emitted_pdf(light, s.scattered_at(), s.previous_normal, s.direction, way, p.p, p.ng, hit.primitive);
        add(s.throughput * radiance * shared_weight(s, power_weight(s.previous_pdf, pdf), emission));
      }
    }
  }
  if (material < tracer.interfaces_.size()) {
    interface = tracer.interfaces_[material];
    interface_ng = p.ng;
  }
  if (is_null) {
    // The surface is passed through. Where shadow rays do not pass it, light that a scattered ray finds behind it does
    // not count, as in pbrt-v3's `path` (the two must agree): a density of 0 has no weight. In pbrt-v4's it is all that counts.
    const bool shadows_pass = tracer.null_surfaces_ && hit.part == 0;
    if (!shadows_pass && job.lit_behind_null) {
      s.flags |= kSpecularBounce;
    } else if (!shadows_pass) {
      s.previous_pdf = 0;
      if (s.flags & kLastRay) return end();
    }
    if (++s.passed > kMaxPassed) return end();
    if (shadows_pass && !(s.flags & kSpecularBounce))
      s.cone_width -= hit.t;
    else if (!s.has_light_ratio())
      s.cone_width += s.cone_spread * hit.t;
    PathSegment& behind = next();
    behind.origin = ray_start(p.p, offset, p.ng, s.direction);
    behind.medium = medium_towards(s.direction);
    return;
  }
  if (is_over(s)) return end();
  scatter_or_wait(material, p, offset, footprint(p, hit.t), hit);
}

void PathTracer::Shader::scatter_or_wait(std::uint32_t material, SurfacePoint& p, const Vec3& offset, const Footprint& print, const Hit& hit) {
  if (eight && eight->take_textured(material, p, offset, print, *path)) return;
  scatter_at(material, p, offset, print, hit);
}

void PathTracer::Shader::scatter_at(std::uint32_t material, SurfacePoint& p, const Vec3& offset, const Footprint& print, const Hit& hit) {
  const PathSegment& s = *path;
  const float t = hit.t;
  if (SubsurfacePoint inside; tracer.subsurface_ && tracer.shading_->subsurface(material, p, print, inside))
    return each_alone([&] {
      SurfacePoint at = p;
      enter(material, inside.medium, at, print, t);
    });
  const Vec3 wo = -s.direction;
  Bsdf bsdf = tracer.shading_->lobes(material, p, print, is_regularized(s));
  if (bsdf.empty()) return end();
  if (eight && eight->take(bsdf, p, offset, s)) return;
  bsdf.finish(wo);
  const auto numbers = SampleSequence(tracer.job_.sequence, tracer.job_.seed, s.pixel, s.sample).get_pairs(s.vertex);
  ScatterOf<float> v = scatter_of(p, offset, wo, s, numbers);
  v.ratio = tracer.light_ratio(s, hit);
  if (group_of(s) > 1) return scatter_group(bsdf, v, t);
  scatter(bsdf, true, v);
  scattered(ScatterResults(v), 0, t);
}

void PathTracer::shade(SegmentBatch& batch, ShadeOutput& out) const {
  const BatchTimer timer(time_.shade);
  const auto set = resident_.snapshot();
  Shadows shadows;
  shadows.rays.reserve(batch.size());
  shadows.lights.reserve(batch.size());
  out.continuing.reserve(out.continuing.size() + batch.size());
  out.ended.reserve(out.ended.size() + batch.size());
  Shader shader{*this, *set, out, shadows, batch.surfaces};
  EightShader eight(shader, batch);
  if (!media_) shader.eight = &eight;
  shader.plain_light = !media_ && !motion_;
  for (std::size_t i = 0; i < batch.size(); ++i) {
    const std::uint32_t part = batch.hits[i].part;
    if (part < kAnsweredPart && !set->has(part)) {
      out.absent.segments.push_back(batch.segments[i]);
      out.absent.hits.push_back(batch.hits[i]);
      out.absent.next.emplace_back(part);
      continue;
    }
    if (batch.segments[i].flags & kInside) {
      shader.begin(batch.segments[i]);
      shader.walk(batch.hits[i]);
      continue;
    }
    if (batch.segments[i].flags & kLightPath) {
      shader.begin(batch.segments[i]);
      if (part == kNone)
        shader.end();
      else
        shader.light_vertex(batch.hits[i]);
      continue;
    }
    if (!media_ && eight.take(i)) continue;
    shader.begin(batch.segments[i]);
    if (media_ && !shader.cross_media(part == kNone ? kInfinity : batch.hits[i].t)) continue;
    if (part == kNone)
      shader.escape();
    else if (batch.hits[i].geometry == kBrickHit)
      shader.collide(batch.hits[i]);
    else
      shader.vertex(batch.hits[i]);
  }
  eight.finish();
  resolve_shadows(*set, shadows, out);
}

}  // namespace cloudrenderer
