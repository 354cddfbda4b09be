#include "parts/split.h"

#include <spdlog/fmt/fmt.h>

#include <filesystem>
#include <system_error>

#include "parts/mapped_file.h"
#include "parts/scene_files.h"
#include "parts/splitter.h"

namespace cloudrenderer {

namespace fs = std::filesystem;

Manifest split_scene(const std::string& scene_path, const std::string& out_folder,
                     const SplitOptions& options, Warnings& warnings) {
  // An earlier split is removed from the folder; it must not be what is read.
  std::error_code ignored;
  const fs::path scene_folder = fs::weakly_canonical(scene_path, ignored).parent_path();
  if (is_split_folder(out_folder) && scene_folder == fs::weakly_canonical(out_folder, ignored))
    throw UsageError("the scene is in the folder that the split would replace: " + out_folder);
  SceneSplitter splitter(out_folder, options, warnings);
  ParseOptions parse;
  parse.dialect = options.dialect;
  parse.confine = options.confine;
  SceneDescription scene = parse_scene(scene_path, parse, splitter.sink(), warnings);
  return splitter.finish(std::move(scene));
}

Manifest open_split(const std::string& folder) {
  const std::string path = folder + "/manifest.bin";
  try {
    const MappedFile file = map_file(path);
    Result<Manifest> manifest = decode_manifest(file.bytes);
    if (!manifest) throw SceneError({}, path + ": " + manifest.error());
    make_file_names_absolute(manifest->scene, folder);
    return std::move(*manifest);
  } catch (const std::system_error& e) {
    throw SceneError({}, folder + " is no split scene: " + e.what());
  }
}

void check_part_files(const std::string& folder, const Manifest& manifest) {
  const auto check = [](const std::string& path, std::uint64_t expected) {
    std::error_code error;
    const std::uint64_t bytes = fs::file_size(path, error);
    if (error) throw SceneError({}, path + ": " + error.message());
    if (bytes != expected)
      throw SceneError({}, fmt::format("{}: the file has {} bytes, {} belong to this split", path,
                                       bytes, expected));
  };
  for (std::uint32_t p = 0; p < manifest.parts.size(); ++p)
    check(part_path(folder, p), manifest.parts[p].file_bytes);
  for (std::uint32_t p = 0; p < manifest.prototypes.size(); ++p)
    check(prototype_path(folder, p), manifest.prototypes[p].file_bytes);
}

bool is_split_folder(const std::string& path) {
  std::error_code ignored;
  return fs::is_regular_file(fs::path(path) / "manifest.bin", ignored);
}

std::string part_path(const std::string& folder, std::uint32_t part) {
  return fmt::format("{}/parts/{:05}.part", folder, part);
}

std::string prototype_path(const std::string& folder, std::uint32_t prototype) {
  return fmt::format("{}/prototypes/{:05}.part", folder, prototype);
}

}  // namespace cloudrenderer
