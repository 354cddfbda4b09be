#include "simulate/list_engine.h"

#include <algorithm>

namespace cloudrenderer::sim {

void ListEngine::trace(SegmentBatch& batch) const {
  batch.hits.resize(batch.size());
  batch.next.assign(batch.size(), PartId());
  for (std::size_t i = 0; i < batch.size(); ++i) trace_one(batch.segments[i], batch.hits[i], batch.next[i]);
}

void ListEngine::trace_one(PathSegment& s, Hit& hit, PartId& next) const {
  candidates(s.origin, list_);
  if (!(s.flags & kMainDone)) hit_main(s.origin, hit);
  s.flags |= kMainDone;
  const auto nearer = [&](std::size_t i) { return i < list_.size() && list_[i].t_enter <= hit.t; };
  for (;;) {
    const std::size_t first = std::size_t{64} * s.window;
    bool all = true;
    for (std::size_t i = first; i < first + 64 && nearer(i); ++i) {
      if (s.tested >> (i - first) & 1u) continue;
      if (!resident.contains(list_[i].part)) {
        all = false;
        continue;
      }
      hit_part(s.origin, list_[i], hit);
      ++tested_;
      s.tested |= std::uint64_t{1} << (i - first);
    }
    if (!all || !nearer(first + 64)) break;
    ++s.window;
    s.tested = 0;
  }
  s.best = {hit.t, hit.shape, hit.primitive};
  const std::size_t first = std::size_t{64} * s.window;
  for (std::size_t i = first; i < first + 64 && nearer(i); ++i) {
    if (s.tested >> (i - first) & 1u) continue;
    next = PartId(list_[i].part);
    return;
  }
  if (hit.part < kAnsweredPart && !resident.contains(hit.part)) next = PartId(hit.part);
}

void ListEngine::shade(SegmentBatch& batch, ShadeOutput& out) const {
  for (std::size_t i = 0; i < batch.size(); ++i) {
    const std::uint32_t part = batch.hits[i].part;
    if (part >= kAnsweredPart || resident.contains(part)) {
      shade_one(batch.segments[i], batch.hits[i], out);
      continue;
    }
    out.absent.segments.push_back(batch.segments[i]);
    out.absent.hits.push_back(batch.hits[i]);
    out.absent.next.emplace_back(part);
  }
}

std::vector<bool> ListEngine::occluded(std::span<const OcclusionRay> rays, std::span<const float>,
                                       std::span<std::uint8_t> blocked) const {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    blocked[i] = 0;
    shadow_candidates(rays[i], list_);
    for (const ListCandidate& c : list_) {
      if (!resident.contains(c.part)) continue;
      ++tested_;
      if (blocks(rays[i], c.part)) blocked[i] = 1;
    }
  }
  std::vector<bool> tested(part_count());
  for (const std::uint32_t p : resident) tested[p] = true;
  return tested;
}

void ListEngine::nearest(std::span<const OcclusionRay> rays, std::span<AnsweredHit> hits) const {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    candidates(rays[i].origin, list_);
    Hit hit;
    hit.t = rays[i].t_max;
    for (const ListCandidate& c : list_)
      if (resident.contains(c.part)) hit_part(rays[i].origin, c, hit);
    hits[i] = {};
    if (hit.part != kNoPart) hits[i] = {hit.t, 0, 0, hit.shape, hit.primitive, {}};
  }
}

void ListEngine::mark_tested(PathSegment& s, float, const std::vector<bool>& answered) const {
  candidates(s.origin, list_);
  const std::size_t first = std::size_t{64} * s.window;
  for (std::size_t i = first; i < std::min(list_.size(), first + 64); ++i)
    if (answered[list_[i].part]) s.tested |= std::uint64_t{1} << (i - first);
}

bool ListEngine::cast_shadow(const OcclusionRay& ray, const Fixed3& contribution, PathSegment& n, bool ends,
                             std::uint16_t flags, ShadeOutput& out) const {
  ++out.counts.shadow;
  shadow_candidates(ray, list_);
  const auto first = static_cast<std::uint32_t>(out.ask_parts.size());
  for (const ListCandidate& c : list_) {
    if (!resident.contains(c.part)) {
      out.ask_parts.push_back(c.part);
    } else if (++tested_; blocks(ray, c.part)) {
      out.ask_parts.resize(first);
      return false;
    }
  }
  const auto open = static_cast<std::uint32_t>(out.ask_parts.size()) - first;
  if (open == 0) {
    for (std::size_t c = 0; c < 3; ++c) n.radiance[c] += contribution[c];
    return false;
  }
  ShadowAsk ask;
  ask.ray = ray;
  ask.parked = static_cast<std::uint32_t>(out.parked.size());
  ask.pending = first;
  ask.part_count = open;
  ask.contribution = contribution;
  out.asks.push_back(ask);
  out.parked.push_back({n, ends, flags});
  return true;
}

}  // namespace cloudrenderer::sim
