#pragma once
// Inside src/tasks: what other hosts answer about segments, and what they are answered.
#include <span>
#include <vector>

#include "tasks/work.h"

namespace cloudrenderer {

inline bool bit(std::span<const std::uint64_t> bits, std::size_t i) {
  return (bits[i / 64] >> (i % 64) & 1u) != 0;
}

// An answered hit goes to another list of surfaces.
void keep_surface(Hit& hit, const std::vector<AnsweredSurface>& from, std::vector<AnsweredSurface>& to);
// Appends to the batch what another host gave back: segments that it has not accepted, with its newer masks, or those
// that it was asked about, with the hits that it has found.
void take_back(const PathEngine& engine, const TraceWork::Returned& returned, SegmentBatch& batch);
wire::NearestReply answer_nearest(const PathEngine& engine, const wire::OcclusionBlock& block);

}  // namespace cloudrenderer
