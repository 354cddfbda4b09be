#include "integrator/path_tracer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>

#include "integrator/crossings.h"
#include "integrator/path_time.h"
#include "integrator/shader.h"
#include "integrator/shadow_channel.h"
#include "integrator/timer.h"
#include "scene/dialect.h"

namespace cloudrenderer {

namespace {

// Share of the rays of lights that are aimed at what may be specular, where others count as well.
constexpr float kAimed = 0.25f;

// The candidates of a segment's window, front to back.
class CandidateList {
 public:
  // The list is a prefix of the same order for every t_max, so that bit i means the same part on every host.
  void find(const PartMap& map, const PathSegment& s, float t_max) {
    const std::size_t skip = kWindow * s.window;
    if (skip == 0) {
      count_ = map.candidates(s.origin, s.direction, t_max, small_);
      first_ = small_.data();
      more_ = false;
      // A full window may have more behind it.
      if (count_ == kWindow) more_ = true;
      return;
    }
    large_.resize(skip + kWindow);
    const std::size_t n = map.candidates(s.origin, s.direction, t_max, large_);
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

// Shadow rays have no path: their numbers come from themselves, and so any host that is asked draws the same ones.
BrickRay shadow_brick_ray(const OcclusionRay& r) {
  BrickRay ray;
  for (int i = 0; i < 3; ++i)
    ray.key = mix64(ray.key + ((std::uint64_t{std::bit_cast<std::uint32_t>(r.origin[i])} << 32) | std::bit_cast<std::uint32_t>(r.direction[i])));
  ray.channel = channel_in(r);
  return ray;
}

}  // namespace

PathTracer::PathTracer(const Manifest& manifest, const JobSettings& job, Part main_part, Resident& resident,
                       Warnings& warnings, std::uint64_t texture_budget)
    : job_(job),
      dialect_(is_of_v4(manifest.scene) ? Dialect::v4 : manifest.scene.dialect),
      map_(manifest.parts),
      one_part_(manifest.parts.size() == 2),
      main_geometry_(!main_part.triangles.empty() || !main_part.quadrics.empty() || !main_part.instances.empty() ||
                     !main_part.curves.segments.empty()),
      resident_(resident),
      shading_(Shading::build(manifest.scene, {.texture_budget = texture_budget}, warnings)) {
  motion_ = manifest.moves;
  shape_lights_ = static_cast<std::uint32_t>(manifest.shape_lights.size());
  subsurface_ = job.subsurface && shading_->needs().subsurface;
  shutter_ = shutter_of(manifest.scene.camera);
  footprint_ = shading_->needs().footprint;
  footprint_scale_ = 1.f / std::sqrt(static_cast<float>(job.footprint_spp ? job.footprint_spp : job.spp));
  if (dialect_ == Dialect::v4) footprint_scale_ = std::max(footprint_scale_, 0.125f);
  resident.set_alpha([shading = shading_.get()](std::uint32_t texture, const Vec2& uv, const Vec3& p) -> Alpha {
    return {shading->alpha(texture, uv, p), shading->alpha_by_chance(texture)};
  });
  lights_ = Lights::build(manifest.scene, manifest.shape_lights, main_part, manifest.bounds, warnings);
  uv_ = shading_->needs().uv || lights_->has_pictures();
  even_lobes_ = lights_->weighs_alone();
  first_pair_ = lights_->has_choice() ? 0 : 1;
  fixed_units_ = fixed_units(job.k);
  infinite_lights_ = lights_->has_infinite();
  hittable_lights_ = infinite_lights_ || !manifest.shape_lights.empty();
  camera_ = Camera::build(manifest.scene.camera, job.film.frame, manifest.scene.dialect, warnings,
                          film_diagonal(manifest.scene.film));
  filter_ = Filter::build(manifest.scene.filter, warnings, manifest.scene.dialect);
  film_pixels_ = static_cast<float>(job.film.frame.pixels());
  if (lights_->disagrees())
    no_light_paths_ = "some lamp shines on another side than it is sampled on, as in pbrt";
  else if (!camera_->views_points())
    no_light_paths_ = "the camera's space has other angles than the world";
  else if (!lights_->empty())
    light_paths_ = job.light_paths;
  if (light_paths_ == LightPaths::all) lights_->want_emission();
  if (light_paths_ != LightPaths::none) lights_->aim(manifest.specular_boxes, light_paths_ == LightPaths::caustics ? 1.f : kAimed);
  if (job.media != MediaTransport::none) build_media(manifest, main_part, warnings);
  if (job.media == MediaTransport::multiple) longest_shadow_ = glm::length(manifest.bounds.max - manifest.bounds.min);
  if (may_share_rays(job)) shared_ = SharedRays(job.samples_per_ray, job.spp);
  resident.load_part(PartId{0}, std::move(main_part));
}

void PathTracer::build_media(const Manifest& manifest, const Part& main_part, Warnings& warnings) {
  const SceneDescription& scene = manifest.scene;
  media_ = Media::build(scene, warnings);
  if (media_ && !media_->grids().empty()) {
    grids_ = true;
    one_channel_ = media_->chromatic_grids();
    std::vector<CollisionRate> rates;
    for (const GridMedium& g : media_->grids()) rates.push_back({g.event, g.blocking});
    resident_.set_collision_rates(std::move(rates));
  }
  if (!media_ || job_.media != MediaTransport::multiple) return;
  const auto number = [](MediumId id) { return static_cast<std::uint16_t>(id ? id.value + 1 : 0); };
  camera_medium_ = number(scene.camera.medium);
  for (const MaterialDesc& m : scene.materials) interfaces_.push_back({number(m.inside), number(m.outside)});
  const auto is_null = [&](const auto& shape) { return shading_->is_null(shape.material); };
  null_surfaces_ = std::ranges::any_of(main_part.chunks, is_null) || std::ranges::any_of(main_part.quadrics, is_null);
  if (!null_surfaces_ || manifest.bounded_media.empty()) return;
  bounded_.resize(scene.media.size());
  for (const std::uint32_t medium : manifest.bounded_media) bounded_.at(medium) = true;
}

float PathTracer::time_of(const PathSegment& s) const {
  return path_time(job_, shutter_, s.pixel, ray_sample(s));
}

TraceRay PathTracer::ray_of(const PathSegment& s) const {
  return {s.origin, kInfinity, s.direction, motion_ ? time_of(s) : 0.f};
}

void PathTracer::camera(const RendererRange& range, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
                        std::vector<PathSegment>& out) const {
  const BatchTimer timer(time_.camera);
  const std::uint32_t samples = range.sample_end - range.sample_begin, tile_width = range.x1 - range.x0;
  out.reserve(out.size() + count);
  const bool lens = camera_->uses_lens();
  SampleSequence::Eight sequences;
  Columns<2> corners;
  auto sample = static_cast<std::uint32_t>(range.sample_begin + first % samples);
  auto x = static_cast<std::uint32_t>(range.x0 + first / samples % tile_width);
  auto y = static_cast<std::uint32_t>(range.y0 + first / samples / tile_width);
  const bool shares = range.shares && shared_.group > 1;
  // Samples of this pixel that are made here: a group of which all are goes as one.
  std::uint32_t from = sample;
  std::uint64_t to = std::min<std::uint64_t>(range.sample_end, sample + count);
  for (std::uint64_t left = count; left > 0;) {
    out.resize(out.size() + kLanes);
    PathSegment* const eight = out.data() + (out.size() - kLanes);
    std::size_t n = 0;
    for (; n < kLanes && left > 0; --left) {
      const std::uint32_t first_of_group = shared_.first(sample);
      const bool whole = shares && first_of_group >= from && first_of_group + 2 * (shared_.group - 1) < to;
      if (!whole || first_of_group == sample) {
        PathSegment& s = eight[n];
        s.task = range.task;
        s.owner = owner;
        s.pixel = y * job_.film.frame.width + x;
        s.sample = sample;
        s.flags = static_cast<std::uint16_t>(kSpecularBounce | kCameraRay | (shares ? kSharesRay : 0) | (whole ? kHoldsGroup : 0));
        s.medium = camera_medium_;
        corners.put(0, n, Vec2(static_cast<float>(x), static_cast<float>(y)));
        sequences[n] = SampleSequence(job_.sequence, job_.seed, s.pixel, shared_.ray_sample(sample, shares));
        ++n;
      }
      if (++sample < range.sample_end) continue;
      from = sample = range.sample_begin;
      to = std::min<std::uint64_t>(range.sample_end, sample + (left - 1));
      if (++x < range.x1) continue;
      x = range.x0;
      ++y;
    }
    out.resize(out.size() - (kLanes - n));
    for (std::size_t lane = n; lane < kLanes; ++lane) {  // what is missing to eight is made and dropped
      corners.put(0, lane, Vec2(0.f));
      sequences[lane] = sequences[0];
    }
    const Vec2x8 offset = filter_->sample8(SampleSequence::get_2d(sequences, 0));
    const Vec2x8 film = corners.two(0) + Vec2x8(Float8(0.5f)) + offset;
    const CameraRay8 ray = camera_->ray8(film, lens ? SampleSequence::get_2d(sequences, 1) : Vec2x8(Float8(0.5f)));
    Columns<9> made;
    made.store(0, ray.origin);
    made.store(3, ray.direction);
    made.store(6, ray.weight);
    made.store(7, ray.cone_width);
    made.store(8, ray.cone_spread);
    for (std::size_t lane = 0; lane < n; ++lane) {
      PathSegment& s = eight[lane];
      s.origin = made.get(0, lane);
      s.direction = made.get(3, lane);
      s.throughput = Rgb(made.at[6][lane]);
      if (one_channel_) {
        Rgb one(0.f);
        const auto channel = static_cast<int>(channel_of(s));
        one[channel] = 3.f * s.throughput[channel];
        s.throughput = one;
      }
      s.previous_normal = Vec3(0.f);
      if (footprint_) {
        s.cone_width = made.at[7][lane] * footprint_scale_;
        s.cone_spread = made.at[8][lane] * footprint_scale_;
      }
      if (camera_->moves()) {
        CameraRay moved{s.origin, s.direction, s.cone_width, s.cone_spread};
        camera_->place(time_of(s), moved);
        s.origin = moved.origin;
        s.direction = moved.direction;
        s.cone_width = moved.cone_width;
      }
    }
  }
}

// Of a path that is of one channel; else all channels are alike to grids.
std::uint32_t PathTracer::channel_of(const PathSegment& s) const {
  return one_channel_ ? (s.sample + static_cast<std::uint32_t>(mix64((std::uint64_t{job_.seed} << 32) | s.pixel) % 3)) % 3 : 0;
}

BrickRay PathTracer::brick_ray(const PathSegment& s, const SampleSequence& sequence) const {
  const std::uint64_t path = mix64((std::uint64_t{s.pixel} << 32) | s.sample) ^ mix64(job_.seed);
  BrickRay ray;
  ray.key = mix64(path + ((std::uint64_t{s.vertex} << 16) | s.passed) * 0xd1342543de82ef95u);
  ray.sequence = &sequence;
  ray.dimension = (s.vertex * 0x9e3779b1u) ^ (s.passed * 0x85ebca6bu);
  ray.channel = channel_of(s);
  if (job_.media == MediaTransport::multiple) ray.medium = s.medium;
  return ray;
}

// Tests what is resident; returns the first part that is not and may hold something nearer.
PartId PathTracer::trace_one(const ResidentSet& set, PathSegment& s, Hit& hit) const {
  if (!traceable(s.origin, s.direction)) return {};
  TraceRay ray = ray_of(s);
  SampleSequence sequence;
  BrickRay bricks;
  if (grids_) {
    sequence = SampleSequence(job_.sequence, job_.seed, s.pixel, s.sample);
    bricks = brick_ray(s, sequence);
    ray.bricks = &bricks;
  }
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
  return !next && hit.part < kAnsweredPart && !set.has(hit.part) ? PartId{hit.part} : next;
}

// Eight rays at once, for which nothing has been tested: packets find the same bits as single rays (tested), faster.
void PathTracer::trace_eight(const ResidentSet& set, PathSegment* s, Hit* hits, PartId* next) const {
  std::array<const float*, kLanes> places;
  std::uint32_t from_camera = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    places[i] = &s[i].origin.x;
    from_camera += (s[i].flags & kCameraRay) ? 1u : 0u;
    s[i].flags |= kMainTested;
  }
  // Origin and direction lie side by side.
  static_assert(offsetof(PathSegment, direction) == offsetof(PathSegment, origin) + sizeof(Vec3));
  const auto in = lanes::gather<8>(places);
  RayPacket rays{{in[0], in[1], in[2]}, kInfinity, {in[3], in[4], in[5]}};
  std::array<float, 8> times;
  if (motion_) {
    for (std::size_t i = 0; i < 8; ++i) times[i] = time_of(s[i]);
    rays.times = times.data();
  }
  const std::uint32_t good = lanes::to_bits(traceable(rays.origin, rays.direction));
  if (good == 0) return;
  const Coherence coherence = from_camera == 8 ? Coherence::alike : Coherence::any;
  if (main_geometry_) set.intersect8(0, rays, good, coherence, hits);
  if (one_part_ && set.has(1)) {
    set.intersect8(1, rays, good, coherence, hits);
    return;
  }
  // What is joined is traced as a whole, and whatever of it may hold something nearer counts as tested.
  const bool join = set.may_join(rays);
  if (join) {
    set.intersect_joined8(rays, good, coherence, hits);
    if (set.joined_count() == map_.part_count() - 1) return;
  }
  // Each round takes the nearest resident part that any of the rays still has to test, with all rays that do.
  constexpr std::size_t kNear = 16;
  std::array<std::array<Candidate, kNear>, 8> lists;
  std::array<std::size_t, 8> counts{}, cursor{};
  for (std::size_t i = 0; i < 8; ++i) {
    if (!(good >> i & 1u)) continue;
    counts[i] = map_.candidates(s[i].origin, s[i].direction, hits[i].t, lists[i]);
    for (std::size_t j = 0; join && j < counts[i]; ++j)
      if (set.joined(lists[i][j].part)) s[i].tested |= std::uint64_t{1} << j;
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
    if (coherence == Coherence::alike || std::popcount(active) > 2) {
      set.intersect8(part, rays, active, coherence, hits);
    } else {
      for (std::uint32_t left = active; left; left &= left - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(left));
        set.intersect(part, ray_of(s[i]), hits[i]);
      }
    }
  }
  for (std::size_t i = 0; i < 8; ++i) {
    if (!(good >> i & 1u)) continue;
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
  // Steps inside of a medium end where it scatters.
  for (std::size_t i = 0; subsurface_ && i < n; ++i)
    if (!(batch.segments[i].flags & kMainTested)) batch.hits[i].t = std::min(batch.hits[i].t, batch.segments[i].best.t);
  for (std::size_t i = 0; i < n;) {
    std::size_t run = 0;
    while (run < 8 && !grids_ && i + run < n && !(batch.segments[i + run].flags & kMainTested) && batch.hits[i + run].t == kInfinity)
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

void PathTracer::find_blocked(const ResidentSet& set, std::span<const OcclusionRay> rays, std::span<const float> times,
                              std::span<std::uint8_t> found) const {
  CandidateList list;
  ShadowStretches stretches(*this, set);
  for (std::size_t first = 0; first < rays.size(); first += 8) {
    const std::size_t n = std::min<std::size_t>(8, rays.size() - first);
    std::array<const float*, kLanes> starts, ends;
    for (std::size_t i = 0; i < 8; ++i) {
      const OcclusionRay& r = rays[first + (i < n ? i : 0)];
      starts[i] = &r.origin.x;
      ends[i] = &r.direction.y;
    }
    // Seven numbers in a row.
    static_assert(offsetof(OcclusionRay, direction) == sizeof(Vec3) && offsetof(OcclusionRay, t_max) == 2 * sizeof(Vec3));
    const auto a = lanes::gather<4>(starts);
    const auto b = lanes::gather<3>(ends);
    RayPacket packet{{a[0], a[1], a[2]}, b[2], {a[3], b[0], b[1]}};
    std::array<float, 8> own{};
    if (!times.empty()) {
      std::copy_n(times.begin() + static_cast<std::ptrdiff_t>(first), n, own.begin());
      packet.times = own.data();
    }
    std::uint32_t open = ((1u << n) - 1u) & lanes::to_bits(traceable(packet.origin, packet.direction) && packet.t_max > 0.f);
    std::uint32_t hit = 0, missing = 0xff;
    // Where shadow rays pass surfaces of the main scene, their way through it is known when they are made.
    if (open && main_geometry_ && !null_surfaces_) hit |= set.occluded8(0, packet, open);
    open &= ~hit;
    if (one_part_ && !grids_) {
      if (open && set.has(1)) {
        hit |= set.occluded8(1, packet, open);
        missing &= ~open;
      }
    } else {
      const bool join = open && !grids_ && set.may_join(packet);
      if (join) {
        hit |= set.occluded_joined8(packet, open);
        open &= ~hit;
        if (set.joined_count() == map_.part_count() - 1) {
          missing &= ~open;
          open = 0;
        }
      }
      for (std::uint32_t left = open; left; left &= left - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(left));
        const OcclusionRay& r = rays[first + i];
        TraceRay ray{r.origin, r.t_max, r.direction, times.empty() ? 0.f : times[first + i]};
        BrickRay bricks;
        if (grids_) {
          bricks = shadow_brick_ray(r);
          // As in homogeneous media: pbrt's shadow rays to what is infinitely far away end there. (The length holds a channel.)
          if (r.t_max > 0.5f * shadow_length(kInfinity)) bricks.reach = longest_shadow_;
          if (!bounded_.empty()) {
            stretches.begin(r, ray.time);
            bricks.stretches = &stretches;
          }
          ray.bricks = &bricks;
        }
        PathSegment probe;
        probe.origin = r.origin;
        probe.direction = r.direction;
        bool blocked = false, all_here = true;
        for (;;) {
          list.find(map_, probe, r.t_max);
          for (std::size_t c = 0; c < list.size() && !blocked; ++c) {
            const bool here = set.has(list[c].part);
            all_here = all_here && here;
            if (here && !(join && set.joined(list[c].part)) && list[c].t_enter <= r.t_max) blocked = set.occluded(list[c].part, ray);
          }
          if (blocked || !list.more()) break;
          ++probe.window;
        }
        if (blocked) hit |= 1u << i;
        if (all_here) missing &= ~(1u << i);
      }
    }
    for (std::size_t i = 0; i < n; ++i)
      found[first + i] = static_cast<std::uint8_t>((hit >> i & 1u ? kBlocked : 0) | (missing >> i & 1u ? kPartsMissing : 0));
  }
}

std::vector<bool> PathTracer::occluded(std::span<const OcclusionRay> rays, std::span<const float> times,
                                       std::span<std::uint8_t> blocked) const {
  const BatchTimer timer(time_.occlusion);
  const auto set = resident_.snapshot();
  // Rays without times, which only a host of another making sends, count as of time 0.
  find_blocked(*set, rays, times.size() == rays.size() ? times : std::span<const float>(), blocked);
  for (std::uint8_t& b : blocked) b &= kBlocked;
  std::vector<bool> tested(map_.part_count());
  for (std::uint32_t p = 0; p < tested.size(); ++p) tested[p] = set->has(p);
  return tested;
}

}  // namespace cloudrenderer
