#include "scene/file_paths.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <system_error>

namespace cloudrenderer {

namespace fs = std::filesystem;

namespace {
bool is_there(const fs::path& p) {
  std::error_code ignored;
  return fs::exists(p, ignored);
}
std::string folder_of(const std::string& file) {
  std::error_code failed;
  const fs::path absolute = fs::absolute(file, failed);
  return (failed ? fs::path(file) : absolute).parent_path().lexically_normal().string();
}
}  // namespace

FilePaths::FilePaths(const std::string& scene_path) : top_(folder_of(scene_path)) {}

std::string FilePaths::find(const std::string& name, const std::string& naming_file) const {
  if (name.empty()) return name;
  const fs::path first = (fs::path(top_) / name).lexically_normal();
  if (is_there(first)) return first.string();
  const fs::path second = (fs::path(folder_of(naming_file)) / name).lexically_normal();
  if (is_there(second)) return second.string();
  if (name.find('\\') != std::string::npos) {  // written on Windows
    std::string slashes = name;
    std::replace(slashes.begin(), slashes.end(), '\\', '/');
    return find(slashes, naming_file);
  }
  return first.string();
}

std::string canonical_file(const std::string& path) {
  std::error_code failed;
  const fs::path p = fs::weakly_canonical(path, failed);
  return failed ? path : p.string();
}

bool is_file_parameter(std::string_view name) {
  static constexpr std::array<std::string_view, 8> kNames{
      "filename", "mapname",  "spdfile",    "bsdffile",
      "lensfile", "specfile", "pointsfile", "emissionfilename"};
  return std::find(kNames.begin(), kNames.end(), name) != kNames.end();
}

}  // namespace cloudrenderer
