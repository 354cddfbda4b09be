// Renderer tasks, the film, the end of the job.
#include <algorithm>
#include <cmath>

#include "tasks/manager_core.h"

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kDefaultCredits = 131072;
constexpr std::uint64_t kMostCredits = std::uint64_t{1} << 40;  // believed
constexpr std::uint32_t kTasksPerHost = 8;                      // at least, by the size of tiles
// Up to so many hosts all are looked at whenever a task is done. Of more, only the one that has done it; the others in
// turns, between which there is a pause for each host.
constexpr std::size_t kFew = 64;
constexpr double kTurnPause = 2e-5;
constexpr std::uint32_t kMostTasksPerHost = 32;  // of many hosts: more replies than needed are work for the manager

}  // namespace

void ManagerCore::begin_rendering(double now) {
  phase_ = Phase::rendering;
  progress_.render_began = progress_.render_ended = now;
  const std::uint64_t wanted =
      std::uint64_t{kTasksPerHost} * std::max<std::size_t>(hosts_.size(), options_.min_hosts);
  for (std::uint32_t tile = options_.tile; options_.fixed_tile == 0; tile /= 2) {
    set_tile(tile);
    if (tile <= options_.smallest_tile || std::uint64_t{covered_.size()} * rounds() >= wanted) break;
  }
  if (options_.hold_rounds)
    begin_held_rounds();
  else if (hosts_.size() > kFew)
    lengthen_rounds();
  begin_trial();
  advance_cursor();
  for (auto& [id, h] : hosts_) h.rate_since = now;
  for (Team& t : teams_)
    if (everything_held(t, true) && enough_complete(t)) new_map(t, false);
  hand_out(now);
  check_end(now);
}

// Before the first is handed out.
void ManagerCore::lengthen_rounds() {
  const std::uint64_t most = std::uint64_t{kMostTasksPerHost} * hosts_.size();
  while (std::uint64_t{covered_.size()} * rounds() > most && options_.round_samples < job_.spp) options_.round_samples *= 2;
  count_rounds();
  const std::uint64_t done = progress_.paths_done;
  progress_.paths_done = 0;
  const std::vector<SampleSet> covered = std::exchange(covered_, std::vector<SampleSet>(covered_.size()));
  for (std::size_t tile = 0; tile < covered.size(); ++tile)
    for (const SampleRange& s : covered[tile].ranges()) cover(tile, s);
  progress_.paths_done = done;
}

void ManagerCore::count_rounds() {
  round_left_.clear();
  for (std::uint32_t r = 0; r < rounds(); ++r)
    round_left_.push_back(job_.frame.pixels() * std::min(options_.round_samples, job_.spp - r * options_.round_samples));
}

void ManagerCore::set_tile(std::uint32_t tile) {
  const auto tiles = [tile](std::uint32_t extent) { return (extent + tile - 1) / tile; };
  tile_ = tile;
  tiles_x_ = tiles(job_.frame.crop_width());
  tiles_y_ = tiles(job_.frame.crop_height());
  covered_.assign(std::size_t{tiles_x_} * tiles_y_, {});
}

// An earlier run may have decided already, or may have held no rounds.
void ManagerCore::begin_held_rounds() {
  if (goals_.empty()) {
    std::uint32_t most = 1;
    for (const SampleSet& s : covered_)
      if (!s.ranges().empty()) most = std::max(most, s.ranges().back().end);
    const std::uint32_t step = options_.round_samples;
    goals_.assign(covered_.size(), whole_groups((most + step - 1) / step * step));
    ++decisions_;
  }
  unassigned_paths_ = missing_paths();
}

bool ManagerCore::restore_goals(std::vector<std::uint32_t> goals) {
  if (phase_ != Phase::gathering || !hosts_.empty() || goals.size() != covered_.size() ||
      std::ranges::any_of(goals, [&](std::uint32_t g) { return g > job_.spp; }))
    return false;
  goals_ = std::move(goals);
  ++decisions_;
  return true;
}

