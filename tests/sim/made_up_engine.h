#pragma once
// A scene without geometry: which parts a ray may hit, what it hits there and how the path goes on
// are hashes of the path. It keeps every rule of PathEngine (masks, windows, conservative order,
// only resident parts are tested), so the picture is a pure function of pixel and sample, and any
// path that went astray shows in it.
#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <set>
#include <vector>

#include "base/random.h"
#include "integrator/engine.h"

namespace cloudrenderer::sim {

struct MadeUpScene {
  std::uint64_t seed = 0;
  std::uint32_t parts = 1;  // with part 0
  std::uint32_t width = 8;
  std::uint32_t longest_list = 6;  // candidates of a ray at most
  std::uint32_t vertices = 5;      // of a path at most
  bool features = false;           // paths tell what they see
};

class MadeUpEngine final : public PathEngine {
 public:
  explicit MadeUpEngine(const MadeUpScene& scene) : scene_(scene) {}
  std::set<std::uint32_t> resident;

  void camera(const RendererRange& r, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
              std::vector<PathSegment>& out) const override {
    const std::uint32_t samples = r.sample_end - r.sample_begin, width = r.x1 - r.x0;
    for (std::uint64_t i = first; i < first + count; ++i) {
      const auto pixel = static_cast<std::uint32_t>(i / samples);
      PathSegment s{};
      s.task = r.task;
      s.owner = owner;
      s.pixel = (r.y0 + pixel / width) * scene_.width + r.x0 + pixel % width;
      s.sample = r.sample_begin + static_cast<std::uint32_t>(i % samples);
      s.origin = Vec3(unit(mix64(scene_.seed ^ (std::uint64_t{s.pixel} << 32 | s.sample))), s.pixel, place(s));
      s.direction = {0, 0, 1};
      s.throughput = Vec3(1, 0.5f, 0.25f);
      out.push_back(s);
    }
  }

  void trace(SegmentBatch& batch) const override {
    batch.hits.resize(batch.size());
    batch.next.assign(batch.size(), PartId());
    for (std::size_t i = 0; i < batch.size(); ++i)
      trace_one(batch.segments[i], batch.hits[i], batch.next[i]);
  }
  void route(SegmentBatch& batch) const override { trace(batch); }

  void shade(SegmentBatch& batch, ShadeOutput& out) const override {
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

  std::vector<bool> occluded(std::span<const OcclusionRay> rays, std::span<const float>,
                             std::span<std::uint8_t> blocked) const override {
    for (std::size_t i = 0; i < rays.size(); ++i) {
      blocked[i] = 0;
      for (const Candidate& c : candidates(key_of(rays[i])))
        if (resident.contains(c.part) && blocks(key_of(rays[i]), c.part)) blocked[i] = 1;
    }
    std::vector<bool> tested(scene_.parts);
    for (const std::uint32_t p : resident) tested[p] = true;
    return tested;
  }
  void nearest(std::span<const OcclusionRay> rays, std::span<AnsweredHit> hits) const override {
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const std::uint64_t key = key_of(rays[i].origin);
      Hit hit;
      hit.t = rays[i].t_max;
      for (const Candidate& c : candidates(key))
        if (resident.contains(c.part)) hit_part(key, c, hit);
      hits[i] = {};
      if (hit.part != 0xffffffffu) hits[i] = {hit.t, 0, 0, hit.shape, hit.primitive, {}};
    }
  }
  void mark_tested(PathSegment& s, float, const std::vector<bool>& answered) const override {
    const auto list = candidates(key_of(s));
    const std::size_t first = std::size_t{64} * s.window;
    for (std::size_t i = first; i < std::min(list.size(), first + 64); ++i)
      if (answered[list[i].part]) s.tested |= std::uint64_t{1} << (i - first);
  }
  std::uint32_t film_width() const override { return scene_.width; }

 private:
  static constexpr std::uint16_t kMainDone = kMainTested;
  struct Candidate {
    float t_enter;
    std::uint32_t part;
  };

