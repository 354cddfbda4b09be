#include "trace/resident.h"

#include <algorithm>
#include <bit>

#include "trace/loaded_part.h"

namespace cloudrenderer {

namespace {

QueryContext::Lane lane_of(const Hit& hit) {
  return {hit.t, kForeign, 0, kForeign, hit.shape, hit.primitive};
}

QueryContext make_context(const LoadedPart& part, QueryContext::Lane* lanes, bool coherent) {
  QueryContext c;
  rtcInitIntersectContext(&c.embree);
  if (coherent) c.embree.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  c.part = &part;
  c.lanes = lanes;
  return c;
}

void take_hit(const LoadedPart& part, std::uint32_t part_id, const QueryContext::Lane& lane, float u, float v, Hit& hit) {
  hit.t = lane.t;
  hit.u = u;
  hit.v = v;
  hit.part = part_id;
  hit.instance = lane.instance;
  hit.geometry = lane.geometry;
  hit.index = lane.index;
  part.ids(lane.geometry, lane.index, lane.instance, hit.shape, hit.primitive);
}

RTCRay single_ray(const TraceRay& ray, float t_far) {
  RTCRay r;
  r.org_x = ray.origin.x;
  r.org_y = ray.origin.y;
  r.org_z = ray.origin.z;
  r.tnear = 0;
  r.dir_x = ray.direction.x;
  r.dir_y = ray.direction.y;
  r.dir_z = ray.direction.z;
  r.time = 0;
  r.tfar = t_far;
  r.mask = 0xffffffffu;
  r.id = 0;
  r.flags = 0;
  return r;
}

// The rays of a packet that do not surely miss the part; t_far(i): where ray i ends.
template <class End>
std::uint32_t that_may_hit(const LoadedPart& part, const TraceRay* const* rays, std::uint32_t active, End t_far) {
  if (!part.few_quadrics()) return active;
  for (std::uint32_t left = active; left; left &= left - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(left));
    if (part.surely_misses(*rays[i], t_far(i))) active &= ~(1u << i);
  }
  return active;
}

template <class Rays>
void fill_lane(Rays& r, int i, const TraceRay& ray, float t_far) {
  r.org_x[i] = ray.origin.x;
  r.org_y[i] = ray.origin.y;
  r.org_z[i] = ray.origin.z;
  r.tnear[i] = 0;
  r.dir_x[i] = ray.direction.x;
  r.dir_y[i] = ray.direction.y;
  r.dir_z[i] = ray.direction.z;
  r.time[i] = 0;
  r.tfar[i] = t_far;
  r.mask[i] = 0xffffffffu;
  r.id[i] = static_cast<unsigned>(i);
  r.flags[i] = 0;
}

}  // namespace

const Part& ResidentSet::part(std::uint32_t part) const { return parts_[part]->part(); }
const Part& ResidentSet::prototype(std::uint32_t part, std::uint32_t instance) const {
  return parts_[part]->prototype(instance).part();
}

bool ResidentSet::intersect(std::uint32_t part_id, const TraceRay& ray, Hit& hit) const {
  const LoadedPart& part = *parts_[part_id];
  const float t_far = std::min(ray.t_max, reach(hit.t));
  if (part.few_quadrics() && part.surely_misses(ray, t_far)) return false;
  QueryContext::Lane lane = lane_of(hit);
  QueryContext context = make_context(part, &lane, false);
  RTCRayHit rh;
  rh.ray = single_ray(ray, t_far);
  rh.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rh.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(part.scene(), &context.embree, &rh);
  if (rh.hit.geomID == RTC_INVALID_GEOMETRY_ID) return false;
  take_hit(part, part_id, lane, rh.hit.u, rh.hit.v, hit);
  return true;
}

