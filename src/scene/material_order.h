#pragma once
#include <cstdint>
#include <vector>

#include "scene/description.h"

namespace cloudrenderer {

// The numbers of all materials, each mix behind the two that it mixes. In pbrt-v4 a mix may be used before it is made, so
// that its number is smaller than theirs. Throws SceneError where materials mix each other in a circle; what a mix
// refers to otherwise is not looked at.
std::vector<std::uint32_t> material_order(const SceneDescription& scene);

}  // namespace cloudrenderer
