// Which work is next, and what becomes of its results.
#include <algorithm>
#include <numeric>
#include <utility>

#include "tasks/worker_core.h"

namespace cloudrenderer {
namespace {

constexpr HostId kManager{0};
constexpr double kUnreachableFor = 8;  // longer than drivers take from one attempt to the next

template <class T>
T pop(std::deque<T>& queue) {
  T front = std::move(queue.front());
  queue.pop_front();
  return front;
}

}  // namespace

using enum TaskMove;

std::uint64_t WorkerCore::live_paths() const {
  std::uint64_t n = 0;
  for (const auto& [task, r] : renderers_) n += r.live();
  return n;
}

// What bounds memory: paths that exist always go on, new ones are made only while there is room for
// them.
bool WorkerCore::may_make_camera() const {
  if (!job_ready_ || remaking_ || routing_->map()->pause() || routing_->epoch() == 0 || queued_ >= options_.low_mark)
    return false;
  if (std::none_of(renderers_.begin(), renderers_.end(),
                   [](const auto& r) { return !r.second.to_make.empty(); }))
    return false;
  if (routing_->most_load_of_others() > options_.peer_load_limit_s) return false;
  return live_paths() < credits();
}

bool WorkerCore::has_work() const {
  if (drops_ != 0) return may_collect();
  return !ready_occlude_.empty() || !ready_resolve_.empty() || !ready_arrived_.empty() ||
         !ready_returned_.empty() || !ready_shade_.empty() || !ready_local_.empty() ||
         may_collect() || may_make_camera();
}

Work WorkerCore::base_work(double now) {
  Work work;
  work.routing = routing_;
  work.job = job_ ? job_->job() : 0;
  work.film_width = job_ ? job_->width() : 0;
  work.features = job_ && job_->features();
  work.taken = now;
  return work;
}

void WorkerCore::run(Work& work, Uuid id) {
  move(id, b_run);
  work.tasks.push_back(id);
}

std::optional<Work> WorkerCore::take(double now) {
  now_ = now;
  if (!has_work()) return std::nullopt;
  const auto next = [&] {
    if (drops_ != 0) return take_collect(now);
    // Others wait for these.
    if (!ready_occlude_.empty()) return take_occlude(now);
    if (!ready_resolve_.empty()) return take_resolve(now);
    if (!ready_arrived_.empty() || !ready_returned_.empty()) return take_trace(now);
    if (may_collect()) return take_collect(now);
    // The deepest work first, but small batches are dear: camera rays may join them while credits
    // last.
    const bool camera = may_make_camera();
    if (shade_queued_ + local_queued_ < options_.small_batch && camera) return take_camera(now);
    if (shade_queued_ != 0 &&
        (shade_queued_ >= options_.small_batch || local_queued_ < options_.small_batch))
      return take_shade(now);
    if (local_queued_ != 0) return take_trace(now);
    return take_camera(now);
  };
  Work work = next();
  ++running_;
  return work;
}

Work WorkerCore::take_camera(double now) {
  Work work = base_work(now);
  const auto it = std::find_if(renderers_.begin(), renderers_.end(),
                               [](const auto& r) { return !r.second.to_make.empty(); });
  Renderer& r = it->second;
  Task& task = tasks_.at(r.id);
  if (task.state == TaskState::ready) move(task, b_run);
  RendererLedger::Run& run = r.to_make.front();
  const std::uint64_t count =
      std::min({run.count, std::uint64_t{options_.camera_batch}, credits() - live_paths()});
  work.what = CameraWork{r.range, static_cast<std::uint16_t>(self_.value), run.first, count};
  run.first += count;
  run.count -= count;
  r.unissued -= count;
  if (run.count == 0) r.to_make.pop_front();
  if (r.to_make.empty()) move(task, g_generated);
  return work;
}

Work WorkerCore::take_trace(double now) {
  Work work = base_work(now);
  TraceWork w;
  std::size_t n = 0;
  const auto take_from = [&](auto& queue, auto& list) {
    while (!queue.empty() && (n == 0 || n + queue.front().count <= options_.trace_batch)) {
      auto ready = pop(queue);
      n += ready.count;
      queued_ -= ready.count;
      run(work, ready.id);
      list.push_back(std::move(ready.item));
    }
  };
  take_from(ready_arrived_, w.arrived);
  take_from(ready_returned_, w.returned);
  const std::size_t before = n;
  take_from(ready_local_, w.local);
  local_queued_ -= n - before;
  work.what = std::move(w);
  return work;
}

Work WorkerCore::take_shade(double now) {
  Work work = base_work(now);
  ShadeWork w;
  std::size_t n = 0;
  while (!ready_shade_.empty() &&
         (n == 0 || n + ready_shade_.front().count <= options_.trace_batch)) {
    auto ready = pop(ready_shade_);
    n += ready.count;
    run(work, ready.id);
    w.batches.push_back(std::move(ready.item));
  }
  queued_ -= n;
  shade_queued_ -= n;
  work.what = std::move(w);
  return work;
}

Work WorkerCore::take_occlude(double now) {
  Work work = base_work(now);
  OccludeWork w;
  for (std::size_t n = 0; !ready_occlude_.empty() && n < options_.trace_batch;) {
    auto ready = pop(ready_occlude_);
    n += ready.count;
    queued_ -= ready.count;
    run(work, ready.id);
    w.asked.push_back(std::move(ready.item));
  }
  work.what = std::move(w);
  return work;
}

Work WorkerCore::take_resolve(double now) {
  Work work = base_work(now);
  ResolveWork w;
  for (std::size_t n = 0; !ready_resolve_.empty() && n < options_.trace_batch;) {
    auto ready = pop(ready_resolve_);
    n += ready.count;
    queued_ -= ready.count;
    run(work, ready.id);
    w.answered.push_back(std::move(ready.item));
  }
  work.what = std::move(w);
  return work;
}

Work WorkerCore::take_collect(double now) {
  Work work = base_work(now);
  CollectWork w;
  w.ledgers = std::exchange(ledgers_, {});
  w.ends = std::exchange(own_ends_, {});
  w.opened = std::exchange(opened_, {});
  w.list_missing = std::exchange(list_missing_, false);
  collecting_ = true;
  work.what = std::move(w);
  return work;
}

void WorkerCore::finish(Work& work, WorkResult& r, double now) {
  now_ = now;
  if (is_loader_work(work)) return finish_load(work, r);
  --running_;
  busy_s_ += now - work.taken;
  const bool stale_job =
      !job_ || job_->job() != work.job || routing_->epoch() < work.routing->epoch();
  const bool stale = stale_job || routing_->generation() != work.routing->generation();
  count_tasks(work);
  for (const Uuid id : work.tasks) {
    if (stale) {
      move(id, l_discard);
      continue;
    }
    move(id, c_finish);
    move(id, j_replied);
  }
  if (stale_job) return;
  if (auto* camera = std::get_if<CameraWork>(&work.what); camera && !r.next.empty()) {
    // Speed is measured on batches that do real work.
  } else if (now > work.taken && !stale) {
    const std::size_t n = r.to_shade.size() + r.next.size();
    const double speed = static_cast<double>(n) / (now - work.taken);
    if (n != 0)
      segments_per_s_ = segments_per_s_ == 0 ? speed : 0.9 * segments_per_s_ + 0.1 * speed;
  }
  if (!r.visits.empty()) visits_.resize(std::max(visits_.size(), work.routing->part_count()));
  for (const auto& [part, rays] : r.visits) visits_[part] += rays;
  counters_.set_camera(counters_.camera() + r.counts.camera);
  counters_.set_bounce(counters_.bounce() + r.counts.bounce);
  counters_.set_shadow(counters_.shadow() + r.counts.shadow);
  for (auto& [owner, ends] : r.ends) {
    if (gone(owner)) continue;  // its tasks are others' now
    gather_ends(owner, std::move(ends));
  }
  if (const auto* collect = std::get_if<CollectWork>(&work.what)) finish_collect(*collect, r);
  if (!stale) {
    ready_local(std::move(r.next));
    ready_shade(std::move(r.to_shade));
    const bool old_map = work.routing->epoch() != routing_->epoch();  // hosts are chosen again
    for (LeavingSegments& l : r.leaving) gather(old_map ? HostId() : l.to, std::move(l.kept));
    for (LeavingAsks& l : r.asks) gather(old_map ? HostId() : l.to, std::move(l.asks));
    for (PagedSegments& p : r.paged) {
      const std::size_t n = p.kept.segments->size();
      TraceWork::Returned item;
      item.kept.push_back(std::move(p.kept));
      page(p.part, std::move(item), n);
    }
    for (PagedAsks& p : r.paged_asks) {
      const std::size_t n = p.asks.size();
      ResolveWork::Answered item;
      item.asks.push_back(std::move(p.asks));
      page(p.part, std::move(item), n);
    }
    if (old_map) {
      retry_stranded(true);
      wake_all();
    }
    for (auto& [to, reply] : r.replies) send(to, std::move(reply));
  }
  flush_all();
}

void WorkerCore::count_tasks(const Work& work) {
  const std::uint64_t n = work.tasks.size();
  if (std::holds_alternative<TraceWork>(work.what))
    counters_.set_tasks_tracer(counters_.tasks_tracer() + n);
  if (std::holds_alternative<ShadeWork>(work.what))
    counters_.set_tasks_aggregator(counters_.tasks_aggregator() + n);
  if (std::holds_alternative<OccludeWork>(work.what) ||
      std::holds_alternative<ResolveWork>(work.what))
    counters_.set_tasks_intersection(counters_.tasks_intersection() + n);
}

void WorkerCore::finish_collect(const CollectWork& work, WorkResult& r) {
  collecting_ = false;
  ledgers_ = std::move(r.ledgers);
  counters_.set_wasted_paths(counters_.wasted_paths() + r.duplicates + r.unknown);
  for (const auto& [number, remaining] : r.remaining) renderers_.at(number).remaining = remaining;
  for (auto& [number, runs] : r.missing) {
    Renderer& renderer = renderers_.at(number);
    if (renderer.cancelled) {
      renderer.unissued = renderer.remaining;  // nothing of it is on the way any more
      continue;
    }
    counters_.set_wasted_paths(counters_.wasted_paths() + renderer.live());
    renderer.to_make.assign(runs.begin(), runs.end());
    renderer.unissued = renderer.remaining;
    Task& task = tasks_.at(renderer.id);
    if (task.state == TaskState::waiting) move(task, h_collected);
  }
  if (work.list_missing) remaking_ = false;
  for (wire::RendererReply& reply : r.completed) {
    const auto it = renderers_.find(reply.task);
    if (it->second.cancelled) continue;
    const Uuid id = it->second.id;
    renderers_.erase(it);
    Task& task = tasks_.at(id);
    if (task.state == TaskState::waiting) move(task, h_collected);
    if (task.state == TaskState::ready) move(task, b_run);
    move(task, c_finish);
    send(kManager, wire::Reply{id, routing_->epoch(), std::move(reply)});
    move(task, j_replied);
    counters_.set_tasks_renderer(counters_.tasks_renderer() + 1);
  }
  forget_cancelled();
}

// ---- loader and unloader
// --------------------------------------------------------------------------------------

// Hits point into parts, so a part is dropped only when no batch is there.
bool WorkerCore::may_unload() const {
  return running_ == 0 && ready_shade_.empty() && ready_returned_.empty() && waiting_.empty() &&
         stranded_.empty() && std::all_of(gather_.begin(), gather_.end(), [](const auto& g) {
           return g.second.segments.empty();
         });
}

bool WorkerCore::has_load_work() const {
  if (loading_) return false;
  if (ready_load_.empty()) return may_page();
  return !std::holds_alternative<UnloadWork>(ready_load_.front().item.what) || may_unload();
}

std::optional<Work> WorkerCore::take_load(double now) {
  now_ = now;
  if (!has_load_work()) return std::nullopt;
  loading_ = true;
  if (ready_load_.empty()) return take_page();
  auto ready = pop(ready_load_);
  Work work = base_work(now);
  work.what = std::move(ready.item.what);
  if (auto* load = std::get_if<LoadWork>(&work.what)) load->evict = take_pages();
  run(work, ready.id);
  return work;
}

void WorkerCore::finish_load(const Work& work, WorkResult& r) {
  loading_ = false;
  counters_.set_load_s(counters_.load_s() + (now_ - work.taken));
  const bool unloader = std::holds_alternative<UnloadWork>(work.what) ||
                        std::holds_alternative<EndJobWork>(work.what);
  if (unloader)
    counters_.set_tasks_unloader(counters_.tasks_unloader() + 1);
  else
    counters_.set_tasks_loader(counters_.tasks_loader() + 1);
  const bool stale = !job_ || job_->job() != work.job;
  for (const Uuid id : work.tasks) {
    if (stale) {
      move(id, l_discard);
      continue;
    }
    move(id, c_finish);
    move(id, j_replied);
  }
  if (stale) return;
  if (const auto* page = std::get_if<PageWork>(&work.what)) return finish_page(*page, r, work.taken);
  if (const auto* load = std::get_if<LoadWork>(&work.what)) keep_pages(load->evict);
  if (const auto* unload = std::get_if<UnloadWork>(&work.what); unload && unload->before_paths)
    --drops_;
  if (std::holds_alternative<StartJobWork>(work.what)) job_ready_ = r.error.empty();
  counters_.set_parts_loaded(
      static_cast<std::uint32_t>(counters_.parts_loaded() + r.loaded.size() - r.unloaded.size()));
  wire::LoadReport report;
  report.set_job(work.job);
  for (const PartId p : r.loaded) report.add_loaded(p.value);
  for (const PartId p : r.unloaded) report.add_unloaded(p.value);
  for (const PartId p : r.declined) report.add_declined(p.value);
  report.set_bytes_used(r.bytes_used);
  report.set_error(r.error);
  send(kManager, std::move(report));
}

// ---- report
// ---------------------------------------------------------------------------------------------------

bool WorkerCore::idle() const {
  return tasks_.empty() && running_ == 0 && !collecting_ && own_ends_.empty() && early_.empty() &&
         std::all_of(gather_.begin(), gather_.end(),
                     [](const auto& g) { return g.second.ends.empty(); });
}

void WorkerCore::set_driver_counters(const DriverCounters& c) {
  driver_ = c;
  drained_ = c.drained && outbox_.empty();
}

// Whenever a tenth more has come, so that the list of a scene of many parts is no burden.
void WorkerCore::say_visits(wire::Status& s) {
  const std::uint64_t more = std::accumulate(visits_.begin(), visits_.end(), std::uint64_t{0});
  if (more <= visits_said_ / 10) return;
  visits_said_ += more;
  for (std::uint32_t p = 0; p < visits_.size(); ++p) {
    if (visits_[p] == 0) continue;
    s.add_visited(p);
    s.add_rays(std::exchange(visits_[p], 0));
  }
}

wire::Status WorkerCore::status() const {
  wire::Status s;
  const double speed = segments_per_s_ * options_.threads;
  s.set_load_s(speed > 0 ? static_cast<double>(queued_) / speed : 0);
  s.set_segments_per_s(speed);
  s.set_queued_segments(queued_);
  s.set_live_paths(live_paths());
  s.set_epoch(routing_->epoch());
  s.set_generation(routing_->generation());
  s.set_idle(idle() && drained_);
  s.mutable_tasks_in_state()->Assign(in_state_.begin(), in_state_.end() - 1);  // none stays in `end`
  wire::Counters& c = *s.mutable_counters();
  c = counters_;
  c.set_dropped_messages(dropped_);
  c.set_busy_s(busy_s_);
  c.set_cpu_s(driver_.cpu_s);
  c.set_bytes_sent(driver_.bytes_sent);
  c.set_bytes_received(driver_.bytes_received);
  c.set_memory_used(driver_.memory_used);
  c.set_memory_peak(driver_.memory_peak);
  c.set_peak_rss(driver_.peak_rss);
  for (const auto& [peer, when] : unreachable_)
    if (now_ - when < kUnreachableFor) s.add_unreachable(peer.value);
  return s;
}

}  // namespace cloudrenderer
