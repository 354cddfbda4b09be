#pragma once
// Paths that were traced once, replayed: which parts rays may hit, where they hit, and how long paths are.
#include "integrator/shared_rays.h"
#include "simulate/list_engine.h"
#include "simulate/scene_model.h"

namespace cloudrenderer::sim {

// What batches have asked of the engine since the last reset().
struct Tally {
  std::uint64_t camera = 0, rays = 0, tests = 0, routed = 0, vertices = 0, shadows = 0, shadow_tests = 0;
};

class ReplayEngine final : public ListEngine {
 public:
  // `width`, `height`, `spp`: of the simulated film. The model must outlive the engine.
  ReplayEngine(const SceneModel& model, std::uint32_t width, std::uint32_t height, std::uint32_t spp);

  void camera(const RendererRange& range, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
              std::vector<PathSegment>& out) const override;
  void trace(SegmentBatch& batch) const override;
  void route(SegmentBatch& batch) const override;
  void shade(SegmentBatch& batch, ShadeOutput& out) const override;
  std::vector<bool> occluded(std::span<const OcclusionRay> rays, std::span<const float> times,
                             std::span<std::uint8_t> blocked) const override;
  std::uint32_t film_width() const override { return width_; }

  Tally take_tally() const { return std::exchange(tally_, {}); }
  // Of `tally`, for one thread of the machine that the costs are of.
  double seconds(const Tally& tally) const;
  double ideal_seconds_per_path() const { return ideal_; }

 private:
  std::uint32_t part_count() const override { return static_cast<std::uint32_t>(model_.parts.size()); }
  // Segments carry the number of their path in origin.x, that of the vertex in origin.y.
  const PathSample& path(const Vec3& origin) const { return model_.samples.paths[static_cast<std::size_t>(origin.x)]; }
  const PathVertex& vertex(const Vec3& origin) const { return path(origin)[static_cast<std::size_t>(origin.y)]; }
  float path_of(std::uint32_t pixel, std::uint32_t sample) const;
  // What follows after the vertex at `s`; `dark`: its light is another's.
  void go_on(const PathSegment& s, const PathVertex& v, bool dark, ShadeOutput& out) const;
  void candidates(const Vec3& origin, Candidates& list) const override;
  void shadow_candidates(const OcclusionRay& ray, Candidates& list) const override;
  void hit_part(const Vec3& origin, const ListCandidate& c, Hit& hit) const override;
  void hit_main(const Vec3& origin, Hit& hit) const override;
  bool blocks(const OcclusionRay& ray, std::uint32_t part) const override { return vertex(ray.origin).blocker == part; }
  void shade_one(const PathSegment& s, const Hit& hit, ShadeOutput& out) const override;

  const SceneModel& model_;
  std::uint32_t width_, height_;
  SharedRays shared_;
  double tests_per_ray_ = 0, tests_per_shadow_ = 0, ideal_ = 0;
  mutable Tally tally_;
};

}  // namespace cloudrenderer::sim
