// Hosts and parts.
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

bool can(const wire::Hello& hello, wire::Category category) {
  return hello.categories().empty() ||
         std::find(hello.categories().begin(), hello.categories().end(), category) !=
             hello.categories().end();
}

bool has_feature(const wire::Hello& hello, const std::string& feature) {
  const auto& all = hello.features();
  return all.empty() || std::find(all.begin(), all.end(), feature) != all.end();
}

}  // namespace

ManagerCore::ManagerCore(const ManagerOptions& options, JobSpec job)
    : options_(options),
      job_(std::move(job)),
      film_(job_.frame, job_.k),
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
  if (fingerprint_ && *fingerprint_ != hello.fingerprint() && !options_.allow_inexact &&
      !hello.allow_inexact())
    return refuse(std::string("the host computes other bits than ") +
                  (options_.fingerprint ? "those in the checkpoint" : "the cluster") +
                  " (numeric fingerprint); --allow-inexact lets it join");
  const std::uint64_t least = main_bytes() + job_.parts[0].build;
  if (can(hello, wire::TRACER) && hello.memory() < least)
    return refuse("the host may use " + std::to_string(hello.memory() >> 20) +
                  " MiB, but what every host must hold needs " + std::to_string((least >> 20) + 1) +
                  " MiB");
  if (!fingerprint_) fingerprint_ = hello.fingerprint();
  bit_exact_ = bit_exact_ && *fingerprint_ == hello.fingerprint();

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

PlacementInput ManagerCore::placement(bool with_leaving, Keep keep) const {
  PlacementInput in;
  in.parts = job_.parts;
  in.prototype_bytes = job_.prototype_bytes;
  in.min_replication = options_.replication;
  in.seed = job_.seed;
  const auto eligible = [&](const Host& h) {
    return (!h.leaving || (with_leaving && h.released == 0)) && can(h.hello, wire::TRACER);
  };
  // The copies that stay with Keep::one_copy: of every part one, that is loaded if any is.
  std::vector<const Host*> keepers(job_.parts.size());
  for (const auto& [id, h] : hosts_) {
    if (!eligible(h)) continue;
    for (const PartId p : h.wanted)
      if (const Host*& k = keepers[p.value]; !k || (!k->holds.contains(p) && h.holds.contains(p))) k = &h;
  }
  for (const auto& [id, h] : hosts_) {
    if (!eligible(h)) continue;
    PlacementHost host{id, h.hello.memory() - std::min(h.hello.memory(), h.unforeseen),
                       h.threads(), {}, {}};
    host.cannot.assign(h.declined.begin(), h.declined.end());
    for (const PartId p : h.wanted)
      if (keep == Keep::all || keepers[p.value] == &h) host.holds.push_back(p);
    for (std::size_t p = 0; p < job_.part_features.size(); ++p)
      for (const std::string& f : job_.part_features[p])
        if (!has_feature(h.hello, f)) host.cannot.emplace_back(static_cast<std::uint32_t>(p));
    in.hosts.push_back(std::move(host));
  }
  return in;
}

ManagerCore::Plan ManagerCore::plan_of(const PlacementInput& in, std::vector<std::vector<PartId>> placed) const {
  Plan result;
  for (std::size_t i = 0; i < in.hosts.size(); ++i) {
    const HostId id = in.hosts[i].host;
    const auto& hold = result.hold[id] = std::move(placed[i]);
    for (const PartId p : hosts_.at(id).wanted)
      if (!std::binary_search(hold.begin(), hold.end(), p)) result.drop[id].push_back(p);
  }
  return result;
}

Result<ManagerCore::Plan> ManagerCore::plan(bool with_leaving, Keep keep) const {
  const PlacementInput in = placement(with_leaving, keep);
  auto placed = place(in);
  if (!placed) return Result<Plan>::failure(placed.error());
  return plan_of(in, std::move(*placed));
}

