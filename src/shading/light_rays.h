#pragma once
// Rays that leave the lights of a scene. Private to the lights.
#include <span>
#include <vector>

#include "shading/light_aims.h"
#include "shading/light_infinite.h"
#include "shading/light_map.h"
#include "shading/light_record.h"

namespace cloudrenderer {

// The lights' records, which belong to somebody else.
struct EmitterRecords {
  std::span<const Emitter> emitters;
  std::span<const SpotCone> spots;
  std::span<const DirectionalMap> maps;
  std::span<const EmissiveQuadric> quadrics;
  std::span<const InfiniteLight> infinite;
  std::span<const EmitterPicture> pictures;
};

// Chooses emitters half by their power, half evenly; points on shapes by area and directions by the cosine, directions of
// points evenly where they shine, light from outside on the disk across it that the scene's sphere fills. A share of the
// rays is aimed.
class LightRays {
 public:
  LightRays() = default;
  LightRays(const EmitterRecords& records, const Bounds3& scene);
  // See Lights.
  void aim(std::span<const Bounds3> boxes, float share);
  bool emit(float u_light, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const;
  float emission(std::uint32_t emitter, const Vec3& p, const Vec3& wi, float distance) const;
  float infinite_emission(const Vec3& p, const Vec3& direction) const;
  std::uint64_t bytes() const { return choice_.bytes() + even_.size() * sizeof(float); }

 private:
  float power(const Emitter& e) const;
  float area(const Emitter& e) const;  // of a shape
  // The share of the aimed rays in u, which is made another number, or that of the others.
  bool is_aimed(float& u) const;
  // Density of lines along `direction` through p; `chosen`: see LightAims.
  float across(const Vec3& p, const Vec3& direction, std::size_t chosen = LightAims::kNoneChosen) const;
  bool emit_from_shape(const Emitter& e, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const;
  bool emit_from_point(const Emitter& e, const Vec2& u_direction, LightRay& out) const;
  bool emit_from_outside(const Emitter& e, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const;

  EmitterRecords records_;
  Vec3 center_{};
  float radius_ = 0;
  Distribution1D choice_;
  std::vector<float> even_;  // of each emitter: its chance, times, of a shape, the density of points by area
  LightAims aims_;
  float aimed_ = 0;  // share of the rays
  std::vector<std::uint32_t> infinite_emitters_;
};

}  // namespace cloudrenderer
