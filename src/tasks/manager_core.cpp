// Who is there, and who holds what.
#include "tasks/manager_core.h"

#include <algorithm>

namespace cloudrenderer {
namespace {

constexpr double kMostThreads = 4096;
constexpr std::uint32_t kMaxHost = 0xfffe;  // a path's owner has 16 bits
// What no host has: such numbers are an error, or meant to do harm.
constexpr std::uint32_t kAbsurdThreads = 1u << 16;
constexpr std::uint64_t kAbsurdMemory = std::uint64_t{1} << 50;
constexpr double kUnreachableFactor =
    2;  // of lost_after_s: until a host that peers cannot reach is given up

std::string quoted(const std::string& text) { return text.empty() ? "unknown" : '"' + text + '"'; }

}  // namespace

bool ManagerCore::can(const wire::Hello& hello, wire::Category category) {
  return hello.categories().empty() ||
         std::find(hello.categories().begin(), hello.categories().end(), category) !=
             hello.categories().end();
}

ManagerCore::ManagerCore(const ManagerOptions& options, JobSpec job)
    : options_(options),
      job_(std::move(job)),
      film_(job_.frame, job_.k),
      features_(job_.start.features() ? job_.frame.pixels() : 0),
      generation_(options.first_generation),
      fingerprint_(options.fingerprint) {
  options_.round_samples = std::max(1u, options_.round_samples);
  options_.tile = std::clamp(options_.tile, 1u, 128u);
  progress_.paths_total = job_.frame.pixels() * job_.spp;
  unassigned_paths_ = progress_.paths_total;
  for (std::uint32_t r = 0; r < rounds(); ++r)
    round_left_.push_back(job_.frame.pixels() *
                          std::min(options_.round_samples, job_.spp - r * options_.round_samples));
  allowed_rounds_ = options_.hold_rounds ? 1 : rounds();
  if (options_.fixed_tile != 0) set_tile(options_.fixed_tile);
}

Result<HostId> ManagerCore::join(const wire::Hello& hello, double now) {
  const auto refuse = [](const std::string& why) { return Result<HostId>::failure(why); };
  if (hello.protocol() != wire::kProtocolVersion)
    return refuse("this cluster speaks protocol version " + std::to_string(wire::kProtocolVersion) +
                  ", the host speaks " + std::to_string(hello.protocol()));
  if (phase_ == Phase::ending || finished()) return refuse("the job is over");
  if (hello.threads() == 0 || hello.threads() > kAbsurdThreads)
    return refuse("the host says that it has " + std::to_string(hello.threads()) +
                  " threads; 1 to " + std::to_string(kAbsurdThreads) + " are believed");
  if (hello.memory() > kAbsurdMemory)
    return refuse("the host says that it may use " + std::to_string(hello.memory() >> 40) +
                  " TiB of memory; up to " + std::to_string(kAbsurdMemory >> 40) +
                  " TiB are believed");
  if (next_host_ > kMaxHost) return refuse("the job has had too many hosts");
  if ((hello.fingerprint() == 0 || (fingerprint_ && *fingerprint_ != hello.fingerprint())) &&
      !options_.allow_inexact && !hello.allow_inexact())
    return refuse(std::string("the host computes other bits than ") +
                  (options_.fingerprint ? "those in the checkpoint" : "the cluster") +
                  " (numeric fingerprint; instruction set " + quoted(hello.instruction_set()) + " against " +
                  quoted(instruction_sets()) + "); --allow-inexact lets it join");
  if (!can(hello, wire::TRACER) && !can(hello, wire::INTERSECTION))
    return refuse("the host neither traces nor intersects: there is no work for it");
  if (job_.start.features() && can(hello, wire::TRACER) && !has_feature(hello, "layers"))
    return refuse("the job has layers of what paths see, and the host does not know how to tell it (\"layers\")");
  const std::uint64_t least = main_bytes() + job_.parts[0].build;
  if (can(hello, wire::TRACER) && hello.memory() < least)
    return refuse("the host may use " + std::to_string(hello.memory() >> 20) +
                  " MiB, but what every host must hold needs " + std::to_string((least >> 20) + 1) +
                  " MiB");
  // A host that says of itself that it computes in another way sets no measure for those that follow.
  if (!fingerprint_ && hello.fingerprint() != 0) fingerprint_ = hello.fingerprint();
  bit_exact_ = bit_exact_ && fingerprint_ == hello.fingerprint();

  const HostId id(next_host_++);
  Host& h = hosts_[id];
  h.hello = hello;
  h.heard = h.rate_since = now;
  h.entry.set_host(id.value);
  h.entry.set_name(hello.name());
  h.entry.set_address(hello.listen());
  h.entry.set_incarnation(hello.incarnation());
  h.entry.set_memory(hello.memory());
  h.entry.set_threads(hello.threads());
  h.entry.set_only_intersects(!h.traces());
  reports_[id].hello = hello;
  reports_[id].joined = now;

  wire::Welcome welcome;
  welcome.set_host(id.value);
  welcome.set_incarnation(options_.incarnation);
  welcome.set_heartbeat_s(options_.heartbeat_s);
  welcome.set_lost_after_s(options_.lost_after_s);
  send(id, std::move(welcome));
  send(id, job_.start);
  next_growth_ = now + options_.map_every_s;
  if (phase_ == Phase::gathering && hosts_.size() >= options_.min_hosts) phase_ = Phase::loading;
  if (phase_ != Phase::gathering) place_all(now);
  return id;
}

std::string ManagerCore::instruction_sets() const {
  std::set<std::string> sets;
  for (const auto& [id, h] : hosts_)
    if (h.hello.fingerprint() == fingerprint_) sets.insert(h.hello.instruction_set());
  std::string text;
  for (const std::string& s : sets) text += (text.empty() ? "" : ", ") + s;
  return text;
}

double ManagerCore::Host::threads() const {
  return std::clamp<double>(hello.threads(), 1, kMostThreads);
}

std::uint64_t ManagerCore::main_bytes() const {
  std::uint64_t bytes = job_.parts[0].bytes;
  for (const std::uint32_t p : job_.parts[0].prototypes) bytes += job_.prototype_bytes[p];
  return bytes;
}

void ManagerCore::new_map(bool generation, const Plan* with_drops) {
  ++epoch_;
  if (generation) ++generation_;
  wire::SceneHostMap map;
  map.set_epoch(epoch_);
  map.set_generation(generation_);
  map.set_pause(pause_ != 0);
  map.set_part_count(static_cast<std::uint32_t>(job_.parts.size()));
  mapped_all_ = everything_held(true);
  std::set<PartId> unheld = paged_;
  for (auto& [id, h] : hosts_) {
    if (!h.started) continue;
    h.mapped = true;
    h.mapped_parts = h.holds.size();
    *map.add_hosts() = h.entry;
    if (h.leaving && h.released != 0) continue;
    if (h.holds.empty()) continue;
    wire::Holding& holding = *map.add_holdings();
    holding.set_host(id.value);
    for (const PartId p : h.holds) {
      holding.add_parts(p.value);
      unheld.erase(p);
      if (!h.leaving) paged_.erase(p);
    }
  }
  for (const PartId p : unheld) map.add_paged(p.value);
  if (with_drops) {
    for (const auto& [id, parts] : with_drops->drop) {
      wire::Holding& drops = *map.add_drops();
      drops.set_host(id.value);
      for (const PartId p : parts) drops.add_parts(p.value);
    }
  }
  for (const auto& [id, h] : hosts_)
    if (h.mapped) send(id, map);
}

std::vector<PartId> ManagerCore::held_by(HostId host) const {
  const auto h = hosts_.find(host);
  if (h == hosts_.end()) return {};
  return {h->second.holds.begin(), h->second.holds.end()};
}

void ManagerCore::send_host_list() {
  wire::HostList list;
  for (const auto& [id, h] : hosts_)
    if (h.mapped) *list.add_hosts() = h.entry;
  if (list.hosts_size() < 2) return;
  for (const auto& [id, h] : hosts_)
    if (h.mapped) send(id, list);
}

void ManagerCore::receive(HostId from, wire::Message message, double now) {
  const auto it = hosts_.find(from);
  if (it == hosts_.end() || finished()) return void(++progress_.dropped_messages);
  it->second.heard = now;
  std::visit([&](auto& m) { handle(from, it->second, m, now); }, message);
}

void ManagerCore::handle(HostId from, Host& h, wire::LoadReport& m, double now) {
  if (m.job() != job_.start.job() || phase_ == Phase::ending)
    return void(++progress_.dropped_messages);
  if (!m.error().empty()) {
    const std::string why =
        "host " + std::to_string(from.value) + " (" + h.hello.name() + "): " + m.error();
    const bool traced = h.traces();
    remove(from, true, now);
    // What the last of them cannot do nobody can.
    const auto can_go_on = [](const auto& e) { return e.second.traces(); };
    if (hosts_.empty() || (traced && std::none_of(hosts_.begin(), hosts_.end(), can_go_on))) fail(why, now);
    return;
  }
  if (!h.started) h.unforeseen = m.bytes_used() - std::min(m.bytes_used(), main_bytes());
  h.started = true;
  for (const std::uint32_t p : m.unloaded())
    if (const auto it = h.unloading.find(PartId(p)); it != h.unloading.end() && --it->second == 0)
      h.unloading.erase(it);
  for (const std::uint32_t p : m.loaded())
    if (h.wanted.contains(PartId(p)) && !h.unloading.contains(PartId(p))) h.holds.insert(PartId(p));
  bool declined = false;
  for (const std::uint32_t p : m.declined()) {
    if (h.unloading.contains(PartId(p))) continue;
    if (h.holds.contains(PartId(p)) || h.wanted.erase(PartId(p)) == 0) continue;
    h.declined.insert(PartId(p));
    declined = true;
  }
  if (declined) place_all(now);
  if (!finished()) check_loaded(now);
}

void ManagerCore::check_loaded(double now) {
  if (phase_ == Phase::loading && everything_held(true)) return begin_rendering(now);
  if (phase_ != Phase::rendering) return;
  const bool more = std::any_of(hosts_.begin(), hosts_.end(), [&](const auto& e) {
    const Host& h = e.second;
    return !h.leaving && (h.complete() || (!h.holds.empty() && now >= next_growth_)) &&
           (!h.mapped || h.holds.size() != h.mapped_parts);
  });
  if (more || (!mapped_all_ && everything_held(true))) {
    new_map(false);
    next_growth_ = now + options_.map_every_s;
  }
  std::vector<HostId> leaving;
  for (const auto& [id, h] : hosts_)
    if (h.leaving) leaving.push_back(id);
  for (const HostId id : leaving) try_release(id, now);
  hand_out(now);
}

void ManagerCore::handle(HostId from, Host& h, wire::Status& m, double now) {
  h.entry.set_load_s(m.load_s());
  h.entry.set_segments_per_s(m.segments_per_s());
  for (const std::uint32_t peer : m.unreachable())
    if (hosts_.contains(HostId(peer)) && HostId(peer) != from)
      unreachable_since_.try_emplace(HostId(peer), now);
  if (static_cast<std::size_t>(m.visits_size()) == job_.parts.size())
    visits_[from].assign(m.visits().begin(), m.visits().end());
  reports_[from].last = m;
  h.final = m.final();
  h.status = std::move(m);
  end_pause(now);
  if (hosts_.contains(from) && h.leaving) return try_release(from, now);
  check_final(now);
}

void ManagerCore::handle(HostId from, Host& h, wire::Leave&, double now) {
  if (h.leaving) return;
  h.leaving = true;
  h.entry.set_leaving(true);
  if (phase_ != Phase::gathering) place_all(now);
  if (!finished()) make_room(now);
  if (!finished()) try_release(from, now);
}

// A leaving host goes when others hold its parts, and its own renderer tasks and all that it
// accepted are done. From the epoch of its release on it accepts nothing.
void ManagerCore::try_release(HostId id, double now) {
  const auto it = hosts_.find(id);
  if (it == hosts_.end() || finished()) return;
  Host& h = it->second;
  const bool taking_part = phase_ == Phase::rendering && h.mapped;
  if (taking_part) {
    if (h.released == 0) {
      // With nobody who stays there is nobody to hand over to.
      const bool last = outstanding_.empty() && std::all_of(hosts_.begin(), hosts_.end(), [](const auto& e) {
        return e.second.leaving || !e.second.traces();
      });
      if (!last && !everything_held(false)) return;
      h.released = epoch_ + 1;
      new_map(false);
      return;
    }
    if (h.outstanding_tasks != 0 || !h.status.idle() || h.status.epoch() < h.released) return;
  }
  wire::JobEnd end;
  end.set_job(job_.start.job());
  end.set_reason("the host leaves");
  send(id, std::move(end));
  remove(id, false, now);
}

void ManagerCore::host_lost(HostId host, double now) { remove(host, true, now); }

void ManagerCore::remove(HostId id, bool lost, double now) {
  const auto it = hosts_.find(id);
  if (it == hosts_.end()) return;
  const bool mapped = it->second.mapped;
  hosts_.erase(it);
  gone_.push_back(id);
  unreachable_since_.erase(id);
  reports_[id].left = now;
  reports_[id].lost = lost;
  for (auto o = outstanding_.begin(); o != outstanding_.end();) {
    if (o->second.host != id) {
      ++o;
      continue;
    }
    if (const auto twin = outstanding_.find(o->second.twin); twin != outstanding_.end()) {
      twin->second.twin = 0;  // it alone is left
    } else {
      returned_.push_back(o->second.range);
      unassigned_paths_ += o->second.range.paths();
    }
    o = outstanding_.erase(o);
  }
  if (finished()) return;
  if (phase_ == Phase::ending) return check_final(now);
  const bool told = phase_ == Phase::rendering &&
                    mapped;  // the others know the host, and must learn that it is gone
  std::optional<Plan> found;
  if (phase_ != Phase::gathering && !hosts_.empty()) {
    if (!everything_held(false)) {
      found = find_plan(now);
    } else {  // other copies take the place of those that are gone; dropping some costs nothing more now
      auto more = plan(false, Keep::all);
      if (!more && lost) more = plan(false, Keep::one_copy);
      if (more) found = std::move(*more);
    }
  }
  if (finished()) return;
  const bool changed = found && adopt(*found), drops = found && !found->drop.empty();
  const bool paused = std::exchange(pause_, 0) != 0;
  if (told || ((changed || paused) && phase_ == Phase::rendering))
    new_map(lost || drops, found ? &*found : nullptr);
  if (found) order(*found);
  make_room(now);
  check_loaded(now);
  if (phase_ == Phase::rendering) check_end(now);
}

void ManagerCore::check_unreachable(double now) {
  for (auto it = unreachable_since_.begin(); it != unreachable_since_.end();) {
    const bool still = std::any_of(hosts_.begin(), hosts_.end(), [&](const auto& h) {
      const auto& list = h.second.status.unreachable();
      return std::find(list.begin(), list.end(), it->first.value) != list.end();
    });
    if (!still) {
      it = unreachable_since_.erase(it);
    } else if (now - it->second > kUnreachableFactor * options_.lost_after_s) {
      return remove(HostId(it->first), true, now);  // the next one at the next tick
    } else {
      ++it;
    }
  }
}

void ManagerCore::tick(double now) {
  next_tick_ = now + 0.5 * options_.heartbeat_s;
  if (finished()) return;
  // Who was away itself (stopped, its machine moved) cannot say who was silent meanwhile.
  if (last_tick_ && now - *last_tick_ > 0.5 * options_.lost_after_s)
    for (auto& [id, h] : hosts_) h.heard = now;
  last_tick_ = now;
  std::vector<HostId> silent;
  for (const auto& [id, h] : hosts_)
    if (now - h.heard > options_.lost_after_s) silent.push_back(id);
  for (const HostId id : silent) remove(id, true, now);
  check_unreachable(now);
  if (no_room_since_ && !finished()) place_all(now);
  if (phase_ == Phase::rendering && now >= next_list_) {
    next_list_ = now + options_.heartbeat_s;
    send_host_list();
  }
  if (phase_ == Phase::rendering) hand_out(now);
  check_final(now);
}

ManagerCore::Progress ManagerCore::progress() const {
  Progress p = progress_;
  for (const auto& [id, h] : hosts_) {
    ++p.hosts;
    if (h.traces()) ++p.tracers;
    if (!h.complete()) ++p.hosts_loading;
  }
  p.paged_parts = static_cast<std::uint32_t>(paged_.size());
  p.epoch = epoch_;
  p.generation = generation_;
  return p;
}

}  // namespace cloudrenderer
