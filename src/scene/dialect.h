#pragma once
#include <string>

#include "scene/description.h"

namespace cloudrenderer {

// Tells pbrt-v2, v3 and v4 apart by words of the file and its includes that only some of them have.
// The older one when nothing decides. Never throws: what is wrong with a file, the parser says. Looks at no file outside
// of the folder `confine`, if one is given.
Dialect detect_dialect(const std::string& path, const std::string& confine = {});

// Whether a scene that is described in pbrt-v3's words is one of pbrt-v4: its film says so.
bool is_of_v4(const SceneDescription& scene);

}  // namespace cloudrenderer
