#pragma once
#include <span>
#include <vector>

#include "parts/scene_spool.h"

namespace cloudrenderer {

// Boxes around all shapes of the world and of its instances whose material may be specular, close ones in one: for
// Manifest::specular_boxes. Asks only for what was read, so that every split of a scene has the same. Before shapes are
// moved from objects to the world. Throws SceneError as maybe_specular().
std::vector<Bounds3> specular_boxes(const SceneDescription& scene, SceneSpool& spool);

// At most `most` boxes that cover the same, so that spheres around them have small sections; long ones are cut.
std::vector<Bounds3> few_boxes(std::vector<Bounds3> boxes, std::size_t most);

}  // namespace cloudrenderer
