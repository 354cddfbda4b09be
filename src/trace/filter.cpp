// Which of Embree's hits count.
#include <bit>
#include <cstring>

#include "trace/joint_scene.h"
#include "trace/loaded_part.h"
#include "trace/user_geometry.h"

namespace cloudrenderer {

namespace {

// A bit a lane. Mostly one lane of a packet asks, and looking at one after the other would cost a wrong guess of the
// processor each time.
std::uint32_t valid_lanes(const int* valid, unsigned n) {
  if (n == kLanes) {
    Ints8 on;
    std::memcpy(&on, valid, sizeof on);
    return lanes::to_bits(Mask8::of(on));
  }
  std::uint32_t bits = 0;
  for (unsigned i = 0; i < n; ++i) bits |= static_cast<std::uint32_t>(valid[i] != 0) << i;
  return bits;
}

const LoadedPart& part_of(const QueryContext& context, const QueryContext::Lane& hit) {
  return context.part ? *context.part : context.joint->member(hit.member);
}

// Whether a settled hit comes before the best one of its lane, which is settled for it.
[[gnu::noinline]] bool is_first(const QueryContext::Lane& found, QueryContext& context, unsigned lane) {
  QueryContext::Lane& best = context.lanes[lane];
  if (context.unsettled >> lane & 1) settle(part_of(context, best), context.origin(lane), context.direction(lane), best);
  context.unsettled &= ~(1u << lane);
  if (found.t != best.t) return found.t < best.t;
  std::uint32_t shape, primitive, best_shape = best.shape, best_primitive = best.primitive;
  part_of(context, found).ids(found.geometry, found.index, found.instance, shape, primitive);
  if (best.instance != kForeign)
    part_of(context, best).ids(best.geometry, best.index, best.instance, best_shape, best_primitive);
  return shape < best_shape || (shape == best_shape && primitive < best_primitive);
}

// Of a triangle that a ray beside the true one has met: true if it is the best hit now.
[[gnu::noinline]] bool take_beside(const LoadedPart& owner, QueryContext& context, unsigned lane, std::uint32_t instance,
                                   std::uint32_t index) {
  Vec3 origin = context.origin(lane), direction = context.direction(lane);
  if (instance != kNone) {
    origin = context.placed->point<float>(origin);
    direction = context.placed->vector<float>(direction);
  }
  QueryContext::Lane found{0, kTriangles, index, instance, 0, 0, 0, 0, context.member};
  settle(owner, origin, direction, found);
  if (!(found.t > 0.f)) return false;
  if (owner.has_alpha() &&
      !owner.opaque(kTriangles, index, found.u, found.v, origin, direction, found.t, false, *context.scene))
    return false;
  if (!is_first(found, context, lane)) return false;
  context.lanes[lane] = found;
  return true;
}

}  // namespace

// Hits come in an order that depends on the BVH. What counts is the order (t, shape, primitive), so the first of
// equal distance must not win by chance. Nor may the distances that Embree computed decide where they are as good as
// equal: there they are computed again. Elsewhere that can wait until the best one is known.
void intersect_filter(const RTCFilterFunctionNArguments* args) {
  auto* context = reinterpret_cast<QueryContext*>(args->context);
  const auto* owner = static_cast<const LoadedPart*>(args->geometryUserPtr);
  const unsigned n = args->N;
  for (std::uint32_t left = valid_lanes(args->valid, n); left; left &= left - 1) {
    const auto i = static_cast<unsigned>(std::countr_zero(left));
    // Lanes of a packet keep their number in the ray's id.
    const unsigned lane = RTCRayN_id(args->ray, n, i);
    QueryContext::Lane& best = context->lanes[lane];
    const float t = RTCRayN_tfar(args->ray, n, i);
    // The ray reaches a little behind the best hit (see reach()): what is really behind it is no hit.
    if (t > best.t * (1.f + 2 * kEmbreeError) && !context->beside) {
      args->valid[i] = 0;
      continue;
    }
    static_assert(RTC_INVALID_GEOMETRY_ID == kNone);
    const std::uint32_t instance = RTCHitN_instID(args->hit, n, i, 0);
    const std::uint32_t geometry = RTCHitN_geomID(args->hit, n, i), index = RTCHitN_primID(args->hit, n, i);
    if (context->beside) [[unlikely]] {
      if (geometry == kTriangles && take_beside(*owner, *context, lane, instance, index))
        RTCRayN_tfar(args->ray, n, i) = reach(best.t);
      else
        args->valid[i] = 0;
      continue;
    }
    const bool nearer = t < best.t * (1.f - 2 * kEmbreeError);
    if (nearer && geometry == kTriangles && instance == kNone && !owner->has_alpha()) {
      best.t = t;
      best.geometry = geometry;
      best.index = index;
      best.instance = instance;
      best.member = context->member;
      context->unsettled |= 1u << lane;
      RTCRayN_tfar(args->ray, n, i) = reach(t);
      continue;
    }
    const LaneRay r = lane_ray(args->ray, n, i);  // in the space of an instance
    QueryContext::Lane found{t, geometry, index, instance, 0, 0, RTCHitN_u(args->hit, n, i), RTCHitN_v(args->hit, n, i), context->member};
    if (geometry == kTriangles) settle(*owner, r.origin, r.direction, found);
    if (owner->has_alpha() &&
        !owner->opaque(geometry, index, found.u, found.v, r.origin, r.direction, found.t, false, *context->scene)) {
      args->valid[i] = 0;
      continue;
    }
    if (nearer) {
      context->unsettled &= ~(1u << lane);  // this one is settled, and in its place
    } else if (!is_first(found, *context, lane)) {
      args->valid[i] = 0;
      continue;
    }
    best = found;
    RTCRayN_tfar(args->ray, n, i) = reach(found.t);
  }
}

void occluded_filter(const RTCFilterFunctionNArguments* args) {
  const auto* context = reinterpret_cast<const QueryContext*>(args->context);
  const auto* owner = static_cast<const LoadedPart*>(args->geometryUserPtr);
  const unsigned n = args->N;
  for (std::uint32_t left = valid_lanes(args->valid, n); left; left &= left - 1) {
    const auto i = static_cast<unsigned>(std::countr_zero(left));
    const float t_max = context->t_max(RTCRayN_id(args->ray, n, i));
    QueryContext::Lane found{RTCRayN_tfar(args->ray, n, i), RTCHitN_geomID(args->hit, n, i), RTCHitN_primID(args->hit, n, i),
                             kNone, 0, 0, 0, 0, 0};
    // Shapes of our own do not come here.
    const bool surely = found.t < t_max * (1.f - 4 * kEmbreeError);
    if (surely && !owner->has_alpha()) continue;
    const LaneRay r = lane_ray(args->ray, n, i);
    settle(*owner, r.origin, r.direction, found);
    if ((!surely && !(found.t < occlusion_end(t_max))) ||
        (owner->has_alpha() &&
         !owner->opaque(found.geometry, found.index, found.u, found.v, r.origin, r.direction, found.t, true, scene_of(args->context))))
      args->valid[i] = 0;
  }
}

void settle(const LoadedPart& part, const Vec3& origin, const Vec3& direction, QueryContext::Lane& hit) {
  const Triangle corners = part.part().triangles[hit.index];
  const auto& positions = part.part().positions;
  const auto exact = triangle_hit<float>({positions[corners.x], positions[corners.y], positions[corners.z]}, origin, direction);
  hit.t = exact.t;
  hit.u = exact.u;
  hit.v = exact.v;
}

}  // namespace cloudrenderer
