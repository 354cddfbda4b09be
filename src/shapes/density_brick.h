#pragma once
// A block of a density grid. Rays collide with it like with a shape, by chance.
#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "cloudrenderer/math.h"
#include "scene/voxels.h"

namespace cloudrenderer {

// Cells between samples along an edge of a brick: fixed, so that pictures do not depend on how a scene is split.
inline constexpr std::uint32_t kBrickCells = 16;

inline constexpr std::uint32_t kMostBrickChannels = 16;

struct DensityBrick {
  Transform object_to_world;
  Vec3 low{}, high{};     // its box in object space
  Vec3 first{}, scale{};  // sample numbers of a point: (p - first) * scale, 0 at the brick's first one
  std::array<std::uint32_t, 3> size{};  // samples along x, y, z, those that it shares with its neighbours included
  float majorant = 0;     // the largest of them that rays collide with
  std::uint32_t channels = 1;   // so many blocks of samples, one after the other
  std::uint32_t densities = 1;  // see GridLayout

  std::size_t channel_samples() const { return std::size_t{size[0]} * size[1] * size[2]; }
};

// Cuts a grid; calls sink(brick, samples) for bricks that are not empty, with their number among all. Samples as in `voxels`,
// channel after channel.
void cut_grid(const GridLayout& grid, const Voxels& voxels, const Transform& object_to_world,
              const std::function<void(const DensityBrick&, std::uint32_t number, std::span<const float> samples)>& sink);

// A channel's value at a point of object space, between 8 of its samples, at most at the last ones.
float value_at(const DensityBrick& brick, std::span<const float> channel, const Vec3& p);

// Where a ray first collides with the brick, by delta tracking (Woodcock et al. 1965) with its own majorant; infinity:
// nowhere before t_far. `rate`: collisions a unit of length and density. `first` are the first two numbers of a walk in
// [0, 1), the others come from `key`. `samples` are those of the channel that counts. A pure function of ray, brick and numbers;
// t_far does not change where the collision is. Collisions of several bricks are a superposition of Poisson processes: the
// first one is as if the whole grid had been tracked.
float track(const DensityBrick& brick, std::span<const float> samples, const Vec3& origin, const Vec3& direction,
            float t_far, float rate, Vec2 first, std::uint64_t key);

}  // namespace cloudrenderer
