#pragma once
// What a compute thread can be asked to do with batches of paths. The real one (PathTracer) works on the resident
// scene; the simulation of the cluster may use it on a small scene or a made-up one with the same rules.
#include <cstdint>
#include <span>
#include <vector>

#include "base/id.h"
#include "integrator/answered_hit.h"
#include "integrator/path_segment.h"
#include "trace/hit.h"

namespace cloudrenderer {

// Segments of a batch with what has been found for each; arrays of equal length.
struct SegmentBatch {
  std::vector<PathSegment> segments;
  std::vector<Hit> hits;
  // After trace() or route(): the nearest untested candidate part that starts before the hit and is not resident
  // here (the segment must move to a holder of it), or none: the segment can be shaded here. If only the part of its
  // own hit is not resident (any more), it is that part.
  std::vector<PartId> next;
  // Of hits with geometry kAnsweredHit, whose `index` counts here; some may be of no use any more.
  std::vector<AnsweredSurface> surfaces;

  std::size_t size() const { return segments.size(); }
};

// A shadow ray that no resident part blocks, and that must still be asked of other hosts.
struct ShadowAsk {
  OcclusionRay ray;
  float time = 0;             // of the path; only where the engine has_motion()
  std::uint32_t parked = 0;   // index into ShadeOutput::parked
  std::uint32_t pending = 0;  // index into the list of parts: first of `part_count` untested candidate parts
  std::uint32_t part_count = 0;
  Fixed3 contribution{};      // added to the path when the answer is "free"
};

// A path that waits for the answers to its asks before it goes on or ends.
struct ParkedPath {
  PathSegment segment;  // its radiance lacks the contributions still asked for
  bool ended = false;   // ends when answered; else becomes a new segment to trace
  std::uint16_t end_flags = 0;  // then: PathEndFlag
  // As in PathEnd; with a target contributions that are asked for are the splat's.
  std::uint32_t target = 0xffffffffu;
  Fixed3 splat{};
  Fixed3& waiting() { return target != 0xffffffffu ? splat : segment.radiance; }
  PathEnd end() const {
    return {segment.task, segment.pixel, segment.sample, segment.owner, end_flags, segment.radiance, target, splat};
  }
};

struct RayCounts {
  std::uint64_t camera = 0, bounce = 0, shadow = 0, clamped = 0, invalid = 0;
  RayCounts& operator+=(const RayCounts& o) {
    camera += o.camera;
    bounce += o.bounce;
    shadow += o.shadow;
    clamped += o.clamped;
    invalid += o.invalid;
    return *this;
  }
};

struct ShadeOutput {
  std::vector<PathSegment> continuing;  // new segments, to be traced (here first)
  std::vector<PathEnd> ended;
  std::vector<PathFeatures> features;   // in jobs that ask for them
  std::vector<ParkedPath> parked;
  std::vector<ShadowAsk> asks;          // at most one a parked path
  std::vector<std::uint32_t> ask_parts; // see ShadowAsk::pending
  SegmentBatch absent;                  // not shaded: their hit is in a part that is not resident any more (`next`)
  RayCounts counts;
};

// All functions are const and may run on many threads at once. They are pure functions of their arguments, of the
// scene, and of what is resident while they run.
class PathEngine {
 public:
  virtual ~PathEngine() = default;
  // Appends the camera segments number [first, first + count) of the range (pixel by pixel, samples innermost).
  virtual void camera(const RendererRange& range, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
                      std::vector<PathSegment>& out) const = 0;
  // Tests every resident candidate not yet tested. On entry hits[i] is what is known (a default Hit with t, shape,
  // primitive of segments[i].best for a segment that just arrived, or an earlier local hit). Afterwards hits[i].part
  // is set if this host has the nearest hit so far, segments[i].tested and best are updated, and next[i] is set.
  virtual void trace(SegmentBatch& batch) const = 0;
  // Sets next[i] again after segments[i].tested has changed (another host has answered "miss").
  virtual void route(SegmentBatch& batch) const = 0;
  // Shades every segment of the batch at its hit (all have next == none and a local hit, or no hit at all: escaped).
  // Local occlusion is tested inside. The batch's contents are consumed.
  virtual void shade(SegmentBatch& batch, ShadeOutput& out) const = 0;
  // blocked[i] = 1 if anything resident here blocks rays[i]. Returns the parts that were resident, a bit each. times: of
  // the rays; may be empty where nothing moves.
  virtual std::vector<bool> occluded(std::span<const OcclusionRay> rays, std::span<const float> times,
                                     std::span<std::uint8_t> blocked) const = 0;
  // The nearest hit of every ray in the resident parts, the main scene left out, for a host that holds none of them.
  // Only triangles are answered for: hosts that only intersect get no other parts. Rays without a hit nearer than
  // their t_max keep a default AnsweredHit.
  virtual void nearest(std::span<const OcclusionRay> rays, std::span<AnsweredHit> hits) const = 0;
  // Another host has answered for the parts that `answered` has a bit for: marks them in the segment's window.
  virtual void mark_tested(PathSegment& segment, float t_max, const std::vector<bool>& answered) const = 0;
  // True if something in the scene moves, so that rays have times.
  virtual bool has_motion() const { return false; }
  // Whether the pixel filter is negative where the sample is (full-resolution number of the pixel, row by row): its
  // radiance is summed apart then, see FilterLobes. `shares`: as its task's range says.
  virtual bool in_negative_lobe(std::uint32_t, std::uint32_t, bool) const { return false; }
  virtual bool has_negative_lobes() const { return false; }
  // Whether the film limits the light of a sample, all of it, and what it leaves of a path's: done once, where paths end up.
  virtual bool limits_samples() const { return false; }
  virtual void limit(PathEnd&) const {}
  // Whether a path from a light may bring something to this pixel of the full film.
  virtual bool may_splat(std::uint32_t) const { return false; }
  // Film position of a segment's contribution, so that drivers can sum path ends: width of the full film.
  virtual std::uint32_t film_width() const = 0;
};

}  // namespace cloudrenderer
