#pragma once
#include <string>

#include "scene/description.h"

namespace cloudrenderer {

// Tells pbrt-v2, v3 and v4 apart by words of the file and its includes that only some of them have.
// The older one when nothing decides. Never throws: what is wrong with a file, the parser says. Looks at no file outside
// of the folder `confine`, if one is given.
Dialect detect_dialect(const std::string& path, const std::string& confine = {});

}  // namespace cloudrenderer
