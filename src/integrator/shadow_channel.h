#pragma once
// Inside src/integrator only: shadow rays of paths of one channel say which one, in the last two bits of their length.
#include <algorithm>
#include <bit>

#include "integrator/path_segment.h"

namespace cloudrenderer {

inline std::uint32_t channel_in(const OcclusionRay& ray) {
  return std::min(std::bit_cast<std::uint32_t>(ray.t_max) & 3u, 2u);
}
inline void put_channel(OcclusionRay& ray, std::uint32_t channel) {
  ray.t_max = std::bit_cast<float>((std::bit_cast<std::uint32_t>(ray.t_max) & ~3u) | channel);
}

}  // namespace cloudrenderer