  static float unit(std::uint64_t h) { return to_unit(static_cast<std::uint32_t>(h >> 32)); }
  // A ray alone tells whose it is: its origin has the pixel in y, sample and vertex in z.
  static float place(const PathSegment& s) { return static_cast<float>(s.sample * 64 + s.vertex); }
  std::uint64_t key_of(const Vec3& origin) const {
    const auto pixel = static_cast<std::uint64_t>(origin.y);
    const auto z = static_cast<std::uint64_t>(origin.z);
    return mix64(mix64(scene_.seed + (pixel << 32 | z / 64)) + z % 64 * 77u + std::bit_cast<std::uint32_t>(origin.x));
  }
  std::uint64_t key_of(const PathSegment& s) const { return key_of(s.origin); }
  std::uint64_t key_of(const OcclusionRay& r) const {
    return mix64(scene_.seed * 3 + (std::uint64_t{std::bit_cast<std::uint32_t>(r.origin.x)} << 32) +
                 std::bit_cast<std::uint32_t>(r.origin.y));
  }
  std::vector<Candidate> candidates(std::uint64_t key) const {
    std::vector<Candidate> list;
    if (scene_.parts < 2) return list;
    const std::uint64_t n = mix64(key + 1) % (scene_.longest_list + 1);
    std::set<std::uint32_t> used;
    for (std::uint64_t i = 0; i < n; ++i) {
      const auto part = 1 + static_cast<std::uint32_t>(mix64(key + 100 + i) % (scene_.parts - 1));
      if (used.insert(part).second)
        list.push_back({static_cast<float>(list.size()) + unit(mix64(key + 300 + i)), part});
    }
    return list;
  }
  bool blocks(std::uint64_t key, std::uint32_t part) const {
    return mix64(key ^ (part * 0x9e37u + 5u)) % 6 == 0;
  }

  void hit_part(std::uint64_t key, const Candidate& c, Hit& hit) const {
    const std::uint64_t h = mix64(key ^ (0x51u + std::uint64_t{c.part} * 0x1003fu));
    if (h % 10 >= 3) return;
    // Coarse distances, so that ties in t are frequent and only (shape, primitive) decides.
    const float t = std::max(c.t_enter, std::floor(c.t_enter + unit(h) * 4.f));
    if (t > hit.t || (t == hit.t && c.part >= hit.shape)) return;
    hit.t = t;
    hit.shape = c.part;
    hit.primitive = static_cast<std::uint32_t>(h & 7u);
    hit.part = c.part;
    hit.geometry = 0;
  }

