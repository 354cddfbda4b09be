#include <algorithm>
#include <iterator>

#include "tasks/answers.h"
#include "tasks/work.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kChunk =
    2048;  // segments of a leaving chunk at most, so that blocks stay small

template <class T>
void append(std::vector<T>& to, std::vector<T>&& from) {
  if (to.empty())
    to = std::move(from);
  else
    to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
}

// The host in a slot of the routing; none for this host itself, which did not have the part when
// the batch ran, and for parts without a holder: both look again a little later.
HostId remote_host(const Routing& routing, Routing::Slot s) {
  if (s == Routing::kNoSlot || routing.host(s) == routing.self()) return {};
  return routing.host(s);
}

class EndsByOwner {
 public:
  explicit EndsByOwner(WorkResult& r) : ends_(r.ends) {}
  void add(const PathEnd& e) {
    if (last_ >= ends_.size() || ends_[last_].first.value != e.owner) find(e.owner);
    ends_[last_].second.ends.push_back(e);
  }
  void add(const PathFeatures& f) {
    if (last_ >= ends_.size() || ends_[last_].first.value != f.owner) find(f.owner);
    ends_[last_].second.features.push_back(f);
  }
  // Mostly all of a batch belong to one owner, and need not be copied one by one.
  void add(std::vector<PathEnd>&& batch) {
    const auto other = [&](const PathEnd& e) { return e.owner != batch.front().owner; };
    if (batch.empty()) return;
    if (ends_.empty() && std::ranges::none_of(batch, other)) {
      const HostId owner(batch.front().owner);
      ends_.emplace_back(owner, EndBatch{std::move(batch), {}});
    } else {
      for (const PathEnd& e : batch) add(e);
    }
  }

 private:
  void find(std::uint16_t owner) {
    for (last_ = 0; last_ < ends_.size(); ++last_)
      if (ends_[last_].first.value == owner) return;
    ends_.emplace_back(HostId(owner), EndBatch());
  }
  std::vector<std::pair<HostId, EndBatch>>& ends_;
  std::size_t last_ = 0;
};

// One bucket a destination: slots of the routing, and one more for "no holder".
template <class Bucket>
class Buckets {
 public:
  explicit Buckets(const Routing& routing) : routing_(routing), index_(routing.hosts() + 1, kNone) {}
  Bucket& at(Routing::Slot s) {
    const std::size_t slot = remote_host(routing_, s) ? s : routing_.hosts();
    if (index_[slot] == kNone) {
      index_[slot] = static_cast<std::uint32_t>(buckets_.size());
      buckets_.emplace_back();
    }
    return buckets_[index_[slot]];
  }
  template <class F>
  void for_each(F f) {
    for (std::size_t s = 0; s < index_.size(); ++s)
      if (index_[s] != kNone)
        f(s < routing_.hosts() ? routing_.host(static_cast<Routing::Slot>(s)) : HostId(), buckets_[index_[s]]);
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  const Routing& routing_;
  std::vector<std::uint32_t> index_;  // by slot; a batch goes to few of many hosts
  std::vector<Bucket> buckets_;
};

struct SegmentBucket {
  std::vector<PathSegment> segments;
  std::vector<Hit> hits;
  std::vector<AnsweredSurface> surfaces;
  void add(const PathSegment& s, const Hit& hit, const std::vector<AnsweredSurface>& answered) {
    segments.push_back(s);
    hits.push_back(hit);
    if (hit.geometry == kAnsweredHit) keep_surface(hits.back(), answered, surfaces);
  }
};

template <class To, class Leaving>
void leave(To to, SegmentBucket& b, std::vector<Leaving>& out) {
  if (b.segments.empty()) return;
  out.push_back({to,
                 {std::make_shared<const std::vector<PathSegment>>(std::move(b.segments)),
                  std::move(b.hits), std::move(b.surfaces)}});
  b = {};
}

// Segments that wait for parts which no host holds, a bucket a part.
class PageBuckets {
 public:
  PageBuckets(const Routing& routing, WorkResult& r) : routing_(routing), result_(r) {}
  // False: the part is no such part.
  bool add(PartId part, const PathSegment& s, const Hit& hit, const std::vector<AnsweredSurface>& answered) {
    if (!routing_.paged(part)) return false;
    buckets_.resize(routing_.part_count());
    SegmentBucket& b = buckets_[part.value];
    b.add(s, hit, answered);
    if (b.segments.size() == kChunk) leave(part, b, result_.paged);
    return true;
  }
  void finish() {
    for (std::uint32_t p = 0; p < buckets_.size(); ++p) {
      // They may wait for long, and many of them: without the room that they do not use.
      buckets_[p].segments.shrink_to_fit();
      buckets_[p].hits.shrink_to_fit();
      leave(PartId(p), buckets_[p], result_.paged);
    }
  }

