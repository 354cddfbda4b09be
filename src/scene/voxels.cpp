#include "scene/voxels.h"

namespace cloudrenderer {

float DenseVoxels::at(const Channel& c, glm::ivec3 i) const {
  if (c.values.empty()) return c.otherwise;
  const glm::ivec3 inside = glm::clamp(i, glm::ivec3(0), glm::ivec3(size_) - 1);
  if (beyond_ == Beyond::nothing && inside != i) return 0.f;
  const auto n = static_cast<std::size_t>(inside.x) +
                 size_.x * (static_cast<std::size_t>(inside.y) + std::size_t{size_.y} * static_cast<std::size_t>(inside.z));
  const std::size_t value = n * c.stride + c.first;
  return c.values[value] + (c.plus.empty() ? c.constant : c.plus[value]);
}

void DenseVoxels::read(std::uint32_t channel, const glm::ivec3& begin, const glm::ivec3& end, float* out) const {
  const Channel& c = channels_[channel];
  for (int z = begin.z; z < end.z; ++z)
    for (int y = begin.y; y < end.y; ++y)
      for (int x = begin.x; x < end.x; ++x) *out++ = at(c, {x, y, z});
}

}  // namespace cloudrenderer
