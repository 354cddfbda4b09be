#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>

#include "base/lanes.h"
#include "base/random.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Where a ray found a part that this host holds. Local to the host, never sent; the ids are global, so that hits of
// different parts and hosts compare by (t, shape, primitive).
struct Hit {
  float t = kInfinity;
  float u = 0, v = 0;                    // Embree's barycentrics: p = (1-u-v) a + u b + v c; of curves CurveHit's
  std::uint32_t part = 0xffffffffu;      // none: nothing hit here (t, shape, primitive may be another host's hit)
  std::uint32_t instance = 0xffffffffu;  // index into the part's instances
  std::uint32_t geometry = 0;            // 0 triangles, 1 quadrics, kCurveHit, kBrickHit, kAnsweredHit
  std::uint32_t index = 0;               // triangle, quadric or curve segment in the part, or in the prototype of the instance
  std::uint32_t shape = 0xffffffffu;
  std::uint32_t primitive = 0xffffffffu;
};

inline constexpr std::uint32_t kCurveHit = 2, kBrickHit = 3;
// A hit in a part that another host has intersected for this one; `geometry` of no part, see AnsweredSurface.
inline constexpr std::uint32_t kAnsweredHit = 4, kAnsweredPart = 0xfffffffeu;

// Nearest hits are ordered by distance, then shape, then primitive, so that it does not matter who finds them.
inline bool comes_before(float t, std::uint32_t shape, std::uint32_t primitive, const Hit& hit) {
  if (t != hit.t) return t < hit.t;
  return shape != hit.shape ? shape < hit.shape : primitive < hit.primitive;
}

// A part of a ray, and what it is in: 1 + the number of a medium, or 0.
struct MediumStretch {
  float begin = 0, end = 0;
  std::uint16_t medium = 0;
};

// Says where along a shadow ray bricks count: asked when the ray meets one. On one thread.
class MediumStretches {
 public:
  virtual ~MediumStretches() = default;
  // All of the ray, from its start; none where all of it counts for bricks of this medium.
  virtual std::span<const MediumStretch> along(std::uint32_t medium) = 0;
};

// What a ray must know to collide with bricks of density grids.
struct BrickRay {
  static constexpr std::uint16_t kAnyMedium = 0xffffu;
  std::uint64_t key = 0;     // of its random numbers
  const SampleSequence* sequence = nullptr;  // of its path, for the first number in each brick: less noise; or none
  std::uint32_t dimension = 0;  // of the sequence
  std::uint32_t channel = 0; // whose rates count
  float reach = kInfinity;   // bricks farther away do not count
  std::uint16_t medium = kAnyMedium;  // only bricks of this one count: 1 + its number
  MediumStretches* stretches = nullptr;  // none: they count all along the ray
};

struct TraceRay {
  Vec3 origin;
  float t_max = kInfinity;
  Vec3 direction;
  float time = 0;  // of the path; matters to instances that move
  const BrickRay* bricks = nullptr;  // none: bricks are nothing to it
};

// Eight rays in lanes.
struct RayPacket {
  Vec3x8 origin;
  Float8 t_max;
  Vec3x8 direction;
  const float* times = nullptr;  // eight; null: 0
};
// Whether the rays of a packet start and go alike; says how to trace them, not what is found.
enum class Coherence : std::uint8_t { alike, any };

// True for rays that Embree may see: finite, below 1e18, direction not null. Everything else hits nothing.
template <class F>
MaskOf<F> traceable(const Vec3Of<F>& o, const Vec3Of<F>& d) {
  using lanes::abs, lanes::max;
  const F m = max(max(max(abs(o.x), abs(o.y)), max(abs(o.z), abs(d.x))), max(abs(d.y), abs(d.z)));
  const F s = o.x + o.y + o.z + d.x + d.y + d.z;  // max() may pass over a NaN, the sum does not
  return m < 1e18f && s == s && !lanes::is_black(d);
}

}  // namespace cloudrenderer
