#pragma once
#include <string>

#include "parts/part.h"

namespace cloudrenderer {

// Writes the split in `folder` as pbrt text: main.pbrt, parts/NNNNN.pbrt, prototypes/NNNNN.pbrt.
// The file names in the manifest are relative to the folder. Throws std::system_error.
void write_text(const std::string& folder, const Manifest& manifest);

}  // namespace cloudrenderer
