#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Where a ray found a part that this host holds. Local to the host, never sent; the ids are global, so that hits of
// different parts and hosts compare by (t, shape, primitive).
struct Hit {
  float t = kInfinity;
  float u = 0, v = 0;                    // Embree's barycentrics: p = (1-u-v) a + u b + v c
  std::uint32_t part = 0xffffffffu;      // none: nothing hit here (t, shape, primitive may be another host's hit)
  std::uint32_t instance = 0xffffffffu;  // index into the part's instances
  std::uint32_t geometry = 0;            // 0 triangles, 1 quadrics
  std::uint32_t index = 0;               // triangle or quadric in the part, or in the prototype of the instance
  std::uint32_t shape = 0xffffffffu;
  std::uint32_t primitive = 0xffffffffu;
};

struct TraceRay {
  Vec3 origin;
  float t_max = kInfinity;
  Vec3 direction;
};

// True for rays that Embree may see: finite, below 1e18, direction not null. Everything else hits nothing.
inline bool traceable(const Vec3& o, const Vec3& d) {
  const float m = std::max({std::fabs(o.x), std::fabs(o.y), std::fabs(o.z), std::fabs(d.x), std::fabs(d.y), std::fabs(d.z)});
  const float s = o.x + o.y + o.z + d.x + d.y + d.z;  // std::max may pass over a NaN, the sum does not
  return m < 1e18f && s == s && (d.x != 0.f || d.y != 0.f || d.z != 0.f);
}

}  // namespace cloudrenderer