SampleRange ManagerCore::wanted(std::size_t tile) const {
  if (options_.hold_rounds) return {0, goals_[tile]};
  const std::uint32_t first = round_ * options_.round_samples;
  return {first, std::min(job_.spp, first + options_.round_samples)};
}

// Of the rounds that may be handed out, with hold_rounds; nothing is on its way.
std::uint64_t ManagerCore::missing_paths() const {
  std::uint64_t paths = 0;
  for (std::size_t tile = 0; tile < covered_.size(); ++tile) {
    RendererRange r = tile_range(tile);
    for (const SampleRange& s : covered_[tile].gaps({0, goals_[tile]})) {
      r.sample_begin = s.begin;
      r.sample_end = s.end;
      paths += r.paths();
    }
  }
  return paths;
}

RendererRange ManagerCore::tile_range(std::size_t tile) const {
  const FilmFrame& f = job_.frame;
  RendererRange r;
  r.x0 = f.x0 + static_cast<std::uint32_t>(tile % tiles_x_) * tile_;
  r.y0 = f.y0 + static_cast<std::uint32_t>(tile / tiles_x_) * tile_;
  r.x1 = std::min(f.x1, r.x0 + tile_);
  r.y1 = std::min(f.y1, r.y0 + tile_);
  return r;
}

std::uint64_t ManagerCore::tile_samples(std::size_t tile) const {
  std::uint64_t n = 0;
  for (const SampleRange& r : covered_[tile].ranges()) n += r.end - r.begin;
  return n;
}

// The samples of a tile are in the film.
void ManagerCore::cover(std::size_t tile, SampleRange samples) {
  covered_[tile].add(samples);
  const RendererRange r = tile_range(tile);
  const std::uint64_t pixels = std::uint64_t{r.x1 - r.x0} * (r.y1 - r.y0);
  for (std::uint32_t s = samples.begin; s < samples.end;) {
    const std::uint32_t round = s / options_.round_samples;
    const std::uint32_t end = std::min(samples.end, (round + 1) * options_.round_samples);
    round_left_[round] -= pixels * (end - s);
    s = end;
  }
  progress_.paths_done += pixels * (samples.end - samples.begin);
}

bool ManagerCore::renders(const Host& h) {
  return h.mapped && !h.leaving && h.team->able && can(h.hello, wire::RENDERER);
}

// In paths per second, where it is known; until then as fast as its threads are elsewhere.
double ManagerCore::speed(const Host& h, double per_thread) const {
  return h.paths_per_s > 0 ? h.paths_per_s
                           : per_thread * h.threads();
}

// How large a task of a host with this share of the cluster's speed may be now: at most some
// seconds of work, and less towards the end, so that no host waits long for the last one.
std::uint64_t ManagerCore::task_paths(const Host& h, double share) const {
  std::uint64_t paths = std::uint64_t{tile_} * tile_ * options_.round_samples;
  if (h.paths_per_s > 0)
    paths = std::min(paths,
                     static_cast<std::uint64_t>(std::ceil(h.paths_per_s * options_.task_seconds)));
  const double rest = share * static_cast<double>(unassigned_paths_);
  return std::min(paths, std::max(options_.smallest_task, static_cast<std::uint64_t>(rest / 4)));
}

