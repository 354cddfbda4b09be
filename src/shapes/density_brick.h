#pragma once
// A block of a density grid. Rays collide with it like with a shape, by chance.
#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Cells between samples along an edge of a brick: fixed, so that pictures do not depend on how a scene is split.
inline constexpr std::uint32_t kBrickCells = 16;

struct DensityBrick {
  Transform object_to_world;
  Vec3 low{}, high{};     // its box in object space
  Vec3 first{}, scale{};  // sample numbers of a point: (p - first) * scale, 0 at the brick's first one
  std::array<std::uint32_t, 3> size{};  // samples along x, y, z, those that it shares with its neighbours included
  float majorant = 0;     // the largest of them
};

// Cuts a grid of `size` samples that divide the box from p0 to p1 evenly; calls sink(brick, samples) for those that are not
// empty, with their number among all. `clamped`: see GridDesc.
void cut_grid(const glm::uvec3& size, const Vec3& p0, const Vec3& p1, bool clamped, const Transform& object_to_world,
              std::span<const float> density,
              const std::function<void(const DensityBrick&, std::uint32_t number, std::span<const float> samples)>& sink);

// Where a ray first collides with the brick, by delta tracking (Woodcock et al. 1965) with its own majorant; infinity:
// nowhere before t_far. `rate`: collisions a unit of length and density. `first` are the first two numbers of a walk in
// [0, 1), the others come from `key`. A pure function of ray, brick and numbers; t_far does not change where the collision is. Collisions of several bricks are a superposition of Poisson processes: the first one is
// as if the whole grid had been tracked.
float track(const DensityBrick& brick, std::span<const float> samples, const Vec3& origin, const Vec3& direction,
            float t_far, float rate, Vec2 first, std::uint64_t key);

}  // namespace cloudrenderer
