#include "scene/cloud_voxels.h"

#include <algorithm>

#include "base/noise.h"

namespace cloudrenderer {
namespace {

constexpr int kOctaves = 5, kMoves = 2;
constexpr float kLacunarity = 1.99f;
constexpr float kFewestSamples = 32, kMostSamples = 384;

// By differences over a hundredth, as pbrt has it.
Vec3 noise_gradient(const Vec3& p) {
  constexpr float kStep = 0.01f;
  const float n = noise(p);
  return Vec3(noise(p + Vec3(kStep, 0, 0)) - n, noise(p + Vec3(0, kStep, 0)) - n, noise(p + Vec3(0, 0, kStep)) - n) / kStep;
}

}  // namespace

std::uint32_t CloudVoxels::samples(float length, const Shape& shape) {
  float period = shape.frequency;
  for (int i = 1; i < kOctaves; ++i) period *= kLacunarity;
  const float n = 3 * length * period;
  return static_cast<std::uint32_t>(n > kFewestSamples ? std::min(n, kMostSamples) : kFewestSamples);
}

float CloudVoxels::at(const Vec3& p) const {
  Vec3 moved = shape_.frequency * p;
  if (shape_.wispiness > 0.f) {
    float weight = 0.05f * shape_.wispiness, frequency = 10.f;
    for (int i = 0; i < kMoves; ++i) {
      moved += weight * noise_gradient(frequency * moved);
      weight *= 0.5f;
      frequency *= kLacunarity;
    }
  }
  float sum = 0.f, weight = 0.5f, frequency = 1.f;
  for (int i = 0; i < kOctaves; ++i) {
    sum += weight * noise(frequency * moved);
    weight *= 0.5f;
    frequency *= kLacunarity;
  }
  const float thinned = std::clamp((1.f - p.y) * 4.5f * shape_.density * sum, 0.f, 1.f);
  return std::clamp(thinned + 2.f * std::max(0.f, 0.5f - p.y), 0.f, 1.f);
}

// Beyond its box the function goes on.
void CloudVoxels::read(std::uint32_t, const glm::ivec3& begin, const glm::ivec3& end, float* out) const {
  const Vec3 step = (layout_.p1 - layout_.p0) / Vec3(layout_.size);
  for (int z = begin.z; z < end.z; ++z)
    for (int y = begin.y; y < end.y; ++y)
      for (int x = begin.x; x < end.x; ++x) *out++ = at(layout_.p0 + (Vec3(x, y, z) + layout_.first_sample) * step);
}

}  // namespace cloudrenderer
