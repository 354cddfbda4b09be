#pragma once
#include <span>
#include <vector>

#include "base/log.h"
#include "parts/grid_spool.h"
#include "parts/spool.h"
#include "scene/description.h"

namespace cloudrenderer {

// By medium, whether its grid can be seen: some surface or the camera has the medium (pbrt-v3 and v4; of pbrt-v2 all have
// room of their own). Warns of the others, and of media whose surfaces are smaller than the box of the grid, since shadow
// rays meet all of it.
std::vector<bool> grids_in_use(const SceneDescription& scene, std::span<const ShapeRow> rows, std::span<const SpooledBrick> bricks,
                               Warnings& warnings);

}  // namespace cloudrenderer
