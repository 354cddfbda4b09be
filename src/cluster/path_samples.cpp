#include "cluster/path_samples.h"

#include <algorithm>
#include <cmath>

#include "integrator/path_tracer.h"
#include "parts/split.h"

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kPerCell = 4;

Part must_read(const std::string& path) {
  Result<Part> part = read_part_file(path);
  if (!part) throw ClusterError(path + ": " + part.error());
  return std::move(*part);
}

class Sampler {
 public:
  Sampler(const std::string& folder, const Manifest& manifest, const JobSettings& settings)
      : map_(manifest.parts), candidates_(map_.part_count()), resident_(Resident::Options{}) {
    for (std::uint32_t i = 0; i < manifest.prototypes.size(); ++i)
      resident_.load_prototype(i, must_read(prototype_path(folder, i)));
    tracer_ = std::make_unique<PathTracer>(manifest, settings, must_read(part_path(folder, 0)), resident_, warnings_);
    for (std::uint32_t i = 1; i < manifest.parts.size(); ++i) resident_.load_part(PartId{i}, must_read(part_path(folder, i)));
  }

  sim::PathSample path(std::uint32_t x, std::uint32_t y, std::uint32_t sample) {
    sim::PathSample path;
    SegmentBatch batch;
    tracer_->camera({0, x, y, x + 1, y + 1, sample, sample + 1}, 1, 0, 1, batch.segments);
    while (batch.size() != 0) {
      const Vec3 origin = batch.segments[0].origin, direction = batch.segments[0].direction;
      batch.hits.clear();
      tracer_->trace(batch);
      sim::PathVertex v;
      v.parts = along(origin, direction, batch.hits[0].t);
      if (batch.hits[0].part < map_.part_count()) v.hit = batch.hits[0].part;
      std::vector<OcclusionRay> shadows;
      tracer_->record_shadow_rays(&shadows);
      ShadeOutput out;
      tracer_->shade(batch, out);
      tracer_->record_shadow_rays(nullptr);
      if (!shadows.empty()) look(shadows[0], v);
      path.push_back(std::move(v));
      batch = {};
      batch.segments = std::move(out.continuing);
    }
    return path;
  }

 private:
  std::vector<std::uint32_t> along(const Vec3& origin, const Vec3& direction, float t) {
    const std::size_t n = map_.candidates(origin, direction, t, candidates_);
    std::vector<std::uint32_t> parts;
    for (std::size_t i = 0; i < n; ++i) parts.push_back(candidates_[i].part);
    return parts;
  }
  // What a shadow ray meets, and the first part that stops it.
  void look(const OcclusionRay& ray, sim::PathVertex& v) {
    v.shadow = true;
    SegmentBatch probe;
    PathSegment s{};
    s.origin = ray.origin;
    s.direction = ray.direction;
    s.best.t = ray.t_max;
    probe.segments.push_back(s);
    Hit end;
    end.t = ray.t_max;
    probe.hits.push_back(end);
    tracer_->trace(probe);
    const std::uint32_t hit = probe.hits[0].part;
    if (hit == 0) return;
    if (hit < map_.part_count()) v.blocker = hit;
    v.shadow_parts = along(ray.origin, ray.direction, ray.t_max);
  }

  Warnings warnings_;  // said when the scene was rendered
  PartMap map_;
  std::vector<Candidate> candidates_;
  Resident resident_;
  std::unique_ptr<PathTracer> tracer_;
};

}  // namespace

sim::PathSamples sample_paths(const std::string& folder, const Manifest& manifest, const JobSettings& settings, std::uint32_t count) {
  const FilmFrame& f = settings.film.frame;
  const double cells = std::max(1.0, static_cast<double>(count) / kPerCell);
  const double aspect = static_cast<double>(f.crop_width()) / f.crop_height();
  const auto within = [](double n, std::uint32_t most) {
    return std::clamp(static_cast<std::uint32_t>(std::lround(n)), 1u, most);
  };
  sim::PathSamples out;
  out.columns = within(std::sqrt(cells * aspect), f.crop_width());
  out.rows = within(cells / out.columns, f.crop_height());
  out.per_cell = kPerCell;
  Sampler sampler(folder, manifest, settings);
  for (std::uint32_t r = 0; r < out.rows; ++r)
    for (std::uint32_t c = 0; c < out.columns; ++c)
      for (std::uint32_t i = 0; i < kPerCell; ++i) {
        // Anywhere in the cell, the same at every run.
        const std::uint64_t key = mix64(((std::uint64_t{r} << 32) | c) * kPerCell + i);
        const auto in_cell = [](std::uint32_t cell, std::uint32_t cells_, std::uint32_t pixels, std::uint64_t dice) {
          const std::uint64_t first = std::uint64_t{cell} * pixels / cells_, end = std::uint64_t{cell + 1} * pixels / cells_;
          return static_cast<std::uint32_t>(first + dice % std::max<std::uint64_t>(1, end - first));
        };
        out.paths.push_back(sampler.path(f.x0 + in_cell(c, out.columns, f.crop_width(), key & 0xffffffffu),
                                         f.y0 + in_cell(r, out.rows, f.crop_height(), key >> 32),
                                         static_cast<std::uint32_t>(mix64(key) % settings.spp)));
      }
  return out;
}

}  // namespace cloudrenderer
