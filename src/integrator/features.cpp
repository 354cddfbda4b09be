// What a path tells of the first surface that it sees: see film/features.h.
#include <array>

#include "integrator/shader.h"

namespace cloudrenderer {

namespace {

// Halton's points.
constexpr std::size_t kSamples = 16;
constexpr auto kPoints = [] {
  std::array<std::array<float, 2>, kSamples> points{};
  for (std::uint32_t i = 0; i < kSamples; ++i)
    for (std::uint32_t base = 2; base <= 3; ++base) {
      float digit = 1;
      for (std::uint32_t n = i + 1; n > 0; n /= base) {
        digit /= static_cast<float>(base);
        points[i][base - 2] += digit * static_cast<float>(n % base);
      }
    }
  return points;
}();

// Share of the light from all sides that goes on towards the viewer, by the BSDF's own samples at fixed numbers: the
// same for all paths, so that it has no noise.
Rgb albedo_of(const Bsdf& bsdf, const Vec3& wo) {
  Rgb sum(0.f);
  for (std::size_t i = 0; i < kSamples; ++i) {
    const float lobe = (static_cast<float>(i) + 0.5f) / static_cast<float>(kSamples);
    BsdfSample sample;
    if (bsdf.sample(wo, lobe, {kPoints[i][0], kPoints[i][1]}, sample) && is_finite(sample.weight)) sum += sample.weight;
  }
  return sum / static_cast<float>(kSamples);
}

// Of light that enters a half-space of the medium: the approximation of Kulla and Conty, "Revisiting Physically Based
// Shading at Imageworks" (2017), of the reduced albedo.
Rgb albedo_of(const InteriorMedium& medium) {
  Rgb out(0.f);
  for (int c = 0; c < 3; ++c) {
    const float scattered = medium.sigma_s[c] * (1.f - medium.g), sum = scattered + medium.sigma_a[c];
    const float s = sum > 0.f ? std::sqrt(medium.sigma_a[c] / sum) : 0.f;
    out[c] = (1.f - s) * (1.f - 0.139f * s) / (1.f + 1.17f * s);
  }
  return out;
}

void put(FeatureValues& values, std::size_t at, const Vec3& v, double units) {
  bool clamped = false;
  for (std::size_t i = 0; i < 3; ++i) values[at + i] = quantise(v[static_cast<int>(i)], units, clamped);
}

PathFeatures features_of(const PathSegment& s, bool of_surface) {
  PathFeatures f;
  f.task = s.task;
  f.pixel = s.pixel;
  f.sample = s.sample;
  f.owner = s.owner;
  f.flags = static_cast<std::uint16_t>((s.flags & kHitTold ? 0 : kTellsHit) | (of_surface ? kTellsSurface : 0));
  return f;
}

}  // namespace

// What mirrors, glass and media have left of white on the way to here.
Rgb PathTracer::tint(const PathSegment& s) const {
  if (s.vertex == 0 && !media_) return Rgb(1.f);
  const std::uint32_t x = s.pixel % job_.film.frame.width, y = s.pixel / job_.film.frame.width;
  std::vector<PathSegment> first;
  camera({s.task, x, y, x + 1, y + 1, s.sample, s.sample + 1, (s.flags & kSharesRay) != 0}, s.owner, 0, 1, first);
  Rgb tint(0.f);
  float largest = 0;
  for (int c = 0; c < 3; ++c) {
    if (first[0].throughput[c] != 0.f) tint[c] = s.throughput[c] / first[0].throughput[c];
    largest = std::max(largest, tint[c]);
  }
  return one_channel_ ? Rgb(largest) : tint;
}

void PathTracer::Shader::tell_surface(const Hit& hit, std::uint32_t material, const SurfacePoint& p) {
  PathSegment& s = *path;
  const Vec3 wo = -s.direction;
  SurfacePoint bumped = p;
  const Footprint print = footprint(p, hit.t);
  const Bsdf bsdf = tracer.shading_->bsdf(material, bumped, wo, print);
  SubsurfacePoint inside;
  const bool subsurface = tracer.subsurface_ && tracer.shading_->subsurface(material, p, print, inside);
  const bool seen_through = !bsdf.empty() && !bsdf.has_smooth() && !subsurface;
  if (seen_through && (s.flags & kHitTold)) return;
  PathFeatures f = features_of(s, !seen_through);
  if (f.flags & kTellsHit) {
    put_place(f, p.p);
    f.ids = {hit.shape + 1, hit.primitive + 1, material + 1};  // none is 2^32-1
    s.flags |= kHitTold;
  }
  if (f.flags & kTellsSurface) {
    const Rgb albedo = bsdf.empty() ? Rgb(0.f) : subsurface ? albedo_of(inside.medium) : albedo_of(bsdf, wo);
    const Rgb seen = tracer.tint(s) * albedo;
    const Vec3 n = glm::dot(p.ng, wo) < 0.f ? -bumped.ns : bumped.ns;
    put(f.values, kAlbedo, is_finite(seen) ? glm::clamp(seen, 0.f, 1.f) : Rgb(0.f), fixed_units(kFeatureK));
    put(f.values, kNormal, is_finite(n) ? n : Vec3(0.f), fixed_units(kFeatureK));
    s.flags |= kSurfaceTold;
  }
  out.features.push_back(f);
  if (!(s.flags & kHoldsGroup)) return;
  for (std::uint32_t i = 1; i < group_of(s); ++i) {
    f.sample += 2;
    out.features.push_back(f);
  }
}

// Fog has no normal, and the albedo that it scatters with.
void PathTracer::Shader::tell_collision(const Vec3& p) {
  PathSegment& s = *path;
  PathFeatures f = features_of(s, true);
  if (f.flags & kTellsHit) put_place(f, p);
  const Rgb seen = tracer.tint(s);
  put(f.values, kAlbedo, is_finite(seen) ? glm::clamp(seen, 0.f, 1.f) : Rgb(0.f), fixed_units(kFeatureK));
  s.flags |= kHitTold | kSurfaceTold;
  out.features.push_back(f);
}

void PathTracer::Shader::put_place(PathFeatures& f, const Vec3& p) const {
  if (!is_finite(p)) return;
  const double units = fixed_units(tracer.job_.length_k);
  bool clamped = false;
  f.values[kDepth] = quantise(tracer.camera_->depth(p, tracer.time_of(*path)), units, clamped);
  put(f.values, kPosition, p, units);
}

}  // namespace cloudrenderer
