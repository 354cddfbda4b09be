// Messages, hosts coming and going.
#include "tasks/worker_core.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace cloudrenderer {
namespace {

constexpr HostId kManager{0};

bool is_path_work(TaskCategory c) {
  return c == TaskCategory::tracer || c == TaskCategory::aggregator ||
         c == TaskCategory::intersection;
}

}  // namespace

using enum TaskMove;

WorkerCore::WorkerCore(HostId self, std::uint64_t incarnation, const WorkerOptions& options)
    : self_(self), incarnation_(incarnation), options_(options) {}

void WorkerCore::receive(HostId from, wire::Message message, double now) {
  now_ = now;
  std::visit([&](auto& m) { handle(from, m); }, message);
  flush_all();
}

void WorkerCore::tick(double now) {
  now_ = now;
  retry_stranded(false);
  flush_all();
  if (now >= next_status_) {
    next_status_ = now + options_.status_every_s;
    wire::Status s = status();
    say_visits(s);
    send(kManager, std::move(s));
  }
}

double WorkerCore::deadline() const {
  double t = next_status_;
  for (const HostId to : filling_) {
    const auto it = gather_.find(to);
    if (it == gather_.end()) continue;
    const Gather& g = it->second;
    if (!g.segments.empty()) t = std::min(t, g.segments_since + options_.block_age_s);
    if (!g.asks.empty()) t = std::min(t, g.asks_since + options_.block_age_s);
    if (!g.ends.empty() && known(to)) t = std::min(t, g.ends_since + options_.block_age_s);
  }
  for (const Stranded& s : stranded_) t = std::min(t, s.since + options_.retry_s);
  if (next_page_ > now_ && !paged_.empty()) t = std::min(t, next_page_);
  return t;
}

// ---- job
// ------------------------------------------------------------------------------------------------------

void WorkerCore::handle(HostId from, wire::JobStart& m) {
  if (from != kManager) return void(++dropped_);
  forget_job();
  job_ = m;
  columns_ = m.columns();
  counters_.Clear();
  busy_s_ = 0;
  Task& task = create(TaskCategory::loader);
  move(task, a_accept);
  Work work;
  work.what = StartJobWork{m};
  ready_load_.push_back({task.id, std::move(work), 0});
}

void WorkerCore::handle(HostId from, wire::JobEnd& m) {
  if (from != kManager) return void(++dropped_);
  end_job(m.reason());
}

void WorkerCore::handle(HostId from, wire::CancelJob& m) {
  if (from != kManager || !job_ || m.job() != job_->job()) return void(++dropped_);
  end_job(m.reason());
}

// Another host was first. All that this one has made of the task is made twice.
void WorkerCore::handle(HostId from, wire::CancelTask& m) {
  if (from != kManager || !job_) return void(++dropped_);
  const auto it = renderers_.find(m.task());
  if (it != renderers_.end() && it->second.cancelled) return void(++dropped_);
  const bool replied = it == renderers_.end();
  const std::uint64_t made =
      replied ? m.paths() : it->second.range.paths() - it->second.unissued;
  counters_.set_copied_paths(counters_.copied_paths() + made);
  if (replied) return;
  Renderer& r = it->second;
  r.cancelled = true;
  r.to_make.clear();
  if (!collecting_) forget_cancelled();
}

// Not while a thread has the ledgers.
void WorkerCore::forget_cancelled() {
  for (auto it = renderers_.begin(); it != renderers_.end();) {
    const Renderer& r = it->second;
    if (!r.cancelled || r.live() != 0) {
      ++it;
      continue;
    }
    std::erase_if(opened_, [&](const RendererRange& o) { return o.task == r.range.task; });
    ledgers_.erase(it->first);
    move(r.id, l_discard);
    it = renderers_.erase(it);
  }
}

void WorkerCore::end_job(const std::string& reason) {
  if (leaving_) left_ = true;
  if (!job_) return void(++dropped_);
  wire::Status last = status();
  last.set_final(true);
  send(kManager, std::move(last));
  forget_job();
  Task& task = create(TaskCategory::unloader);
  move(task, a_accept);
  Work work;
  work.what = EndJobWork{reason};
  ready_load_.push_back({task.id, std::move(work), 0});
}

