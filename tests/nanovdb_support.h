#pragma once
// NanoVDB files made by the library's own writer.
#define NANOVDB_USE_ZIP 1
#include <nanovdb/util/GridBuilder.h>
#include <nanovdb/util/IO.h>

#include <string>
#include <vector>

namespace cloudrenderer::nanovdb_test {

using Handle = nanovdb::GridHandle<>;

// A grid of the values of f(x, y, z) from `low` to before `high` that are not 0.
template <class F>
Handle make_grid(const char* name, double voxel, const nanovdb::Coord& low, const nanovdb::Coord& high, F f) {
  nanovdb::GridBuilder<float> builder(0.f, nanovdb::GridClass::FogVolume);
  auto accessor = builder.getAccessor();
  for (int x = low[0]; x < high[0]; ++x)
    for (int y = low[1]; y < high[1]; ++y)
      for (int z = low[2]; z < high[2]; ++z)
        if (const float v = f(x, y, z); v != 0.f) accessor.setValue({x, y, z}, v);
  return builder.getHandle<>(voxel, nanovdb::Vec3d(1, 2, 3), name);
}

// Two small grids, "density" and "temperature".
inline void write_small(const std::string& path) {
  std::vector<Handle> grids;
  const auto make = [&](const char* name, float value) {
    grids.push_back(make_grid(name, 0.5, {0, 0, 0}, {3, 4, 5}, [&](int x, int, int) { return value * static_cast<float>(x + 1); }));
  };
  make("density", 0.5f);
  make("temperature", 1000.f);
  nanovdb::io::writeGrids(path, grids, nanovdb::io::Codec::NONE);
}

}  // namespace cloudrenderer::nanovdb_test
