#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "scene/description.h"

namespace cloudrenderer {

inline constexpr std::array kMixed{"namedmaterial1", "namedmaterial2"};  // parameters of a mix

// The number of the material that a mix of the description names so; none: the parameter is no number.
std::optional<std::uint32_t> mixed_material(const ParamSet& mix, std::string_view name);

// The numbers of all materials, each mix behind the two that it mixes. In pbrt-v4 a mix may be used before it is made, so
// that its number is smaller than theirs. Throws SceneError where materials mix each other in a circle; what a mix
// refers to otherwise is not looked at.
std::vector<std::uint32_t> material_order(const SceneDescription& scene);

}  // namespace cloudrenderer
