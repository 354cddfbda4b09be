// The light transport. Everything that a path does at a surface is here and nowhere else.
#include <cmath>

#include "base/sampling.h"
#include "integrator/path_tracer.h"
#include "integrator/timer.h"
#include "shapes/surface.h"
#include "shapes/triangle.h"

namespace cloudrenderer {

namespace {

// What the four pairs of numbers of a vertex are for.
enum VertexPair : std::size_t { kLightChoice = 0, kLightPoint = 1, kLobeAndRoulette = 2, kDirection = 3 };

constexpr std::uint16_t kMaxPassed = 1000;    // null surfaces in a row of one path: none is endless
constexpr std::uint32_t kRouletteFrom = 3;    // vertex after which paths are thinned

// A path survives with this times its largest throughput, at most surely.
constexpr float kRouletteScale = 1.f;

// Shadow rays stop this far (relative) before the light's surface.
constexpr float kShadowEnd = 1.f - 1e-4f;

float power_weight(float a, float b) {
  if (!(a > 0.f)) return 0.f;
  const float a2 = a * a, b2 = b * b;
  return a2 / (a2 + b2);
}

// The side whose light matters (see Lights::sample). The geometric normal decides, as in Bsdf: with a shading normal
// that leans far from it, light from below the shading horizon is reflected too, and light along the surface strongly:
// then no side is preferred.
Vec3 lit_side(const Bsdf& bsdf, const SurfacePoint& p, const Vec3& wo) {
  const Vec3& ng = p.ng;
  if (std::fabs(glm::dot(p.ns, ng)) < 0.5f) return Vec3(0.f);
  for (int i = 0; i < bsdf.lobe_count(); ++i)
    if (bsdf.lobe(i).transmits || bsdf.lobe(i).kind == LobeKind::microfacet_dielectric) return Vec3(0.f);
  return glm::dot(ng, wo) < 0.f ? -ng : ng;
}

}  // namespace

// Light that arrives if its ray is free.
struct PathTracer::Shadow {
  OcclusionRay ray;
  Fixed3 contribution;
  std::uint32_t path;  // index into continuing or ended
  bool path_ended;
};

// Shades one batch; holds what the vertices of a batch share.
struct PathTracer::Shader {
  const PathTracer& tracer;
  const ResidentSet& set;
  ShadeOutput& out;
  std::vector<Shadow>& shadows;

  // The path under work.
  PathSegment s;
  std::uint16_t end_flags = 0;
  std::size_t first_shadow = 0;
  Vec3 offset;  // of new rays (ray_offset), at the point under work

  bool to_fixed(Rgb c, Fixed3& fixed) {
    const float limit = tracer.job_.film.max_sample_luminance;
    if (limit < kInfinity) {
      const float y = luminance(c);
      if (y > limit) c *= limit / y;
    }
    if (!is_finite(c)) {
      ++out.counts.invalid;
      end_flags |= kEndInvalid;
      return false;
    }
    bool clamped = false;
    fixed = quantise(c, tracer.job_.k, clamped);
    if (clamped) {
      ++out.counts.clamped;
      end_flags |= kEndClamped;
    }
    return true;
  }
  void add(const Rgb& c) {
    if (is_black(c)) return;
    Fixed3 f;
    if (!to_fixed(c, f)) return;
    for (std::size_t i = 0; i < 3; ++i) s.radiance[i] += f[i];
  }
  void shadow(const OcclusionRay& ray, const Rgb& c) {
    if (is_black(c)) return;
    Fixed3 f;
    if (to_fixed(c, f)) shadows.push_back({ray, f, 0, false});
  }

