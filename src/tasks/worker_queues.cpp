// Tasks and their states, and the blocks that gather for other hosts.
#include <algorithm>
#include <utility>

#include "tasks/worker_core.h"

namespace cloudrenderer {
namespace {

// For a host that only intersects: it needs no more of a path than its ray, up to what is known to be hit.
wire::OcclusionBlock rays_of(const std::vector<KeptSegments>& kept) {
  auto rays = std::make_shared<std::vector<OcclusionRay>>();
  for (const KeptSegments& k : kept)
    for (std::size_t i = 0; i < k.hits.size(); ++i) {
      const PathSegment& s = (*k.segments)[i];
      rays->push_back({s.origin, s.direction, k.hits[i].t});
    }
  wire::OcclusionBlock block;
  block.nearest = true;
  block.chunks.push_back(std::move(rays));
  return block;
}

}  // namespace

using enum TaskMove;

Task& WorkerCore::create(Uuid id, TaskCategory category, HostId submitter) {
  Task task;
  task.id = id;
  task.category = category;
  task.submitter = submitter;
  ++in_state_[static_cast<std::size_t>(task.state)];
  return tasks_.emplace(id, task).first->second;
}

void WorkerCore::move(Task& task, TaskMove m) {
  --in_state_[static_cast<std::size_t>(task.state)];
  task.move(m);
  if (task.state == TaskState::end) {
    tasks_.erase(Uuid(task.id));
    return;
  }
  ++in_state_[static_cast<std::size_t>(task.state)];
}

void WorkerCore::end_inline(Uuid id) {
  Task& task = tasks_.at(id);
  move(task, h_collected);
  move(task, b_run);
  move(task, c_finish);
  move(task, j_replied);
}

void WorkerCore::ready_local(std::vector<PathSegment> segments) {
  if (segments.empty()) return;
  Task& task = create(TaskCategory::tracer);
  move(task, a_accept);
  const std::size_t n = segments.size();
  queued_ += n;
  local_queued_ += n;
  ready_local_.push_back({task.id, std::move(segments), n});
}

void WorkerCore::ready_shade(SegmentBatch batch) {
  if (batch.size() == 0) return;
  Task& task = create(TaskCategory::aggregator);
  move(task, a_accept);
  const std::size_t n = batch.size();
  queued_ += n;
  shade_queued_ += n;
  ready_shade_.push_back({task.id, std::move(batch), n});
}

void WorkerCore::ready_returned(Uuid id, TraceWork::Returned returned, std::size_t count) {
  queued_ += count;
  ready_returned_.push_back({id, std::move(returned), count});
}

void WorkerCore::ready_resolve(Uuid id, ResolveWork::Answered answered, std::size_t count) {
  queued_ += count;
  ready_resolve_.push_back({id, std::move(answered), count});
}

void WorkerCore::gather(HostId to, KeptSegments kept) {
  const std::size_t n = kept.segments->size();
  kept_ += n;
  if (!to) {
    TraceWork::Returned item;
    item.kept.push_back(std::move(kept));
    strand(create(TaskCategory::tracer).id, std::move(item), n);
    return;
  }
  Gather& g = gather_[to];
  filling_.insert(to);
  if (g.segments.empty()) {
    Task& task = create(TaskCategory::tracer);
    task.target = to;
    move(task, d_delegate);
    g.segment_task = task.id;
    g.segments_since = now_;
  }
  g.segments.push_back(std::move(kept));
  g.segment_count += n;
}

void WorkerCore::gather(HostId to, ParkedAsks asks) {
  const std::size_t n = asks.size();
  kept_ += n;
  if (!to) {
    ResolveWork::Answered item;
    item.asks.push_back(std::move(asks));
    strand(create(TaskCategory::intersection).id, std::move(item), n);
    return;
  }
  Gather& g = gather_[to];
  filling_.insert(to);
  if (g.asks.empty()) {
    Task& task = create(TaskCategory::intersection);
    task.target = to;
    move(task, d_delegate);
    g.ask_task = task.id;
    g.asks_since = now_;
  }
  g.asks.push_back(std::move(asks));
  g.ask_count += n;
}

void WorkerCore::gather_ends(HostId to, EndBatch ends) {
  if (ends.empty()) return;
  if (to == self_) {
    own_ends_.push_back(std::move(ends));
    return;
  }
  Gather& g = gather_[to];
  filling_.insert(to);
  if (g.ends.empty()) {
    g.ends_since = now_;
    g.ends = std::move(ends);
  } else {
    g.ends.ends.insert(g.ends.ends.end(), ends.ends.begin(), ends.ends.end());
    g.ends.features.insert(g.ends.features.end(), ends.features.begin(), ends.features.end());
  }
}

// Blocks leave when they are full, old, or when the receiver owes us nothing and so may be idle.
void WorkerCore::flush(HostId to, Gather& g) {
  const auto old = [&](double since) { return now_ - since >= options_.block_age_s; };
  if (!g.segments.empty() && (g.segment_count >= options_.block_segments ||
                              g.segment_blocks_out == 0 || old(g.segments_since)))
    send_segments(to, g);
  if (!g.asks.empty() &&
      (g.ask_count >= 4 * options_.block_segments || g.ask_blocks_out == 0 || old(g.asks_since)))
    send_asks(to, g);
  if (!g.ends.empty() && known(to) &&
      (g.ends.size() >= 2 * options_.block_segments || old(g.ends_since)))
    send(to, wire::PathEnds{routing_->generation(), std::exchange(g.ends, {})});
}

void WorkerCore::flush_all() {
  for (auto it = filling_.begin(); it != filling_.end();) {
    const auto gathered = gather_.find(*it);
    if (gathered != gather_.end()) flush(*it, gathered->second);
    const bool left = gathered != gather_.end() && (!gathered->second.segments.empty() || !gathered->second.asks.empty() ||
                                                    !gathered->second.ends.empty());
    it = left ? std::next(it) : filling_.erase(it);
  }
}

void WorkerCore::send_segments(HostId to, Gather& g) {
  auto chunks = std::exchange(g.segments, {});
  g.segment_count = 0;
  Uuid id = g.segment_task;
  for (std::size_t i = 0; i < chunks.size();) {
    if (i != 0) {
      Task& more = create(TaskCategory::tracer);
      more.target = to;
      move(more, d_delegate);
      id = more.id;
    }
    std::vector<KeptSegments> kept;
    wire::SegmentBlock block;
    block.columns = columns_;
    const bool asks = routing_->only_intersects(to);
    std::size_t n = 0;
    while (i < chunks.size() && n < options_.block_segments) {
      n += chunks[i].segments->size();
      block.chunks.push_back(chunks[i].segments);
      kept.push_back(std::move(chunks[i++]));
    }
    move(id, f_submitted);
    ++g.segment_blocks_out;
    counters_.set_blocks_sent(counters_.blocks_sent() + 1);
    wire::SubmitTask submit{id, routing_->epoch(), routing_->generation(), {}};
    if (asks) {
      submit.payload = rays_of(kept);
      counters_.set_nearest_asked(counters_.nearest_asked() + n);
    } else {
      submit.payload = std::move(block);
      counters_.set_moved(counters_.moved() + n);
    }
    waiting_.emplace(id, Waiting{std::move(kept), routing_, n, asks});
    send(to, std::move(submit));
  }
}

void WorkerCore::send_asks(HostId to, Gather& g) {
  auto chunks = std::exchange(g.asks, {});
  g.ask_count = 0;
  Uuid id = g.ask_task;
  for (std::size_t i = 0; i < chunks.size();) {
    if (i != 0) {
      Task& more = create(TaskCategory::intersection);
      more.target = to;
      move(more, d_delegate);
      id = more.id;
    }
    std::vector<ParkedAsks> kept;
    wire::OcclusionBlock block;
    std::size_t n = 0;
    while (i < chunks.size() && n < 4 * options_.block_segments) {
      n += chunks[i].size();
      block.chunks.push_back(chunks[i].rays);
      if (chunks[i].times) block.times.push_back(chunks[i].times);
      kept.push_back(std::move(chunks[i++]));
    }
    move(id, f_submitted);
    waiting_.emplace(id, Waiting{std::move(kept), routing_, n, false});
    ++g.ask_blocks_out;
    counters_.set_shadow_asked(counters_.shadow_asked() + n);
    counters_.set_blocks_sent(counters_.blocks_sent() + 1);
    send(to, wire::SubmitTask{id, routing_->epoch(), routing_->generation(), std::move(block)});
  }
}

void WorkerCore::strand(Uuid id, std::variant<TraceWork::Returned, ResolveWork::Answered> item,
                        std::size_t count) {
  stranded_.push_back({now_, id, std::move(item), count});
}

// Batches without a holder look for one again.
void WorkerCore::retry_stranded(bool all) {
  if (stranded_.empty()) return;
  std::vector<Stranded> later;
  for (Stranded& s : stranded_) {
    if (!all && now_ - s.since < options_.retry_s) {
      later.push_back(std::move(s));
      continue;
    }
    counters_.set_retries(counters_.retries() + 1);
    move(s.id, a_accept);
    kept_ -= s.count;
    if (auto* returned = std::get_if<TraceWork::Returned>(&s.item))
      ready_returned(s.id, std::move(*returned), s.count);
    else
      ready_resolve(s.id, std::move(std::get<ResolveWork::Answered>(s.item)), s.count);
  }
  stranded_ = std::move(later);
}

}  // namespace cloudrenderer
