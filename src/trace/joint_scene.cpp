#include "trace/joint_scene.h"

#include <algorithm>

namespace cloudrenderer {
namespace {

void member_bounds(const RTCBoundsFunctionArguments* args) {
  const Bounds3& b = static_cast<const JointScene*>(args->geometryUserPtr)->bounds(args->primID);
  *args->bounds_o = {b.min.x, b.min.y, b.min.z, 0, b.max.x, b.max.y, b.max.z, 0};
}

// A packet of Embree's goes on into a member as it is; hits in there are told by the context whose they are.
RTCScene enter(RTCIntersectContext* context, const void* joint, unsigned member) {
  reinterpret_cast<QueryContext*>(context)->member = member;
  return static_cast<const JointScene*>(joint)->member(member).scene();
}

void member_intersect(const RTCIntersectFunctionNArguments* args) {
  if (args->N != kLanes) return;  // only packets are traced here
  rtcIntersect8(args->valid, enter(args->context, args->geometryUserPtr, args->primID), args->context,
                reinterpret_cast<RTCRayHit8*>(args->rayhit));
}

void member_occluded(const RTCOccludedFunctionNArguments* args) {
  if (args->N != kLanes) return;
  rtcOccluded8(args->valid, enter(args->context, args->geometryUserPtr, args->primID), args->context,
               reinterpret_cast<RTCRay8*>(args->ray));
}

// Embree's test of boxes around shapes that are not its own is off by a few roundings of the ray's origin and of its way.
// Boxes are wider by more, for origins within kFarthest times the largest coordinate.
constexpr float kWider = 0x1p-17f, kFarthest = 4;

}  // namespace

std::shared_ptr<const JointScene> JointScene::build(std::shared_ptr<Device> device,
                                                    std::span<const std::shared_ptr<const LoadedPart>> parts) {
  auto joint = std::make_shared<JointScene>();
  joint->has_.resize(parts.size());
  float largest = 0;
  // The main scene is tested first for all rays, and is mostly a few large shapes.
  for (std::uint32_t i = 1; i < parts.size(); ++i) {
    if (!parts[i] || !parts[i]->part().bricks.empty()) continue;
    RTCBounds b;
    rtcGetSceneBounds(parts[i]->scene(), &b);
    const Bounds3 box{{b.lower_x, b.lower_y, b.lower_z}, {b.upper_x, b.upper_y, b.upper_z}};
    joint->members_.push_back({i, parts[i], box});
    joint->has_[i] = true;
    if (box.empty()) continue;
    for (int a = 0; a < 3; ++a) largest = std::max({largest, std::abs(box.min[a]), std::abs(box.max[a])});
  }
  if (joint->members_.size() < 2 || !(largest < 1e17f)) return nullptr;
  for (Member& m : joint->members_)
    if (!m.bounds.empty()) m.bounds = {m.bounds.min - kWider * largest, m.bounds.max + kWider * largest};
  joint->farthest_ = kFarthest * largest;
  joint->device_ = std::move(device);
  const RTCDevice embree = joint->device_->get();
  joint->scene_.reset(rtcNewScene(embree));
  rtcSetSceneFlags(joint->scene_.get(), RTC_SCENE_FLAG_ROBUST);
  joint->device_->attach(joint->scene_.get(), 0, joint->members_.size(), joint.get(), {member_bounds, member_intersect, member_occluded});
  rtcCommitScene(joint->scene_.get());
  joint->device_->check("joint scene");
  return joint;
}

}  // namespace cloudrenderer