  SurfacePoint surface(const Hit& hit, std::uint32_t& material, std::uint32_t& light, bool derivatives) const;
  Footprint footprint(const SurfacePoint& p, float t) const;
  void vertex(const Hit& hit);
  void escape();
  void end();
  void next(const SurfacePoint& p, const Vec3& direction);
  void occlusion(SurfacePoint& p, const SampleSequence& sequence);
  void direct(const SurfacePoint& p, const Vec3& side, const Bsdf& bsdf, const Vec3& wo,
              const SampleSequence::Pairs& numbers);
};

SurfacePoint PathTracer::Shader::surface(const Hit& hit, std::uint32_t& material, std::uint32_t& light,
                                         bool derivatives) const {
  const Part& part = hit.instance == kNone ? set.part(hit.part) : set.prototype(hit.part, hit.instance);
  SurfacePoint p;
  const Transform* to_world = hit.instance == kNone ? nullptr : &set.part(hit.part).instances[hit.instance].to_world;
  if (hit.geometry == 0) {
    const MeshChunk& c = part.chunk_of(hit.index);
    material = c.material;
    light = c.light;
    const Triangle index = part.triangles[hit.index];
    TriangleVertices tri;
    for (int i = 0; i < 3; ++i) tri.p[static_cast<std::size_t>(i)] = part.positions[index[i]];
    if (c.first_normal != kNone) {
      tri.has_normals = true;
      for (int i = 0; i < 3; ++i) tri.n[static_cast<std::size_t>(i)] = part.normals[c.first_normal + index[i] - c.first_vertex];
    }
    // pbrt-v2 takes the side of a triangle from its uv map.
    if (c.first_uv != kNone && (derivatives || tracer.dialect_ == Dialect::v2)) {
      tri.has_uvs = true;
      for (int i = 0; i < 3; ++i) tri.uv[static_cast<std::size_t>(i)] = part.uvs[c.first_uv + index[i] - c.first_vertex];
    }
    p = triangle_point(tri, c.flip != 0, tracer.dialect_, hit.u, hit.v, derivatives);
  } else {
    const QuadricRecord& q = part.quadrics[hit.index];
    material = q.material;
    light = q.light;
    Vec3 o = s.origin, d = s.direction;
    if (to_world) {
      const Transform inverse = to_world->inverse();
      o = inverse.point(o);
      d = inverse.vector(d);
    }
    p = surface_point(q.quadric, q.flip != 0, o, d, hit.t);
  }
  if (to_world) p = transformed(p, *to_world);
  return p;
}

// The pixel's cone cut by the tangent plane: stretched along the ray by 1 / cos.
Footprint PathTracer::Shader::footprint(const SurfacePoint& p, float t) const {
  const float width = s.cone_width + s.cone_spread * t;
  if (!(width > 0.f)) return {};
  const Vec3 wo = -s.direction;
  const float cosine = std::max(std::fabs(glm::dot(wo, p.ng)), 0.01f);
  Vec3 along = s.direction - p.ng * glm::dot(s.direction, p.ng);
  const float length = glm::length(along);
  Vec3 a, b;
  if (length > 1e-4f) {
    a = along / length;
    b = glm::cross(p.ng, a);
  } else {
    orthonormal_basis(p.ng, a, b);
  }
  return {a * (width / cosine), b * width};
}

void PathTracer::Shader::end() {
  out.ended.push_back({s.task, s.pixel, s.sample, s.owner, end_flags, s.radiance});
  const auto index = static_cast<std::uint32_t>(out.ended.size() - 1);
  for (std::size_t i = first_shadow; i < shadows.size(); ++i) {
    shadows[i].path = index;
    shadows[i].path_ended = true;
  }
}

// Sends the path on from p.
void PathTracer::Shader::next(const SurfacePoint& p, const Vec3& direction) {
  s.origin = ray_start(p.p, offset, p.ng, direction);
  s.direction = direction;
  s.best = {};
  s.tested = 0;
  s.window = 0;
  s.flags = static_cast<std::uint16_t>(s.flags & ~(kMainTested | kCameraRay));
  ++out.counts.bounce;
  out.continuing.push_back(s);
  const auto index = static_cast<std::uint32_t>(out.continuing.size() - 1);
  for (std::size_t i = first_shadow; i < shadows.size(); ++i) {
    shadows[i].path = index;
    shadows[i].path_ended = false;
  }
}

void PathTracer::Shader::escape() {
  const Lights& lights = *tracer.lights_;
  if (lights.has_infinite() && tracer.job_.integrator != IntegratorKind::ambient_occlusion) {
    if (s.flags & kSpecularBounce) {
      if (s.vertex <= tracer.job_.emission_vertex) {
        add(s.throughput * lights.escaped(s.direction));
      }
    } else {
      float pdf;
      const Rgb radiance = lights.escaped(s.origin, s.previous_normal, s.direction, pdf);
      add(s.throughput * radiance * power_weight(s.previous_pdf, pdf));
    }
  }
  end();
}

// One ray of ambient occlusion over the hemisphere (pbrt-v2: uniform, from 0.01 on).
void PathTracer::Shader::occlusion(SurfacePoint& p, const SampleSequence& sequence) {
  const Vec3 n = glm::dot(p.ng, s.direction) > 0.f ? -p.ng : p.ng;
  const Vec2 u = sequence.get_pairs(0)[kDirection];
  const Vec3 w = Frame(n).to_world(tracer.job_.ao_cosine ? sample_cosine_hemisphere(u) : sample_uniform_hemisphere(u));
  ++out.counts.shadow;
  shadow({ray_start(p.p, offset, p.ng, w), w, std::min(tracer.job_.ao_distance, 1e18f)}, s.throughput);
  end();
}

// Light that arrives from a chosen point of a light, weighted against finding it by the BSDF's sample (Veach 1995).
void PathTracer::Shader::direct(const SurfacePoint& p, const Vec3& side, const Bsdf& bsdf, const Vec3& wo,
                                const SampleSequence::Pairs& numbers) {
  // From where the next ray starts: the density of the choice must be the same there when that ray finds a light, and
  // it jumps in the plane of an emitter.
  const Vec3 from = ray_start(p.p, offset, p.ng, side == Vec3(0.f) ? wo : side);
  LightSample sample;
  if (!tracer.lights_->sample(from, side, numbers[kLightChoice].x, numbers[kLightPoint], sample)) return;
  if (!(sample.pdf > 0.f)) return;
  float pdf = 0;
  const Rgb f = bsdf.eval_cos(wo, sample.wi, pdf);
  if (is_black(f)) return;
  if (tracer.even_lobes_) pdf = bsdf.even_pdf(wo, sample.wi);
  const float weight = sample.delta ? 1.f : power_weight(sample.weight_pdf, pdf);
  ++out.counts.shadow;
  const Vec3 origin = ray_start(p.p, offset, p.ng, sample.wi);
  shadow({origin, sample.wi, sample.distance < 1e18f ? sample.distance * kShadowEnd : 1e18f},
         s.throughput * f * sample.radiance * (weight / sample.pdf));
}

void PathTracer::Shader::vertex(const Hit& hit) {
  const JobSettings& job = tracer.job_;
  std::uint32_t material, light;
  SurfacePoint p = surface(hit, material, light, tracer.shading_->needs_uv());
  const Vec3 wo = -s.direction;
  offset = ray_offset(p.p, p.p_error, p.ng);

  if (job.integrator == IntegratorKind::ambient_occlusion) {
    occlusion(p, SampleSequence(job.sequence, job.seed, s.pixel, s.sample));
    return;
  }
  if (light != kNone) {
    const Rgb radiance = tracer.lights_->emitted(light, p.ng, p.uv, s.direction);
    if (!is_black(radiance)) {
      if (s.flags & kSpecularBounce) {
        if (s.vertex <= job.emission_vertex) add(s.throughput * radiance);
      } else {
        const float pdf = tracer.lights_->emitted_pdf(light, s.origin, s.previous_normal, s.direction, hit.t, p.p, p.ng, hit.primitive);
        add(s.throughput * radiance * power_weight(s.previous_pdf, pdf));
      }
    }
  }
  if (tracer.shading_->is_null(material)) {
    // The surface is passed through. As in pbrt's `path`, light that a scattered ray finds behind it does not count
    // (shadow rays are blocked by it, and the two must agree): a density of 0 has no weight.
    s.previous_pdf = 0;
    if (s.flags & kLastRay || ++s.passed > kMaxPassed) return end();
    s.cone_width += s.cone_spread * hit.t;
    return next(p, s.direction);
  }
  if ((s.flags & kLastRay) || s.vertex >= job.light_vertices) return end();

  const Footprint print = tracer.footprint_ ? footprint(p, hit.t) : Footprint{};
  const Bsdf bsdf = tracer.shading_->bsdf(material, p, wo, print);
  if (bsdf.empty()) return end();
  const auto numbers = SampleSequence(job.sequence, job.seed, s.pixel, s.sample).get_pairs(s.vertex);
  const bool lit = bsdf.has_smooth() && !tracer.lights_->empty();
  const Vec3 side = lit_side(bsdf, p, wo);
  if (lit) direct(p, side, bsdf, wo, numbers);

  const Vec2 choice = numbers[kLobeAndRoulette];
  BsdfSample sample;
  if (!bsdf.sample(wo, choice.x, numbers[kDirection], sample) || is_black(sample.weight)) return end();
  s.throughput *= sample.weight;
  if (!is_finite(s.throughput)) {
    ++out.counts.invalid;
    end_flags |= kEndInvalid;
    return end();
  }
  ++s.vertex;
  const bool last = !sample.specular && (job.integrator == IntegratorKind::direct || s.vertex >= job.light_vertices);
  if (last) {
    // The ray is only the other half of the light sample at this vertex.
    if (!tracer.hittable_lights_) return end();
    s.flags |= kLastRay;
  } else if (sample.specular && s.vertex > job.emission_vertex && s.vertex >= job.light_vertices) {
    return end();
  }
  if (s.vertex > kRouletteFrom) {
    const float survive = std::min(1.f, max_component(s.throughput) * kRouletteScale);
    if (survive < 1.f) {
      if (choice.y >= survive) return end();
      s.throughput /= survive;
    }
  }
  if (sample.specular) {
    s.flags |= kSpecularBounce;
    s.cone_width += s.cone_spread * hit.t;
    s.previous_pdf = 0;
  } else {
    s.flags = static_cast<std::uint16_t>((s.flags & ~kSpecularBounce) | kAnyNonSpecular);
    // As in pbrt, textures seen by light that has scattered are not filtered.
    s.cone_width = s.cone_spread = 0;
    s.previous_pdf = tracer.even_lobes_ ? bsdf.even_pdf(wo, sample.wi) : sample.pdf;
  }
  s.previous_normal = side;
  next(p, sample.wi);
}

// Tests the batch's shadow rays on what is resident and adds what is free; the rest is left to ask others.
void PathTracer::resolve_shadows(const ResidentSet& set, std::vector<Shadow>& shadows, ShadeOutput& out) const {
  if (shadows.empty()) return;
  std::vector<OcclusionRay> rays(shadows.size());
  std::vector<std::uint8_t> blocked(shadows.size());
  for (std::size_t i = 0; i < shadows.size(); ++i) rays[i] = shadows[i].ray;
  {
    const BatchTimer timer(time_.occlusion);
    find_blocked(set, rays, blocked);
  }
  std::vector<std::uint32_t> leaving;  // shadows that others must answer
  std::vector<Candidate> candidates(map_.part_count());
  const bool complete = one_part_ ? set.has(1) : false;
  for (std::size_t i = 0; i < shadows.size(); ++i) {
    if (blocked[i]) continue;
    const Shadow& w = shadows[i];
    if (!complete && map_.part_count() > 1) {
      const std::size_t n = std::min(map_.candidates(w.ray.origin, w.ray.direction, w.ray.t_max, candidates), candidates.size());
      const auto first = static_cast<std::uint32_t>(out.ask_parts.size());
      for (std::size_t c = 0; c < n; ++c)
        if (!set.has(candidates[c].part)) out.ask_parts.push_back(candidates[c].part);
      const auto count = static_cast<std::uint32_t>(out.ask_parts.size()) - first;
      if (count) {
        leaving.push_back(static_cast<std::uint32_t>(i));
        out.asks.push_back({w.ray, 0, first, count, w.contribution});
        continue;
      }
    }
    Fixed3& radiance = w.path_ended ? out.ended[w.path].radiance : out.continuing[w.path].radiance;
    for (std::size_t c = 0; c < 3; ++c) radiance[c] += w.contribution[c];
  }
  if (leaving.empty()) return;
  // Paths that wait move to `parked`; the rest close up. A path has at most one shadow ray a vertex.
  std::vector<std::uint8_t> gone_continuing(out.continuing.size()), gone_ended(out.ended.size());
  for (std::size_t a = 0; a < leaving.size(); ++a) {
    const Shadow& w = shadows[leaving[a]];
    out.asks[out.asks.size() - leaving.size() + a].parked = static_cast<std::uint32_t>(out.parked.size());
    ParkedPath parked;
    if (w.path_ended) {
      const PathEnd& e = out.ended[w.path];
      parked.segment.task = e.task;
      parked.segment.pixel = e.pixel;
      parked.segment.sample = e.sample;
      parked.segment.owner = e.owner;
      parked.segment.radiance = e.radiance;
      parked.ended = true;
      parked.invalid = e.flags & kEndInvalid;
      parked.clamped = e.flags & kEndClamped;
      gone_ended[w.path] = 1;
    } else {
      parked.segment = out.continuing[w.path];
      gone_continuing[w.path] = 1;
    }
    out.parked.push_back(parked);
  }
  const auto close_up = [](auto& list, const std::vector<std::uint8_t>& gone) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < list.size(); ++i)
      if (!gone[i]) list[kept++] = list[i];
    list.resize(kept);
  };
  close_up(out.continuing, gone_continuing);
  close_up(out.ended, gone_ended);
}

void PathTracer::shade(SegmentBatch& batch, ShadeOutput& out) const {
  const BatchTimer timer(time_.shade);
  const auto set = resident_.snapshot();
  std::vector<Shadow> shadows;
  shadows.reserve(batch.size());
  Shader shader{*this, *set, out, shadows, {}, 0, 0, Vec3(0.f)};
  for (std::size_t i = 0; i < batch.size(); ++i) {
    const std::uint32_t part = batch.hits[i].part;
    if (part != kNone && !set->has(part)) {
      out.absent.segments.push_back(batch.segments[i]);
      out.absent.hits.push_back(batch.hits[i]);
      out.absent.next.emplace_back(part);
      continue;
    }
    shader.s = batch.segments[i];
    shader.end_flags = 0;
    shader.first_shadow = shadows.size();
    if (shader.s.flags & kCameraRay) ++out.counts.camera;
    if (batch.hits[i].part == kNone)
      shader.escape();
    else
      shader.vertex(batch.hits[i]);
  }
  resolve_shadows(*set, shadows, out);
}

}  // namespace cloudrenderer
