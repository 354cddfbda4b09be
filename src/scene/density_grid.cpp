// Grids of densities: `Volume "volumegrid"`, MakeNamedMedium "heterogeneous" (pbrt-v3) and "uniformgrid" (pbrt-v4).
#include <cmath>

#include "scene/description.h"

namespace cloudrenderer {
namespace {

// As many samples along an axis as no file has; keeps products in 64 bits.
constexpr int kLongestAxis = 1 << 20;

std::uint32_t axis_size(const MediumDesc& medium, const char* name) {
  const int n = medium.params.integer(name, 1);
  if (n < 1 || n > kLongestAxis)
    throw SceneError(medium.location, std::string(name) + " of a density grid must be between 1 and " +
                                          std::to_string(kLongestAxis) + ", got " + std::to_string(n));
  return static_cast<std::uint32_t>(n);
}

}  // namespace

bool is_grid(const MediumDesc& medium, Dialect dialect) {
  return dialect == Dialect::v2 ? medium.type == "volumegrid"
                                : medium.type == "heterogeneous" || medium.type == "uniformgrid";
}

std::optional<GridDesc> take_grid(MediumDesc& medium, MediumId id, Dialect dialect) {
  const bool v2 = dialect == Dialect::v2;
  if (!is_grid(medium, dialect)) return std::nullopt;
  GridDesc grid;
  grid.medium = id;
  grid.size = {axis_size(medium, "nx"), axis_size(medium, "ny"), axis_size(medium, "nz")};
  grid.density = medium.params.reals("density");
  const std::uint64_t wanted = std::uint64_t{grid.size.x} * grid.size.y * grid.size.z;
  if (grid.density.size() != wanted)
    throw SceneError(medium.location, "a density grid of nx * ny * nz samples needs " + std::to_string(wanted) +
                                          " values of \"density\", got " + std::to_string(grid.density.size()));
  for (const float d : grid.density)
    if (!(d >= 0.f && d < kInfinity)) throw SceneError(medium.location, "densities must be finite and at least 0");
  grid.p0 = medium.params.point3("p0", Vec3(0.f));
  grid.p1 = medium.params.point3("p1", Vec3(1.f));
  const Vec3 extent = glm::abs(grid.p1 - grid.p0);
  if (!(extent.x > 0.f && extent.y > 0.f && extent.z > 0.f) || !is_finite(extent))
    throw SceneError(medium.location, "the box of a density grid, from p0 to p1, must have a volume");
  if (v2) {  // sorts the corners; pbrt-v3 mirrors the grid
    const Vec3 low = glm::min(grid.p0, grid.p1);
    grid.p1 = glm::max(grid.p0, grid.p1);
    grid.p0 = low;
  }
  grid.clamped = v2;
  grid.medium_to_world = medium.medium_to_world;
  grid.location = medium.location;
  ParamSet others;
  for (const Param& p : medium.params.all())
    if (p.name != "density") others.add(p);
  medium.params = std::move(others);
  return grid;
}

}  // namespace cloudrenderer
