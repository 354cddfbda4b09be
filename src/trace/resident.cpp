#include "trace/resident.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "trace/loaded_part.h"
#include "trace/part_cache.h"

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

QueryContext make_context(const LoadedPart& part, const SceneFunctions* scene, QueryContext::Lane* lanes) {
  QueryContext c;
  rtcInitIntersectContext(&c.embree);
  c.part = &part;
  c.scene = scene;
  c.lanes = lanes;
  return c;
}
QueryContext make_context(const LoadedPart& part, const SceneFunctions* scene, QueryContext::Lane* lane, const TraceRay& ray) {
  QueryContext c = make_context(part, scene, lane);
  c.ray = &ray;
  c.times = &ray.time;
  c.bricks = ray.bricks;
  return c;
}
QueryContext make_context(const LoadedPart& part, const SceneFunctions* scene, QueryContext::Lane* lanes, const RayPacket& rays) {
  QueryContext c = make_context(part, scene, lanes);
  c.packet = &rays;
  c.times = rays.times;
  return c;
}

// Settles the hits of a packet that are not, at least one.
void settle_packet(const Part& part, const RayPacket& rays, std::uint32_t which, QueryContext::Lane* hits) {
  std::array<std::array<const float*, kLanes>, 3> places;
  for (std::size_t i = 0; i < kLanes; ++i) {
    const std::size_t from = which >> i & 1 ? i : static_cast<std::size_t>(std::countr_zero(which));
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
  hit.geometry = part.is_brick(lane.geometry, lane.instance) ? kBrickHit : lane.geometry;
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

// The rays of a packet that do not surely miss the part.
std::uint32_t that_may_hit(const LoadedPart& part, const RayPacket& rays, std::uint32_t active, Float8 t_far) {
  if (!part.few_quadrics()) return active;
  return active & ~lanes::to_bits(part.surely_misses(rays.origin, rays.direction, t_far));
}

// Embree's packet. Lanes that are off still get the numbers of one that is on: Embree reads them before it masks them.
template <class Rays>
void fill(Rays& r, int* valid, const RayPacket& rays, std::uint32_t active, Float8 t_far) {
  const auto on = static_cast<std::size_t>(std::countr_zero(active));
  const Mask8 mask = lanes::from_mask_bits(active);
  const auto put = [&](float* to, Float8 x) {
    if (active != 0xffu) x = lanes::select(mask, x, lanes::get(x, on));
    x.store(to);
  };
  put(r.org_x, rays.origin.x);
  put(r.org_y, rays.origin.y);
  put(r.org_z, rays.origin.z);
  put(r.dir_x, rays.direction.x);
  put(r.dir_y, rays.direction.y);
  put(r.dir_z, rays.direction.z);
  put(r.tfar, t_far);
  const auto put_bits = [](void* to, Ints8 x) { std::memcpy(to, &x, sizeof x); };
  put_bits(valid, mask.v);
  put_bits(r.tnear, Ints8{});
  put_bits(r.time, Ints8{});
  put_bits(r.mask, Ints8{} - 1);
  put_bits(r.id, Ints8{0, 1, 2, 3, 4, 5, 6, 7});
  put_bits(r.flags, Ints8{});
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
  const float t_far = reach(std::min(ray.t_max, hit.t));
  if (part.few_quadrics() && part.surely_misses(ray.origin, ray.direction, t_far)) return false;
  QueryContext::Lane lane;
  begin(lane, hit, ray.t_max);
  QueryContext context = make_context(part, scene_.get(), &lane, ray);
  RTCRayHit rh;
  rh.ray = single_ray(ray, t_far);
  rh.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rh.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(part.scene(), &context.embree, &rh);
  if (rh.hit.geomID == RTC_INVALID_GEOMETRY_ID) return false;
  if (context.unsettled) settle(part, ray.origin, ray.direction, lane);
  take_hit(part, part_id, lane, hit);
  return true;
}

void ResidentSet::intersect8(std::uint32_t part_id, const RayPacket& rays, std::uint32_t active, Coherence coherence,
                             Hit* hits) const {
  const LoadedPart& part = *parts_[part_id];
  // Eight numbers that are put together in memory would have to wait for the last of them to be written.
  const Float8 known = Float8::of(Floats8{hits[0].t, hits[1].t, hits[2].t, hits[3].t, hits[4].t, hits[5].t, hits[6].t, hits[7].t});
  const Float8 t_far = reach(lanes::min(rays.t_max, known));
  active = that_may_hit(part, rays, active, t_far);
  if (!active) return;
  QueryContext::Lane lanes[8];
  QueryContext context = make_context(part, scene_.get(), lanes, rays);
  if (coherence == Coherence::alike) context.embree.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  RTCRayHit8 rh;
  alignas(32) int valid[8];
  fill(rh.ray, valid, rays, active, t_far);
  for (int i = 0; i < 8; ++i) {
    begin(lanes[i], hits[i], lanes::get(rays.t_max, static_cast<std::size_t>(i)));
    rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  rtcIntersect8(valid, part.scene(), &context.embree, &rh);
  Ints8 geometry;
  std::memcpy(&geometry, rh.hit.geomID, sizeof geometry);
  std::uint32_t found = active & ~lanes::to_bits(Mask8::of(geometry == -1));
  if (context.unsettled) settle_packet(part.part(), rays, context.unsettled, lanes);
  for (; found; found &= found - 1) {
    const int i = std::countr_zero(found);
    take_hit(part, part_id, lanes[i], hits[i]);
  }
}

bool ResidentSet::occluded(std::uint32_t part_id, const TraceRay& ray) const {
  const LoadedPart& part = *parts_[part_id];
  if (part.few_quadrics() && part.surely_misses(ray.origin, ray.direction, ray.t_max)) return false;
  QueryContext context = make_context(part, scene_.get(), nullptr, ray);
  RTCRay r = single_ray(ray, ray.t_max);
  rtcOccluded1(part.scene(), &context.embree, &r);
  return r.tfar < 0;
}

std::uint32_t ResidentSet::occluded8(std::uint32_t part_id, const RayPacket& rays, std::uint32_t active) const {
  const LoadedPart& part = *parts_[part_id];
  active = that_may_hit(part, rays, active, rays.t_max);
  if (!active) return 0;
  // Even to one light rays part early enough that Embree's way for coherent packets takes half as long again.
  QueryContext context = make_context(part, scene_.get(), nullptr, rays);
  RTCRay8 r;
  alignas(32) int valid[8];
  fill(r, valid, rays, active, rays.t_max);
  rtcOccluded8(valid, part.scene(), &context.embree, &r);
  return active & lanes::to_bits(Float8::load(r.tfar) < 0.f);
}

Resident::Resident(const Options& options)
    : cache_(options.cache),
      device_(cache_ ? nullptr : std::make_shared<Device>(options.threads, options.isa.c_str())) {
  set_scene({options.alpha, {}});
}

Resident::~Resident() {
  if (!cache_) return;
  for (Loaded& part : held()) cache_->give_back(part);
}

void Resident::set_scene(SceneFunctions scene) {
  now_.scene_ = std::make_shared<const SceneFunctions>(std::move(scene));
  set_.reset();
}
bool Alpha::opaque(const Vec3& origin, const Vec3& direction, const Vec3& p) const {
  if (!by_chance) return value != 0.f;
  if (!(value > 0.f)) return false;
  if (value >= 1.f) return true;
  std::uint64_t key = 0;
  for (const Vec3& v : {origin, direction, p})
    for (int i = 0; i < 3; ++i) key = mix64(key + std::bit_cast<std::uint32_t>(v[i] + 0.f));  // -0 is 0
  return to_unit(static_cast<std::uint32_t>(key >> 32)) < value;
}

void Resident::set_alpha(AlphaFunction alpha) { set_scene({std::move(alpha), now_.scene_->rates}); }
void Resident::set_collision_rates(std::vector<CollisionRate> rates) { set_scene({now_.scene_->alpha, std::move(rates)}); }

Resident::Loaded Resident::build(Part part, std::vector<Loaded> prototypes, BvhForm form) {
  if (!cache_) return std::make_shared<const LoadedPart>(device_, std::move(part), std::move(prototypes), form);
  bool there = false;
  return cache_->take({}, [&] {
    return [&](const std::shared_ptr<Device>& device) {
      return std::make_shared<const LoadedPart>(device, std::move(part), std::move(prototypes), form);
    };
  }, there);
}

Resident::Loaded Resident::share(const PartKey& key, BvhForm form, const std::function<Part()>& read,
                                 const std::function<void(const Part&)>& check, bool& there) {
  const Loaded loaded = cache_->take(key, [&]() -> PartCache::Build {
    // Shared, because what builds must be copyable.
    const auto part = std::make_shared<Part>(read());
    return [part, form, prototypes = prototypes_of(*part)](const std::shared_ptr<Device>& device) {
      return std::make_shared<const LoadedPart>(device, std::move(*part), prototypes, form);
    };
  }, there);
  if (!there) return loaded;
  try {
    check(loaded->part());
  } catch (...) {
    cache_->give_back(loaded);
    throw;
  }
  return loaded;
}

std::vector<Resident::Loaded> Resident::prototypes_of(const Part& part) const {
  const std::lock_guard lock(mutex_);
  std::vector<Loaded> needed(prototypes_.size());
  for (const InstanceRecord& r : part.instances)
    if (r.prototype < prototypes_.size()) needed[r.prototype] = prototypes_[r.prototype];
  return needed;
}

void Resident::exchange(Loaded& place, Loaded& with) {
  if (cache_) held_ += (with ? with->bytes() : 0) - (place ? place->bytes() : 0);
  held_peak_ = std::max(held_peak_, held_);
  std::swap(place, with);
}

void Resident::drop(Loaded loaded) {
  if (loaded && cache_) cache_->give_back(loaded);
}

void Resident::put_prototype(std::uint32_t prototype, Loaded loaded) {
  {
    const std::lock_guard lock(mutex_);
    if (prototypes_.size() <= prototype) prototypes_.resize(prototype + 1);
    exchange(prototypes_[prototype], loaded);
  }
  drop(std::move(loaded));
}

void Resident::put_part(PartId id, Loaded loaded) {
  {
    const std::lock_guard lock(mutex_);
    if (now_.parts_.size() <= id.value) now_.parts_.resize(id.value + 1);
    exchange(now_.parts_[id.value], loaded);
    set_.reset();
  }
  drop(std::move(loaded));
}

std::uint64_t Resident::load_prototype(std::uint32_t prototype, Part part) {
  const Loaded loaded = build(std::move(part), {}, BvhForm::fast);
  put_prototype(prototype, loaded);
  return loaded->bytes();
}

std::uint64_t Resident::load_part(PartId id, Part part, BvhForm form) {
  auto needed = prototypes_of(part);
  const Loaded loaded = build(std::move(part), std::move(needed), form);
  put_part(id, loaded);
  return loaded->bytes();
}

bool Resident::share_prototype(std::uint32_t prototype, const PartKey& key, const std::function<Part()>& read,
                               const std::function<void(const Part&)>& check) {
  bool there = false;
  put_prototype(prototype, share(key, BvhForm::fast, read, check, there));
  return there;
}

bool Resident::share_part(PartId id, const PartKey& key, BvhForm form, const std::function<Part()>& read,
                          const std::function<void(const Part&)>& check) {
  bool there = false;
  put_part(id, share(key, form, read, check, there));
  return there;
}

void Resident::unload_part(PartId id) {
  Loaded gone;
  {
    const std::lock_guard lock(mutex_);
    if (!now_.has(id.value)) return;
    exchange(now_.parts_[id.value], gone);
    set_.reset();
  }
  drop(std::move(gone));
}

void Resident::unload_prototype(std::uint32_t prototype) {
  Loaded gone;
  {
    const std::lock_guard lock(mutex_);
    if (prototype < prototypes_.size()) exchange(prototypes_[prototype], gone);
  }
  drop(std::move(gone));
}

bool Resident::has_prototype(std::uint32_t prototype) const {
  const std::lock_guard lock(mutex_);
  return prototype < prototypes_.size() && prototypes_[prototype] != nullptr;
}

std::vector<Resident::Loaded> Resident::held() const {
  const std::lock_guard lock(mutex_);
  std::vector<Loaded> all;
  for (const auto* list : {&prototypes_, &now_.parts_})
    std::ranges::copy_if(*list, std::back_inserter(all), [](const Loaded& p) { return p != nullptr; });
  return all;
}

std::uint64_t Resident::bytes() const {
  if (!cache_) return device_->bytes();
  const std::lock_guard lock(mutex_);
  return held_;
}

double Resident::own_bytes() const { return cache_ ? cache_->share_of(held()) : static_cast<double>(bytes()); }

std::uint64_t Resident::peak_bytes() const {
  if (!cache_) return device_->peak();
  const std::lock_guard lock(mutex_);
  return held_peak_;
}

std::shared_ptr<const ResidentSet> Resident::snapshot() const {
  const std::lock_guard lock(mutex_);
  if (!set_) set_ = std::make_shared<const ResidentSet>(now_);
  return set_;
}

}  // namespace cloudrenderer
