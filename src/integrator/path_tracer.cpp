#include "integrator/path_tracer.h"

#include <array>
#include <bit>
#include <chrono>

#include "integrator/timer.h"

namespace cloudrenderer {

namespace {

constexpr std::size_t kWindow = 64;  // candidates that a segment's mask can name

// The candidates of a segment's window, front to back.
class CandidateList {
 public:
  // The list is a prefix of the same order for every t_max, so that bit i means the same part on every host.
  void find(const PartMap& map, const PathSegment& s, float t_max) {
    const std::size_t skip = kWindow * s.window;
    if (skip == 0) {
      count_ = std::min(map.candidates(s.origin, s.direction, t_max, small_), kWindow);
      first_ = small_.data();
      more_ = false;
      // A full window may have more behind it.
      if (count_ == kWindow) more_ = true;
      return;
    }
    large_.resize(skip + kWindow);
    const std::size_t n = std::min(map.candidates(s.origin, s.direction, t_max, large_), large_.size());
    first_ = large_.data() + skip;
    count_ = n > skip ? n - skip : 0;
    more_ = count_ == kWindow;
  }
  std::size_t size() const { return count_; }
  const Candidate& operator[](std::size_t i) const { return first_[i]; }
  bool more() const { return more_; }
  operator std::span<const Candidate>() const { return {first_, count_}; }  // NOLINT

 private:
  std::array<Candidate, kWindow> small_;
  std::vector<Candidate> large_;
  const Candidate* first_ = nullptr;
  std::size_t count_ = 0;
  bool more_ = false;
};

// The nearest candidate of the window that is neither tested nor behind the hit.
PartId untested(std::span<const Candidate> list, const PathSegment& s, const Hit& hit) {
  for (std::size_t i = 0; i < list.size() && list[i].t_enter <= hit.t; ++i)
    if (!(s.tested >> i & 1u)) return PartId{list[i].part};
  return {};
}

TraceRay ray_of(const PathSegment& s) { return {s.origin, kInfinity, s.direction}; }

}  // namespace

PathTracer::PathTracer(const Manifest& manifest, const JobSettings& job, Part main_part, Resident& resident,
                       Warnings& warnings, std::uint64_t texture_budget)
    : job_(job),
      dialect_(manifest.scene.dialect),
      map_(manifest.parts),
      one_part_(manifest.parts.size() == 2),
      main_geometry_(!main_part.triangles.empty() || !main_part.quadrics.empty() || !main_part.instances.empty()),
      resident_(resident),
      shading_(Shading::build(manifest.scene, {.texture_budget = texture_budget}, warnings)) {
  footprint_ = shading_->needs_footprint();
  footprint_scale_ = 1.f / std::sqrt(static_cast<float>(job.footprint_spp ? job.footprint_spp : job.spp));
  resident.set_alpha([shading = shading_.get()](std::uint32_t texture, const Vec2& uv, const Vec3& p) {
    return shading->alpha(texture, uv, p);
  });
  lights_ = Lights::build(manifest.scene, manifest.shape_lights, main_part, manifest.bounds, warnings);
  even_lobes_ = lights_->has_v2_disk();
  hittable_lights_ = lights_->has_infinite() || !manifest.shape_lights.empty();
  camera_ = Camera::build(manifest.scene.camera, job.film.frame, dialect_, warnings);
  filter_ = Filter::build(manifest.scene.filter, warnings, dialect_);
  resident.load_part(PartId{0}, std::move(main_part));
}

void PathTracer::camera(const RendererRange& range, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
                        std::vector<PathSegment>& out) const {
  const BatchTimer timer(time_.camera);
  const std::uint32_t samples = range.sample_end - range.sample_begin, tile_width = range.x1 - range.x0;
  const std::size_t at = out.size();
  out.resize(at + count);
  const bool lens = camera_->uses_lens();
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint64_t pixel = (first + i) / samples;
    const auto x = range.x0 + static_cast<std::uint32_t>(pixel % tile_width);
    const auto y = range.y0 + static_cast<std::uint32_t>(pixel / tile_width);
    PathSegment& s = out[at + i];
    s.task = range.task;
    s.owner = owner;
    s.pixel = y * job_.film.frame.width + x;
    s.sample = range.sample_begin + static_cast<std::uint32_t>((first + i) % samples);
    const SampleSequence sequence(job_.sequence, job_.seed, s.pixel, s.sample);
    float filter_weight;
    const Vec2 offset = filter_->sample(sequence.get_2d(0), filter_weight);
    const CameraRay ray = camera_->ray({static_cast<float>(x) + 0.5f + offset.x, static_cast<float>(y) + 0.5f + offset.y},
                                       lens ? sequence.get_2d(1) : Vec2{0.5f, 0.5f});
    s.origin = ray.origin;
    s.direction = ray.direction;
    s.throughput = Rgb(ray.weight * filter_weight);
    s.previous_normal = Vec3(0.f);
    s.flags = kSpecularBounce | kCameraRay;
    if (footprint_) {
      s.cone_width = ray.cone_width * footprint_scale_;
      s.cone_spread = ray.cone_spread * footprint_scale_;
    }
  }
}

