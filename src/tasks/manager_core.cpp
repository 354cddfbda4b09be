// Who is there, and who holds what.
#include "tasks/manager_core.h"

#include <algorithm>

#include "tasks/admission.h"

namespace cloudrenderer {
namespace {

constexpr double kMostThreads = 4096;
constexpr std::uint32_t kMaxHost = 0xfffe;  // a path's owner has 16 bits
constexpr double kUnreachableFactor =
    2;  // of lost_after_s: until a host that peers cannot reach is given up

constexpr double kMissedHeartbeats = 3;  // before a host is lost
// Up to so many hosts everything is gone through whenever something happens; more are gone through from time to time.
constexpr std::size_t kFew = 64;
constexpr double kMost = 0.9;  // of these

std::string quoted(const std::string& text) { return text.empty() ? "unknown" : '"' + text + '"'; }

void count_part(auto& holders, PartId p, int sign) {
  std::uint32_t& n = holders.of[p.value];
  if (sign > 0 && n == 0) --holders.unheld;
  n += static_cast<std::uint32_t>(sign);
  if (n == 0) ++holders.unheld;
}

}  // namespace

bool ManagerCore::can(const wire::Hello& hello, wire::Category category) {
  return hello.categories().empty() ||
         std::find(hello.categories().begin(), hello.categories().end(), category) !=
             hello.categories().end();
}

ManagerCore::ManagerCore(const ManagerOptions& options, JobSpec job)
    : options_(options),
      job_(std::move(job)),
      film_(job_.frame, job_.k, job_.lobes),
      features_(job_.start.features() ? job_.frame.pixels() : 0),
      generation_(options.first_generation),
      fingerprint_(options.fingerprint),
      visits_(job_.parts.size()) {
  const std::uint32_t block = shared_rays().block();  // rounds do not cut groups of samples
  options_.round_samples = (std::max(1u, options_.round_samples) + block - 1) / block * block;
  options_.tile = std::clamp(options_.tile, 1u, 128u);
  teams_.emplace_back(job_.parts.size()).generation = generation_;
  teams_.front().told_heartbeat = told_heartbeat_ = options_.heartbeat_s;
  progress_.paths_total = job_.frame.pixels() * job_.spp;
  unassigned_paths_ = progress_.paths_total;
  count_rounds();
  allowed_rounds_ = options_.hold_rounds ? 1 : rounds();
  if (options_.fixed_tile != 0) set_tile(options_.fixed_tile);
}

Result<HostId> ManagerCore::join(const wire::Hello& hello, double now) {
  const auto refuse = [](const std::string& why) { return Result<HostId>::failure(why); };
  if (const auto why = unbelievable(hello)) return refuse(*why);
  if (phase_ == Phase::ending || finished()) return refuse("the job is over");
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
  if (job_.start.light_paths() != 0 && can(hello, wire::TRACER) && !has_feature(hello, "aimed light paths"))
    return refuse("the job has paths from lights, and the host does not know how to trace them (\"aimed light paths\")");
  if (film_.sums_per_pixel() > 1 && can(hello, wire::RENDERER) && !has_feature(hello, "lobes"))
    return refuse("the scene's pixel filter has negative lobes, and the host does not know how to sum them apart (\"lobes\")");
  if (job_.samples_per_ray > 1 && can(hello, wire::TRACER) && !has_feature(hello, "shared rays"))
    return refuse("samples of the job share camera rays, and the host does not know how to (\"shared rays\"; --samples-per-ray 1 does without)");
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
  h.can_hear_changes = has_feature(hello, "changes");
  reports_[id].hello = hello;
  reports_[id].joined = now;

  wire::Welcome welcome;
  welcome.set_host(id.value);
  welcome.set_incarnation(options_.incarnation);
  welcome.set_heartbeat_s(told_heartbeat_);
  welcome.set_lost_after_s(options_.lost_after_s);
  send(id, std::move(welcome));
  send(id, job_.start);
  enter(id, h, phase_ == Phase::gathering ? teams_.front() : team_for_newcomer(now));
  h.team->next_growth = now + options_.map_every_s;
  if (phase_ == Phase::gathering && hosts_.size() >= options_.min_hosts) {
    phase_ = Phase::loading;
    form_teams();
    for (Team& team : teams_) team.placement_due = true;
  }
  if (phase_ == Phase::gathering) return id;
  h.team->placement_due = true;  // of many with those that come at the same time
  if (hosts_.size() <= kFew)
    for (Team& team : teams_)
      if (team.placement_due && !finished()) place(team, now);
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

ManagerCore::Outbox ManagerCore::take_outbox() {
  Outbox out;
  for (Sending& s : take_sendings())
    for (const HostId to : s.to) out.emplace_back(to, s.message);
  return out;
}

std::vector<PartId> ManagerCore::held_by(HostId host) const {
  const auto h = hosts_.find(host);
  if (h == hosts_.end()) return {};
  return {h->second.holds.begin(), h->second.holds.end()};
}

double ManagerCore::lost_after() const {
  return std::max(options_.lost_after_s, kMissedHeartbeats * told_heartbeat_);
}

void ManagerCore::count_holds(const Host& h, int sign) {
  if (!h.started) return;
  const auto count = [&](Holders& holders) {
    holders.tracers += static_cast<std::uint32_t>(h.traces() ? sign : 0);
    for (const PartId p : h.holds) count_part(holders, p, sign);
  };
  if (!h.leaving || h.released == 0) count(h.team->there);
  if (!h.leaving) count(h.team->staying);
}

void ManagerCore::count_hold(const Host& h, PartId p) {
  if (!h.leaving || h.released == 0) count_part(h.team->there, p, 1);
  if (!h.leaving) count_part(h.team->staying, p, 1);
}

void ManagerCore::receive(HostId from, wire::Message message, double now) {
  const auto it = hosts_.find(from);
  if (auto* const last = std::get_if<wire::Status>(&message); last && !finished() && departing_.contains(from)) {
    take_counters(from, *last);
    if (last->final()) depart(from, now);
    return;
  }
  if (it == hosts_.end() || finished()) return void(++progress_.dropped_messages);
  it->second.heard = last_now_ = now;
  std::visit([&](auto& m) { handle(from, it->second, m, now); }, message);
  end_broken_teams(now);
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
  const bool counted = h.started;
  if (!h.started) h.unforeseen = m.bytes_used() - std::min(m.bytes_used(), main_bytes());
  h.started = true;
  for (const std::uint32_t p : m.unloaded())
    if (const auto it = h.unloading.find(PartId(p)); it != h.unloading.end() && --it->second == 0)
      h.unloading.erase(it);
  for (const std::uint32_t p : m.loaded())
    if (h.wanted.contains(PartId(p)) && !h.unloading.contains(PartId(p)) && h.holds.insert(PartId(p)).second && counted)
      count_hold(h, PartId(p));
  if (!counted) count_holds(h, 1);
  bool declined = false;
  for (const std::uint32_t p : m.declined()) {
    if (h.unloading.contains(PartId(p))) continue;
    if (h.holds.contains(PartId(p)) || h.wanted.erase(PartId(p)) == 0) continue;
    h.declined.insert(PartId(p));
    declined = true;
  }
  if (declined) place(*h.team, now);
  if (!finished()) check_loaded(*h.team, now);
}

// One holder of each part would get the segments of all hosts, and what has been sent to it stays there. So where hosts
// are many most of them have everything before anybody begins.
bool ManagerCore::enough_complete(const Team& t) const {
  if (t.hosts.size() <= kFew) return true;
  if (last_now_ < next_look_) return false;
  const auto complete = std::ranges::count_if(t.hosts, [](const auto& h) { return h.second->complete(); });
  return static_cast<double>(complete) >= kMost * static_cast<double>(t.hosts.size());
}

// Other teams begin when they have loaded what they need.
void ManagerCore::check_loaded(Team& t, double now) {
  const bool ready = everything_held(t, true) && (t.epoch != 0 || enough_complete(t));
  if (phase_ == Phase::loading && ready) return begin_rendering(now);
  if (phase_ != Phase::rendering) return;
  if (t.hosts.size() > kFew && now < t.next_growth && (t.mapped_all || !ready)) return hand_out(now);
  const bool more = std::any_of(t.hosts.begin(), t.hosts.end(), [&](const auto& e) {
    const Host& h = *e.second;
    return !h.leaving && (h.complete() || (!h.holds.empty() && now >= t.next_growth)) &&
           (!h.mapped || h.holds.size() != h.mapped_parts);
  });
  if ((more && t.epoch != 0) || (!t.mapped_all && ready)) {
    last_now_ = now;
    t.next_growth = 0;
    new_map(t, false);
  }
  std::vector<HostId> leaving;
  for (const auto& [id, h] : t.hosts)
    if (h->leaving) leaving.push_back(id);
  for (const HostId id : leaving) try_release(id, now);
  hand_out(now);
}

void ManagerCore::take_counters(HostId from, wire::Status& m) {
  for (int i = 0; i < m.visited_size(); ++i)
    if (m.visited(i) < visits_.size()) visits_[m.visited(i)] += static_cast<double>(m.rays(i));
  m.clear_visited();  // of no use to anybody else
  m.clear_rays();
  reports_[from].last = m;
}

void ManagerCore::handle(HostId from, Host& h, wire::Status& m, double now) {
  if (h.final) return;  // it still says that it lives
  h.entry.set_load_s(m.load_s());
  h.entry.set_segments_per_s(m.segments_per_s());
  for (const std::uint32_t peer : m.unreachable())
    if (hosts_.contains(HostId(peer)) && HostId(peer) != from)
      unreachable_since_.try_emplace(HostId(peer), now);
  take_counters(from, m);
  h.final = m.final() && phase_ == Phase::ending;  // nobody is asked for it before
  if (h.final) ++finals_;
  h.status = std::move(m);
  end_pause(*h.team, now);
  if (hosts_.contains(from) && h.leaving) try_release(from, now);
  check_final(now);
}

void ManagerCore::handle(HostId from, Host& h, wire::Leave&, double now) {
  if (h.leaving) return;
  count_holds(h, -1);
  h.leaving = h.changed = true;
  count_holds(h, 1);
  h.entry.set_leaving(true);
  if (phase_ != Phase::gathering) place(*h.team, now);
  if (!finished()) make_room(*h.team, now);
  if (!finished()) try_release(from, now);
}

// A leaving host goes when others hold its parts, and its own renderer tasks and all that it
// accepted are done. From the epoch of its release on it accepts nothing.
void ManagerCore::try_release(HostId id, double now) {
  const auto it = hosts_.find(id);
  if (it == hosts_.end() || phase_ == Phase::ending || finished()) return;
  Host& h = it->second;
  const bool taking_part = phase_ == Phase::rendering && h.mapped;
  if (taking_part) {
    if (h.released == 0) {
      // With nobody who stays there is nobody to hand over to.
      const bool last = outstanding_.empty() && std::all_of(hosts_.begin(), hosts_.end(), [](const auto& e) {
        return e.second.leaving || !e.second.traces();
      });
      if (!last && !everything_held(*h.team, false)) return;
      count_holds(h, -1);
      h.released = epoch_ + 1;
      h.changed = true;
      count_holds(h, 1);
      new_map(*h.team, false);
      return;
    }
    if (h.outstanding_tasks != 0 || !h.status.idle() || h.status.epoch() < h.released) return;
  }
  wire::JobEnd end;
  end.set_job(job_.start.job());
  end.set_reason("the host leaves");
  send(id, std::move(end));
  departing_[id] = now + options_.end_wait_s;
  remove(id, false, now);
}

// Whether the host was departing: with its final counters, or without them it is now gone.
bool ManagerCore::depart(HostId id, double now) {
  if (departing_.erase(id) == 0) return false;
  gone_.push_back(id);
  check_final(now);
  return true;
}

void ManagerCore::host_lost(HostId host, double now) {
  if (depart(host, now)) return;
  remove(host, true, now);
  end_broken_teams(now);
}

void ManagerCore::remove(HostId id, bool lost, double now) {
  const auto it = hosts_.find(id);
  if (it == hosts_.end()) return;
  const bool mapped = it->second.mapped;
  Team& t = *it->second.team;
  last_now_ = now;
  if (mapped) t.gone_since_map.push_back(id.value);
  count_holds(it->second, -1);
  if (it->second.final) --finals_;
  t.hosts.erase(id);
  hosts_.erase(it);
  if (!departing_.contains(id)) gone_.push_back(id);
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
      if (o->second.range.trial) {
        trial_->give_back(o->second.range);
      } else {
        returned_.push_back(o->second.range);
        unassigned_paths_ += o->second.range.paths();
      }
    }
    o = outstanding_.erase(o);
  }
  if (finished()) return;
  if (phase_ == Phase::ending) return check_final(now);
  const bool told = phase_ == Phase::rendering &&
                    mapped;  // the others know the host, and must learn that it is gone
  std::optional<Plan> found;
  if (phase_ != Phase::gathering && !t.hosts.empty() && !t.gathering) {
    if (!everything_held(t, false)) {
      found = find_plan(t, now);
    } else {  // other copies take the place of those that are gone; dropping some costs nothing more now
      auto more = plan(t, false, Keep::all);
      if (!more && lost) more = plan(t, false, Keep::one_copy);
      if (more) found = std::move(*more);
    }
  }
  if (finished()) return;
  if (t.hosts.empty()) t.broken = teams_.size() > 1;
  const bool changed = found && adopt(t, *found), drops = found && !found->drop.empty();
  const bool paused = std::exchange(t.pause, 0) != 0;
  if (!t.broken && (told || ((changed || paused) && phase_ == Phase::rendering)))
    new_map(t, lost || drops, found ? &*found : nullptr);
  if (found) order(t, *found);
  make_room(t, now);
  if (!t.broken) check_loaded(t, now);
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
  last_now_ = now;
  if (finished()) return;
  // Who was away itself (stopped, its machine moved) cannot say who was silent meanwhile.
  if (last_tick_ && now - *last_tick_ > 0.5 * options_.lost_after_s)
    for (auto& [id, h] : hosts_) h.heard = now;
  last_tick_ = now;
  std::vector<HostId> silent;
  for (const auto& [id, h] : hosts_)
    if (now - h.heard > lost_after()) silent.push_back(id);
  for (const HostId id : silent) remove(id, true, now);
  std::vector<HostId> speechless;
  for (const auto& [id, until] : departing_)
    if (now > until) speechless.push_back(id);
  for (const HostId id : speechless) depart(id, now);
  check_unreachable(now);
  look_at_newcomers(now);
  for (Team& t : teams_) {
    if ((no_room_since_ || t.placement_due) && !finished()) place(t, now);
    if (t.hosts.size() > kFew && (phase_ == Phase::loading || (phase_ == Phase::rendering && now >= t.next_growth))) {
      next_look_ = now;
      check_loaded(t, now);
      next_look_ = std::numeric_limits<double>::infinity();  // reports alone are no reason to look at all hosts
    }
    if (phase_ == Phase::rendering && now >= t.next_list) send_host_list(t, now);
  }
  end_broken_teams(now);
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
  for (const Team& t : teams_) p.paged_parts = std::max(p.paged_parts, static_cast<std::uint32_t>(t.paged.size()));
  p.teams = static_cast<std::uint32_t>(std::ranges::count(teams_, false, &Team::gathering));
  p.epoch = epoch_;
  p.generation = generation_;
  return p;
}

}  // namespace cloudrenderer