// For hosts that have not memory enough for everything.
Result<ManagerCore::Plan> ManagerCore::plan_paged(bool with_leaving) const {
  const PlacementInput in = placement(with_leaving, Keep::all);
  for (const PlacementHost& h : in.hosts)
    if (!has_feature(hosts_.at(h.host).hello, "paging"))
      return Result<Plan>::failure("host " + std::to_string(h.host.value) + " cannot load parts for a while");
  auto placed = place_paged(in);
  if (!placed) return Result<Plan>::failure(placed.error());
  Plan result = plan_of(in, std::move(placed->hold));
  result.paged.insert(placed->paged.begin(), placed->paged.end());
  return result;
}

// The mildest plan that gives every part a holder: first one that only adds and lets leaving hosts go. Parts
// that come and go are better than a host that may not.
std::optional<ManagerCore::Plan> ManagerCore::find_plan(double now) {
  if (std::all_of(hosts_.begin(), hosts_.end(), [](const auto& h) { return h.second.released != 0; }))
    return std::nullopt;  // all of them are going: the next one that joins is waited for
  std::string why;
  for (const bool with_leaving : {false, true}) {
    for (const Keep keep : {Keep::all, Keep::one_copy}) {
      auto found = plan(with_leaving, keep);
      if (!found && why.empty()) why = found.error();
      // It works without a new host that brings no room, or with the one that wants to leave.
      if (!found && everything_wanted(true)) return std::nullopt;
      if (!found) continue;
      no_room_since_.reset();
      no_room_.clear();
      return std::move(*found);
    }
    auto paged = plan_paged(with_leaving);
    // What has to give way goes in a pause (make_room), unless there is no other way.
    if (paged && !paged->drop.empty() && everything_covered()) return std::nullopt;
    if (paged) {
      no_room_since_.reset();
      no_room_.clear();
      return std::move(*paged);
    }
    why += "; " + paged.error();
  }
  no_room_ = why;
  if (!no_room_since_) no_room_since_ = now;
  if (now - *no_room_since_ >= options_.wait_for_room_s) fail(no_room_, now);
  return std::nullopt;
}

void ManagerCore::place_all(double now) {
  if (hosts_.empty()) return;
  const auto found = find_plan(now);
  if (!found) return;
  if (adopt(*found) && phase_ == Phase::rendering) new_map(!found->drop.empty(), &*found);
  order(*found);
}

// True if hosts that take part must be told at once. What gets a holder is paged until it has one (new_map).
bool ManagerCore::adopt(const Plan& p) {
  drop(p);
  const std::size_t before = paged_.size();
  paged_.insert(p.paged.begin(), p.paged.end());
  return !p.drop.empty() || paged_.size() != before;
}

// Takes surplus copies off the books; the hosts are told by the next map, or here before there is
// one.
void ManagerCore::drop(const Plan& p) {
  for (const auto& [id, parts] : p.drop) {
    Host& h = hosts_.at(id);
    wire::UnloadParts m;
    for (const PartId part : parts) {
      h.wanted.erase(part);
      h.holds.erase(part);
      m.add_parts(part.value);
    }
    if (phase_ != Phase::rendering || !h.mapped) send(id, std::move(m));
  }
}

// Hosts load one part after the other, so each begins with its share of what nobody has yet:
// rendering begins, or goes on, long before the last copy is there.
void ManagerCore::order(const Plan& p) {
  std::map<HostId, std::vector<PartId>> first, later;
  for (std::uint32_t part = 1; part < job_.parts.size(); ++part) {
    const PartId id(part);
    std::vector<HostId> ordered;
    for (const auto& [host, parts] : p.hold)
      if (std::binary_search(parts.begin(), parts.end(), id) &&
          hosts_.at(host).wanted.insert(id).second)
        ordered.push_back(host);
    if (ordered.empty()) continue;
    const bool held = std::any_of(hosts_.begin(), hosts_.end(),
                                  [&](const auto& h) { return h.second.holds.contains(id); });
    const auto least = std::min_element(ordered.begin(), ordered.end(), [&](HostId x, HostId y) {
      return first[x].size() < first[y].size();
    });
    for (auto h = ordered.begin(); h != ordered.end(); ++h)
      (h == least && !held ? first : later)[*h].push_back(id);
  }
  for (const auto& [id, host] : p.hold) {
    wire::LoadParts m;
    for (const auto* list : {&first[id], &later[id]})
      for (const PartId part : *list) m.add_parts(part.value);
    if (m.parts_size() != 0) send(id, std::move(m));
  }
}

