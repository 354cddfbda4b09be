// The shadow rays of a shaded batch.
#include "integrator/shader.h"
#include "integrator/timer.h"

namespace cloudrenderer {

// Tests the batch's shadow rays on what is resident and adds what is free; the rest is left to ask others.
void PathTracer::resolve_shadows(const ResidentSet& set, const Shadows& shadows, ShadeOutput& out) const {
  const std::span<const OcclusionRay> rays = shadows.rays;
  if (rays.empty()) return;
  if (recorded_) recorded_->insert(recorded_->end(), rays.begin(), rays.end());
  std::vector<std::uint8_t> found(rays.size());
  {
    const BatchTimer timer(time_.occlusion);
    find_blocked(set, rays, shadows.times, found);
  }
  std::vector<std::uint32_t> leaving;  // shadows that others must answer
  std::vector<Candidate> candidates(map_.part_count());
  const auto radiance_of = [&](const Shadows::Light& w) -> Fixed3& {
    if (!w.path_ended) return out.continuing[w.path].radiance;
    PathEnd& e = out.ended[w.path];
    return e.target != kNone ? e.splat : e.radiance;
  };
  constexpr std::size_t kAhead = 16;  // paths to be fetched into the cache ahead of use
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (i + kAhead < rays.size()) __builtin_prefetch(&radiance_of(shadows.lights[i + kAhead]), 1);
    if (found[i] & kBlocked) continue;
    const Shadows::Light& w = shadows.lights[i];
    const OcclusionRay& ray = rays[i];
    if (found[i] & kPartsMissing) {
      const std::size_t n = map_.candidates(ray.origin, ray.direction, ray.t_max, candidates);
      const auto first = static_cast<std::uint32_t>(out.ask_parts.size());
      for (std::size_t c = 0; c < n; ++c)
        if (!set.has(candidates[c].part)) out.ask_parts.push_back(candidates[c].part);
      const auto count = static_cast<std::uint32_t>(out.ask_parts.size()) - first;
      if (count) {
        leaving.push_back(static_cast<std::uint32_t>(i));
        out.asks.push_back({ray, shadows.times.empty() ? 0.f : shadows.times[i], 0, first, count, w.contribution});
        continue;
      }
    }
    Fixed3& radiance = radiance_of(w);
    for (std::size_t c = 0; c < 3; ++c) radiance[c] += w.contribution[c];
  }
  if (leaving.empty()) return;
  // Paths that wait move to `parked`; the rest close up. A path has at most one shadow ray a vertex.
  std::vector<std::uint8_t> gone_continuing(out.continuing.size()), gone_ended(out.ended.size());
  for (std::size_t a = 0; a < leaving.size(); ++a) {
    const Shadows::Light& w = shadows.lights[leaving[a]];
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
      parked.end_flags = e.flags;
      parked.target = e.target;
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

}  // namespace cloudrenderer
