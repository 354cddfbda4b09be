// Rays through what is resident.
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "trace/joint_scene.h"
#include "trace/loaded_part.h"

namespace cloudrenderer {

namespace {

// What a hit must come before, in a ray that ends at t_max.
void begin(QueryContext::Lane& lane, const Hit& hit, float t_max) {
  const bool ends = t_max < hit.t;
  lane.t = ends ? t_max : hit.t;
  lane.geometry = lane.instance = kForeign;
  lane.shape = ends ? kNone : hit.shape;
  lane.primitive = ends ? kNone : hit.primitive;
}

QueryContext make_context(const LoadedPart& part, const SceneFunctions* scene, QueryContext::Lane* lane, const TraceRay& ray) {
  QueryContext c;
  rtcInitIntersectContext(&c.embree);
  c.part = &part;
  c.scene = scene;
  c.lanes = lane;
  c.ray = &ray;
  c.times = &ray.time;
  c.bricks = ray.bricks;
  return c;
}
template <class Target>
QueryContext make_context(const Target& target, const SceneFunctions* scene, QueryContext::Lane* lanes, const RayPacket& rays) {
  QueryContext c;
  rtcInitIntersectContext(&c.embree);
  target.begin(c);
  c.scene = scene;
  c.lanes = lanes;
  c.packet = &rays;
  c.times = rays.times;
  return c;
}

// What a packet is traced through: one part, or all that are joined. member: of a hit.
struct OnePart {
  const LoadedPart& loaded;
  std::uint32_t number;
  RTCScene scene() const { return loaded.scene(); }
  const LoadedPart& part(std::uint32_t /*member*/) const { return loaded; }
  std::uint32_t part_number(std::uint32_t /*member*/) const { return number; }
  void begin(QueryContext& c) const { c.part = &loaded; }
  // The rays that do not surely miss it.
  std::uint32_t may_hit(const RayPacket& rays, std::uint32_t active, Float8 t_far) const {
    if (!loaded.few_quadrics()) return active;
    return active & ~lanes::to_bits(loaded.surely_misses(rays.origin, rays.direction, t_far));
  }
  bool may_lie_beside() const { return !loaded.few_quadrics(); }
};
struct JoinedParts {
  const JointScene& joint;
  RTCScene scene() const { return joint.scene(); }
  const LoadedPart& part(std::uint32_t member) const { return joint.member(member); }
  std::uint32_t part_number(std::uint32_t member) const { return joint.part(member); }
  void begin(QueryContext& c) const { c.joint = &joint; }
  std::uint32_t may_hit(const RayPacket&, std::uint32_t active, Float8) const { return active; }
  bool may_lie_beside() const { return true; }
};

// Settles the hits of a packet that are not, at least one.
template <class Target>
void settle_packet(const Target& target, const RayPacket& rays, std::uint32_t which, QueryContext::Lane* hits) {
  std::array<std::array<const float*, kLanes>, 3> places;
  for (std::size_t i = 0; i < kLanes; ++i) {
    const std::size_t from = which >> i & 1 ? i : static_cast<std::size_t>(std::countr_zero(which));
    const Part& part = target.part(hits[from].member).part();
    const Triangle corners = part.triangles[hits[from].index];
    for (std::size_t c = 0; c < 3; ++c) places[c][i] = &part.positions[corners[static_cast<int>(c)]].x;
  }
  std::array<Vec3x8, 3> corners;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto g = lanes::gather<3>(places[c]);
    corners[c] = Vec3x8(g[0], g[1], g[2]);
  }
  const TriangleHitOf<Float8> exact = triangle_hit(corners, rays.origin, rays.direction);
  for (; which; which &= which - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(which));
    hits[i].t = lanes::get(exact.t, i);
    hits[i].u = lanes::get(exact.u, i);
    hits[i].v = lanes::get(exact.v, i);
  }
}

void take_hit(const LoadedPart& part, std::uint32_t part_id, const QueryContext::Lane& lane, Hit& hit) {
  hit.t = lane.t;
  hit.u = lane.u;
  hit.v = lane.v;
  hit.part = part_id;
  hit.instance = lane.instance;
  hit.geometry = lane.geometry;
  hit.index = lane.index;
  part.ids(lane.geometry, lane.index, lane.instance, hit.shape, hit.primitive);
}

RTCRay single_ray(const TraceRay& ray, const Vec3& direction, float t_far) {
  RTCRay r;
  r.org_x = ray.origin.x;
  r.org_y = ray.origin.y;
  r.org_z = ray.origin.z;
  r.tnear = 0;
  r.dir_x = direction.x;
  r.dir_y = direction.y;
  r.dir_z = direction.z;
  r.time = 0;
  r.tfar = t_far;
  r.mask = 0xffffffffu;
  r.id = 0;
  r.flags = 0;
  return r;
}