void ResidentSet::intersect8(std::uint32_t part_id, const TraceRay* const* rays, Hit* const* hits,
                             std::uint32_t active) const {
  const LoadedPart& part = *parts_[part_id];
  active = that_may_hit(part, rays, active, [&](std::size_t i) { return std::min(rays[i]->t_max, reach(hits[i]->t)); });
  if (!active) return;
  QueryContext::Lane lanes[8];
  QueryContext context = make_context(part, lanes, true);
  RTCRayHit8 rh;
  alignas(32) int valid[8];
  for (int i = 0; i < 8; ++i) {
    const bool on = (active >> i) & 1u;
    valid[i] = on ? -1 : 0;
    // Lanes that are off still get numbers: Embree reads them before it masks them.
    const int from = on ? i : std::countr_zero(active);
    lanes[i] = lane_of(*hits[from]);
    fill_lane(rh.ray, i, *rays[from], std::min(rays[from]->t_max, reach(hits[from]->t)));
    rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  rtcIntersect8(valid, part.scene(), &context.embree, &rh);
  for (int i = 0; i < 8; ++i)
    if (valid[i] && rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID)
      take_hit(part, part_id, lanes[i], rh.hit.u[i], rh.hit.v[i], *hits[i]);
}

bool ResidentSet::occluded(std::uint32_t part_id, const TraceRay& ray) const {
  const LoadedPart& part = *parts_[part_id];
  if (part.few_quadrics() && part.surely_misses(ray, ray.t_max)) return false;
  QueryContext context = make_context(part, nullptr, false);
  RTCRay r = single_ray(ray, ray.t_max);
  rtcOccluded1(part.scene(), &context.embree, &r);
  return r.tfar < 0;
}

std::uint32_t ResidentSet::occluded8(std::uint32_t part_id, const TraceRay* const* rays, std::uint32_t active) const {
  const LoadedPart& part = *parts_[part_id];
  active = that_may_hit(part, rays, active, [&](std::size_t i) { return rays[i]->t_max; });
  if (!active) return 0;
  QueryContext context = make_context(part, nullptr, true);
  RTCRay8 r;
  alignas(32) int valid[8];
  for (int i = 0; i < 8; ++i) {
    const bool on = (active >> i) & 1u;
    valid[i] = on ? -1 : 0;
    const TraceRay& ray = *rays[on ? i : std::countr_zero(active)];
    fill_lane(r, i, ray, ray.t_max);
  }
  rtcOccluded8(valid, part.scene(), &context.embree, &r);
  std::uint32_t blocked = 0;
  for (int i = 0; i < 8; ++i)
    if (valid[i] && r.tfar[i] < 0) blocked |= 1u << i;
  return blocked;
}

Resident::Resident(const Options& options)
    : alpha_(options.alpha),
      device_(std::make_shared<Device>(options.threads, options.isa.c_str())),
      set_(std::make_shared<ResidentSet>()) {}
Resident::~Resident() = default;

void Resident::set_alpha(AlphaFunction alpha) { alpha_ = std::move(alpha); }

std::uint64_t Resident::load_prototype(std::uint32_t prototype, Part part) {
  auto loaded = std::make_shared<const LoadedPart>(device_, alpha_, std::move(part),
                                                   std::vector<std::shared_ptr<const LoadedPart>>(), BvhForm::fast);
  const std::lock_guard lock(mutex_);
  if (prototypes_.size() <= prototype) prototypes_.resize(prototype + 1);
  prototypes_[prototype] = loaded;
  return loaded->bytes();
}

std::uint64_t Resident::load_part(PartId id, Part part, BvhForm form) {
  std::vector<std::shared_ptr<const LoadedPart>> needed;
  {
    const std::lock_guard lock(mutex_);
    needed.resize(prototypes_.size());
    for (const InstanceRecord& r : part.instances)
      if (r.prototype < prototypes_.size()) needed[r.prototype] = prototypes_[r.prototype];
  }
  auto loaded = std::make_shared<const LoadedPart>(device_, alpha_, std::move(part), std::move(needed), form);
  const std::lock_guard lock(mutex_);
  auto next = std::make_shared<ResidentSet>(*set_);
  if (next->parts_.size() <= id.value) next->parts_.resize(id.value + 1);
  next->parts_[id.value] = loaded;
  set_ = std::move(next);
  return loaded->bytes();
}

void Resident::unload_part(PartId id) {
  const std::lock_guard lock(mutex_);
  if (!set_->has(id.value)) return;
  auto next = std::make_shared<ResidentSet>(*set_);
  next->parts_[id.value].reset();
  set_ = std::move(next);
}

void Resident::unload_prototype(std::uint32_t prototype) {
  const std::lock_guard lock(mutex_);
  if (prototype < prototypes_.size()) prototypes_[prototype].reset();
}

bool Resident::has_prototype(std::uint32_t prototype) const {
  const std::lock_guard lock(mutex_);
  return prototype < prototypes_.size() && prototypes_[prototype] != nullptr;
}

std::uint64_t Resident::bytes() const { return device_->bytes(); }
std::uint64_t Resident::peak_bytes() const { return device_->peak(); }

std::shared_ptr<const ResidentSet> Resident::snapshot() const {
  const std::lock_guard lock(mutex_);
  return set_;
}

}  // namespace cloudrenderer
