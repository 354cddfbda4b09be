#include "trace/resident.h"

#include <algorithm>
#include <bit>

#include "trace/joint_scene.h"
#include "trace/loaded_part.h"
#include "trace/part_cache.h"

namespace cloudrenderer {

Resident::Resident(const Options& options)
    : cache_(options.cache),
      device_(cache_ ? nullptr : std::make_shared<Device>(options.threads, options.isa.c_str())),
      isa_(options.isa) {
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
  if (!set_) {
    auto set = std::make_shared<ResidentSet>(now_);
    if (std::ranges::count_if(set->parts_, [](const Loaded& p) { return p != nullptr; }) > 1) {
      if (!joint_device_) joint_device_ = std::make_shared<Device>(1, isa_.c_str());
      set->joint_ = JointScene::build(joint_device_, set->parts_);
    }
    set_ = std::move(set);
  }
  return set_;
}

}  // namespace cloudrenderer