  void trace_one(PathSegment& s, Hit& hit, PartId& next) const {
    const std::uint64_t key = key_of(s);
    const auto list = candidates(key);
    if (!(s.flags & kMainDone)) hit_part(key, {6.f, 0}, hit);
    s.flags |= kMainDone;
    const auto nearer = [&](std::size_t i) { return i < list.size() && list[i].t_enter <= hit.t; };
    for (;;) {
      const std::size_t first = std::size_t{64} * s.window;
      bool all = true;
      for (std::size_t i = first; i < first + 64 && nearer(i); ++i) {
        if (s.tested >> (i - first) & 1u) continue;
        if (!resident.contains(list[i].part)) {
          all = false;
          continue;
        }
        hit_part(key, list[i], hit);
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
      next = PartId(list[i].part);
      return;
    }
    if (hit.part < kAnsweredPart && !resident.contains(hit.part)) next = PartId(hit.part);
  }

  void shade_one(const PathSegment& s, const Hit& hit, ShadeOutput& out) const {
    const std::uint64_t key = mix64(key_of(s) ^ (std::uint64_t{hit.shape} << 20) ^ hit.primitive);
    PathSegment n = s;
    n.tested = 0;
    n.window = 0;
    n.best = {};
    n.flags = s.flags & (kHitTold | kSurfaceTold);
    if (scene_.features && hit.part != 0xffffffffu) tell(n, mix64(key + 20), out);
    for (std::size_t c = 0; c < 3; ++c)
      n.radiance[c] += static_cast<std::int64_t>(mix64(key + c) >> 40) - (1 << 20);
    ++out.counts.bounce;
    const bool escaped = hit.part == 0xffffffffu;
    const bool ends = escaped || s.vertex + 1u >= scene_.vertices || mix64(key + 9) % 8 == 0;
    n.vertex = static_cast<std::uint16_t>(s.vertex + 1);
    n.origin.x = unit(mix64(key + 10));
    n.origin.z = place(n);
    n.throughput *= 0.9f;
    std::uint16_t flags = 0;
    if (ends && mix64(key + 11) % 512 == 0) flags |= kEndInvalid;
    if (ends && mix64(key + 12) % 256 == 0) flags |= kEndClamped;
    if (ends && scene_.features) {
      if (!(n.flags & kHitTold)) flags |= kEndWithoutHit;
      if (!(n.flags & kSurfaceTold)) flags |= kEndWithoutSurface;
    }
    if (!escaped && mix64(key + 13) % 2 == 0 && asks(n, key, ends, flags, out)) return;
    if (ends)
      out.ended.push_back({n.task, n.pixel, n.sample, n.owner, flags, n.radiance});
    else
      out.continuing.push_back(n);
  }

  // All at once, the hit first, or nothing yet.
  static void tell(PathSegment& n, std::uint64_t h, ShadeOutput& out) {
    const bool hit = !(n.flags & kHitTold) && h % 4 != 0;
    const bool surface = !(n.flags & kSurfaceTold) && (hit || (n.flags & kHitTold)) && h % 4 >= 2;
    if (!hit && !surface) return;
    PathFeatures f{n.task, n.pixel, n.sample, n.owner, 0, {}, {}};
    f.flags = static_cast<std::uint16_t>((hit ? kTellsHit : 0) | (surface ? kTellsSurface : 0));
    n.flags = static_cast<std::uint16_t>(n.flags | (hit ? kHitTold : 0) | (surface ? kSurfaceTold : 0));
    for (std::size_t i = 0; i < f.values.size(); ++i) f.values[i] = static_cast<std::int64_t>(mix64(h + i)) >> 30;
    if (hit) f.ids = {static_cast<std::uint32_t>(h >> 40) + 1, 2, 3};
    out.features.push_back(f);
  }

  // One shadow ray: true if other hosts must be asked, and the path is parked.
  bool asks(PathSegment& n, std::uint64_t key, bool ends, std::uint16_t flags,
            ShadeOutput& out) const {
    ++out.counts.shadow;
    OcclusionRay ray{Vec3(unit(mix64(key + 14)), unit(mix64(key + 15)), 0), {0, 1, 0}, 5.f};
    const Fixed3 contribution{static_cast<std::int64_t>(key >> 44), 3,
                              -static_cast<std::int64_t>(key >> 50)};
    std::vector<std::uint32_t> open;
    for (const Candidate& c : candidates(key_of(ray))) {
      if (!resident.contains(c.part)) {
        open.push_back(c.part);
      } else if (blocks(key_of(ray), c.part)) {
        return false;
      }
    }
    if (open.empty()) {
      for (std::size_t c = 0; c < 3; ++c) n.radiance[c] += contribution[c];
      return false;
    }
    ShadowAsk ask;
    ask.ray = ray;
    ask.parked = static_cast<std::uint32_t>(out.parked.size());
    ask.pending = static_cast<std::uint32_t>(out.ask_parts.size());
    ask.part_count = static_cast<std::uint32_t>(open.size());
    ask.contribution = contribution;
    out.ask_parts.insert(out.ask_parts.end(), open.begin(), open.end());
    out.asks.push_back(ask);
    out.parked.push_back({n, ends, flags});
    return true;
  }

  MadeUpScene scene_;
};

}  // namespace cloudrenderer::sim
