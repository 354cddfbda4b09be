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

FilePaths::FilePaths(const std::string& scene_path, const std::string& confine, std::set<std::string>* named)
    : top_(folder_of(scene_path)), confine_(confine.empty() ? confine : canonical_file(confine)), named_(named) {}

std::string FilePaths::find(const std::string& name, const std::string& naming_file, const FileLocation& where) const {
  if (name.empty()) return name;
  const auto found = [&](const fs::path& path) {
    if (named_) named_->insert(path.string());
    return path.string();
  };
  const fs::path first = (fs::path(top_) / name).lexically_normal();
  if (admits(first.string()) && is_there(first)) return found(first);
  const fs::path second = (fs::path(folder_of(naming_file)) / name).lexically_normal();
  if (admits(second.string()) && is_there(second)) return found(second);
  if (name.find('\\') != std::string::npos) {  // written on Windows
    std::string slashes = name;
    std::replace(slashes.begin(), slashes.end(), '\\', '/');
    return find(slashes, naming_file, where);
  }
  if (!admits(first.string()) && !admits(second.string()))
    throw SceneError(where, "the file '" + name + "' is outside of the scene's folder; files must be inside of it");
  return found(admits(first.string()) ? first : second);
}

void FilePaths::check(const std::string& path, const FileLocation& where) const {
  if (!admits(path))
    throw SceneError(where, "the file '" + path + "' is outside of the folder " + confine_ + "; files must be inside of it");
}

bool FilePaths::admits(const std::string& path) const {
  if (confine_.empty()) return true;
  std::error_code failed;
  const std::string real = fs::weakly_canonical(path, failed).string();
  return !failed && real.starts_with(confine_ == "/" ? confine_ : confine_ + "/");
}

std::string canonical_file(const std::string& path) {
  std::error_code failed;
  const fs::path p = fs::weakly_canonical(path, failed);
  return failed ? path : p.string();
}

bool is_file_parameter(std::string_view name, std::string_view value) {
  static constexpr std::array<std::string_view, 10> kNames{
      "filename", "mapname",  "spdfile",    "bsdffile",
      "lensfile", "specfile", "pointsfile", "emissionfilename", "normalmap", "aperture"};
  static constexpr std::array<std::string_view, 4> kBuiltIn{"gaussian", "square", "pentagon", "star"};
  if (name == "aperture" && std::ranges::find(kBuiltIn, value) != kBuiltIn.end()) return false;
  return std::ranges::find(kNames, name) != kNames.end();
}

}  // namespace cloudrenderer
