#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <memory>
#include <string>

#include "base/log.h"
#include "parts/part.h"

namespace cloudrenderer {

struct SplitOptions {
  std::uint64_t part_size = std::uint64_t{64} << 20;  // predicted loaded bytes of a part
  // An object of more predicted bytes with one instance becomes shapes of the world. Moving shapes rounds them, so this
  // may not follow the part size, or the picture would.
  std::uint64_t large_object = std::uint64_t{256} << 20;
  std::uint64_t memory = std::uint64_t{512} << 20;    // anonymous memory that the split itself may use
  std::optional<Dialect> dialect;
  std::string confine;          // the only folder that the scene's files may be in, links resolved; "": any
  bool text = false;            // also write the split as pbrt text (main.pbrt, parts/00017.pbrt)
  bool tells_missing_files = true;  // or else whoever reads them next does: pictures, tables
  std::string scratch;          // folder for temporary files; "" = the output folder
};

// Reads a scene, cuts it into parts and writes a split folder:
//   manifest.bin, parts/00000.part (main scene's shapes), parts/00001.part ..., prototypes/00000.part ...,
//   with --text also main.pbrt and parts/*.pbrt.
// Image, spectrum and other files that the scene names are copied (or linked) into files/ and named relative to the folder.
// Returns the manifest (with file names absolute again). Throws SceneError, std::system_error.
Manifest split_scene(const std::string& scene_path, const std::string& out_folder, const SplitOptions& options,
                     Warnings& warnings);

// Opens a split folder; file names in the manifest are made absolute. Throws SceneError when it is no split folder.
Manifest open_split(const std::string& folder);
// Whether every part and prototype has its file, as long as the manifest says: cheap, and known before hosts begin to
// load. Throws SceneError. (What is in the files is checked when they are loaded.)
void check_part_files(const std::string& folder, const Manifest& manifest);
bool is_split_folder(const std::string& path);
std::string part_path(const std::string& folder, std::uint32_t part);
std::string prototype_path(const std::string& folder, std::uint32_t prototype);

}  // namespace cloudrenderer
