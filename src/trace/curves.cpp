// Curves. Embree has flat and normal-oriented ones of its own, which it cuts into straight pieces: their distance,
// parameters and ends are not those of pbrt's, and differ between packets and single rays.
#include "shapes/surface.h"
#include "trace/user_geometry.h"

namespace cloudrenderer {

namespace {

void bounds(const RTCBoundsFunctionArguments* args) {
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  const Bounds3 b = self->curve_bounds(args->primID);
  *args->bounds_o = {b.min.x, b.min.y, b.min.z, 0, b.max.x, b.max.y, b.max.z, 0};
}

void intersect(const RTCIntersectFunctionNArguments* args) {
  if (is_beside(args->context)) return;
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  RTCRayN* rays = RTCRayHitN_RayN(args->rayhit, args->N);
  for (unsigned i = 0; i < args->N; ++i) {
    if (!args->valid[i]) continue;
    const LaneRay r = lane_ray(rays, args->N, i);
    CurveHit found;
    if (self->intersect_curve(args->primID, r.origin, r.direction, r.t_near, r.t_far, found))
      offer_hit(args, i, r, found.t, found.u, found.v);
  }
}

void occluded(const RTCOccludedFunctionNArguments* args) {
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  for (unsigned i = 0; i < args->N; ++i) {
    if (!args->valid[i]) continue;
    const LaneRay r = lane_ray(args->ray, args->N, i);
    CurveHit found;
    if (!self->intersect_curve(args->primID, r.origin, r.direction, r.t_near, r.t_far, found)) continue;
    if (self->has_alpha() && !self->opaque(kCurves, args->primID, found.u, found.v, r.origin, r.direction, found.t, true,
                                               scene_of(args->context)))
      continue;
    RTCRayN_tfar(args->ray, args->N, i) = -kInfinity;
  }
}

}  // namespace

void LoadedPart::add_curves() {
  const CurveArrays& curves = part_.curves;
  if (curves.segments.empty()) return;
  for (const CurveGroup& g : curves.groups) curve_to_object_.push_back(glm::inverse(glm::dmat3(Mat4(g.object_to_world.matrix()))));
  device_->attach(scene_.get(), kCurves, curves.segments.size(), this, {bounds, intersect, occluded});
  device_->check("curves");
}

Bounds3 LoadedPart::curve_bounds(std::uint32_t segment) const {
  const CurveArrays& curves = part_.curves;
  const CurveRecord& record = curves.record_of(segment);
  const CurveGroup& group = curves.groups[record.group];
  const auto [u0, u1] = curves.range(segment);
  Bounds3 b = object_bounds(curves.piece(record), u0, u1);
  if (group.placed) b = b.transformed(group.object_to_world);
  const Vec3 slack = 0x1p-20f * glm::max(glm::abs(b.min), glm::abs(b.max));  // hits are computed in another space
  return {b.min - slack, b.max + slack};
}

bool LoadedPart::intersect_curve(std::uint32_t segment, const Vec3& origin, const Vec3& direction, float t_min, float t_max,
                                 CurveHit& hit) const {
  const CurveArrays& curves = part_.curves;
  const CurveRecord& record = curves.record_of(segment);
  const CurveGroup& group = curves.groups[record.group];
  const std::uint32_t number = curves.segments[segment] & ((1u << kCurveSegmentBits) - 1);
  if (!group.placed && cloudrenderer::surely_misses(&curves.points[record.first_point], std::max(record.width[0], record.width[1]),
                                     group.log2_segments, number, origin, direction, t_min, t_max))
    return false;
  const auto [u0, u1] = curves.range(segment);
  CurveRay ray{glm::dvec3(origin), glm::dvec3(direction)};
  if (group.placed) {
    const glm::dmat3& to_object = curve_to_object_[record.group];
    ray.origin = to_object * (ray.origin - glm::dvec3(group.object_to_world.matrix()[3]));
    ray.direction = to_object * ray.direction;
  }
  return cloudrenderer::intersect(curves.piece(record), u0, u1, ray, t_min, t_max, hit);
}

bool LoadedPart::curve_is_opaque(std::uint32_t segment, float u, float v, const Vec3& origin, const Vec3& direction, bool shadow,
                                 const SceneFunctions& scene) const {
  const CurveGroup& g = part_.curves.group_of(segment);
  const std::uint32_t texture = shadow && g.shadow_alpha_texture != kNone ? g.shadow_alpha_texture : g.alpha_texture;
  if (texture == kNone) return true;
  const SurfacePoint s = curve_point(part_.curves, segment, direction, u, v);
  return scene.alpha(texture, s.uv, s.p).opaque(origin, direction, s.p);
}

}  // namespace cloudrenderer
