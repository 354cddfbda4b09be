#pragma once
#include <atomic>
#include <memory>
#include <string_view>

#include "film/camera.h"
#include "integrator/engine.h"
#include "integrator/job.h"
#include "integrator/shared_rays.h"
#include "parts/part_map.h"
#include "shading/lights.h"
#include "shading/material.h"
#include "shading/media.h"
#include "shapes/surface.h"
#include "trace/resident.h"

namespace cloudrenderer {

inline constexpr std::size_t kWindow = 64;  // candidates that a segment's mask can name, see PathSegment::window

// Processor time of the batches, in nanoseconds, for the report.
struct EngineTime {
  std::atomic<std::uint64_t> camera{0}, trace{0}, shade{0}, occlusion{0};  // shade: with its occlusion
};

// The light transport: one path tracer for local runs, clusters and simulations.
class PathTracer final : public PathEngine {
 public:
  // Builds shading, loads the main scene's geometry into `resident` (which must outlive the tracer), builds lights
  // and camera. Throws SceneError, ClusterError.
  PathTracer(const Manifest& manifest, const JobSettings& job, Part main_part, Resident& resident, Warnings& warnings,
             std::uint64_t texture_budget = std::uint64_t{1} << 30);

  void camera(const RendererRange& range, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
              std::vector<PathSegment>& out) const override;
  void trace(SegmentBatch& batch) const override;
  void route(SegmentBatch& batch) const override;
  void shade(SegmentBatch& batch, ShadeOutput& out) const override;
  std::vector<bool> occluded(std::span<const OcclusionRay> rays, std::span<const float> times,
                             std::span<std::uint8_t> blocked) const override;
  void nearest(std::span<const OcclusionRay> rays, std::span<AnsweredHit> hits) const override;
  void mark_tested(PathSegment& segment, float t_max, const std::vector<bool>& answered) const override;
  bool has_motion() const override { return motion_; }
  bool in_negative_lobe(std::uint32_t pixel, std::uint32_t sample, bool shares) const override;
  bool has_negative_lobes() const override { return job_.lobes.sums_per_pixel() > 1; }
  bool limits_samples() const override { return cloudrenderer::limits_samples(job_.film); }
  void limit(PathEnd& end) const override;
  bool may_splat(std::uint32_t pixel) const override { return light_paths_ != LightPaths::none && Film::holds(job_.film.frame, pixel); }
  std::uint32_t film_width() const override { return job_.film.frame.width; }

  const JobSettings& job() const { return job_; }
  bool needs_footprint() const { return footprint_; }
  // Why there are no paths from lights although the job asks for them, which only the geometry tells; empty: there are.
  std::string_view no_light_paths() const { return job_.light_paths == LightPaths::none ? std::string_view() : no_light_paths_; }
  // Textures and light tables: counted in a host's memory besides the resident parts.
  std::uint64_t shading_bytes() const { return shading_->bytes() + lights_->bytes(); }
  const EngineTime& time() const { return time_; }
  // For measurements, with one thread: all shadow rays from now on are appended to `to` as they are traced.
  void record_shadow_rays(std::vector<OcclusionRay>* to) { recorded_ = to; }

 private:
  struct Shadows;
  // Media on the sides of a surface, as in PathSegment::medium; equal where it leaves rays in theirs.
  struct Interface {
    std::uint16_t inside = 0, outside = 0;
  };
  struct Shader;
  class EightShader;
  class Crossings;
  class ShadowStretches;
  void build_media(const Manifest& manifest, const Part& main_part, Warnings& warnings);
  std::uint32_t channel_of(const PathSegment& s) const;
  Rgb tint(const PathSegment& s) const;
  // `time` counts for hits of instances.
  SurfacePoint surface(const ResidentSet& set, const Vec3& origin, const Vec3& direction, float time, const Hit& hit,
                       std::uint32_t& material, std::uint32_t& light, bool derivatives) const;
  BrickRay brick_ray(const PathSegment& s, const SampleSequence& sequence) const;
  PartId trace_one(const ResidentSet& set, PathSegment& s, Hit& hit) const;
  void trace_eight(const ResidentSet& set, PathSegment* s, Hit* hits, PartId* next) const;
  // Of a shadow ray: something resident blocks it; parts that are not resident may lie on its way.
  static constexpr std::uint8_t kBlocked = 1, kPartsMissing = 2;
  void find_blocked(const ResidentSet& set, std::span<const OcclusionRay> rays, std::span<const float> times,
                    std::span<std::uint8_t> found) const;
  float time_of(const PathSegment& s) const;
  // Whose numbers its camera ray took.
  std::uint32_t ray_sample(const PathSegment& s) const { return shared_.ray_sample(s.sample, (s.flags & kSharesRay) != 0); }
  // PathSegment::light_ratio() of a path from the camera that arrives at a vertex, by its hit there.
  float light_ratio(const PathSegment& s, const Hit& hit) const;
  TraceRay ray_of(const PathSegment& s) const;
  void resolve_shadows(const ResidentSet& set, const Shadows& shadows, ShadeOutput& out) const;

  JobSettings job_;
  Dialect dialect_;
  PartMap map_;
  bool one_part_;       // nothing but the main scene and one part
  bool main_geometry_;  // the main scene has shapes of its own
  bool even_lobes_;       // lights are weighed against even chances of the lobes (Lights::weighs_alone)
  bool hittable_lights_;  // rays can find lights by themselves: emissive shapes, or light from outside
  bool infinite_lights_;  // light comes from outside
  bool footprint_;
  std::string_view no_light_paths_;
  bool uv_ = false;  // points on surfaces are asked for theirs
  std::uint32_t shape_lights_;  // their number
  bool motion_;      // some instance moves: rays have times
  bool subsurface_;  // some material has a medium inside, and light scatters there
  Shutter shutter_;
  std::uint32_t first_pair_;  // of a vertex's numbers that is of use: the first one chooses among lights
  double fixed_units_;     // of fixed point, in one
  float footprint_scale_;  // pbrt: a sample's footprint is a pixel's over sqrt(spp), in pbrt-v4 an eighth at least
  Resident& resident_;
  std::unique_ptr<Shading> shading_;
  std::unique_ptr<Lights> lights_;
  std::unique_ptr<const Media> media_;  // null: the job has none
  std::vector<Interface> interfaces_;   // by material, where a path has a medium that it is in (v3)
  std::uint16_t camera_medium_ = 0;
  // As far a shadow ray to a light at infinity meets media: the diameter of the scene's sphere, as in
  // pbrt-v3 and v4, or such lights would not shine into a medium without bounds.
  float longest_shadow_ = kInfinity;
  bool grids_ = false;     // there are bricks to collide with
  std::vector<bool> bounded_;  // by medium: Manifest::bounded_media; empty where there is none
  bool one_channel_ = false;  // a path is of one channel: grids differ between them
  LightPaths light_paths_ = LightPaths::none;
  SharedRays shared_;  // camera rays
  float film_pixels_ = 0;  // that are rendered
  bool null_surfaces_ = false;  // shadow rays pass surfaces without material: these are all in the main scene
  std::unique_ptr<Camera> camera_;
  std::unique_ptr<Filter> filter_;
  mutable EngineTime time_;
  std::vector<OcclusionRay>* recorded_ = nullptr;
};

}  // namespace cloudrenderer