void ManagerCore::hand_out(double now, HostId only) {
  if (phase_ != Phase::rendering || stopped_) return;
  if (hosts_.size() > kFew && now < next_turn_) {
    const auto it = hosts_.find(only);
    if (it == hosts_.end()) return;
    it->second.team->able = everything_held(*it->second.team, true);
    if (!renders(it->second)) return;
    Turn turn = Turn::given;
    while (turn == Turn::given) turn = give_one(only, it->second, now);
    if (turn == Turn::nothing_left) give_again(now);
    return;
  }
  next_turn_ = now + kTurnPause * static_cast<double>(hosts_.size());
  for (Team& t : teams_) t.able = everything_held(t, true);
  std::vector<std::pair<HostId, Host*>> turn;
  for (auto& [id, h] : hosts_)
    if (renders(h)) turn.emplace_back(id, &h);
  double known = 0, threads = 0;
  for (const auto& [id, h] : turn) {
    if (h->paths_per_s <= 0) continue;
    known += h->paths_per_s;
    threads += h->threads();
  }
  per_thread_ = known > 0 ? known / threads : 1;
  total_speed_ = 0;
  for (const auto& [id, h] : turn) total_speed_ += speed(*h, per_thread_);
  while (!turn.empty()) {  // one each, until they have enough
    std::size_t more = 0;
    for (const auto& [id, h] : turn) {
      const Turn given = give_one(id, *h, now);
      if (given == Turn::nothing_left) return give_again(now);
      if (given == Turn::given) turn[more++] = {id, h};
    }
    turn.resize(more);
  }
}

// A task, unless the host has enough for now.
ManagerCore::Turn ManagerCore::give_one(HostId id, Host& h, double now) {
  const double share = speed(h, per_thread_) / std::max(total_speed_, speed(h, per_thread_));
  std::uint64_t credits = h.hello.path_credits() ? h.hello.path_credits() : kDefaultCredits;
  if (!h.team->paged.empty()) credits = std::max(credits, h.hello.paging_credits());
  credits = std::min(credits, kMostCredits);
  const std::uint64_t enough = std::max(
      task_paths(h, share), static_cast<std::uint64_t>(share * static_cast<double>(unassigned_paths_) / 2));
  if (h.outstanding_tasks != 0 && h.outstanding_paths >= std::min(2 * credits, enough)) return Turn::enough;
  const auto range = next_range(task_paths(h, share));
  if (!range) return Turn::nothing_left;
  if (!range->trial) unassigned_paths_ -= range->paths();
  give(id, h, *range, now);
  return Turn::given;
}

// Nothing is left but what hosts are at. Those that have nothing get a second copy of what would
// be done last: the end of the longest queue, which its host may not even have begun. The first
// reply counts.
void ManagerCore::give_again(double now) {
  if (hosts_.size() > kFew) {
    if (now < next_again_) return;
    next_again_ = now + kTurnPause * static_cast<double>(hosts_.size());
  }
  std::vector<HostId> idle;
  for (const auto& [id, h] : hosts_)
    if (renders(h) && h.outstanding_tasks == 0) idle.push_back(id);
  if (idle.empty()) return;
  // What has taken long will take as long again, whatever the host has done in the past.
  const auto wait = [now](const Host& o) {
    const double queue = o.paths_per_s > 0 ? static_cast<double>(o.outstanding_paths) / o.paths_per_s
                                           : std::numeric_limits<double>::infinity();
    return std::max(queue, now - o.fed);
  };
  std::vector<std::pair<double, std::uint32_t>> waiting;  // for tasks of which there is no copy yet
  for (const auto& [task, o] : outstanding_)
    if (o.twin == 0) waiting.emplace_back(wait(*o.at), task);
  std::ranges::sort(waiting);  // the longest last, and of one host's tasks its last
  for (const HostId id : idle) {
    if (waiting.empty()) return;
    const auto [longest, task] = waiting.back();
    Host& h = hosts_.at(id);
    const RendererRange range = outstanding_.at(task).range;
    if (h.paths_per_s > 0 && static_cast<double>(range.paths()) / h.paths_per_s >= longest) continue;  // it would be no help
    waiting.pop_back();
    const std::uint32_t copy = give(id, h, range, now);
    outstanding_.at(task).twin = copy;
    outstanding_.at(copy).twin = task;
  }
}

