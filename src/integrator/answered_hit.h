#pragma once
// What a host that only intersects says of a nearest hit: the hit, and the triangle that was hit, so that the asker
// can shade a surface of a part that it does not hold. Plain data.
#include <array>
#include <cstdint>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// In world space; all else that is known of the surface follows from material and light.
struct AnsweredSurface {
  std::array<Vec3, 3> p{Vec3(0.f), Vec3(0.f), Vec3(0.f)};
  std::array<Vec3, 3> n{Vec3(0.f), Vec3(0.f), Vec3(0.f)};
  std::array<Vec2, 3> uv{Vec2(0.f), Vec2(0.f), Vec2(0.f)};
  std::uint32_t material = 0xffffffffu, light = 0xffffffffu;  // as in MeshChunk
  std::uint16_t flags = 0;                                    // kAnsweredFlip, ...
};
enum AnsweredFlag : std::uint16_t {
  kAnsweredFlip = 1,     // MeshChunk::flip
  kAnsweredNormals = 2,  // n counts
  kAnsweredUvs = 4,      // uv counts
};

struct AnsweredHit {
  float t = kInfinity;
  float u = 0, v = 0;  // as in Hit
  std::uint32_t shape = 0xffffffffu, primitive = 0xffffffffu;
  AnsweredSurface surface;
};

}  // namespace cloudrenderer
