#include "simulate/replay_engine.h"

#include <algorithm>

namespace cloudrenderer::sim {
namespace {

// Of a ray's time the share that does not depend on how many parts it is tested against: one BVH against K parts of the
// same mesh took 1 : 1.16 : 1.30 of the time at 1, 1.23 and 1.54 visits a ray.
constexpr double kFixedShare = 0.4;
constexpr double kRouting = 5e-8;  // to find the next part of a segment that came back

double shared(double rays, double tests, double mean) {
  return mean > 0 ? kFixedShare * rays + (1 - kFixedShare) * tests / mean : rays;
}

}  // namespace

ReplayEngine::ReplayEngine(const SceneModel& model, std::uint32_t width, std::uint32_t height, std::uint32_t spp)
    : model_(model), width_(width), height_(height), shared_(model.samples_per_ray, spp) {
  double vertices = 0, shadows = 0, tests = 0, shadow_tests = 0;
  for (const PathSample& path : model.samples.paths)
    for (const PathVertex& v : path) {
      const double times = &v == &path.front() ? 1. / shared_.group : 1;
      vertices += times;
      tests += times * static_cast<double>(v.parts.size());
      if (!v.shadow) continue;
      shadows += times;
      // Local parts are tested until one blocks.
      const auto blocker = std::ranges::find(v.shadow_parts, v.blocker);
      shadow_tests += times * (static_cast<double>(blocker - v.shadow_parts.begin()) + (blocker == v.shadow_parts.end() ? 0 : 1));
    }
  const auto paths = static_cast<double>(model.samples.paths.size());
  tests_per_ray_ = vertices > 0 ? tests / vertices : 0;
  tests_per_shadow_ = shadows > 0 ? shadow_tests / shadows : 0;
  const ComputeCosts& c = model.costs;
  ideal_ = c.camera / shared_.group + c.path + vertices / paths * (c.trace + c.shade) + shadows / paths * c.occlusion;
}

float ReplayEngine::path_of(std::uint32_t at, std::uint32_t sample) const {
  const PathSamples& cells = model_.samples;
  const std::uint32_t x = at % width_, y = at / width_;
  const std::uint64_t dice = mix64((std::uint64_t{at} << 32) + sample);
  // A pixel of the simulated film stands for many, and may span cells.
  const auto cell = [](std::uint32_t place, std::uint64_t within, std::uint32_t n, std::uint32_t of) {
    return (std::uint64_t{place} * 1024 + within % 1024) * n / (std::uint64_t{of} * 1024);
  };
  const std::uint64_t column = cell(x, dice >> 20, cells.columns, width_), row = cell(y, dice >> 40, cells.rows, height_);
  return static_cast<float>((row * cells.columns + column) * cells.per_cell + dice % cells.per_cell);
}

void ReplayEngine::camera(const RendererRange& r, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
                          std::vector<PathSegment>& out) const {
  const std::uint32_t samples = r.sample_end - r.sample_begin, width = r.x1 - r.x0;
  const bool shares = r.shares && shared_.group > 1;
  const std::size_t before = out.size();
  for (std::uint64_t i = first; i < first + count; ++i) {
    const auto pixel = static_cast<std::uint32_t>(i / samples);
    PathSegment s{};
    s.task = r.task;
    s.owner = owner;
    s.pixel = (r.y0 + pixel / width) * width_ + r.x0 + pixel % width;
    s.sample = r.sample_begin + static_cast<std::uint32_t>(i % samples);
    if (shares) {  // a group of which all samples are made here goes as one
      const std::uint32_t before_it = s.sample - shared_.first(s.sample), of_group = 2 * (shared_.group - 1);
      const bool whole = before_it <= i - first && i - before_it + of_group < first + count && s.sample - before_it >= r.sample_begin &&
                         s.sample - before_it + of_group < r.sample_end;
      if (whole && before_it != 0) continue;
      if (whole) s.flags = kHoldsGroup;
    }
    s.origin = Vec3(path_of(s.pixel, s.sample), 0, 0);
    s.direction = {0, 0, 1};
    s.throughput = Vec3(1);
    out.push_back(s);
  }
  tally_.camera += out.size() - before;
}

void ReplayEngine::trace(SegmentBatch& batch) const {
  tested_ = 0;
  ListEngine::trace(batch);
  tally_.rays += batch.size();
  tally_.tests += tested_;
}

void ReplayEngine::route(SegmentBatch& batch) const {
  tested_ = 0;
  ListEngine::route(batch);
  tally_.routed += batch.size();
  tally_.tests += tested_;
}

void ReplayEngine::shade(SegmentBatch& batch, ShadeOutput& out) const {
  tested_ = 0;
  ListEngine::shade(batch, out);
  tally_.vertices += batch.size();
  tally_.shadows += out.counts.shadow;
  tally_.shadow_tests += tested_;
}

std::vector<bool> ReplayEngine::occluded(std::span<const OcclusionRay> rays, std::span<const float> times,
                                         std::span<std::uint8_t> blocked) const {
  tested_ = 0;
  std::vector<bool> tested = ListEngine::occluded(rays, times, blocked);
  tally_.shadows += rays.size();
  tally_.shadow_tests += tested_;
  return tested;
}

double ReplayEngine::seconds(const Tally& t) const {
  const ComputeCosts& c = model_.costs;
  const auto n = [](std::uint64_t count) { return static_cast<double>(count); };
  return n(t.camera) * c.camera + shared(n(t.rays), n(t.tests), tests_per_ray_) * c.trace + n(t.routed) * kRouting +
         n(t.vertices) * c.shade + shared(n(t.shadows), n(t.shadow_tests), tests_per_shadow_) * c.occlusion;
}

void ReplayEngine::candidates(const Vec3& origin, Candidates& list) const {
  list.clear();
  for (const std::uint32_t p : vertex(origin).parts) list.push_back({static_cast<float>(list.size()), p});
}

void ReplayEngine::shadow_candidates(const OcclusionRay& ray, Candidates& list) const {
  list.clear();
  for (const std::uint32_t p : vertex(ray.origin).shadow_parts) list.push_back({static_cast<float>(list.size()), p});
}

void ReplayEngine::hit_part(const Vec3& origin, const ListCandidate& c, Hit& hit) const {
  const PathVertex& v = vertex(origin);
  if (v.hit != c.part) return;
  hit.t = static_cast<float>(v.parts.size());  // behind all that is listed
  hit.shape = hit.part = c.part;
  hit.primitive = 0;
  hit.geometry = 0;
}

void ReplayEngine::hit_main(const Vec3& origin, Hit& hit) const {
  if (vertex(origin).hit == 0) hit_part(origin, {0.f, 0}, hit);
}

void ReplayEngine::shade_one(const PathSegment& s, const Hit&, ShadeOutput& out) const {
  const PathVertex& v = vertex(s.origin);
  go_on(s, v, false, out);
  if (!(s.flags & kHoldsGroup)) return;
  // The others of the group go on as other paths of their neighbourhood do.
  PathSegment member = s;
  for (std::uint32_t i = 1; i < shared_.group; ++i) {
    member.sample = s.sample + 2 * i;
    member.origin.x = path_of(member.pixel, member.sample);
    go_on(member, v, true, out);
  }
}

void ReplayEngine::go_on(const PathSegment& s, const PathVertex& v, bool dark, ShadeOutput& out) const {
  const bool ends = s.vertex + 1u >= path(s.origin).size();
  PathSegment n = s;
  n.tested = 0;
  n.window = 0;
  n.best = {};
  n.flags = 0;
  n.vertex = static_cast<std::uint16_t>(s.vertex + 1);
  const OcclusionRay ray{s.origin, {0, 1, 0}, 1.f};
  n.origin.y = static_cast<float>(n.vertex);
  if (!ends) ++out.counts.bounce;
  if (v.shadow && !dark && cast_shadow(ray, {1, 1, 1}, n, ends, 0, out)) return;
  if (ends)
    out.ended.push_back({n.task, n.pixel, n.sample, n.owner, 0, n.radiance});
  else
    out.continuing.push_back(n);
}

}  // namespace cloudrenderer::sim
