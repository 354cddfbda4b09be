#pragma once
#include <vector>

#include "scene/description.h"

namespace cloudrenderer {

// By material: false when no point of a surface of it reflects or refracts like a mirror or smooth glass, or lets light
// straight through. True is a guess: a texture, say, may rule it out everywhere. Throws SceneError where materials mix
// each other in a circle.
std::vector<bool> maybe_specular(const SceneDescription& scene);

}  // namespace cloudrenderer
