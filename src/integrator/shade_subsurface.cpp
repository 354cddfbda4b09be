// What a path does below the surface of a subsurface material: a random walk through the medium inside, until it leaves.
//
// Light that leaves after it was scattered goes out as if it had come evenly from all sides (bsdf::diffuse_exit), so that
// it can be asked of lights; how much leaves, and where, is the walk's. Light that was never scattered is refracted. A
// walk is one vertex of its path, as in pbrt.
#include "integrator/shader.h"
#include "shading/bsdf_lobes.h"
#include "shading/bsdf_math.h"
#include "shading/phase.h"

namespace cloudrenderer {

namespace {

constexpr std::uint32_t kMostSteps = 4096;  // after these a walk goes straight out of its medium
constexpr std::uint32_t kMostCrossings = 1000;  // of surfaces on that way
constexpr int kStepsAtOnce = 64;            // before others have their turn
constexpr float kWalkRoulette = 4.f;        // as kRouletteScale of other paths: most walks leave within few steps

// Turns the normals to the side of `towards`. True if that is the back: the shading normals know the outside (where there
// are some, triangles of pbrt-v2 may have any geometric one).
bool turn_normals(SurfacePoint& p, const Vec3& towards) {
  if (glm::dot(p.ng, p.ns) < 0.f) p.ng = -p.ng;
  if (!(glm::dot(p.ng, towards) < 0.f)) return false;
  p.ng = -p.ng;
  p.ns = -p.ns;
  return true;
}

}  // namespace

// What is drawn for one step: a pure function of the path and its number.
struct PathTracer::Shader::Step {
  SampleSequence::Pairs numbers;
  float distance = kInfinity;  // where the medium scatters
  Rgb scattered{1}, passed{1};  // weight of what scatters there, and of what passes `reached` before
  bool last;

