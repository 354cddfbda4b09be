#pragma once
#include <span>
#include <vector>

#include "base/log.h"
#include "parts/grid_spool.h"
#include "parts/spool.h"
#include "scene/description.h"

namespace cloudrenderer {

// Leaves of each brick what can be seen of it: nothing, with an empty box, where no surface and no camera has its medium;
// what is in the box around the surfaces that have it; of pbrt-v2's, whose media have room of their own, everything. Paths
// never meet more of it, shadow rays would. Warns of what nobody uses, and of media whose surfaces are smaller than their grid.
void clip_bricks(const SceneDescription& scene, std::span<const ShapeRow> rows, std::span<SpooledBrick> bricks, Warnings& warnings);

}  // namespace cloudrenderer
