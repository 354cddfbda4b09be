#pragma once
// A scene without geometry: rays are lists of the parts that they may hit. It keeps every rule of PathEngine (masks,
// windows, conservative order, only resident parts are tested); what lies along a ray and what happens there is the
// derived class's. Not for several threads.
#include <cstdint>
#include <set>
#include <vector>

#include "integrator/engine.h"

namespace cloudrenderer::sim {

struct ListCandidate {
  float t_enter;
  std::uint32_t part;
};

class ListEngine : public PathEngine {
 public:
  std::set<std::uint32_t> resident;

  void trace(SegmentBatch& batch) const override;
  void route(SegmentBatch& batch) const override { trace(batch); }
  void shade(SegmentBatch& batch, ShadeOutput& out) const override;
  std::vector<bool> occluded(std::span<const OcclusionRay> rays, std::span<const float> times,
                             std::span<std::uint8_t> blocked) const override;
  void nearest(std::span<const OcclusionRay> rays, std::span<AnsweredHit> hits) const override;
  void mark_tested(PathSegment& s, float t_max, const std::vector<bool>& answered) const override;

 protected:
  static constexpr std::uint16_t kMainDone = kMainTested;
  static constexpr std::uint32_t kNoPart = 0xffffffffu;
  using Candidates = std::vector<ListCandidate>;

  virtual std::uint32_t part_count() const = 0;
  // Of a segment, or of a ray that asks for the nearest hit in its place; and of a shadow ray.
  virtual void candidates(const Vec3& origin, Candidates& list) const = 0;
  virtual void shadow_candidates(const OcclusionRay& ray, Candidates& list) const = 0;
  virtual void hit_part(const Vec3& origin, const ListCandidate& c, Hit& hit) const = 0;
  virtual void hit_main(const Vec3& origin, Hit& hit) const = 0;
  virtual bool blocks(const OcclusionRay& ray, std::uint32_t part) const = 0;
  virtual void shade_one(const PathSegment& s, const Hit& hit, ShadeOutput& out) const = 0;
  // Parks the path if parts that are not resident must be asked for its shadow ray; else adds `contribution` where the
  // ray is free. True if it was parked.
  bool cast_shadow(const OcclusionRay& ray, const Fixed3& contribution, PathSegment& n, bool ends, std::uint16_t flags,
                   ShadeOutput& out) const;

  mutable std::uint64_t tested_ = 0;  // candidates, by trace() and occluded()

 private:
  void trace_one(PathSegment& s, Hit& hit, PartId& next) const;
  mutable Candidates list_;
};

}  // namespace cloudrenderer::sim
