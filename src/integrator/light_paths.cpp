// Paths from lights (job.light_paths). They bring what paths from the camera seldom or never find: light that comes by specular
// surfaces to one that is not, and from there, directly or by others, to what the camera sees; or all light that comes by one
// surface or more to what the camera sees. A sample's path begins one when it has ended; it travels as any other and brings
// light to at most one pixel of the film. What paths of both kinds and light samples can find is weighted by the power
// heuristic (Veach 1995), with the ratio of their densities kept up from vertex to vertex (as by Georgiev et al. 2012, "Light
// Transport Simulation with Vertex Connection and Merging", with fewer techniques). For these ratios specular lobes are as
// likely from either side, which weights may say: they only have to agree.
#include <cmath>

#include "integrator/shader.h"
#include "shading/bsdf_lobes.h"

namespace cloudrenderer {
namespace {

// Numbers of the light's ray, and behind it of the vertices.
constexpr std::uint32_t kLightNumbers = 0x40000000u;

// A ray's flux changes by this, besides what the BSDF says, where the shading normal is not the surface's (Veach 1996, "Non-
// symmetric scattering in light transport algorithms"), and where a specular lobe has taken it for radiance.
float flux_factor(const Bsdf& bsdf, const Vec3& from, const BsdfSample& to) {
  const auto cosine = [](const Vec3& n, const Vec3& w) { return std::fabs(glm::dot(n, w)); };
  const Vec3 &ns = bsdf.frame().n, &ng = bsdf.ng();
  float factor = cosine(ns, from) * cosine(ng, to.wi) / (cosine(ng, from) * cosine(ns, to.wi));
  if (to.transmission && to.eta > 0.f) {
    bool scales = false;
    for (int i = 0; i < bsdf.lobe_count(); ++i) scales = scales || bsdf.lobe(i).scale_radiance;
    factor *= scales ? to.eta * to.eta : 1.f / (to.eta * to.eta);
  }
  return factor;
}

bool has_specular(const Bsdf& bsdf) {
  for (int i = 0; i < bsdf.lobe_count(); ++i)
    if (bsdf.lobe(i).kind >= LobeKind::specular_reflection) return true;
  return false;
}

}  // namespace

float PathTracer::light_ratio(const PathSegment& s, const Hit& hit) const {
  if (light_paths_ == LightPaths::none || hit.geometry == kCurveHit) return 0.f;
  if (s.has_light_ratio()) return s.light_ratio();
  // Rays to the camera pass nothing, and begin at surfaces that scatter.
  return s.vertex == 0 && s.passed == 0 ? film_pixels_ / camera_->density(s.direction, hit.t) : 0.f;
}

template <class F>
F PathTracer::Shader::light_ratio_behind(const BsdfOf<F>& bsdf, const ScatterOf<F>& v, const BsdfSampleOf<F>& sample) const {
  BsdfOf<F> back(bsdf);
  back.finish(sample.wi);
  const F returns = lanes::select(lanes::greater(v.vertex, 0), (1.f - kConnect) * back.pdf(sample.wi, v.wo), F(1.f));
  const F bends = lanes::abs(glm::dot(v.ng, sample.wi)) / lanes::abs(glm::dot(v.ng, v.wo));
  const F ratio = v.ratio * bends * returns / sample.pdf;
  return lanes::select(sample.specular, v.ratio, lanes::select(ratio < 1e30f, ratio, F(1e30f)));
}
template float PathTracer::Shader::light_ratio_behind<float>(const Bsdf&, const ScatterOf<float>&, const BsdfSample&) const;
template Float8 PathTracer::Shader::light_ratio_behind<Float8>(const Bsdf8&, const ScatterOf<Float8>&, const BsdfSampleOf<Float8>&) const;

template <class F>
F PathTracer::Shader::sample_ratio(const BsdfOf<F>& bsdf, const ScatterOf<F>& v, const LightSampleOf<F>& sample) const {
  BsdfOf<F> back(bsdf);
  back.finish(sample.wi);
  const F bends = lanes::abs(glm::dot(v.ng, sample.wi)) / lanes::abs(glm::dot(v.ng, v.wo));
  const F ratio = v.ratio * bends * back.pdf(sample.wi, v.wo) * (kConnect * sample.emission / sample.pdf);
  return lanes::select(lanes::greater(v.vertex, 0) && ratio > 0.f, ratio, F(0.f));
}
template float PathTracer::Shader::sample_ratio<float>(const Bsdf&, const ScatterOf<float>&, const LightSample&) const;
template Float8 PathTracer::Shader::sample_ratio<Float8>(const Bsdf8&, const ScatterOf<Float8>&, const LightSample8&) const;

bool PathTracer::Shader::light_ray(LightRay& ray) const {
  const auto numbers = SampleSequence(tracer.job_.sequence, tracer.job_.seed, path->pixel, path->sample).get_pairs(kLightNumbers);
  return tracer.lights_->emit(numbers[0].x, numbers[1], numbers[2], ray);
}

bool PathTracer::Shader::begin_light_path() {
  const PathSegment& s = *path;
  LightRay ray;
  if (!light_ray(ray)) return false;
  PathSegment& to = next();
  to.origin = ray.origin;
  to.direction = ray.direction;
  to.throughput = ray.weight;
  to.previous_pdf = 0;
  to.previous_normal = Vec3(0.f);
  to.vertex = to.passed = to.medium = 0;
  to.flags = static_cast<std::uint16_t>((s.flags & (kHitTold | kSurfaceTold)) | kLightPath | kSpecularBounce);
  to.cone_width = 0;
  to.light_ratio() = 0;
  return true;
}

void PathTracer::Shader::light_vertex(const Hit& hit) {
  PathSegment& s = *path;
  const JobSettings& job = tracer.job_;
  std::uint32_t material, light;
  SurfacePoint p = surface(s.origin, s.direction, hit, material, light, tracer.uv_);
  const Vec3 offset = ray_offset(p.p, p.p_error, p.ng);
  if (tracer.shading_->is_null(material)) {
    if (++s.passed > kMaxPassed) return end();
    next().origin = ray_start(p.p, offset, p.ng, s.direction);
    return;
  }
  // What a ray meets of a curve depends on where it comes from: no path could be the other way round.
  if (hit.geometry == kCurveHit) return end();
  const bool first = s.vertex == 0, caustics = tracer.light_paths_ == LightPaths::caustics;
  const std::uint32_t vertices = s.vertex + 1u;  // with this one
  // What has a medium inside is for paths from the camera only, which weigh it so.
  if (SubsurfacePoint inside; tracer.subsurface_ && tracer.shading_->subsurface(material, p, Footprint{}, inside)) return end();
  Bsdf bsdf = tracer.shading_->lobes(material, p, Footprint{});
  if (bsdf.empty() || (first && caustics && !has_specular(bsdf))) return end();
  const Vec3 wo = -s.direction;
  const auto numbers = SampleSequence(job.sequence, job.seed, s.pixel, s.sample).get_pairs(kLightNumbers + vertices);
  const bool may_connect = !first && bsdf.has_smooth();
  if (may_connect && numbers[kLightChoice].x < kConnect) {
    connect(bsdf, p, offset, numbers);
    return end();
  }
  bsdf.finish(wo);
  BsdfSample sample;
  if (!bsdf.sample(wo, numbers[kLobeAndRoulette].x, numbers[kDirection], sample)) return end();
  // Light that scatters behind a surface without material counts from the other side neither.
  if (first && !sample.specular && (caustics || s.passed > 0)) return end();
  const bool scattered = first ? !sample.specular : (s.flags & kLightScattered) != 0;
  if (vertices >= (scattered ? job.light_vertices : job.emission_vertex)) return end();
  LightRay light_before;
  float emission = 0;
  if (first) {
    if (!light_ray(light_before)) return end();
    emission = tracer.lights_->emission(light_before.emitter, p.p, wo, glm::length(light_before.origin - p.p));
  }
  Rgb change;
  float ratio = s.light_ratio(), sampled = s.previous_pdf;
  if (sample.specular) {
    change = sample.weight * flux_factor(bsdf, wo, sample);
    if (first) ratio = light_before.found ? emission : kInfinity;
  } else {
    // The other way round, as a path from the camera meets the surface.
    Bsdf seen(bsdf);
    seen.finish(sample.wi);
    float pdf;
    const Rgb f = seen.eval_cos(sample.wi, wo, pdf);
    const float bends = std::fabs(glm::dot(p.ng, sample.wi)) / std::fabs(glm::dot(p.ng, wo));
    if (!(pdf > 0.f)) return end();
    change = f * (bends / sample.pdf);
    if (first) {
      // As in direct().
      const Vec3 side = lit_side<float>(seen, p.ns, seen.ng(), sample.wi);
      const float by_sample = tracer.lights_->pdf_of(light_before, ray_start(p.p, offset, p.ng, is_black(side) ? sample.wi : side), side);
      ratio = emission * sample.pdf / (bends * (light_before.found ? pdf : by_sample));
      sampled = light_before.found ? (by_sample / pdf) * (by_sample / pdf) : 0.f;
    } else {
      ratio *= sample.pdf * (1.f - kConnect) / (bends * pdf);
    }
  }
  if (may_connect) change /= 1.f - kConnect;
  const float survive = std::min(1.f, max_component(change));
  if (!(numbers[kLobeAndRoulette].y < survive)) return end();
  const Rgb throughput = s.throughput * change / survive;
  if (!is_finite(throughput)) {
    ++out.counts.invalid;
    return end();
  }
  PathSegment& to = next();
  to.origin = ray_start(p.p, offset, p.ng, sample.wi);
  to.direction = sample.wi;
  to.throughput = throughput;
  to.light_ratio() = ratio;
  to.previous_pdf = sampled;
  ++to.vertex;
  if (first && scattered) to.flags |= kLightScattered;
  if (!sample.specular) to.flags = static_cast<std::uint16_t>((to.flags & ~kSpecularBounce) | kAnyNonSpecular);
}

// One of the pixels whose filter reaches the raster position, and the filter there over the choice's chance; 0: none.
float PathTracer::Shader::choose_pixel(const Vec2& film, float u, std::uint32_t& pixel) const {
  const FilmFrame& frame = tracer.job_.film.frame;
  const Vec2 width = tracer.filter_->width();
  const auto first = [](float x, float w, std::uint32_t low) { return std::max(static_cast<float>(low), std::ceil(x - w - 0.5f)); };
  const auto last = [](float x, float w, std::uint32_t high) { return std::min(static_cast<float>(high) - 1.f, std::floor(x + w - 0.5f)); };
  const float x0 = first(film.x, width.x, frame.x0), x1 = last(film.x, width.x, frame.x1);
  const float y0 = first(film.y, width.y, frame.y0), y1 = last(film.y, width.y, frame.y1);
  const auto at = [&](float x, float y) { return tracer.filter_->value(film - Vec2(x + 0.5f, y + 0.5f)); };
  float total = 0;
  for (float y = y0; y <= y1; ++y)
    for (float x = x0; x <= x1; ++x) total += std::fabs(at(x, y));
  if (!(total > 0.f)) return 0.f;
  float left = u * total, value = 0;
  for (float y = y0; y <= y1; ++y)
    for (float x = x0; x <= x1; ++x) {
      const float f = at(x, y);
      if (f == 0.f) continue;
      value = f < 0.f ? -total : total;
      pixel = static_cast<std::uint32_t>(y) * frame.width + static_cast<std::uint32_t>(x);
      left -= std::fabs(f);
      if (left < 0.f) return value;
    }
  return value;
}

void PathTracer::Shader::connect(Bsdf& bsdf, const SurfacePoint& p, const Vec3& offset, const SampleSequence::Pairs& numbers) {
  const PathSegment& s = *path;
  if (s.vertex + 1u > (s.flags & kLightScattered ? tracer.job_.light_vertices : tracer.job_.emission_vertex)) return;
  CameraView view;
  if (!tracer.camera_->view(p.p, numbers[kLightPoint], view)) return;
  std::uint32_t pixel = 0;
  const float filter = choose_pixel(view.film, numbers[kLightChoice].y, pixel);
  if (filter == 0.f) return;
  const Vec3 wo = -view.direction, wi = -s.direction;
  bsdf.finish(wo);
  float pdf;
  const Rgb f = bsdf.eval_cos(wo, wi, pdf);
  if (is_black(f) || !(pdf > 0.f)) return;
  const float bends = std::fabs(glm::dot(p.ng, wo)) / std::fabs(glm::dot(p.ng, wi));
  const float share = view.density / tracer.film_pixels_;  // of the film, in pictures of a pixel each
  const float ratio = s.light_ratio() * kConnect / (bends * pdf * share);
  const float weight = ratio > 0.f ? 1.f / (1.f + (1.f + s.previous_pdf) / ratio / ratio) : 0.f;
  const Rgb light = s.throughput * f * (bends * share * filter * weight / kConnect);
  if (is_black(light)) return;
  // No limit of the film for single samples holds here: by its density a path stands for many.
  if (!is_finite(light)) {
    ++out.counts.invalid;
    return;
  }
  Shadows::Light& asked = shadows.lights.emplace_back();
  bool clamped = false;
  for (std::size_t i = 0; i < 3; ++i) asked.contribution[i] = quantise(light[static_cast<int>(i)], tracer.fixed_units_, clamped);
  if (clamped) {
    ++out.counts.clamped;
    end_flags |= kEndClamped;
  }
  if (tracer.motion_) shadows.times.push_back(tracer.time_of(s));
  shadows.rays.push_back({ray_start(p.p, offset, p.ng, wo), wo, shadow_length(view.distance)});
  ++out.counts.shadow;
  target = pixel;
}

}  // namespace cloudrenderer