// Every part is held by a host that takes part, or (by_leaving) still does, or is nobody's by decision.
bool ManagerCore::everything_held(bool by_leaving) const {
  std::vector<bool> held(job_.parts.size());
  std::size_t n = 1;
  bool someone = false;
  for (const auto& [id, h] : hosts_) {
    if (!h.started || (h.leaving && (!by_leaving || h.released != 0))) continue;
    someone = true;
    for (const PartId p : h.holds) {
      if (!held[p.value]) ++n;
      held[p.value] = true;
    }
  }
  for (const PartId p : paged_) n += held[p.value] ? 0 : 1;
  return someone && n >= job_.parts.size();
}

// Every part has been ordered at a host that takes part, or (by_leaving) still does.
bool ManagerCore::everything_wanted(bool by_leaving) const {
  std::set<PartId> wanted;
  for (const auto& [id, h] : hosts_)
    if (!h.leaving || (by_leaving && h.released == 0)) wanted.insert(h.wanted.begin(), h.wanted.end());
  return wanted.size() + 1 >= job_.parts.size();
}

// Every part is somewhere, or nobody's by decision.
bool ManagerCore::everything_covered() const {
  std::set<PartId> covered = paged_;
  for (const auto& [id, h] : hosts_)
    if (h.released == 0) covered.insert(h.wanted.begin(), h.wanted.end());
  return covered.size() + 1 >= job_.parts.size();
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
    remove(from, true, now);
    if (hosts_.empty()) fail(why, now);
    return;
  }
  if (!h.started) h.unforeseen = m.bytes_used() - std::min(m.bytes_used(), main_bytes());
  h.started = true;
  for (const std::uint32_t p : m.loaded())
    if (h.wanted.contains(PartId(p))) h.holds.insert(PartId(p));
  bool declined = false;
  for (const std::uint32_t p : m.declined()) {
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

// Without the hosts that want to leave.
std::optional<ManagerCore::Plan> ManagerCore::smaller_plan() const {
  auto found = plan(false, Keep::one_copy);
  if (!found) found = plan_paged(false);
  return found ? std::optional(std::move(*found)) : std::nullopt;
}

// What leaving hosts hold finds room only where surplus copies make it, and a part can be dropped
// only when no path is under way: else all of them would be made again. So nobody begins any until
// all have ended.
void ManagerCore::make_room(double now) {
  if (phase_ != Phase::rendering || pause_ != 0 || everything_wanted(false)) return;
  const bool asked = std::any_of(hosts_.begin(), hosts_.end(), [](const auto& h) {
    return h.second.leaving && h.second.released == 0;
  });
  if (!asked || !smaller_plan()) return;
  pause_ = epoch_ + 1;
  new_map(false);
  end_pause(now);
}

void ManagerCore::end_pause(double now) {
  if (pause_ == 0 || phase_ != Phase::rendering) return;
  for (const auto& [id, h] : hosts_)
    if (h.mapped && (h.status.epoch() < pause_ || h.status.live_paths() != 0)) return;
  pause_ = 0;
  const auto found = smaller_plan();
  if (!found || everything_wanted(false)) return new_map(false);
  adopt(*found);
  new_map(true, &*found);
  order(*found);
  check_loaded(now);
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
        return e.second.leaving;
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
    if (!h.complete()) ++p.hosts_loading;
  }
  p.paged_parts = static_cast<std::uint32_t>(paged_.size());
  p.epoch = epoch_;
  p.generation = generation_;
  return p;
}

}  // namespace cloudrenderer