std::optional<RendererRange> ManagerCore::next_range(std::uint64_t paths) {
  if (trial_) return trial_->next();
  if (returned_.empty()) {
    if (round_ >= allowed_rounds_) return std::nullopt;
    RendererRange whole = tile_range(cursor_tile_);
    for (const SampleRange& s : covered_[cursor_tile_].gaps(wanted(cursor_tile_))) {
      whole.sample_begin = s.begin;
      whole.sample_end = s.end;
      returned_.push_back(whole);
    }
    ++cursor_tile_;
    advance_cursor();
  }
  RendererRange r = returned_.back();
  returned_.pop_back();
  const std::uint64_t pixels = std::uint64_t{r.x1 - r.x0} * (r.y1 - r.y0);
  // Behind the last whole group nothing is shared.
  const SharedRays groups = shared_rays();
  r.shares = shares_ && r.sample_begin < groups.end;
  const std::uint32_t block = groups.block(), left = (r.shares ? std::min(r.sample_end, groups.end) : r.sample_end) - r.sample_begin;
  const auto samples = static_cast<std::uint32_t>(std::min<std::uint64_t>(left, std::max<std::uint64_t>(1, paths / pixels / block) * block));
  if (r.sample_begin + samples < r.sample_end) {  // the rest is for the next one
    RendererRange rest = r;
    r.sample_end = rest.sample_begin = r.sample_begin + samples;
    returned_.push_back(rest);
  }
  return r;
}

void ManagerCore::begin_trial() {
  shares_ = job_.samples_per_ray > 1 && shared_rays().end > 0;
  if (!shares_ || !job_.share_if_worth || unassigned_paths_ == 0) return;
  shares_ = false;
  trial_.emplace(job_.frame, film_.sums_per_pixel());
}

void ManagerCore::end_trial() {
  shared_variance_ = trial_->ratio();
  shares_ = shared_variance_.value_or(kSharedVariance) < kSharedVariance;
  trial_.reset();
}

// To the next tile and round of which something is missing.
void ManagerCore::advance_cursor() {
  for (; round_ < allowed_rounds_; ++round_, cursor_tile_ = 0)
    for (; cursor_tile_ < covered_.size(); ++cursor_tile_)
      if (!covered_[cursor_tile_].gaps(wanted(cursor_tile_)).empty()) return;
}

std::uint32_t ManagerCore::give(HostId id, Host& h, RendererRange range, double now) {
  if (h.outstanding_tasks == 0) {
    h.fed = now;
    if (h.rate_paths == 0) h.rate_since = now;
  }
  range.task = next_task_++;
  outstanding_.emplace_hint(outstanding_.end(), range.task, Outstanding{range, id, &h});
  ++h.outstanding_tasks;
  h.outstanding_paths += range.paths();
  send(id, wire::SubmitTask{{options_.incarnation, next_number_++}, h.team->epoch, h.team->generation, range});
  return range.task;
}

void ManagerCore::take_back(std::map<std::uint32_t, Outstanding>::iterator o) {
  Host& h = *o->second.at;
  --h.outstanding_tasks;
  h.outstanding_paths -= o->second.range.paths();
  outstanding_.erase(o);
}

void ManagerCore::handle(HostId from, Host& h, wire::Reply& m, double now) {
  auto* r = std::get_if<wire::RendererReply>(&m.payload);
  const auto it = r ? outstanding_.find(r->task) : outstanding_.end();
  if (it == outstanding_.end() || it->second.host != from)
    return void(++progress_.dropped_messages);
  const RendererRange range = it->second.range;
  if (!fits(*r, range)) {  // nor would it answer once more
    ++progress_.dropped_messages;
    return remove(from, true, now);
  }
  merge(it->second, *r);
  const std::uint64_t paths = range.paths();
  const auto twin = it->second.twin != 0 ? outstanding_.find(it->second.twin) : outstanding_.end();
  if (twin != outstanding_.end()) {
    wire::CancelTask cancel;
    cancel.set_task(twin->first);
    cancel.set_paths(paths);
    send(twin->second.host, std::move(cancel));
    take_back(twin);
  }
  take_back(it);
  h.fed = now;
  h.rate_paths += paths;
  if (now > h.rate_since + 1) {
    h.paths_per_s = static_cast<double>(h.rate_paths) / (now - h.rate_since);
    if (now > h.rate_since + 10) {  // what was long ago counts less
      h.rate_since = now - (now - h.rate_since) / 2;
      h.rate_paths /= 2;
    }
  }
  if (!range.trial) reports_[from].paths_done += static_cast<double>(paths);
  progress_.render_ended = now;
  record_.add(now, progress_.paths_done);
  hand_out(now, from);
  check_end(now);
  if (h.leaving) try_release(from, now);
}