// A ray that starts in the plane of a vertex, across an axis, and runs in it, as exactly as its numbers can tell, touches the
// boxes on both sides that begin there, but Embree's test sees those of one side only: which of the triangles along the plane
// it offers then depends on what else is in their boxes, and so on how a mesh was split. Such rays are traced once more for
// each other side, turned to it by less than matters.
constexpr float kAlong = 0x1p-21f, kTurned = 0x1p-42f;
// query(lanes, direction) for each other way of a ray, and the lanes that have it.
template <class F, class Query>
void each_beside(const Vec3Of<F>& direction, MaskOf<F> active, const Query& query) {
  const std::array<MaskOf<F>, 3> along{lanes::abs(direction.x) < kAlong, lanes::abs(direction.y) < kAlong,
                                       lanes::abs(direction.z) < kAlong};
  if (!lanes::any(active && (along[0] || along[1] || along[2]))) return;
  for (unsigned axes = 1; axes < 7; ++axes) {
    MaskOf<F> which = active;
    Vec3Of<F> turned = direction;
    for (int a = 0; a < 3; ++a) {
      if (!(axes >> a & 1u)) continue;
      which = which && along[static_cast<std::size_t>(a)];
      turned[a] = lanes::select(direction[a] < 0.f, F(kTurned), F(-kTurned));
    }
    if (lanes::any(which)) query(which, turned);
  }
}

// Embree's packet. Lanes that are off still get the numbers of one that is on: Embree reads them before it masks them.
template <class Rays>
void fill(Rays& r, int* valid, const RayPacket& rays, const Vec3x8& direction, std::uint32_t active, Float8 t_far) {
  const auto on = static_cast<std::size_t>(std::countr_zero(active));
  const Mask8 mask = lanes::from_mask_bits(active);
  const auto put = [&](float* to, Float8 x) {
    if (active != 0xffu) x = lanes::select(mask, x, lanes::get(x, on));
    x.store(to);
  };
  put(r.org_x, rays.origin.x);
  put(r.org_y, rays.origin.y);
  put(r.org_z, rays.origin.z);
  put(r.dir_x, direction.x);
  put(r.dir_y, direction.y);
  put(r.dir_z, direction.z);
  put(r.tfar, t_far);
  const auto put_bits = [](void* to, Ints8 x) { std::memcpy(to, &x, sizeof x); };
  put_bits(valid, mask.v);
  put_bits(r.tnear, Ints8{});
  put_bits(r.time, Ints8{});
  put_bits(r.mask, Ints8{} - 1);
  put_bits(r.id, Ints8{0, 1, 2, 3, 4, 5, 6, 7});
  put_bits(r.flags, Ints8{});
}

// Embree's rays go in `direction`, beside the true ones, if so.
template <class Target>
void query_packet(const Target& target, const SceneFunctions* scene, const RayPacket& rays, const Vec3x8& direction, bool beside,
                  std::uint32_t active, Coherence coherence, Hit* hits) {
  // Eight numbers that are put together in memory would have to wait for the last of them to be written.
  const Float8 known = Float8::of(Floats8{hits[0].t, hits[1].t, hits[2].t, hits[3].t, hits[4].t, hits[5].t, hits[6].t, hits[7].t});
  const Float8 t_far = reach(lanes::min(rays.t_max, known));
  active = target.may_hit(rays, active, t_far);
  if (!active) return;
  QueryContext::Lane lanes[8];
  QueryContext context = make_context(target, scene, lanes, rays);
  context.beside = beside;
  if (coherence == Coherence::alike) context.embree.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  RTCRayHit8 rh;
  alignas(32) int valid[8];
  fill(rh.ray, valid, rays, direction, active, t_far);
  for (int i = 0; i < 8; ++i) {
    begin(lanes[i], hits[i], lanes::get(rays.t_max, static_cast<std::size_t>(i)));
    rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  rtcIntersect8(valid, target.scene(), &context.embree, &rh);
  Ints8 geometry;
  std::memcpy(&geometry, rh.hit.geomID, sizeof geometry);
  std::uint32_t found = active & ~lanes::to_bits(Mask8::of(geometry == -1));
  if (context.unsettled) settle_packet(target, rays, context.unsettled, lanes);
  for (; found; found &= found - 1) {
    const int i = std::countr_zero(found);
    take_hit(target.part(lanes[i].member), target.part_number(lanes[i].member), lanes[i], hits[i]);
  }
}

template <class Target>
void intersect_packet(const Target& target, const SceneFunctions* scene, const RayPacket& rays, std::uint32_t active,
                      Coherence coherence, Hit* hits) {
  query_packet(target, scene, rays, rays.direction, false, active, coherence, hits);
  if (!target.may_lie_beside()) return;
  each_beside<Float8>(rays.direction, lanes::from_mask_bits(active), [&](Mask8 which, const Vec3x8& direction) {
    query_packet(target, scene, rays, direction, true, lanes::to_bits(which), coherence, hits);
  });
}

template <class Target>
std::uint32_t occluded_packet(const Target& target, const SceneFunctions* scene, const RayPacket& rays, std::uint32_t active) {
  active = target.may_hit(rays, active, rays.t_max);
  if (!active) return 0;
  // Even to one light rays part early enough that Embree's way for coherent packets takes half as long again.
  QueryContext context = make_context(target, scene, nullptr, rays);
  RTCRay8 r;
  alignas(32) int valid[8];
  fill(r, valid, rays, rays.direction, active, rays.t_max);
  rtcOccluded8(valid, target.scene(), &context.embree, &r);
  return active & lanes::to_bits(Float8::load(r.tfar) < 0.f);
}

}  // namespace