void WorkerCore::forget_in_flight() {
  std::vector<Uuid> ended;
  for (const auto& [id, task] : tasks_)
    if (is_path_work(task.category) && task.state != TaskState::running) ended.push_back(id);
  for (const Uuid id : ended) {
    const Task& task = tasks_.at(id);
    const bool at_lost_host = task.state == TaskState::waiting && task.target && !known(task.target);
    move(id, at_lost_host ? k_target_lost : l_discard);
  }
  waiting_.clear();
  ready_local_.clear();
  ready_arrived_.clear();
  ready_returned_.clear();
  ready_shade_.clear();
  ready_occlude_.clear();
  ready_resolve_.clear();
  stranded_.clear();
  paged_.clear();
  queued_ = local_queued_ = shade_queued_ = kept_ = 0;
  for (auto it = gather_.begin(); it != gather_.end();) {
    auto ends = std::move(it->second.ends);  // samples that are done need not be made again
    it->second = {};
    it->second.ends = std::move(ends);
    it = gone(it->first) ? gather_.erase(it) : std::next(it);
  }
}

void WorkerCore::forget_job() {
  forget_in_flight();
  std::vector<Uuid> ended;
  for (const auto& [id, task] : tasks_)
    if (task.category == TaskCategory::renderer ||
        (!is_path_work(task.category) && task.state != TaskState::running))
      ended.push_back(id);
  for (const Uuid id : ended) move(id, l_discard);
  ready_load_.clear();
  gather_.clear();
  early_.clear();
  renderers_.clear();
  ledgers_.clear();
  own_ends_.clear();
  opened_.clear();
  collecting_ = list_missing_ = remaking_ = false;
  visits_.clear();
  visits_said_ = 0;
  seen_.clear();
  routing_ = std::make_shared<const Routing>();
  refuse_below_ = 0;
  job_.reset();
  job_ready_ = false;
  drops_ = 0;
  pages_.clear();
  next_page_ = pages_declined_ = 0;
}

void WorkerCore::handle(HostId from, wire::LoadParts& m) {
  if (from != kManager || !job_) return void(++dropped_);
  for (const std::uint32_t p : m.parts()) {  // one each, so that what is there is known early
    Task& task = create(TaskCategory::loader);
    move(task, a_accept);
    Work work;
    work.what = LoadWork{{PartId(p)}, {}};
    ready_load_.push_back({task.id, std::move(work), 0});
  }
}

void WorkerCore::handle(HostId from, wire::UnloadParts& m) {
  if (from != kManager || !job_) return void(++dropped_);
  refuse_below_ = std::max(refuse_below_, m.epoch());
  unload({m.parts().begin(), m.parts().end()}, false);
}

void WorkerCore::unload(const std::vector<std::uint32_t>& parts, bool before_paths) {
  UnloadWork what;
  what.before_paths = before_paths;
  if (before_paths) ++drops_;
  for (const std::uint32_t p : parts) what.parts.emplace_back(p);
  Task& task = create(TaskCategory::unloader);
  move(task, a_accept);
  Work work;
  work.what = std::move(what);
  ready_load_.push_back({task.id, std::move(work), 0});
}

// ---- hosts
// ----------------------------------------------------------------------------------------------------

void WorkerCore::handle(HostId from, wire::HostList& m) {
  if (from != kManager || !job_ || routing_->epoch() == 0) return void(++dropped_);
  if (m.heartbeat_s() > 0) options_.status_every_s = m.heartbeat_s();
  // Only loads are taken over: hosts come and go with a new map.
  const ClusterMapPtr& map = routing_->map();
  HostLoadsPtr loads = options_.maps ? options_.maps->loads(routing_->loads(), map, m)
                                     : std::make_shared<const HostLoads>(*routing_->loads(), *map, m);
  routing_ = std::make_shared<const Routing>(map, std::move(loads), self_, options_.alpha);
}