// Tests what is resident; returns the first part that is not and may hold something nearer.
PartId PathTracer::trace_one(const ResidentSet& set, PathSegment& s, Hit& hit) const {
  if (!traceable(s.origin, s.direction)) return {};
  const TraceRay ray = ray_of(s);
  if (main_geometry_ && !(s.flags & kMainTested)) set.intersect(0, ray, hit);
  s.flags |= kMainTested;
  if (one_part_ && set.has(1)) {
    set.intersect(1, ray, hit);
    return {};
  }
  if (map_.part_count() < 2) return {};
  CandidateList list;
  PartId remote;
  for (;;) {
    list.find(map_, s, hit.t);
    bool all = true;
    for (std::size_t i = 0; i < list.size(); ++i) {
      if (list[i].t_enter > hit.t) break;
      if (s.tested >> i & 1u) continue;
      if (!set.has(list[i].part)) {
        if (all) remote = PartId{list[i].part};
        all = false;
        continue;
      }
      set.intersect(list[i].part, ray, hit);
      s.tested |= std::uint64_t{1} << i;
    }
    if (!all || !list.more() || list[kWindow - 1].t_enter > hit.t) break;
    ++s.window;  // all of this window are tested
    s.tested = 0;
  }
  s.best = {hit.t, hit.shape, hit.primitive};
  const PartId next = untested(list, s, hit);
  // What was hit here may have been unloaded meanwhile.
  return !next && hit.part != kNone && !set.has(hit.part) ? PartId{hit.part} : next;
}

// Eight rays from the camera, nearly alike: packets find the same bits as single rays (tested), faster.
void PathTracer::trace_eight(const ResidentSet& set, PathSegment* s, Hit* hits, PartId* next) const {
  std::array<TraceRay, 8> rays;
  std::array<const TraceRay*, 8> ray_pointers;
  std::array<Hit*, 8> hit_pointers;
  for (std::size_t i = 0; i < 8; ++i) {
    if (!traceable(s[i].origin, s[i].direction)) {
      for (std::size_t j = 0; j < 8; ++j) next[j] = trace_one(set, s[j], hits[j]);
      return;
    }
    rays[i] = ray_of(s[i]);
    ray_pointers[i] = &rays[i];
    hit_pointers[i] = &hits[i];
  }
  if (main_geometry_) set.intersect8(0, ray_pointers.data(), hit_pointers.data(), 0xffu);
  for (std::size_t i = 0; i < 8; ++i) s[i].flags |= kMainTested;
  if (one_part_ && set.has(1)) {
    set.intersect8(1, ray_pointers.data(), hit_pointers.data(), 0xffu);
    return;
  }
  // Each round takes the nearest resident part that any of the rays still has to test, with all rays that do.
  constexpr std::size_t kNear = 16;
  std::array<std::array<Candidate, kNear>, 8> lists;
  std::array<std::size_t, 8> counts{}, cursor{};
  for (std::size_t i = 0; i < 8; ++i) {
    counts[i] = std::min(map_.candidates(s[i].origin, s[i].direction, hits[i].t, lists[i]), kNear);
  }
  for (;;) {
    float nearest = kInfinity;
    std::uint32_t part = kNone;
    for (std::size_t i = 0; i < 8; ++i) {
      while (cursor[i] < counts[i] && lists[i][cursor[i]].t_enter <= hits[i].t &&
             ((s[i].tested >> cursor[i] & 1u) || !set.has(lists[i][cursor[i]].part)))
        ++cursor[i];
      if (cursor[i] == counts[i]) continue;
      const Candidate& c = lists[i][cursor[i]];
      if (c.t_enter > hits[i].t) {
        cursor[i] = counts[i];
      } else if (part == kNone || c.t_enter < nearest) {
        nearest = c.t_enter;
        part = c.part;
      }
    }
    if (part == kNone) break;
    std::uint32_t active = 0;
    for (std::size_t i = 0; i < 8; ++i)
      for (std::size_t j = cursor[i]; j < counts[i] && lists[i][j].t_enter <= hits[i].t; ++j)
        if (lists[i][j].part == part) {
          active |= 1u << i;
          s[i].tested |= std::uint64_t{1} << j;
          break;
        }
    set.intersect8(part, ray_pointers.data(), hit_pointers.data(), active);
  }
  for (std::size_t i = 0; i < 8; ++i) {
    if (counts[i] == kNear) {  // there may be more candidates
      next[i] = trace_one(set, s[i], hits[i]);
      continue;
    }
    s[i].best = {hits[i].t, hits[i].shape, hits[i].primitive};
    next[i] = untested(std::span(lists[i]).first(counts[i]), s[i], hits[i]);
  }
}

