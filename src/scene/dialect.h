#pragma once
#include <string>

#include "scene/description.h"

namespace cloudrenderer {

// Tells pbrt-v2 from pbrt-v3 by the first directive (of the file and its includes) that only one of
// them has. v2 when nothing decides. Never throws: what is wrong with a file, the parser says.
Dialect detect_dialect(const std::string& path);

}  // namespace cloudrenderer