void WorkerCore::handle(HostId from, wire::SceneHostMap& m) {
  const ClusterMapPtr before = routing_->map();
  if (from != kManager || !job_ || m.epoch() <= before->epoch() || (m.since() != 0 && m.since() != before->epoch()))
    return void(++dropped_);
  const bool again = before->epoch() != 0 && m.generation() > before->generation();
  const ClusterMapPtr map = options_.maps ? options_.maps->map(before, m)
                            : m.since() == 0 ? std::make_shared<const ClusterMap>(m)
                                             : std::make_shared<const ClusterMap>(*before, m);
  // A complete map says all loads; what changes keep the others as they were.
  const ClusterMap nobody;
  const ClusterMap& base = m.since() == 0 ? nobody : *before;
  HostLoadsPtr loads = options_.maps ? options_.maps->first_loads(map, base, *routing_->loads())
                                     : std::make_shared<const HostLoads>(*map, base, *routing_->loads());
  routing_ = std::make_shared<const Routing>(map, std::move(loads), self_, options_.alpha);
  ++hosts_version_;
  for (const wire::HostEntry& e : map->entries()) {
    if (seen_.size() <= e.host()) seen_.resize(e.host() + 1);
    seen_[e.host()] = true;
  }
  // Once others hold all that this host held, it takes no more paths and can go when its own are
  // done.
  const Routing::Slot own = map->slot(self_);
  const bool holder = own != Routing::kNoSlot && map->holds_any(own);
  if (leaving_ && !holder) refuse_below_ = std::max(refuse_below_, map->epoch());
  std::erase_if(unreachable_, [&](const auto& u) { return !known(u.first); });
  if (again) {
    // A host was lost with paths that nobody can tell: every owner makes what it still lacks once
    // more, and nothing of before goes on. Copies that do arrive are equal to the bit and count
    // once.
    forget_in_flight();
    if (!renderers_.empty()) list_missing_ = remaking_ = true;
    for (const wire::Holding& d : m.drops())
      if (d.host() == self_.value) unload({d.parts().begin(), d.parts().end()}, true);
  } else {
    regroup();
    wake_all();  // some parts may have got a holder
  }
  retry_stranded(true);
  for (auto& [sender, submit] : std::exchange(early_, {})) handle(sender, submit);
}

// What gathers was routed by the old map: it must not leave under the number of the new one, for a
// host that has given its parts away takes blocks of the new epoch as meant. And hosts that left in
// good order have accepted nothing that they did not answer: that looks for another way too.
void WorkerCore::regroup() {
  for (auto it = gather_.begin(); it != gather_.end();) {
    Gather& g = it->second;
    if (!g.segments.empty()) {
      move(g.segment_task, p_map_changed);
      strand(g.segment_task, TraceWork::Returned{std::exchange(g.segments, {}), {}},
             std::exchange(g.segment_count, 0));
    }
    if (!g.asks.empty()) {
      move(g.ask_task, p_map_changed);
      strand(g.ask_task, ResolveWork::Answered{std::exchange(g.asks, {}), {}, {}, {}},
             std::exchange(g.ask_count, 0));
    }
    it = gone(it->first) ? gather_.erase(it) : std::next(it);
  }
  std::vector<Uuid> lost;
  for (const auto& [id, waiting] : waiting_)
    if (!known(tasks_.at(id).target)) lost.push_back(id);
  for (const Uuid id : lost) {
    Waiting w = std::move(waiting_.at(id));
    waiting_.erase(id);
    move(id, k_target_lost);
    if (auto* segments = std::get_if<std::vector<KeptSegments>>(&w.kept))
      strand(create(TaskCategory::tracer).id, TraceWork::Returned{std::move(*segments), {}},
             w.count);
    else
      strand(
          create(TaskCategory::intersection).id,
          ResolveWork::Answered{std::move(std::get<std::vector<ParkedAsks>>(w.kept)), {}, {}, {}},
          w.count);
  }
}

void WorkerCore::peer_unreachable(HostId peer) { unreachable_[peer] = now_; }
void WorkerCore::peer_reachable(HostId peer) { unreachable_.erase(peer); }

void WorkerCore::leave(const std::string& reason) {
  leaving_ = true;
  wire::Leave m;
  m.set_reason(reason);
  send(kManager, std::move(m));
}

// ---- work
// -----------------------------------------------------------------------------------------------------

void WorkerCore::handle(HostId from, wire::SubmitTask& m) {
  if (!job_ || tasks_.contains(m.id)) return void(++dropped_);
  if (const auto* range = std::get_if<RendererRange>(&m.payload)) {
    if (from != kManager || renderers_.contains(range->task) || range->x1 > job_->width() ||
        range->y1 > job_->height())
      return void(++dropped_);
    return submit_renderer(m.id, *range);
  }
  submit_block(from, m);
}

