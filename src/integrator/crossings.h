#pragma once
// Inside src/integrator only: what rays pass of the main scene, which every host has.
#include <vector>

#include "integrator/path_tracer.h"

namespace cloudrenderer {

inline constexpr int kMaxCrossings = 1000;  // of surfaces by one shadow ray, or events of one path that do not scatter it

// The surfaces of the main scene along a ray, nearest first, each passed whatever it is.
class PathTracer::Crossings {
 public:
  Crossings(const PathTracer& tracer, const ResidentSet& set, const Vec3& origin, const Vec3& direction, float distance, float time)
      : tracer_(tracer), set_(set), from_(origin), direction_(direction), left_(distance), time_(time) {}

  // Goes on to the next one within the distance. False: there is none.
  bool next();
  // Of the surface: where along the ray, and how far behind the one before.
  float t() const { return t_; }
  float step() const { return step_; }
  std::uint32_t material() const { return material_; }
  // Whether media differ on its two sides; of those what the ray leaves and enters, as in PathSegment::medium.
  bool is_border() const;
  std::uint16_t left_medium() const { return outwards_ ? sides().inside : sides().outside; }
  std::uint16_t entered_medium() const { return outwards_ ? sides().outside : sides().inside; }
  // Where the rest of the ray starts.
  const Vec3& from() const { return from_; }
  bool is_endless() const { return count_ > kMaxCrossings; }  // given up

 private:
  Interface sides() const { return material_ < tracer_.interfaces_.size() ? tracer_.interfaces_[material_] : Interface{}; }

  const PathTracer& tracer_;
  const ResidentSet& set_;
  Vec3 from_, direction_;
  float left_, time_, t_ = 0, step_ = 0;
  std::uint32_t material_ = 0;
  bool outwards_ = false;
  int count_ = 0;
};

// What a shadow ray is in where surfaces tell, found when it is first asked for. A function of the ray and the main scene
// alone, so that any host finds the same. One ray after another.
class PathTracer::ShadowStretches final : public MediumStretches {
 public:
  ShadowStretches(const PathTracer& tracer, const ResidentSet& set) : tracer_(tracer), set_(set) {}
  void begin(const OcclusionRay& ray, float time) {
    ray_ = ray;
    time_ = time;
    found_.clear();
  }
  std::span<const MediumStretch> along(std::uint32_t medium) override;

 private:
  // Where no surface along the ray tells: what one farther on, or behind it, does.
  std::uint16_t medium_at_start() const;

  const PathTracer& tracer_;
  const ResidentSet& set_;
  OcclusionRay ray_;
  float time_ = 0;
  std::vector<MediumStretch> found_;
};

}  // namespace cloudrenderer
