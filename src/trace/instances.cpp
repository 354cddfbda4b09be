// Instances that stand still.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/error.h"
#include "trace/user_geometry.h"

namespace cloudrenderer {
namespace {

// Boxes of shapes that are not its own Embree tests without slack, off by a few roundings of the ray's origin and its way. So they
// are wider by this much of the part's largest coordinate.
constexpr float kWider = 0x1p-18f;

void bounds(const RTCBoundsFunctionArguments* args) {
  const Bounds3& b = static_cast<const LoadedPart*>(args->geometryUserPtr)->placed_instance(args->primID).bounds;
  *args->bounds_o = {b.min.x, b.min.y, b.min.z, 0, b.max.x, b.max.y, b.max.z, 0};
}

// Rays of Embree's in the space of an instance, for as long as this lives: one, or eight. (Also of rays with hits: these are
// behind the rays.)
template <class Ray>
class Inside;

template <>
class Inside<RTCRay8> {
 public:
  Inside(const LoadedPart::Placed& placed, RTCRay8& ray, const int* valid) : ray_(ray) {
    origin_ = {Float8::load(ray.org_x), Float8::load(ray.org_y), Float8::load(ray.org_z)};
    direction_ = {Float8::load(ray.dir_x), Float8::load(ray.dir_y), Float8::load(ray.dir_z)};
    Vec3x8 o = placed.point(origin_), d = placed.vector(direction_);
    Ints8 on;
    std::memcpy(&on, valid, sizeof on);
    const Mask8 good = Mask8::of(on) && traceable(o, d);
    std::memcpy(valid_, &good.v, sizeof valid_);
    any_ = lanes::any(good);
    if (lanes::any(!good)) {  // Embree must not see what cannot be traced, not even where it is off
      o = lanes::select(good, o, Vec3x8(Float8(0.f)));
      d = lanes::select(good, d, Vec3x8(Float8(1.f)));
    }
    put(o, d);
  }
  ~Inside() { put(origin_, direction_); }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;
  bool any() const { return any_; }
  const int* valid() const { return valid_; }

 private:
  void put(const Vec3x8& o, const Vec3x8& d) {
    o.x.store(ray_.org_x);
    o.y.store(ray_.org_y);
    o.z.store(ray_.org_z);
    d.x.store(ray_.dir_x);
    d.y.store(ray_.dir_y);
    d.z.store(ray_.dir_z);
  }
  RTCRay8& ray_;
  Vec3x8 origin_, direction_;
  alignas(32) int valid_[kLanes];
  bool any_;
};

template <>
class Inside<RTCRay> {
 public:
  Inside(const LoadedPart::Placed& placed, RTCRay& ray, const int* valid)
      : ray_(ray), origin_(ray.org_x, ray.org_y, ray.org_z), direction_(ray.dir_x, ray.dir_y, ray.dir_z) {
    const Vec3 o = placed.point<float>(origin_), d = placed.vector<float>(direction_);
    any_ = *valid && traceable(o, d);
    if (any_) put(o, d);
  }
  ~Inside() { put(origin_, direction_); }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;
  bool any() const { return any_; }

 private:
  void put(const Vec3& o, const Vec3& d) {
    ray_.org_x = o.x;
    ray_.org_y = o.y;
    ray_.org_z = o.z;
    ray_.dir_x = d.x;
    ray_.dir_y = d.y;
    ray_.dir_z = d.z;
  }
  RTCRay& ray_;
  Vec3 origin_, direction_;
  bool any_;
};

// Tells whose the hits in there are: they carry the instance's number, as those of Embree's instances.
class Numbered {
 public:
  Numbered(RTCIntersectContext* context, const LoadedPart::Placed& placed) : context_(reinterpret_cast<QueryContext*>(context)) {
    context_->embree.instID[0] = placed.instance;
    context_->placed = &placed;
  }
  ~Numbered() {
    context_->embree.instID[0] = RTC_INVALID_GEOMETRY_ID;
    context_->placed = nullptr;
  }
  Numbered(const Numbered&) = delete;
  Numbered& operator=(const Numbered&) = delete;

 private:
  QueryContext* context_;
};

void intersect(const RTCIntersectFunctionNArguments* args) {
  const LoadedPart::Placed& p = static_cast<const LoadedPart*>(args->geometryUserPtr)->placed_instance(args->primID);
  const Numbered numbered(args->context, p);
  if (args->N == kLanes) {
    auto* rays = reinterpret_cast<RTCRayHit8*>(args->rayhit);
    const Inside<RTCRay8> inside(p, rays->ray, args->valid);
    if (inside.any()) rtcIntersect8(inside.valid(), p.prototype->scene(), args->context, rays);
  } else if (args->N == 1) {
    auto* ray = reinterpret_cast<RTCRayHit*>(args->rayhit);
    const Inside<RTCRay> inside(p, ray->ray, args->valid);
    if (inside.any()) rtcIntersect1(p.prototype->scene(), args->context, ray);
  }
}

void occluded(const RTCOccludedFunctionNArguments* args) {
  const LoadedPart::Placed& p = static_cast<const LoadedPart*>(args->geometryUserPtr)->placed_instance(args->primID);
  const Numbered numbered(args->context, p);
  if (args->N == kLanes) {
    auto* rays = reinterpret_cast<RTCRay8*>(args->ray);
    const Inside<RTCRay8> inside(p, *rays, args->valid);
    if (inside.any()) rtcOccluded8(inside.valid(), p.prototype->scene(), args->context, rays);
  } else if (args->N == 1) {
    auto* ray = reinterpret_cast<RTCRay*>(args->ray);
    const Inside<RTCRay> inside(p, *ray, args->valid);
    if (inside.any()) rtcOccluded1(p.prototype->scene(), args->context, ray);
  }
}

}  // namespace

void LoadedPart::add_instances() {
  float largest = 0;
  for (std::uint32_t i = 0; i < part_.instances.size(); ++i) {
    const InstanceRecord& record = part_.instances[i];
    if (moving_instance(i)) continue;
    if (record.prototype >= prototypes_.size() || !prototypes_[record.prototype])
      throw ClusterError("part loaded before its prototype " + std::to_string(record.prototype));
    Placed& p = placed_.emplace_back();
    p.instance = i;
    p.prototype = prototypes_[record.prototype].get();
    const Affine to_world(record.to_world.matrix()), to_object = to_world.inverse();
    for (int a = 0; a < 3; ++a) p.axes[static_cast<std::size_t>(a)] = Vec3(to_object.m[a]);
    p.offset = Vec3(to_object.t);
    RTCBounds b;
    rtcGetSceneBounds(p.prototype->scene(), &b);
    p.bounds = moved_bounds(to_world, {}, {{b.lower_x, b.lower_y, b.lower_z}, {b.upper_x, b.upper_y, b.upper_z}});
    if (p.bounds.empty()) continue;
    for (int a = 0; a < 3; ++a) largest = std::max({largest, std::abs(p.bounds.min[a]), std::abs(p.bounds.max[a])});
  }
  if (placed_.empty()) return;
  for (Placed& p : placed_)
    if (!p.bounds.empty()) p.bounds = {p.bounds.min - kWider * largest, p.bounds.max + kWider * largest};
  device_->attach(scene_.get(), kPlaced, placed_.size(), this, {bounds, intersect, occluded});
  device_->check("instances");
}

}  // namespace cloudrenderer