void PathTracer::trace(SegmentBatch& batch) const {
  const BatchTimer timer(time_.trace);
  const auto set = resident_.snapshot();
  const std::size_t n = batch.size();
  batch.hits.resize(n);
  batch.next.assign(n, PartId{});
  constexpr std::uint16_t kFresh = kCameraRay, kFreshMask = kCameraRay | kMainTested;
  for (std::size_t i = 0; i < n;) {
    std::size_t run = 0;
    while (run < 8 && i + run < n && (batch.segments[i + run].flags & kFreshMask) == kFresh &&
           batch.hits[i + run].t == kInfinity)
      ++run;
    if (run == 8) {
      trace_eight(*set, &batch.segments[i], &batch.hits[i], &batch.next[i]);
      i += 8;
    } else {
      batch.next[i] = trace_one(*set, batch.segments[i], batch.hits[i]);
      ++i;
    }
  }
}

void PathTracer::route(SegmentBatch& batch) const { trace(batch); }

void PathTracer::find_blocked(const ResidentSet& set, std::span<const OcclusionRay> rays,
                              std::span<std::uint8_t> blocked) const {
  for (std::size_t i = 0; i < rays.size(); ++i) blocked[i] = 0;
  std::array<TraceRay, 8> packet;
  std::array<const TraceRay*, 8> pointers;
  for (std::size_t i = 0; i < 8; ++i) pointers[i] = &packet[i];
  CandidateList list;
  for (std::size_t first = 0; first < rays.size(); first += 8) {
    const std::size_t n = std::min<std::size_t>(8, rays.size() - first);
    std::uint32_t open = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const OcclusionRay& r = rays[first + i];
      packet[i] = {r.origin, r.t_max, r.direction};
      if (traceable(r.origin, r.direction) && r.t_max > 0.f) open |= 1u << i;
    }
    std::uint32_t hit = 0;
    if (open && main_geometry_) hit |= set.occluded8(0, pointers.data(), open);
    open &= ~hit;
    if (one_part_) {
      if (open && set.has(1)) hit |= set.occluded8(1, pointers.data(), open);
    } else {
      for (std::uint32_t left = open; left; left &= left - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(left));
        PathSegment probe;
        probe.origin = packet[i].origin;
        probe.direction = packet[i].direction;
        bool found = false;
        for (;;) {
          list.find(map_, probe, packet[i].t_max);
          for (std::size_t c = 0; c < list.size() && !found; ++c)
            if (list[c].t_enter <= packet[i].t_max && set.has(list[c].part)) found = set.occluded(list[c].part, packet[i]);
          if (found || !list.more()) break;
          ++probe.window;
        }
        if (found) hit |= 1u << i;
      }
    }
    for (std::size_t i = 0; i < n; ++i) blocked[first + i] = hit >> i & 1u;
  }
}

std::vector<bool> PathTracer::occluded(std::span<const OcclusionRay> rays, std::span<std::uint8_t> blocked) const {
  const BatchTimer timer(time_.occlusion);
  const auto set = resident_.snapshot();
  find_blocked(*set, rays, blocked);
  std::vector<bool> tested(map_.part_count());
  for (std::uint32_t p = 0; p < tested.size(); ++p) tested[p] = set->has(p);
  return tested;
}

}  // namespace cloudrenderer
