#pragma once
#include <cstdint>
#include <string>

#include "base/log.h"
#include "scene/description.h"

namespace cloudrenderer {

// Copies every file that the scene names (images, measured materials, lens tables) to folder/files,
// same content once, and makes their names relative to `folder`. Returns a hash of all contents. A
// file that cannot be read is a warning and keeps its name.
std::uint64_t collect_files(SceneDescription& scene, const std::string& folder, Warnings& warnings);

// Makes names that collect_files made relative absolute again.
void make_file_names_absolute(SceneDescription& scene, const std::string& folder);

}  // namespace cloudrenderer
