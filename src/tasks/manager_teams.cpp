// Which hosts work together, and what they are told of each other.
#include <algorithm>

#include "tasks/manager_core.h"

namespace cloudrenderer {
namespace {

constexpr double kLoadMatters = 0.1, kLoadMattersShare = 0.1;  // seconds of queued work that others are told of, and share of it
constexpr std::size_t kFew = 64;   // hosts of a team that hear at once what one more has loaded
constexpr double kTeamCopies = 2;  // of the scene that a team has room for: one host less is no reason to part

}  // namespace

ManagerCore::Team::Team(std::size_t parts) {
  for (Holders* h : {&there, &staying}) {
    h->of.assign(parts, 0);
    h->unheld = parts == 0 ? 0 : parts - 1;
  }
}

void ManagerCore::enter(HostId id, Host& h, Team& t) {
  h.team = &t;
  t.hosts[id] = &h;
  count_holds(h, 1);
}

// Whether so many teams of these hosts have room for the scene, each as often as it should.
bool ManagerCore::have_room(std::span<Host* const> hosts, std::size_t teams) const {
  double scene = 0, room = 0;
  std::uint64_t build = 0;
  for (std::size_t p = 1; p < job_.parts.size(); ++p) {
    scene += static_cast<double>(job_.parts[p].bytes);
    build = std::max(build, job_.parts[p].build);
  }
  for (const std::uint64_t bytes : job_.prototype_bytes) scene += static_cast<double>(bytes);
  const std::uint64_t taken = main_bytes() + build;
  for (const Host* h : hosts)
    if (h->traces()) room += static_cast<double>(h->hello.memory() - std::min(h->hello.memory(), taken));
  return room >= kTeamCopies * std::max(1u, options_.replication) * scene * static_cast<double>(teams);
}

// As the job begins to load: nobody holds any part yet.
void ManagerCore::form_teams() {
  std::vector<Host*> all;
  for (auto& [id, h] : hosts_) all.push_back(&h);
  std::size_t teams = all.size() / std::max(1u, options_.team_hosts);
  while (teams > 1 && !have_room(all, teams)) --teams;
  if (teams < 2) return;
  // Large and small ones to each, and neighbours by number, who are given neighbouring tiles, to different ones.
  std::ranges::stable_sort(all, [](const Host* a, const Host* b) {
    return std::pair(a->traces(), a->hello.memory()) > std::pair(b->traces(), b->hello.memory());
  });
  teams_.clear();
  for (std::size_t i = 0; i < teams; ++i) teams_.emplace_back(job_.parts.size()).generation = generation_;
  auto team = teams_.begin();
  for (Host* h : all) {
    enter(HostId(h->entry.host()), *h, *team);
    if (++team == teams_.end()) team = teams_.begin();
  }
}

// Of those that hosts may be added to; null: there is none.
ManagerCore::Team* ManagerCore::smallest_team() {
  Team* smallest = nullptr;
  for (Team& t : teams_)
    if (!t.gathering && !t.broken && (!smallest || t.hosts.size() < smallest->hosts.size())) smallest = &t;
  return smallest;
}

ManagerCore::Team& ManagerCore::team_for_newcomer(double now) {
  Team* t = smallest_team();
  if (t && t->hosts.size() < 2 * std::size_t{options_.team_hosts}) return *t;
  const auto gathering = std::ranges::find_if(teams_, &Team::gathering);
  if (gathering != teams_.end()) return *gathering;
  Team& fresh = teams_.emplace_back(job_.parts.size());
  fresh.generation = generation_;
  fresh.gathering = true;
  fresh.waits_until = now + options_.newcomers_wait_s;
  return fresh;
}

void ManagerCore::look_at_newcomers(double now) {
  const auto t = std::ranges::find_if(teams_, &Team::gathering);
  if (t == teams_.end()) return;
  std::vector<Host*> hosts;
  for (const auto& [id, h] : t->hosts) hosts.push_back(h);
  if (hosts.size() >= options_.team_hosts && have_room(hosts, 1)) {
    t->gathering = false;
    t->placement_due = true;
  } else if (now >= t->waits_until) {
    t->broken = true;
  }
}

// Hosts of a team that is no more go to the others with what they hold. What its paths had come to is made again, and
// with it, where its hosts have had a map, what is under way in the teams that take them in: generations tell hosts so.
void ManagerCore::end_broken_teams(double now) {
  while (!finished() && teams_.size() > 1) {
    const auto broken = std::ranges::find_if(teams_, &Team::broken);
    if (broken == teams_.end()) return;
    std::list<Team> old;
    old.splice(old.begin(), teams_, broken);
    if (!smallest_team()) teams_.front().gathering = teams_.front().broken = false;
    std::set<Team*> larger;
    for (const auto& [id, h] : old.front().hosts) {
      Team* t = smallest_team();
      count_holds(*h, -1);
      enter(id, *h, *t);
      h->told = 0;
      h->changed = true;
      h->mapped = h->mapped && t->epoch != 0;
      larger.insert(t);
    }
    const bool had_paths = old.front().epoch != 0;
    if (!old.front().gathering) ++progress_.teams_ended;
    for (Team& t : teams_) {
      if (!larger.contains(&t) || finished()) continue;
      if (!had_paths) {
        place(t, now);
      } else {
        t.pause = 0;  // asked for again, if need be
        const auto found = find_plan(t, now);
        if (found) adopt(t, *found);
        if (t.epoch != 0) new_map(t, true, found ? &*found : nullptr);
        else t.generation = ++generation_;
        if (found) order(t, *found);
      }
      if (phase_ == Phase::rendering) make_room(t, now);
      if (!finished()) check_loaded(t, now);
    }
  }
}

// Who knows the last map hears what has changed.
void ManagerCore::new_map(Team& t, bool generation, const Plan* with_drops) {
  const std::uint32_t before = t.epoch;
  t.epoch = ++epoch_;
  if (generation) t.generation = ++generation_;
  wire::SceneHostMap change;
  change.set_epoch(t.epoch);
  change.set_generation(t.generation);
  change.set_pause(t.pause != 0);
  change.set_part_count(static_cast<std::uint32_t>(job_.parts.size()));
  t.mapped_all = everything_held(t, true);
  if (!t.paged.empty())
    for (const auto& [id, h] : t.hosts)
      if (h->started && !h->leaving)
        for (const PartId p : h->holds) t.paged.erase(p);
  for (const PartId p : t.paged)
    if (t.there.of[p.value] == 0) change.add_paged(p.value);
  if (with_drops) {
    for (const auto& [id, parts] : with_drops->drop) {
      wire::Holding& drops = *change.add_drops();
      drops.set_host(id.value);
      for (const PartId p : parts) drops.add_parts(p.value);
    }
  }
  wire::SceneHostMap complete = change;
  change.set_since(before);
  for (const std::uint32_t h : std::exchange(t.gone_since_map, {})) change.add_gone(h);
  std::vector<HostId> hear_change, hear_all;
  for (auto& [id, h] : t.hosts) {
    if (!h->started) continue;
    h->changed = h->changed || !h->mapped || h->holds.size() != h->mapped_parts;
    h->mapped = true;
    (h->can_hear_changes && before != 0 && h->told == before ? hear_change : hear_all).push_back(id);
    h->told = t.epoch;
  }
  const auto add = [](wire::SceneHostMap& map, HostId id, const Host& h) {
    *map.add_hosts() = h.entry;
    wire::Holding holding;
    holding.set_host(id.value);
    if (!h.leaving || h.released == 0)
      for (const PartId p : h.holds) holding.add_parts(p.value);
    // In a complete map hosts without parts are not named.
    if (map.since() != 0 || holding.parts_size() != 0) *map.add_holdings() = std::move(holding);
  };
  for (auto& [id, h] : t.hosts) {
    if (!h->mapped) continue;
    if (!hear_all.empty()) add(complete, id, *h);
    if (h->changed && !hear_change.empty()) add(change, id, *h);
    h->changed = false;
    h->mapped_parts = h->holds.size();
  }
  const double news = static_cast<double>(change.ByteSizeLong()) * static_cast<double>(hosts_.size());
  t.next_growth = std::max(t.next_growth, last_now_ + std::max(t.hosts.size() > kFew ? options_.heartbeat_s / 2 : options_.map_every_s,
                                                               news / options_.news_bytes_per_s));
  send(std::move(hear_change), std::move(change));
  send(std::move(hear_all), std::move(complete));
}

// A heartbeat of thousands of hosts is slower than that of a few.
double ManagerCore::heartbeat() const {
  return std::max(options_.heartbeat_s, static_cast<double>(hosts_.size()) / options_.statuses_per_s);
}

void ManagerCore::send_host_list(Team& t, double now) {
  t.next_list = now + options_.heartbeat_s;
  wire::HostList changes, complete;
  std::vector<HostId> hear_changes, hear_all;
  for (auto& [id, h] : t.hosts) {
    if (!h->mapped) continue;
    (h->can_hear_changes ? hear_changes : hear_all).push_back(id);
    const double load = h->entry.load_s();
    if (std::abs(load - h->told_load) <= kLoadMatters + kLoadMattersShare * std::min(load, h->told_load)) continue;
    h->told_load = load;
    changes.add_changed(id.value);
    changes.add_load_s(static_cast<float>(load));
  }
  if (hear_changes.size() + hear_all.size() < 2) return;
  const double beat = heartbeat();
  if (beat > 1.25 * told_heartbeat_ || beat < 0.8 * told_heartbeat_) told_heartbeat_ = beat;
  const bool other_beat = t.told_heartbeat != told_heartbeat_;
  if (other_beat) changes.set_heartbeat_s(t.told_heartbeat = told_heartbeat_);
  if (changes.changed_size() != 0 || other_beat) {
    changes.set_number(++lists_);
    t.next_list = now + std::max(options_.heartbeat_s, static_cast<double>(changes.ByteSizeLong()) *
                                                           static_cast<double>(hosts_.size()) / options_.news_bytes_per_s);
    send(std::move(hear_changes), std::move(changes));
  }
  if (hear_all.empty()) return;
  for (const auto& [id, h] : t.hosts)
    if (h->mapped) *complete.add_hosts() = h->entry;
  send(std::move(hear_all), std::move(complete));
}

}  // namespace cloudrenderer
