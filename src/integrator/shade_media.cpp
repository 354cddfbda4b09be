// What a path does between surfaces.
#include "integrator/crossings.h"
#include "integrator/shader.h"
#include "shading/phase.h"
#include "shapes/surface.h"

namespace cloudrenderer {

namespace {

// The numbers of the stretch that ends at the path's next surface: null surfaces end one without a vertex.
MediumNumbers numbers_of(const JobSettings& job, const PathSegment& s) {
  return {SampleSequence(job.sequence, job.seed, s.pixel, s.sample), 0x80000000u | (s.vertex * 0x9e3779b1u + s.passed * 0x85ebca6bu)};
}

// Samples at a point, channel by channel: none where the grid is the same everywhere but for its density.
class GridValues {
 public:
  GridValues(const Part& part, const BrickRecord& record, const GridMedium& grid, const Vec3& p) {
    if (!grid.varies()) return;
    const std::size_t n = record.brick.channel_samples();
    const Vec3 at = record.brick.object_to_world.inverse().point(p);
    for (; count_ < record.brick.channels; ++count_)
      values_[count_] = value_at(record.brick, part.densities.subspan(record.first_sample + n * count_, n), at);
  }
  operator std::span<const float>() const { return {values_.data(), count_}; }

 private:
  std::array<float, kMostBrickChannels> values_;
  std::size_t count_ = 0;
};

}  // namespace

bool PathTracer::Shader::cross_media(float t) {
  PathSegment& s = *path;
  const JobSettings& job = tracer.job_;
  const Media& media = *tracer.media_;
  const MediumRay ray{s.origin, s.direction, t};
  const MediumNumbers numbers = numbers_of(job, s);
  if (job.media != MediaTransport::multiple) {
    const bool seen = asks_media();
    if (seen) add(s.throughput * media.emitted(s.medium, ray, numbers));
    if (!seen || job.media == MediaTransport::emission) {
      s.throughput *= media.transmittance(s.medium, ray);
      if (seen) s.throughput *= media.unmarched(ray, job.media_step, numbers);
      return true;
    }
  }
  const MediumSample sample = media.sample(s.medium, ray, numbers);
  if (!is_black(sample.emitted)) add(s.throughput * sample.emitted);
  s.throughput *= sample.weight;
  if (job.media == MediaTransport::single && !sample.collides) s.throughput *= media.unmarched(ray, job.media_step, numbers);
  if (sample.collides) scatter_in_medium(sample);
  return !sample.collides;
}

void PathTracer::Shader::collide(const Hit& hit) {
  PathSegment& s = *path;
  const JobSettings& job = tracer.job_;
  const Part& part = set.part(hit.part);
  const BrickRecord& brick = part.bricks[hit.index];
  const GridMedium& grid = tracer.media_->grids()[brick.medium];
  const Vec3 p = s.origin + hit.t * s.direction;
  const GridCollision at = tracer.media_->collision(grid, GridValues(part, brick, grid, p), p);
  const bool scatters = job.media == MediaTransport::multiple || (job.media == MediaTransport::single && asks_media());
  if (!is_black(at.emission) && (job.media == MediaTransport::multiple || asks_media())) add(s.throughput * at.emission);
  if (grid.blocking[static_cast<int>(tracer.channel_of(s))] == 0.f) {  // only its light was of interest
    if (++s.passed > kMaxCrossings) return end();
    s.cone_width += s.flags & kSpecularBounce ? s.cone_spread * hit.t : -hit.t;
    next().origin = p;
    return;
  }
  if (!scatters) return end();
  s.throughput *= at.albedo;
  scatter_in_medium({true, hit.t, grid.g, Rgb(1.f)});
}

void PathTracer::Shader::scatter_in_medium(const MediumSample& at) {
  const PathSegment& s = *path;
  const JobSettings& job = tracer.job_;
  if (tells_features()) tell_collision(s.origin + at.t * s.direction);
  if (is_over(s) || is_black(s.throughput)) return end();
  const auto numbers = SampleSequence(job.sequence, job.seed, s.pixel, s.sample).get_pairs(s.vertex);
  ScatterOf<float> v;
  v.p = s.origin + at.t * s.direction;
  v.wo = -s.direction;
  v.vertex = s.vertex;
  for (std::size_t i = 0; i < v.numbers.size(); ++i) v.numbers[i] = numbers[i];
  v.throughput = s.throughput;
  v.side = Vec3(0.f);
  LightSample light;
  if (tracer.lights_->sample(v.p, v.side, v.numbers[kLightChoice].x, v.numbers[kLightPoint], light)) {
    const float phase = phase_hg(v.wo, light.wi, at.g);
    // With single scattering no ray but this one looks for light.
    const bool only = light.delta || job.media == MediaTransport::single;
    const float weight = only ? 1.f : power_weight(light.weight_pdf, phase);
    v.asks = true;
    v.light_origin = v.p;
    v.light_direction = light.wi;
    v.light_distance = shadow_length(light.distance);
    v.light = v.throughput * light.radiance * (phase * weight / light.pdf);
  }
  if (job.media == MediaTransport::multiple) {
    v.goes_on = true;
    v.origin = v.p;
    v.direction = sample_phase_hg(v.wo, at.g, v.numbers[kDirection]);
    v.pdf = phase_hg(v.wo, v.direction, at.g);
    thin_out(v);
  }
  scattered(ScatterResults(v), 0, at.t);
}

Rgb PathTracer::Shader::shadow_transmittance(const Vec3& origin, const Vec3& direction, float distance) const {
  const Media& media = *tracer.media_;
  std::uint16_t medium = medium_towards(direction);
  // What media the ray meets; surfaces count farther away, too.
  float reach = distance >= shadow_length(kInfinity) ? std::min(distance, tracer.longest_shadow_) : distance;
  if (!tracer.null_surfaces_) return media.transmittance(medium, {origin, direction, reach});
  Rgb passed(1.f);
  Crossings at(tracer, set, origin, direction, distance, tracer.motion_ ? tracer.time_of(*path) : 0.f);
  Vec3 from = origin;
  while (at.next()) {
    if (!tracer.shading_->is_null(at.material())) return Rgb(0.f);
    passed *= media.transmittance(medium, {from, direction, std::min(at.step(), reach)});
    reach = std::max(0.f, reach - at.step());
    if (at.is_border()) medium = at.entered_medium();
    from = at.from();
  }
  return at.is_endless() ? Rgb(0.f) : passed * media.transmittance(medium, {from, direction, reach});
}

}  // namespace cloudrenderer