void WorkerCore::submit_renderer(Uuid id, const RendererRange& range) {
  Task& task = create(id, TaskCategory::renderer, kManager);
  move(task, a_accept);
  Renderer r;
  r.id = id;
  r.range = range;
  r.to_make.push_back({0, range.paths()});
  r.unissued = r.remaining = range.paths();
  renderers_.emplace(range.task, std::move(r));
  opened_.push_back(range);
}

void WorkerCore::submit_block(HostId from, wire::SubmitTask& m) {
  if (m.generation < routing_->generation())
    return void(++dropped_);  // its sender has forgotten it by now, or will
  if (m.generation > routing_->generation() || routing_->epoch() == 0) {
    early_.emplace_back(from, std::move(m));
    return;
  }
  if (!job_ready_ || m.epoch < refuse_below_) {
    send(from, wire::Reply{m.id, routing_->epoch(), wire::Refusal{}});
    return;
  }
  counters_.set_blocks_received(counters_.blocks_received() + 1);
  const bool segments = std::holds_alternative<wire::SegmentBlock>(m.payload);
  Task& task = create(m.id, segments ? TaskCategory::tracer : TaskCategory::intersection, from);
  move(task, a_accept);
  if (segments) {
    auto& block = std::get<wire::SegmentBlock>(m.payload);
    const std::size_t n = block.size();
    queued_ += n;
    ready_arrived_.push_back({m.id, {m.id, from, std::move(block)}, n});
  } else {
    auto& block = std::get<wire::OcclusionBlock>(m.payload);
    const std::size_t n = block.size();
    queued_ += n;
    ready_occlude_.push_back({m.id, {m.id, from, std::move(block)}, n});
  }
}

void WorkerCore::handle(HostId from, wire::Reply& m) {
  const auto it = waiting_.find(m.id);
  if (it == waiting_.end()) return void(++dropped_);
  Task& task = tasks_.at(m.id);
  Waiting& w = it->second;
  auto* segments = std::get_if<std::vector<KeptSegments>>(&w.kept);
  auto* asks = std::get_if<std::vector<ParkedAsks>>(&w.kept);
  auto* traced = std::get_if<wire::TracerReply>(&m.payload);
  auto* occluded = std::get_if<wire::OcclusionReply>(&m.payload);
  const bool refused = std::holds_alternative<wire::Refusal>(m.payload);
  auto* nearest = std::get_if<wire::NearestReply>(&m.payload);
  const bool fits = refused || (segments && !w.nearest && traced && traced->count == w.count) ||
                    (segments && w.nearest && nearest && nearest->count == w.count) ||
                    (asks && occluded && occluded->count == w.count);
  if (task.target != from || !fits) return void(++dropped_);

  Gather& g = gather_[from];
  if (segments && g.segment_blocks_out > 0) --g.segment_blocks_out;
  if (asks && g.ask_blocks_out > 0) --g.ask_blocks_out;
  Waiting done = std::move(w);
  waiting_.erase(it);
  segments = std::get_if<std::vector<KeptSegments>>(&done.kept);
  asks = std::get_if<std::vector<ParkedAsks>>(&done.kept);
  if (refused) {
    move(task, o_refused);
    if (segments)
      strand(m.id, TraceWork::Returned{std::move(*segments), {}}, done.count);
    else
      strand(m.id, ResolveWork::Answered{std::move(*asks), {}, {}, {}}, done.count);
    return;
  }
  kept_ -= done.count;
  if (traced && traced->tested.empty())
    return end_inline(m.id);  // all of them belong to the other host now
  move(task, h_collected);
  if (traced) {
    const std::size_t misses = traced->tested.size();
    ready_returned(m.id, {std::move(*segments), std::move(*traced), {}, {}, {}}, misses);
  } else if (nearest) {
    ready_returned(m.id, {std::move(*segments), {}, std::move(*nearest), from, done.at}, done.count);
  } else {
    ready_resolve(m.id, {std::move(*asks), from, done.at, std::move(*occluded)}, done.count);
  }
}

void WorkerCore::handle(HostId, wire::PathEnds& m) {
  if (!job_) return void(++dropped_);
  own_ends_.push_back(std::move(m.batch));  // of any generation: a sample is the same in all of them
}

}  // namespace cloudrenderer
