// What hosts shall hold: plans, and how they come about.
#include <algorithm>

#include "parts/features.h"
#include "tasks/manager_core.h"

namespace cloudrenderer {
namespace {

constexpr double kExpectationWeighs = 1e5;  // rays
constexpr double kQuiet = 0.1;              // seconds of queued work: less makes no difference among hosts

constexpr const char* kNoTracer = "no host that is there can trace paths; to intersect is not enough";

// Hosts that only intersect describe the triangle that was hit: parts with anything else are not for them.
bool can_be_answered(const std::string& feature) {
  return feature == kFeatureTriangles || feature == kFeatureAlpha || feature == kFeatureInstances;
}

}  // namespace

bool ManagerCore::has_feature(const wire::Hello& hello, const std::string& feature) {
  const auto& all = hello.features();
  return all.empty() || std::find(all.begin(), all.end(), feature) != all.end();
}

// How often rays come to every part: what was expected before the frame, until so many have been counted that they
// speak for themselves.
std::vector<double> ManagerCore::visits() const {
  std::vector<double> visits(job_.parts.size());
  double expected = 0, counted = 0;
  for (const PlacementPart& p : job_.parts) expected += p.visits;
  for (std::size_t p = 1; p < visits.size(); ++p) counted += visits[p] = visits_[p];
  if (expected <= 0 && counted < kExpectationWeighs) return std::vector<double>(visits.size());
  for (std::size_t p = 1; p < visits.size() && expected > 0; ++p)
    visits[p] += kExpectationWeighs * job_.parts[p].visits / expected;
  return visits;
}

// How much a host would take from others by holding one more copy of a part: its share of what is visited, the more
// the longer the queues of those that hold it now.
std::vector<double> ManagerCore::pressure(const Team& t) const {
  std::vector<double> load(job_.parts.size()), copies(job_.parts.size());
  for (const auto& [id, h] : t.hosts)
    for (const PartId p : h->holds) {
      load[p.value] += h->entry.load_s();
      ++copies[p.value];
    }
  std::vector<double> pressure = visits();
  for (std::size_t p = 0; p < pressure.size(); ++p)
    if (copies[p] > 0) pressure[p] *= (kQuiet + load[p] / copies[p]) / (copies[p] + 1);
  return pressure;
}

PlacementInput ManagerCore::placement(const Team& t, bool with_leaving, Keep keep) const {
  PlacementInput in;
  in.parts = job_.parts;
  const std::vector<double> visited = visits();
  for (std::size_t p = 1; p < visited.size(); ++p) in.parts[p].visits = visited[p];
  in.prototype_bytes = job_.prototype_bytes;
  in.min_replication = options_.replication;
  in.seed = job_.seed;
  const auto eligible = [&](const Host& h) { return !h.leaving || (with_leaving && h.released == 0); };
  // The copies that stay with Keep::one_copy: of every part one, that is loaded if any is.
  std::vector<const Host*> keepers(job_.parts.size());
  for (const auto& [id, h] : t.hosts) {
    if (!eligible(*h)) continue;
    for (const PartId p : h->wanted)
      if (const Host*& k = keepers[p.value]; !k || (!k->holds.contains(p) && h->holds.contains(p))) k = h;
  }
  for (const auto& [id, h] : t.hosts) {
    if (!eligible(*h)) continue;
    PlacementHost host{id, h->hello.memory() - std::min(h->hello.memory(), h->unforeseen),
                       h->threads(), {}, {}, h->traces()};
    host.cannot.assign(h->declined.begin(), h->declined.end());
    for (const PartId p : h->wanted)
      if (keep == Keep::all || keepers[p.value] == h) host.holds.push_back(p);
    for (std::size_t p = 0; p < job_.part_features.size(); ++p)
      for (const std::string& f : job_.part_features[p])
        if (!has_feature(h->hello, f) || (!h->traces() && !can_be_answered(f)))
          host.cannot.emplace_back(static_cast<std::uint32_t>(p));
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

Result<ManagerCore::Plan> ManagerCore::plan(const Team& t, bool with_leaving, Keep keep) const {
  const PlacementInput in = placement(t, with_leaving, keep);
  if (std::ranges::none_of(in.hosts, &PlacementHost::traces)) return Result<Plan>::failure(kNoTracer);
  auto placed = cloudrenderer::place(in);
  if (!placed) return Result<Plan>::failure(placed.error());
  return plan_of(in, std::move(*placed));
}

// For hosts that have not memory enough for everything.
Result<ManagerCore::Plan> ManagerCore::plan_paged(const Team& t, bool with_leaving) const {
  const PlacementInput in = placement(t, with_leaving, Keep::all);
  if (std::ranges::none_of(in.hosts, &PlacementHost::traces)) return Result<Plan>::failure(kNoTracer);
  for (const PlacementHost& h : in.hosts)
    if (h.traces && !has_feature(hosts_.at(h.host).hello, "paging"))
      return Result<Plan>::failure("host " + std::to_string(h.host.value) + " cannot load parts for a while");
  auto placed = place_paged(in);
  if (!placed) return Result<Plan>::failure(placed.error());
  Plan result = plan_of(in, std::move(placed->hold));
  result.paged.insert(placed->paged.begin(), placed->paged.end());
  return result;
}

// The mildest plan that gives every part a holder: first one that only adds and lets leaving hosts go. Parts
// that come and go are better than a host that may not.
std::optional<ManagerCore::Plan> ManagerCore::find_plan(Team& t, double now) {
  const bool alone = teams_.size() == 1;
  // Nobody is there, or all are going: the next one that joins is waited for.
  if (std::none_of(t.hosts.begin(), t.hosts.end(),
                   [](const auto& h) { return h.second->traces() && h.second->released == 0; })) {
    t.broken = !alone;
    if (alone) no_room_ = kNoTracer;
    return std::nullopt;
  }
  std::string why;
  for (const bool with_leaving : {false, true}) {
    for (const Keep keep : {Keep::all, Keep::one_copy}) {
      auto found = plan(t, with_leaving, keep);
      if (!found && why.empty()) why = found.error();
      // Better in the other teams than out of core.
      if (!found && !alone && !everything_wanted(t, false) && !plan(t, false, Keep::one_copy)) {
        t.broken = true;
        return std::nullopt;
      }
      // It works without a new host that brings no room, or with the one that wants to leave.
      if (!found && everything_wanted(t, true)) return std::nullopt;
      if (!found) continue;
      no_room_since_.reset();
      no_room_.clear();
      return std::move(*found);
    }
    auto paged = plan_paged(t, with_leaving);
    // What has to give way goes in a pause (make_room), unless there is no other way.
    if (paged && !paged->drop.empty() && everything_covered(t)) return std::nullopt;
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

void ManagerCore::place(Team& t, double now) {
  t.placement_due = false;
  if (t.hosts.empty() || t.gathering) return;
  const auto found = find_plan(t, now);
  if (!found) return;
  if (adopt(t, *found) && phase_ == Phase::rendering) new_map(t, !found->drop.empty(), &*found);
  order(t, *found);
}

// True if hosts that take part must be told at once. What gets a holder is paged until it has one (new_map).
bool ManagerCore::adopt(Team& t, const Plan& p) {
  drop(p);
  const std::size_t before = t.paged.size();
  t.paged.insert(p.paged.begin(), p.paged.end());
  return !p.drop.empty() || t.paged.size() != before;
}

// Takes surplus copies off the books; the hosts are told by the next map, or here before there is
// one.
void ManagerCore::drop(const Plan& p) {
  for (const auto& [id, parts] : p.drop) {
    Host& h = hosts_.at(id);
    count_holds(h, -1);
    h.changed = true;
    wire::UnloadParts m;
    for (const PartId part : parts) {
      h.wanted.erase(part);
      h.holds.erase(part);
      ++h.unloading[part];
      m.add_parts(part.value);
    }
    count_holds(h, 1);
    if (phase_ != Phase::rendering || !h.mapped) send(id, std::move(m));
  }
}

// Hosts load one part after the other, so each begins with its share of what nobody has yet:
// rendering begins, or goes on, long before the last copy is there. Copies come in the order of what they relieve.
void ManagerCore::order(const Team& t, const Plan& p) {
  std::vector<std::vector<HostId>> ordered(job_.parts.size());  // by part
  for (const auto& [host, parts] : p.hold)
    for (const PartId part : parts)
      if (hosts_.at(host).wanted.insert(part).second) ordered[part.value].push_back(host);
  std::map<HostId, std::vector<PartId>> first, later;
  for (std::uint32_t part = 1; part < job_.parts.size(); ++part) {
    if (ordered[part].empty()) continue;
    const auto least = std::ranges::min_element(
        ordered[part], [&](HostId x, HostId y) { return first[x].size() < first[y].size(); });
    for (auto h = ordered[part].begin(); h != ordered[part].end(); ++h)
      (h == least && t.there.of[part] == 0 ? first : later)[*h].emplace_back(part);
  }
  const std::vector<double> relief = pressure(t);
  for (auto& [id, parts] : later)
    std::ranges::stable_sort(parts, std::ranges::greater(), [&](PartId part) { return relief[part.value]; });
  for (const auto& [id, host] : p.hold) {
    wire::LoadParts m;
    for (const auto* list : {&first[id], &later[id]})
      for (const PartId part : *list) m.add_parts(part.value);
    if (m.parts_size() != 0) send(id, std::move(m));
  }
}

// Every part is held by a host that takes part, or (by_leaving) still does, or is nobody's by decision.
bool ManagerCore::everything_held(const Team& t, bool by_leaving) const {
  const Holders& h = by_leaving ? t.there : t.staying;
  if (h.tracers == 0) return false;
  std::size_t missing = h.unheld;
  for (const PartId p : t.paged) missing -= h.of[p.value] == 0 ? 1 : 0;
  return missing == 0;
}

// Every part has been ordered at a host that takes part, or (by_leaving) still does.
bool ManagerCore::everything_wanted(const Team& t, bool by_leaving) const {
  std::set<PartId> wanted;
  for (const auto& [id, h] : t.hosts)
    if (!h->leaving || (by_leaving && h->released == 0)) wanted.insert(h->wanted.begin(), h->wanted.end());
  return wanted.size() + 1 >= job_.parts.size();
}

// Every part is somewhere, or nobody's by decision.
bool ManagerCore::everything_covered(const Team& t) const {
  std::set<PartId> covered = t.paged;
  for (const auto& [id, h] : t.hosts)
    if (h->released == 0) covered.insert(h->wanted.begin(), h->wanted.end());
  return covered.size() + 1 >= job_.parts.size();
}

// Without the hosts that want to leave.
std::optional<ManagerCore::Plan> ManagerCore::smaller_plan(const Team& t) const {
  auto found = plan(t, false, Keep::one_copy);
  if (!found) found = plan_paged(t, false);
  return found ? std::optional(std::move(*found)) : std::nullopt;
}

// What leaving hosts hold finds room only where surplus copies make it, and a part can be dropped
// only when no path is under way: else all of them would be made again. So nobody begins any until
// all have ended.
void ManagerCore::make_room(Team& t, double now) {
  if (phase_ != Phase::rendering || t.broken || t.pause != 0 || everything_wanted(t, false)) return;
  const bool asked = std::any_of(t.hosts.begin(), t.hosts.end(), [](const auto& h) {
    return h.second->leaving && h.second->released == 0;
  });
  if (!asked || !smaller_plan(t)) return;
  t.pause = epoch_ + 1;
  new_map(t, false);
  end_pause(t, now);
}

void ManagerCore::end_pause(Team& t, double now) {
  if (t.pause == 0 || phase_ != Phase::rendering) return;
  for (const auto& [id, h] : t.hosts)
    if (h->mapped && (h->status.epoch() < t.pause || h->status.live_paths() != 0)) return;
  t.pause = 0;
  const auto found = smaller_plan(t);
  if (!found || everything_wanted(t, false)) return new_map(t, false);
  adopt(t, *found);
  new_map(t, true, &*found);
  order(t, *found);
  check_loaded(t, now);
}

}  // namespace cloudrenderer