 private:
  const Routing& routing_;
  WorkResult& result_;
  std::vector<SegmentBucket> buckets_;
};

// The ray is traced from its start: its hit was in a part that this host has not got any more.
PathSegment restarted(PathSegment s) {
  s.best = {};
  s.tested = 0;
  s.window = 0;
  s.flags = static_cast<std::uint16_t>(s.flags & ~kMainTested);
  return s;
}

// Splits a traced batch: what can be shaded stays in it (in order), the rest goes to the buckets of
// its holders.
void split_traced(SegmentBatch& batch, const Routing& routing, WorkResult& r) {
  for (std::size_t i = 0; i < batch.size(); ++i) {
    const std::uint32_t part = batch.next[i] ? batch.next[i].value : batch.hits[i].part;
    if (part >= routing.part_count()) continue;
    if (r.visits.empty() || r.visits.back().first != part) r.visits.emplace_back(part, 0);
    ++r.visits.back().second;
  }
  const auto stays = [](PartId p) { return !p; };
  const auto first = std::find_if_not(batch.next.begin(), batch.next.end(), stays);
  std::size_t kept = static_cast<std::size_t>(first - batch.next.begin());
  if (kept < batch.size()) {
    Buckets<SegmentBucket> buckets(routing);
    PageBuckets pages(routing, r);
    for (std::size_t i = kept; i < batch.size(); ++i) {
      if (stays(batch.next[i])) {
        batch.segments[kept] = batch.segments[i];
        batch.hits[kept] = batch.hits[i];
        batch.next[kept++] = PartId();
        continue;
      }
      if (pages.add(batch.next[i], batch.segments[i], batch.hits[i], batch.surfaces)) continue;
      if (batch.next[i].value == batch.hits[i].part) {
        r.next.push_back(restarted(batch.segments[i]));
        continue;
      }
      const Routing::Slot s = routing.target(batch.next[i]);
      SegmentBucket& b = buckets.at(s);
      b.add(batch.segments[i], batch.hits[i], batch.surfaces);
      if (b.segments.size() == kChunk) leave(remote_host(routing, s), b, r.leaving);
    }
    buckets.for_each([&](HostId to, SegmentBucket& b) { leave(to, b, r.leaving); });
    pages.finish();
    batch.segments.resize(kept);
    batch.hits.resize(kept);
    batch.next.resize(kept);
  }
  r.to_shade = std::move(batch);
}

// Answers the blocks that lie from `at` on in the traced batch, and leaves only the accepted
// segments in it.
void answer_arrived(std::span<TraceWork::Arrived> arrived, std::size_t at, std::uint32_t epoch,
                    SegmentBatch& batch, WorkResult& r) {
  std::size_t kept = at;
  for (TraceWork::Arrived& a : arrived) {
    const std::size_t n = a.block.size();
    wire::TracerReply reply;
    reply.count = static_cast<std::uint32_t>(n);
    reply.accepted.resize((n + 63) / 64);
    bool windows = false;
    for (std::size_t i = 0; i < n; ++i, ++at) {
      if (batch.hits[at].part != 0xffffffffu) {
        reply.accepted[i / 64] |= std::uint64_t{1} << (i % 64);
        batch.segments[kept] = batch.segments[at];
        batch.hits[kept] = batch.hits[at];
        batch.next[kept++] = batch.next[at];
      } else {
        reply.tested.push_back(batch.segments[at].tested);
        reply.windows.push_back(batch.segments[at].window);
        windows |= batch.segments[at].window != 0;
      }
    }
    if (!windows) reply.windows.clear();
    r.replies.emplace_back(a.from, wire::Reply{a.id, epoch, std::move(reply)});
  }
  batch.segments.resize(kept);
  batch.hits.resize(kept);
  batch.next.resize(kept);
}

WorkResult run(const PathEngine& engine, Work& work, TraceWork& w) {
  WorkResult r;
  SegmentBatch batch;
  for (auto& segments : w.local) append(batch.segments, std::move(segments));
  batch.hits.resize(batch.segments.size());
  for (const TraceWork::Returned& returned : w.returned) take_back(engine, returned, batch);
  const std::size_t own = batch.size();
  for (const TraceWork::Arrived& a : w.arrived) {
    for (const auto& chunk : a.block.chunks) {
      batch.segments.insert(batch.segments.end(), chunk->begin(), chunk->end());
      for (const PathSegment& s : *chunk) {
        Hit hit;
        hit.t = s.best.t;
        hit.shape = s.best.shape;
        hit.primitive = s.best.primitive;
        batch.hits.push_back(hit);
      }
    }
  }
  batch.next.resize(batch.size());
  if (batch.size() != 0) engine.trace(batch);
  if (!w.arrived.empty()) answer_arrived(w.arrived, own, work.routing->epoch(), batch, r);
  split_traced(batch, *work.routing, r);
  return r;
}

// A path whose shadow ray has been answered goes on or ends.
void resume(const ParkedPath& p, WorkResult& r, EndsByOwner& ends) {
  if (!p.ended) {
    r.next.push_back(p.segment);
    return;
  }
  ends.add(p.end());
}

constexpr std::span<const float> kNoTimes;

// Asks gathered for one destination.
struct AskBucket {
  std::vector<OcclusionRay> rays;
  std::vector<float> times;
  ParkedAsks asks;
};

class AskSorter {
 public:
  AskSorter(const PathEngine& engine, const Routing& routing, WorkResult& r)
      : motion_(engine.has_motion()), routing_(routing), result_(r), buckets_(routing) {}
  void add(const OcclusionRay& ray, float time, const ParkedPath& path, const Fixed3& contribution,
           std::span<PartId> parts) {
    // What other hosts hold is asked of them first: to load a part is the dearest way.
    if (routing_.paging())
      std::ranges::stable_partition(parts, [&](PartId p) { return !routing_.paged(p); });
    const bool paged = routing_.paged(parts[0]);
    if (paged) pages_.resize(routing_.part_count());
    const Routing::Slot s = paged ? Routing::kNoSlot : cover_first(parts, routing_);
    AskBucket& b = paged ? pages_[parts[0].value] : buckets_.at(s);
    b.rays.push_back(ray);
    if (motion_) b.times.push_back(time);
    b.asks.paths.push_back(path);
    b.asks.contributions.push_back(contribution);
    b.asks.parts.insert(b.asks.parts.end(), parts.begin(), parts.end());
    b.asks.part_end.push_back(static_cast<std::uint32_t>(b.asks.parts.size()));
    if (b.rays.size() < kChunk) return;
    if (paged)
      close(parts[0], b, result_.paged_asks);
    else
      close(remote_host(routing_, s), b, result_.asks);
  }
  void finish() {
    buckets_.for_each([&](HostId to, AskBucket& b) { close(to, b, result_.asks); });
    for (std::uint32_t p = 0; p < pages_.size(); ++p) {
      pages_[p].asks.paths.shrink_to_fit();
      close(PartId(p), pages_[p], result_.paged_asks);
    }
  }

