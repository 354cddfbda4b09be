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
// never meet more of it, shadow rays would. Of objects' rows those count not that are `lifted` (by row; may be shorter), since
// they are among the world's, too. Gives Manifest::bounded_media. Warns of grids that nobody uses, and of those that shadow
// rays see where no path does.
std::vector<std::uint32_t> clip_bricks(const SceneDescription& scene, std::span<const ShapeRow> rows, const std::vector<bool>& lifted,
                                       std::span<SpooledBrick> bricks, Warnings& warnings);

}  // namespace cloudrenderer
