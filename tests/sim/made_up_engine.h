#pragma once
// A scene without geometry: which parts a ray may hit, what it hits there and how the path goes on
// are hashes of the path, so the picture is a pure function of pixel and sample, and any path that
// went astray shows in it.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <set>
#include <vector>

#include "base/random.h"
#include "simulate/list_engine.h"

namespace cloudrenderer::sim {

struct MadeUpScene {
  std::uint64_t seed = 0;
  std::uint32_t parts = 1;  // with part 0
  std::uint32_t width = 8;
  std::uint32_t longest_list = 6;  // candidates of a ray at most
  std::uint32_t vertices = 5;      // of a path at most
  bool features = false;           // paths tell what they see
  bool negative_lobes = false;     // of the filter: some samples are summed apart
};

class MadeUpEngine final : public ListEngine {
 public:
  explicit MadeUpEngine(const MadeUpScene& scene) : scene_(scene) {}

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
  std::uint32_t film_width() const override { return scene_.width; }
  bool has_negative_lobes() const override { return scene_.negative_lobes; }
  bool in_negative_lobe(std::uint32_t pixel, std::uint32_t sample, bool) const override {
    return scene_.negative_lobes && mix64(scene_.seed * 5 + (std::uint64_t{pixel} << 32 | sample)) % 5 == 0;
  }

 private:
  static float unit(std::uint64_t h) { return to_unit(static_cast<std::uint32_t>(h >> 32)); }
  // A ray alone tells whose it is: its origin has the pixel in y, sample and vertex in z.
  static float place(const PathSegment& s) { return static_cast<float>(s.sample * 64 + s.vertex); }
  std::uint64_t key_of(const Vec3& origin) const {
    const auto pixel = static_cast<std::uint64_t>(origin.y);
    const auto z = static_cast<std::uint64_t>(origin.z);
    return mix64(mix64(scene_.seed + (pixel << 32 | z / 64)) + z % 64 * 77u + std::bit_cast<std::uint32_t>(origin.x));
  }
  std::uint64_t key_of(const OcclusionRay& r) const {
    return mix64(scene_.seed * 3 + (std::uint64_t{std::bit_cast<std::uint32_t>(r.origin.x)} << 32) +
                 std::bit_cast<std::uint32_t>(r.origin.y));
  }
  std::uint32_t part_count() const override { return scene_.parts; }
  void candidates(const Vec3& origin, Candidates& list) const override { find(key_of(origin), list); }
  void shadow_candidates(const OcclusionRay& ray, Candidates& list) const override { find(key_of(ray), list); }
  void find(std::uint64_t key, Candidates& list) const {
    list.clear();
    if (scene_.parts < 2) return;
    const std::uint64_t n = mix64(key + 1) % (scene_.longest_list + 1);
    std::set<std::uint32_t> used;
    for (std::uint64_t i = 0; i < n; ++i) {
      const auto part = 1 + static_cast<std::uint32_t>(mix64(key + 100 + i) % (scene_.parts - 1));
      if (used.insert(part).second)
        list.push_back({static_cast<float>(list.size()) + unit(mix64(key + 300 + i)), part});
    }
  }
  bool blocks(const OcclusionRay& ray, std::uint32_t part) const override {
    return mix64(key_of(ray) ^ (part * 0x9e37u + 5u)) % 6 == 0;
  }
  void hit_main(const Vec3& origin, Hit& hit) const override { hit_part(origin, {6.f, 0}, hit); }
  void hit_part(const Vec3& origin, const ListCandidate& c, Hit& hit) const override {
    const std::uint64_t key = key_of(origin), h = mix64(key ^ (0x51u + std::uint64_t{c.part} * 0x1003fu));
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

  void shade_one(const PathSegment& s, const Hit& hit, ShadeOutput& out) const override {
    const std::uint64_t key = mix64(key_of(s.origin) ^ (std::uint64_t{hit.shape} << 20) ^ hit.primitive);
    PathSegment n = s;
    n.tested = 0;
    n.window = 0;
    n.best = {};
    n.flags = s.flags & (kHitTold | kSurfaceTold);
    if (scene_.features && hit.part != 0xffffffffu) tell(n, mix64(key + 20), out);
    for (std::size_t c = 0; c < 3; ++c)
      n.radiance[c] += static_cast<std::int64_t>(mix64(key + c) >> 40) - (1 << 20);
    ++out.counts.bounce;
    const bool escaped = hit.part == kNoPart;
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
    if (!escaped && mix64(key + 13) % 2 == 0) {
      const OcclusionRay ray{Vec3(unit(mix64(key + 14)), unit(mix64(key + 15)), 0), {0, 1, 0}, 5.f};
      const Fixed3 contribution{static_cast<std::int64_t>(key >> 44), 3, -static_cast<std::int64_t>(key >> 50)};
      if (cast_shadow(ray, contribution, n, ends, flags, out)) return;
    }
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

  MadeUpScene scene_;
};

}  // namespace cloudrenderer::sim
