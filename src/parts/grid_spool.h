#pragma once
#include <cstdint>
#include <string>

#include "parts/mapped_file.h"
#include "parts/part.h"

namespace cloudrenderer {

struct SpooledBrick {
  BrickRecord record;
  Bounds3 box;  // in the world
  std::uint64_t first_sample = 0;
};

Bounds3 brick_box(const DensityBrick& brick);  // in the world

// The bricks of a scene's density grids in temporary files.
class GridSpool {
 public:
  // Valid until the next map().
  struct View {
    std::span<const SpooledBrick> bricks;
    std::span<const float> densities;
    std::span<const float> samples(const SpooledBrick& b) const {
      return densities.subspan(static_cast<std::size_t>(b.first_sample), b.record.sample_count());
    }
  };

  explicit GridSpool(const std::string& folder) : bricks_(folder), densities_(folder) {}
  void add(const GridDesc& grid, std::uint32_t shape);  // its global id
  bool empty() const { return bricks_.size() == 0; }
  View map() { return {bricks_.map(), densities_.map()}; }
  std::span<SpooledBrick> bricks() { return bricks_.map(); }  // likewise

 private:
  SpoolArray<SpooledBrick> bricks_;
  SpoolArray<float> densities_;
};

}  // namespace cloudrenderer
