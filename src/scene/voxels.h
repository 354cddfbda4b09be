#pragma once
// Grids of samples in space: densities of participating media, and what else varies with them.
#include <cstdint>
#include <vector>

#include "base/bulk_array.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

inline constexpr std::uint32_t kNoChannel = 0xffffffffu;

// The samples of a grid, a number a channel. Immutable; any thread.
class Voxels {
 public:
  virtual ~Voxels() = default;
  // The samples from `begin` to before `end`, x fastest, then y; also one beyond the grid on each side.
  virtual void read(std::uint32_t channel, const glm::ivec3& begin, const glm::ivec3& end, float* out) const = 0;
};

// How samples lie in the box of a medium's space from p0 to p1, which may be mirrored.
struct GridLayout {
  glm::uvec3 size{1};        // samples along x, y, z; they divide the box evenly
  Vec3 p0{0}, p1{1};
  float first_sample = 0.5f;  // where the first one is, in distances between samples from p0
  std::uint32_t channels = 1;
  std::uint32_t densities = 1;  // of these the first ones that rays collide with: 1, or 3 for red, green and blue
};

// Arrays of samples, x fastest: one a channel, or several channels that lie side by side in one.
class DenseVoxels final : public Voxels {
 public:
  // What stands beyond the samples.
  enum class Beyond : std::uint8_t { nothing, last };
  struct Channel {
    BulkArray<float> values;
    std::uint32_t stride = 1, first = 0;  // value i is values[i * stride + first]
    BulkArray<float> plus{};              // of the same shape, added where there is one
    float otherwise = 1;                  // without values: this, also beyond
    float constant = 0;                   // added to values
  };
  DenseVoxels(const glm::uvec3& size, Beyond beyond, std::vector<Channel> channels)
      : size_(size), beyond_(beyond), channels_(std::move(channels)) {}

  void read(std::uint32_t channel, const glm::ivec3& begin, const glm::ivec3& end, float* out) const override;

 private:
  float at(const Channel& c, glm::ivec3 i) const;

  glm::uvec3 size_;
  Beyond beyond_;
  std::vector<Channel> channels_;
};

}  // namespace cloudrenderer