bool ManagerCore::nothing_left() const { return !trial_ && returned_.empty() && round_ >= allowed_rounds_; }

// No tile may get more samples than it has, or will have at the end of this round.
bool ManagerCore::held_to_the_end() const {
  return !options_.hold_rounds || std::ranges::all_of(goals_, [&](std::uint32_t g) { return g >= job_.spp; });
}

bool ManagerCore::round_complete() const {
  return options_.hold_rounds && phase_ == Phase::rendering && !stopped_ && nothing_left() && outstanding_.empty() &&
         !held_to_the_end();
}

std::uint32_t ManagerCore::whole_groups(std::uint32_t samples) const {
  const std::uint32_t block = shared_rays().block();
  return std::min(job_.spp, (samples + block - 1) / block * block);
}

void ManagerCore::next_round(double now, std::vector<std::uint32_t> goals, std::uint64_t expected) {
  if (!round_complete()) return;
  for (std::size_t tile = 0; tile < goals_.size(); ++tile)
    goals_[tile] = whole_groups(std::max(goals_[tile], goals.empty() ? goals_[tile] + options_.round_samples : goals[tile]));
  ++decisions_;
  ++allowed_rounds_;
  cursor_tile_ = 0;
  unassigned_paths_ = missing_paths();
  if (expected > 0) progress_.paths_total = std::max(expected, progress_.paths_done + unassigned_paths_);
  advance_cursor();
  hand_out(now);
  check_end(now);  // a checkpoint may have had all that was left
}

std::uint32_t ManagerCore::complete_samples() const {
  std::uint32_t r = 0;
  while (r < round_left_.size() && round_left_[r] == 0) ++r;
  return std::min(job_.spp, r * options_.round_samples);
}

void ManagerCore::check_end(double now) {
  if (phase_ != Phase::rendering || !outstanding_.empty()) return;
  if (stopped_ || (nothing_left() && held_to_the_end())) begin_end("", now);
}

void ManagerCore::stop(double now) {
  stopped_ = true;
  if (phase_ == Phase::gathering || phase_ == Phase::loading) return begin_end("stopped", now);
  check_end(now);
}

void ManagerCore::cancel(const std::string& reason, double now) {
  if (phase_ != Phase::ending && !finished()) begin_end(reason, now);
}

void ManagerCore::begin_end(const std::string& reason, double now) {
  phase_ = Phase::ending;
  outstanding_.clear();
  end_deadline_ = now + options_.end_wait_s;
  wire::JobEnd end;
  end.set_job(job_.start.job());
  end.set_reason(reason);
  std::vector<HostId> all;
  for (const auto& [id, h] : hosts_) all.push_back(id);
  send(std::move(all), std::move(end));
  check_final(now);
}

// The counters of every host are in, or are not waited for any more.
void ManagerCore::check_final(double now) {
  if (phase_ != Phase::ending) return;
  if ((finals_ < hosts_.size() || !departing_.empty()) && now < end_deadline_) return;
  phase_ = Phase::done;
  all_gone();
}

void ManagerCore::fail(const std::string& why, double now) {
  if (finished()) return;
  error_ = why;
  begin_end(why, now);
  phase_ = Phase::failed;
  all_gone();
}

void ManagerCore::all_gone() {
  for (const auto& [id, h] : hosts_) gone_.push_back(id);
  for (const auto& [id, until] : std::exchange(departing_, {})) gone_.push_back(id);
}

}  // namespace cloudrenderer
