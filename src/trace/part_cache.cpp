#include "trace/part_cache.h"

#include <algorithm>
#include <limits>

#include "base/random.h"
#include "trace/loaded_part.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kUnshared = std::numeric_limits<std::uint64_t>::max();  // PartKey::bytes of parts that nobody shares

}  // namespace

PartKey prototype_key(const Manifest& manifest, std::uint32_t prototype) {
  const PrototypeInfo& p = manifest.prototypes[prototype];
  return {p.checksum, p.file_bytes, 0, false};
}

PartKey part_key(const Manifest& manifest, std::uint32_t part, BvhForm form) {
  const PartInfo& p = manifest.parts[part];
  PartKey key{p.checksum, p.file_bytes, 0, form == BvhForm::passing};
  for (const std::uint32_t i : p.prototypes) {
    const PartKey prototype = prototype_key(manifest, i);
    if (prototype.file == 0) key.file = 0;
    for (const std::uint64_t x : {std::uint64_t{i}, prototype.file, prototype.bytes}) key.prototypes = mix64(key.prototypes + x);
  }
  return key;
}

PartCache::PartCache(Options options)
    : options_(std::move(options)), device_(std::make_shared<Device>(options_.threads, options_.isa.c_str())) {}
PartCache::~PartCache() = default;

bool PartCache::has(const PartKey& key) const {
  const std::lock_guard lock(mutex_);
  return key.file != 0 && entries_.contains(key);
}

PartCache::Loaded PartCache::take(const PartKey& wanted, const std::function<Build()>& make, bool& there) {
  PartKey key = wanted;
  {
    std::unique_lock lock(mutex_);
    if (key.file == 0) key = {0, kUnshared, unshared_++, false};
    finished_.wait(lock, [&] { return !building_.contains(key); });
    const auto found = entries_.find(key);
    there = found != entries_.end();
    if (there) {
      ++found->second.users;
      return found->second.part;
    }
    building_.insert(key);
  }
  const auto done = [&](Loaded part) {
    const std::lock_guard lock(mutex_);
    if (part) {
      entries_[key] = {part, 1, 0};
      keys_[part.get()] = key;
    }
    building_.erase(key);
    finished_.notify_all();
    return part;
  };
  try {
    const Build build = make();
    const std::lock_guard building(build_mutex_);
    return done(build(device_));
  } catch (...) {
    done(nullptr);
    throw;
  }
}

void PartCache::give_back(const Loaded& part) {
  const std::lock_guard lock(mutex_);
  const auto key = keys_.find(part.get());
  if (key == keys_.end()) return;
  Entry& e = entries_.at(key->second);
  if (--e.users == 0) e.left = ++clock_;
}

bool PartCache::reserve(const void* user, std::vector<Need> needs) {
  const std::lock_guard building(build_mutex_);
  const std::lock_guard lock(mutex_);
  Reserved& own = reserved_[user];
  own = {0, std::move(needs)};
  for (const Need& n : own.needs)
    if (n.key.file == 0 || !entries_.contains(n.key)) own.bytes += n.bytes;
  std::uint64_t needed = 0;
  for (const auto& [other, reserved] : reserved_) needed += reserved.bytes;
  drop_idle(needed);
  if (own.bytes == 0 || (needed <= options_.memory && bytes() <= options_.memory - needed)) return true;
  reserved_.erase(user);
  return false;
}

void PartCache::release(const void* user) {
  const std::lock_guard lock(mutex_);
  reserved_.erase(user);
}

void PartCache::tidy() {
  const std::unique_lock building(build_mutex_, std::try_to_lock);
  if (!building) return;
  const std::lock_guard lock(mutex_);
  drop_idle(0);
}

// Prototypes can be dropped only after the parts that use them.
void PartCache::drop_idle(std::uint64_t needed) {
  while (drop_some(needed)) {
  }
}

// A batch that runs may still hold what its scene has left: that cannot be dropped yet.
bool PartCache::drop_some(std::uint64_t needed) {
  const auto wanted = [&](const PartKey& key) {
    return std::ranges::any_of(reserved_, [&](const auto& r) {
      return std::ranges::any_of(r.second.needs, [&](const Need& n) { return n.key == key; });
    });
  };
  std::vector<std::pair<std::uint64_t, PartKey>> idle;
  for (const auto& [key, e] : entries_)
    if (e.users == 0 && e.part.use_count() == 1 && (key.file == 0 || !wanted(key))) idle.emplace_back(e.left, key);
  std::ranges::sort(idle);
  bool dropped = false;
  for (const auto& [left, key] : idle) {
    if (key.file != 0 && needed <= options_.memory && bytes() <= options_.memory - needed) continue;
    const auto it = entries_.find(key);
    keys_.erase(it->second.part.get());
    entries_.erase(it);
    dropped = true;
  }
  return dropped;
}

void PartCache::add_other(std::int64_t bytes) { device_->add_shared(bytes); }
std::uint64_t PartCache::bytes() const { return device_->bytes(); }
std::uint64_t PartCache::peak_bytes() const { return device_->peak(); }

double PartCache::share_of(std::span<const Loaded> parts) const {
  const std::lock_guard lock(mutex_);
  double sum = 0;
  for (const Loaded& part : parts)
    if (const auto key = keys_.find(part.get()); key != keys_.end())
      sum += static_cast<double>(part->bytes()) / std::max(1u, entries_.at(key->second).users);
  return sum;
}

}  // namespace cloudrenderer