  Step(const JobSettings& job, const PathSegment& s, const InteriorMedium& medium)
      : numbers(SampleSequence(job.sequence, job.seed, s.pixel, s.sample)
                    .get_pairs(0x40000000u + s.vertex * 0x9e3779b1u + s.passed * 0x85ebca6bu)),
        last(s.passed >= kMostSteps) {
    if (last) return;
    const Rgb sigma_t = medium.sigma_a + medium.sigma_s;
    // A channel is chosen by what the path carries of it; then no weight exceeds the sum of what is carried.
    const Rgb carried = glm::abs(s.throughput);
    const float sum = carried.x + carried.y + carried.z, at = numbers[0].x * sum;
    const int channel = at < carried.x ? 0 : at < carried.x + carried.y ? 1 : 2;
    if (sigma_t[channel] > 0.f) distance = -portable::log(1.f - numbers[0].y) / sigma_t[channel];
  }
  // Weights for the way `t`, of all three choices of the channel together (the balance heuristic). scatters: at its end.
  static Rgb weight(const InteriorMedium& medium, const Rgb& throughput, float t, bool scatters) {
    const Rgb carried = glm::abs(throughput);
    const Rgb sigma_t = medium.sigma_a + medium.sigma_s;
    if (sigma_t.x == sigma_t.y && sigma_t.x == sigma_t.z) return scatters ? medium.sigma_s / sigma_t : Rgb(1.f);
    const float nearest = std::min(sigma_t.x, std::min(sigma_t.y, sigma_t.z));
    Rgb through;  // relative to the clearest channel's, which keeps it in range
    for (int c = 0; c < 3; ++c) through[c] = portable::exp((nearest - sigma_t[c]) * t);
    const float sum = carried.x + carried.y + carried.z;
    const float density = glm::dot(carried, scatters ? sigma_t * through : through) / sum;
    return density > 0.f ? (scatters ? medium.sigma_s * through : through) / density : Rgb(0.f);
  }
  // What of the light is left at the surface after the first kMostSteps of a walk. Their distances from the surface spread
  // with a variance of 2 kMostSteps / 3 free paths squared as in diffusion off a wall (Rayleigh's distribution), and light
  // falls off by exp(-sqrt(3 (1 - albedo)) depth); the mean of that, x^2 = 2 kMostSteps (1 - albedo), to within 5 %.
  static Rgb left_of_the_rest(const InteriorMedium& medium) {
    const Rgb sigma_t = medium.sigma_a + medium.sigma_s;
    Rgb out(1.f);
    for (int c = 0; c < 3; ++c) {
      const float x2 = sigma_t[c] > 0.f ? 2.f * kMostSteps * medium.sigma_a[c] / sigma_t[c] : 0.f;
      out[c] = 1.f / (1.f + 1.2533f * std::sqrt(x2) + 0.8f * x2);
    }
    return out;
  }
};

void PathTracer::Shader::enter(std::uint32_t material, const InteriorMedium& medium, SurfacePoint& p,
                               const Footprint& footprint, float t) {
  const PathSegment& s = *path;
  if (s.has_light_ratio()) path->light_ratio() = 0;  // paths from lights end here
  const bool reversed = turn_normals(p, -s.direction);
  const Bsdf bsdf = tracer.shading_->bsdf(material, p, -s.direction, footprint, is_regularized(s));
  if (bsdf.empty()) return end();
  const auto numbers = SampleSequence(tracer.job_.sequence, tracer.job_.seed, s.pixel, s.sample).get_pairs(s.vertex);
  ScatterOf<float> v = scatter_of(p, ray_offset(p.p, p.p_error, p.ng), -s.direction, s, numbers);
  v.side = Vec3(0.f);
  if (bsdf.has_smooth() && !tracer.lights_->empty()) {
    direct(bsdf, true, v);
    if (v.asks && glm::dot(v.light_direction, p.ng) < 0.f) v.asks = false;  // a light inside is found by the walk
  }
  BsdfSample sample;
  v.goes_on = bsdf.sample(v.wo, v.numbers[kLobeAndRoulette].x, v.numbers[kDirection], sample) && !is_black(sample.weight);
  v.throughput *= sample.weight;
  v.specular = sample.specular;
  v.origin = ray_start(v.p, v.offset, v.ng, sample.wi);
  v.direction = sample.wi;
  v.pdf = tracer.even_lobes_ ? bsdf.even_pdf(v.wo, sample.wi) : sample.pdf;
  if (!v.goes_on || !(glm::dot(sample.wi, p.ng) < 0.f)) {
    thin_out(v);
    return scattered(ScatterResults(v), 0, t);
  }
  ask_for_light(ScatterResults(v), 0);
  PathSegment& inside = next();
  inside.origin = v.origin;
  inside.direction = v.direction;
  // Rough refraction compresses radiance, which leaves the medium in another way.
  inside.throughput = sample.specular ? v.throughput : v.throughput * (sample.eta * sample.eta);
  inside.flags = static_cast<std::uint16_t>(inside.flags | kInside | kSpecularBounce | (reversed ? kInsideReversed : 0));
  inside.passed = 0;
  inside.cone_width = inside.cone_spread = 0;
  inside.set_inside(medium.pack());
}

void PathTracer::Shader::walk(Hit hit) {
  PathSegment& s = *path;
  const InteriorMedium medium = InteriorMedium::unpack(s.inside());
  Step step(tracer.job_, s, medium);
  for (int n = 0;; ++n) {
    const bool meets = hit.part != kNone && hit.t <= step.distance;
    if (!meets && step.distance == kInfinity) {  // of an open surface, or through a hole
      s.flags = static_cast<std::uint16_t>(s.flags & ~(kInside | kInsideScattered | kInsideReversed));
      return escape();
    }
    if (!step.last) s.throughput *= Step::weight(medium, s.throughput, meets ? hit.t : step.distance, !meets);
    if (s.passed == kMostSteps) s.throughput *= Step::left_of_the_rest(medium);
    if (!is_finite(s.throughput)) {
      ++out.counts.invalid;
      end_flags |= kEndInvalid;
      return end();
    }
    const float largest = max_component(glm::abs(s.throughput));  // negative behind some filters
    const float survive = std::min(1.f, largest * kWalkRoulette);
    if (!(step.numbers[1].y < survive) || s.passed > kMostSteps + kMostCrossings) return end();
    s.throughput /= survive;
    if (!meets) {
      s.origin += step.distance * s.direction;
      s.direction = sample_phase_hg(-s.direction, medium.g, step.numbers[2]);
      s.flags |= kInsideScattered;
    } else if (!walk_meets(hit, step)) {
      return;
    }
    ++s.passed;
    step = Step(tracer.job_, s, medium);
    hit = {};
    hit.t = step.distance;
    // The next ray, here and now unless other hosts must see it.
    PathSegment ray = s;
    ray.tested = 0;
    ray.window = 0;
    ray.flags = static_cast<std::uint16_t>(ray.flags & ~kMainTested);
    const float end_of_ray = hit.t;
    if (n == kStepsAtOnce || tracer.trace_one(set, ray, hit)) {
      next().best.t = end_of_ray;
      return;
    }
    ++out.counts.bounce;
  }
}

// A surface on the way of the walk. False: the path has left or ended.
bool PathTracer::Shader::walk_meets(const Hit& hit, const Step& step) {
  PathSegment& s = *path;
  std::uint32_t material, light;
  SurfacePoint p = surface(s.origin, s.direction, hit, material, light, tracer.uv_);
  if (light != kNone && s.vertex <= tracer.job_.emission_vertex)
    add(s.throughput * tracer.lights_->emitted(light, p.ng, s.direction, hit.primitive, p.uv));
  const auto goes_on = [&](const Vec3& direction) {
    s.origin = ray_start(p.p, ray_offset(p.p, p.p_error, p.ng), p.ng, direction);
    s.direction = direction;
    return true;
  };
  const auto stops = [&] {
    end();
    return false;
  };
  if (tracer.shading_->is_null(material)) return goes_on(s.direction);
  SubsurfacePoint at;
  if (!tracer.shading_->subsurface(material, p, Footprint{}, at)) {
    // Something else stands in the medium.
    const Bsdf bsdf = tracer.shading_->bsdf(material, p, -s.direction, Footprint{});
    BsdfSample sample;
    if (step.last || bsdf.empty() || !bsdf.sample(-s.direction, step.numbers[1].x, step.numbers[2], sample)) return stops();
    s.throughput *= sample.weight;
    s.flags |= kInsideScattered;
    return goes_on(sample.wi);
  }
  const bool reversed = turn_normals(p, s.direction);
  // The outside of another object of the kind, within this one.
  if (reversed != ((s.flags & kInsideReversed) != 0)) return goes_on(s.direction);
  const Vec3& ng = p.ng;
  const auto reflected = [&](const Vec3& n) { return s.direction - 2.f * glm::dot(s.direction, n) * n; };
  if (s.flags & kInsideScattered) {
    const float cosine = glm::dot(s.direction, p.ns) > 0.f ? glm::dot(s.direction, p.ns) : glm::dot(s.direction, ng);
    if (!step.last && step.numbers[1].x < bsdf::fresnel_dielectric(std::min(cosine, 1.f), 1.f / at.eta)) {
      const Vec3 back = reflected(p.ns);
      return goes_on(glm::normalize(glm::dot(back, ng) < 0.f ? back : reflected(ng)));
    }
    leave(at, p);
    return false;
  }
  // Straight from where it entered.
  Bsdf bsdf(Frame(p.ns), ng);
  bsdf.add(at.boundary);
  bsdf.finish(-s.direction);
  BsdfSample sample;
  if (!bsdf.sample(-s.direction, step.numbers[1].x, step.numbers[2], sample)) return stops();
  s.throughput *= sample.specular || !sample.transmission ? sample.weight : sample.weight * (sample.eta * sample.eta);
  if (!sample.transmission) return goes_on(sample.wi);
  s.flags = static_cast<std::uint16_t>(s.flags & ~(kInside | kInsideReversed));
  ScatterOf<float> v;
  v.vertex = s.vertex;
  v.throughput = s.throughput;
  v.numbers[kLobeAndRoulette].y = step.numbers[3].x;
  v.goes_on = v.specular = true;
  v.side = Vec3(0.f);
  v.origin = ray_start(p.p, ray_offset(p.p, p.p_error, p.ng), p.ng, sample.wi);
  v.direction = sample.wi;
  v.pdf = 0;
  thin_out(v);
  s.passed = 0;
  scattered(ScatterResults(v), 0, 0.f);
  return false;
}

// Out of the medium, after it has scattered the light. p: with its normals outwards.
void PathTracer::Shader::leave(const SubsurfacePoint& at, const SurfacePoint& p) {
  PathSegment& s = *path;
  s.flags = static_cast<std::uint16_t>(s.flags & ~(kInside | kInsideScattered | kInsideReversed));
  s.passed = 0;
  const auto numbers = SampleSequence(tracer.job_.sequence, tracer.job_.seed, s.pixel, s.sample).get_pairs(0x20000000u + s.vertex);
  ScatterOf<float> v = scatter_of(p, ray_offset(p.p, p.p_error, p.ng), p.ng, s, numbers);
  Bsdf bsdf(Frame(p.ns), p.ng);
  bsdf.add(at.matte_exit > 0.f ? bsdf::lambert(Rgb(at.matte_exit)) : bsdf::diffuse_exit(at.eta));
  bsdf.finish(p.ng);
  scatter(bsdf, true, v);
  v.ratio = 0;
  scattered(ScatterResults(v), 0, 0.f);
}

}  // namespace cloudrenderer
