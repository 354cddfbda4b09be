#pragma once
// Samples of a pixel that share what the camera sees: its ray, the surface that the ray hits and the light samples there. From
// there on every sample goes its own way. A group has every second sample of a block, so that it lies within one of the two
// sequences of a pixel. Its first sample brings the light of all of them: what the camera sees shining, and what the light samples
// at the first vertex bring, counts as often as there are samples in the group. For whom it pays: src/README.md, decision 63.
#include <cstdint>

namespace cloudrenderer {

inline bool may_be_samples_per_ray(std::uint32_t n) { return n == 1 || n == 2 || n == 4 || n == 8; }

// Groups of samples. Which samples share rays at all the manager says, with each task; a path carries it (kSharesRay).
struct SharedRays {
  std::uint32_t group = 1;  // samples a ray: a power of two
  std::uint32_t end = 0;    // samples from here on never share: no whole block of them is left

  SharedRays() = default;
  SharedRays(std::uint32_t samples_per_ray, std::uint32_t spp) : group(samples_per_ray), end(spp / block() * block()) {}

  // Samples without which no group is whole: those of two groups, of even and of odd numbers.
  std::uint32_t block() const { return group > 1 ? 2 * group : 1; }
  // Of the sample's group. The others of it are those 2, 4, ... after the first one.
  std::uint32_t first(std::uint32_t sample) const { return sample - (sample / 2 & (group - 1u)) * 2; }
  // Whose numbers the camera's ray and the light samples take: rays count on one by one, as every second number of a sequence
  // would be distributed worse than the first half of them.
  std::uint32_t ray_sample(std::uint32_t sample, bool shares) const {
    return shares && group > 1 ? sample / block() * 2 + sample % 2 : sample;
  }
};

}  // namespace cloudrenderer
