#include "parts/grid_spool.h"

#include "parts/spool.h"

namespace cloudrenderer {

Bounds3 brick_box(const DensityBrick& brick) { return grown(Bounds3{brick.low, brick.high}.transformed(brick.object_to_world)); }

void GridSpool::add(const GridDesc& grid, std::uint32_t shape) {
  const auto take = [&](const DensityBrick& brick, std::uint32_t number, std::span<const float> samples) {
    if (bricks_.size() >= kNone) throw SceneError(grid.location, "more than 2^32 bricks of density grids");
    SpooledBrick b;
    b.record.brick = brick;
    b.record.medium = grid.medium.value;
    b.record.shape = shape;
    b.record.primitive = number;
    b.box = brick_box(brick);
    b.first_sample = densities_.size();
    if (!is_finite(b.box.min) || !is_finite(b.box.max)) throw SceneError(grid.location, "the density grid is not finite");
    bricks_.push_back(b);
    densities_.append(samples);
  };
  cut_grid(grid.layout, *grid.voxels, grid.medium_to_world, take);
}

}  // namespace cloudrenderer