 private:
  template <class To, class Leaving>
  void close(To to, AskBucket& b, std::vector<Leaving>& out) {
    if (b.rays.empty()) return;
    b.asks.rays = std::make_shared<const std::vector<OcclusionRay>>(std::move(b.rays));
    if (motion_) b.asks.times = std::make_shared<const std::vector<float>>(std::move(b.times));
    out.push_back({to, std::move(b.asks)});
    b = {};
  }
  bool motion_;
  const Routing& routing_;
  WorkResult& result_;
  Buckets<AskBucket> buckets_;
  std::vector<AskBucket> pages_;  // by part
};

WorkResult run(const PathEngine& engine, Work& work, ShadeWork& w) {
  WorkResult r;
  SegmentBatch batch;
  for (SegmentBatch& b : w.batches) {
    for (Hit& h : b.hits)
      if (h.geometry == kAnsweredHit) h.index += static_cast<std::uint32_t>(batch.surfaces.size());
    append(batch.surfaces, std::move(b.surfaces));
    append(batch.segments, std::move(b.segments));
    append(batch.hits, std::move(b.hits));
    append(batch.next, std::move(b.next));
  }
  ShadeOutput out;
  engine.shade(batch, out);
  r.next = std::move(out.continuing);
  r.counts = out.counts;
  PageBuckets pages(*work.routing, r);
  for (std::size_t i = 0; i < out.absent.size(); ++i)
    if (!pages.add(out.absent.next[i], out.absent.segments[i], out.absent.hits[i], {}))
      r.next.push_back(restarted(out.absent.segments[i]));
  pages.finish();
  EndsByOwner ends(r);
  ends.add(std::move(out.ended));
  for (const PathFeatures& f : out.features) ends.add(f);
  if (out.parked.empty()) return r;
  AskSorter sorter(engine, *work.routing, r);
  std::vector<std::uint8_t> asked(out.parked.size());
  std::vector<PartId> parts;
  for (const ShadowAsk& a : out.asks) {
    parts.clear();
    for (std::uint32_t i = 0; i < a.part_count; ++i)
      parts.emplace_back(out.ask_parts[a.pending + i]);
    asked[a.parked] = 1;
    sorter.add(a.ray, a.time, out.parked[a.parked], a.contribution, parts);
  }
  for (std::size_t i = 0; i < out.parked.size(); ++i)
    if (!asked[i]) resume(out.parked[i], r, ends);
  sorter.finish();
  return r;
}

WorkResult run(const PathEngine& engine, Work& work, OccludeWork& w) {
  WorkResult r;
  std::vector<std::uint8_t> blocked;
  for (OccludeWork::Asked& a : w.asked) {
    if (a.block.nearest) {
      r.replies.emplace_back(a.from, wire::Reply{a.id, work.routing->epoch(), answer_nearest(engine, a.block)});
      continue;
    }
    const std::size_t n = a.block.size();
    wire::OcclusionReply reply;
    reply.count = static_cast<std::uint32_t>(n);
    reply.blocked.resize((n + 63) / 64);
    std::size_t i = 0;
    for (std::size_t k = 0; k < a.block.chunks.size(); ++k) {
      const auto& chunk = a.block.chunks[k];
      blocked.assign(chunk->size(), 0);
      engine.occluded(*chunk, a.block.times.empty() ? kNoTimes : std::span<const float>(*a.block.times[k]), blocked);
      for (const std::uint8_t b : blocked) {
        if (b) reply.blocked[i / 64] |= std::uint64_t{1} << (i % 64);
        ++i;
      }
    }
    r.replies.emplace_back(a.from, wire::Reply{a.id, work.routing->epoch(), std::move(reply)});
  }
  return r;
}

WorkResult run(const PathEngine& engine, Work& work, ResolveWork& w) {
  WorkResult r;
  EndsByOwner ends(r);
  AskSorter sorter(engine, *work.routing, r);
  std::vector<std::uint8_t> local;
  std::vector<bool> resident;
  std::vector<PartId> parts;
  for (ResolveWork::Answered& answered : w.answered) {
    // Without an answer this host tests again what it has got meanwhile.
    const bool here = !answered.by;
    const Routing& at = here ? *work.routing : *answered.at;
    const Routing::Slot by = here ? Routing::kNoSlot : at.slot(answered.by);
    std::size_t i = 0;
    for (ParkedAsks& asks : answered.asks) {
      if (here) {
        local.assign(asks.size(), 0);
        resident = engine.occluded(*asks.rays, asks.times ? std::span<const float>(*asks.times) : kNoTimes, local);
      }
      const auto answered_for = [&](PartId p) {
        if (here) return p.value < resident.size() && resident[p.value];
        return by != Routing::kNoSlot && at.holds(by, p);
      };
      for (std::size_t k = 0; k < asks.size(); ++k, ++i) {
        ParkedPath& path = asks.paths[k];
        const bool blocked = here ? local[k] != 0 : bit(answered.reply.blocked, i);
        if (!blocked) {
          parts.clear();
          for (std::uint32_t p = k == 0 ? 0 : asks.part_end[k - 1]; p < asks.part_end[k]; ++p)
            if (!answered_for(asks.parts[p])) parts.push_back(asks.parts[p]);
          if (!parts.empty()) {
            sorter.add((*asks.rays)[k], asks.times ? (*asks.times)[k] : 0.f, path, asks.contributions[k], parts);
            continue;
          }
          Fixed3& waiting = path.waiting();
          for (std::size_t c = 0; c < 3; ++c) waiting[c] += asks.contributions[k][c];
        }
        resume(path, r, ends);
      }
    }
  }
  sorter.finish();
  return r;
}

WorkResult run(const PathEngine& engine, Work&, CameraWork& w) {
  WorkResult r;
  r.next.reserve(w.count);
  engine.camera(w.range, w.owner, w.first, w.count, r.next);
  return r;
}

WorkResult run(const PathEngine& engine, Work& work, CollectWork& w) {
  WorkResult r;
  r.ledgers = std::move(w.ledgers);
  const bool lobes = engine.has_negative_lobes(), limits = engine.limits_samples();
  for (const RendererRange& range : w.opened)
    r.ledgers.try_emplace(range.task, range, work.film_width, work.features, lobes);
  auto ledger = r.ledgers.end();
  const auto find = [&](std::uint32_t task) {
    if (ledger == r.ledgers.end() || ledger->first != task) ledger = r.ledgers.find(task);
    return ledger != r.ledgers.end();
  };
  for (EndBatch& block : w.ends) {
    for (PathEnd& e : block.ends) {
      const bool splats = e.target != PartId::kNone;
      if (!find(e.task) || (splats && !engine.may_splat(e.target))) {
        ++r.unknown;
        continue;
      }
      if (limits) engine.limit(e);
      switch (ledger->second.record(e, lobes && engine.in_negative_lobe(e.pixel, e.sample, ledger->second.range().shares))) {
        case RendererLedger::Outcome::counted:
          break;
        case RendererLedger::Outcome::duplicate:
          ++r.duplicates;
          break;
        case RendererLedger::Outcome::foreign:
          ++r.unknown;
          break;
      }
    }
    for (const PathFeatures& f : block.features)
      if (find(f.task)) ledger->second.record(f);
  }
  for (auto it = r.ledgers.begin(); it != r.ledgers.end();) {
    r.remaining.emplace_back(it->first, it->second.remaining());
    if (it->second.remaining() == 0) {
      r.completed.push_back(std::move(it->second).reply());
      it = r.ledgers.erase(it);
      continue;
    }
    if (w.list_missing) r.missing.emplace_back(it->first, it->second.missing());
    ++it;
  }
  return r;
}

// Loader work is not for the path engine.
template <class W>
WorkResult run(const PathEngine&, Work&, W&) {
  return {};
}

}  // namespace

WorkResult execute(const PathEngine& engine, Work& work) {
  return std::visit([&](auto& w) { return run(engine, work, w); }, work.what);
}

}  // namespace cloudrenderer
