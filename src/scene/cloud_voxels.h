#pragma once
#include "scene/voxels.h"

namespace cloudrenderer {

// pbrt-v4's cloud: octaves of noise, moved by noise, thinner with the height (Pharr, Jakob and Humphreys, "Physically
// Based Rendering", 4th ed., section 11.4), sampled on a grid. Between 0 and 1.
class CloudVoxels final : public Voxels {
 public:
  struct Shape {
    float density = 1, wispiness = 1, frequency = 5;
  };
  // So many samples along an axis of this length that the finest octave has three a period, if that is not too much.
  static std::uint32_t samples(float length, const Shape& shape);

  CloudVoxels(const GridLayout& layout, const Shape& shape) : layout_(layout), shape_(shape) {}
  void read(std::uint32_t channel, const glm::ivec3& begin, const glm::ivec3& end, float* out) const override;

 private:
  float at(const Vec3& p) const;

  GridLayout layout_;
  Shape shape_;
};

}  // namespace cloudrenderer