const Part& ResidentSet::part(std::uint32_t part) const { return parts_[part]->part(); }
const Part& ResidentSet::prototype(std::uint32_t part, std::uint32_t instance) const {
  return parts_[part]->prototype(instance).part();
}

const Transform& ResidentSet::place(std::uint32_t part, std::uint32_t instance, float time, Transform& moved) const {
  const LoadedPart& p = *parts_[part];
  if (!p.part().motions.empty())
    if (const LoadedPart::Moving* m = p.moving_instance(instance); m && !m->moves.empty()) return moved = m->to_world(time);
  return p.part().instances[instance].to_world;
}

bool ResidentSet::enters_exactly(std::uint32_t part, std::uint32_t instance) const {
  const LoadedPart::Moving* const m = parts_[part]->moving_instance(instance);
  return m && m->moves.empty();
}

bool ResidentSet::intersect(std::uint32_t part_id, const TraceRay& ray, Hit& hit) const {
  const LoadedPart& part = *parts_[part_id];
  bool any = false;
  const auto query = [&](const Vec3& direction, bool beside) {
    const float t_far = reach(std::min(ray.t_max, hit.t));
    if (part.few_quadrics() && (beside || part.surely_misses(ray.origin, ray.direction, t_far))) return;
    QueryContext::Lane lane;
    begin(lane, hit, ray.t_max);
    QueryContext context = make_context(part, scene_.get(), &lane, ray);
    context.beside = beside;
    RTCRayHit rh;
    rh.ray = single_ray(ray, direction, t_far);
    rh.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rh.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(part.scene(), &context.embree, &rh);
    if (rh.hit.geomID == RTC_INVALID_GEOMETRY_ID) return;
    if (context.unsettled) settle(part, ray.origin, ray.direction, lane);
    take_hit(part, part_id, lane, hit);
    any = true;
  };
  query(ray.direction, false);
  each_beside<float>(ray.direction, true, [&](bool, const Vec3& direction) { query(direction, true); });
  return any;
}

void ResidentSet::intersect8(std::uint32_t part_id, const RayPacket& rays, std::uint32_t active, Coherence coherence,
                             Hit* hits) const {
  intersect_packet(OnePart{*parts_[part_id], part_id}, scene_.get(), rays, active, coherence, hits);
}

void ResidentSet::intersect_joined8(const RayPacket& rays, std::uint32_t active, Coherence coherence, Hit* hits) const {
  intersect_packet(JoinedParts{*joint_}, scene_.get(), rays, active, coherence, hits);
}

bool ResidentSet::joined(std::uint32_t part) const { return joint_ && joint_->has(part); }
std::size_t ResidentSet::joined_count() const { return joint_ ? joint_->count() : 0; }
bool ResidentSet::may_join(const RayPacket& rays) const { return joint_ && joint_->is_near(rays.origin); }

bool ResidentSet::occluded(std::uint32_t part_id, const TraceRay& ray) const {
  const LoadedPart& part = *parts_[part_id];
  if (part.few_quadrics() && part.surely_misses(ray.origin, ray.direction, ray.t_max)) return false;
  QueryContext context = make_context(part, scene_.get(), nullptr, ray);
  RTCRay r = single_ray(ray, ray.direction, ray.t_max);
  rtcOccluded1(part.scene(), &context.embree, &r);
  return r.tfar < 0;
}

std::uint32_t ResidentSet::occluded8(std::uint32_t part_id, const RayPacket& rays, std::uint32_t active) const {
  return occluded_packet(OnePart{*parts_[part_id], part_id}, scene_.get(), rays, active);
}
std::uint32_t ResidentSet::occluded_joined8(const RayPacket& rays, std::uint32_t active) const {
  return occluded_packet(JoinedParts{*joint_}, scene_.get(), rays, active);
}

}  // namespace cloudrenderer
