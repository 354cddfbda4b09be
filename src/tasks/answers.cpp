#include "tasks/answers.h"

namespace cloudrenderer {
namespace {

void take_back_asked(const PathEngine& engine, const TraceWork::Returned& returned, SegmentBatch& batch) {
  const Routing& at = *returned.at;
  std::vector<bool> held(at.part_count());
  const Routing::Slot by = at.slot(returned.by);
  for (std::uint32_t p = 1; p < held.size() && by != Routing::kNoSlot; ++p) held[p] = at.holds(by, PartId(p));
  std::size_t i = 0, next = 0;
  for (const KeptSegments& kept : returned.kept) {
    for (std::size_t k = 0; k < kept.segments->size(); ++k, ++i) {
      PathSegment& s = batch.segments.emplace_back((*kept.segments)[k]);
      Hit& hit = batch.hits.emplace_back(kept.hits[k]);
      engine.mark_tested(s, hit.t, held);
      const AnsweredHit* found = bit(returned.nearest.found, i) ? &returned.nearest.hits[next++] : nullptr;
      if (found && comes_before(found->t, found->shape, found->primitive, hit)) {
        hit = {found->t, found->u, found->v, kAnsweredPart, 0xffffffffu, kAnsweredHit,
               static_cast<std::uint32_t>(batch.surfaces.size()), found->shape, found->primitive};
        batch.surfaces.push_back(found->surface);
      } else if (hit.geometry == kAnsweredHit) {
        keep_surface(hit, kept.surfaces, batch.surfaces);
      }
    }
  }
}

}  // namespace

void keep_surface(Hit& hit, const std::vector<AnsweredSurface>& from, std::vector<AnsweredSurface>& to) {
  to.push_back(from[hit.index]);
  hit.index = static_cast<std::uint32_t>(to.size() - 1);
}

void take_back(const PathEngine& engine, const TraceWork::Returned& returned, SegmentBatch& batch) {
  if (returned.nearest.count != 0) return take_back_asked(engine, returned, batch);
  const wire::TracerReply& reply = returned.reply;
  std::size_t i = 0, miss = 0;
  for (const KeptSegments& kept : returned.kept) {
    for (std::size_t k = 0; k < kept.segments->size(); ++k, ++i) {
      if (reply.count != 0 && bit(reply.accepted, i)) continue;
      PathSegment s = (*kept.segments)[k];
      if (reply.count != 0) {
        const std::uint16_t window = reply.windows.empty() ? std::uint16_t{0} : reply.windows[miss];
        if (window > s.window) {
          s.window = window;
          s.tested = reply.tested[miss];
        } else if (window == s.window) {
          s.tested |= reply.tested[miss];
        }
        ++miss;
      }
      batch.segments.push_back(s);
      batch.hits.push_back(kept.hits[k]);
      if (kept.hits[k].geometry == kAnsweredHit) keep_surface(batch.hits.back(), kept.surfaces, batch.surfaces);
    }
  }
}

wire::NearestReply answer_nearest(const PathEngine& engine, const wire::OcclusionBlock& block) {
  wire::NearestReply reply;
  reply.count = static_cast<std::uint32_t>(block.size());
  reply.found.resize((block.size() + 63) / 64);
  std::vector<AnsweredHit> hits;
  std::size_t i = 0;
  for (const wire::RayChunk& chunk : block.chunks) {
    hits.assign(chunk->size(), {});
    engine.nearest(*chunk, hits);
    for (const AnsweredHit& h : hits) {
      if (h.t < kInfinity) {
        reply.found[i / 64] |= std::uint64_t{1} << (i % 64);
        reply.hits.push_back(h);
      }
      ++i;
    }
  }
  return reply;
}

}  // namespace cloudrenderer
