#pragma once
#include <optional>
#include <string>

#include "parts/part.h"

namespace cloudrenderer {

// read_part can only check a part by itself. This says why the part does not belong to the manifest
// (a material, light, texture or prototype that is not there), or nothing when all is well. For
// parts that came over a network.
std::optional<std::string> find_bad_reference(const Part& part, const Manifest& manifest);

}  // namespace cloudrenderer
