#include "parts/scene_files.h"

#include <xxhash.h>

#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string_view>
#include <system_error>

#include "parts/mapped_file.h"
#include "scene/file_paths.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFolder = "files/";
// Calls rename(name, location) for every file that the scene reads; what it returns is the new
// name.
using Rename = std::function<std::string(const std::string&, const FileLocation&)>;

void rename_files(Entity& entity, const Rename& rename) {
  std::vector<Param> changed;
  for (const Param& p : entity.params.all()) {
    if (p.type != ParamType::string || p.strings.size() != 1 || p.strings[0].empty()) continue;
    if (!is_file_parameter(p.name, p.strings[0])) continue;
    Param renamed = p;
    renamed.strings[0] = rename(p.strings[0], p.location);
    changed.push_back(std::move(renamed));
  }
  for (Param& p : changed) entity.params.add(std::move(p));
}

// The film is left out: its file is written.
void rename_files(SceneDescription& scene, const Rename& rename) {
  rename_files(scene.camera, rename);
  rename_files(scene.sampler, rename);
  rename_files(scene.integrator, rename);
  for (Entity& e : scene.textures) rename_files(e, rename);
  for (Entity& e : scene.materials) rename_files(e, rename);
  for (Entity& e : scene.lights) rename_files(e, rename);
  for (Entity& e : scene.area_lights) rename_files(e, rename);
}

}  // namespace

std::uint64_t collect_files(SceneDescription& scene, const std::string& folder,
                            Warnings& warnings) {
  std::map<std::string, std::string> copied;        // source -> new name
  std::map<std::uint64_t, std::string> by_content;  // hash -> new name
  std::set<std::string> taken;
  std::uint64_t hash = 0;
  rename_files(scene, [&](const std::string& name, const FileLocation& location) {
    if (const auto found = copied.find(name); found != copied.end()) return found->second;
    std::string& result = copied[name];
    result = name;
    try {
      const MappedFile file = map_file(name);
      const std::uint64_t content = XXH3_64bits(file.bytes.data(), file.bytes.size());
      hash = XXH3_64bits_withSeed(&content, sizeof content, hash);
      if (const auto found = by_content.find(content); found != by_content.end())
        return result = found->second;
      const fs::path source(name);
      std::string target = std::string(kFolder) + source.filename().string();
      for (int i = 2; !taken.insert(target).second; ++i)
        target = std::string(kFolder) + source.stem().string() + "-" + std::to_string(i) +
                 source.extension().string();
      fs::create_directories(fs::path(folder) / kFolder);
      fs::copy_file(source, fs::path(folder) / target, fs::copy_options::overwrite_existing);
      by_content[content] = target;
      result = target;
    } catch (const std::system_error& e) {
      warnings.add(location, "cannot read \"" + name + "\": " + e.code().message());
    }
    return result;
  });
  return hash;
}

void make_file_names_absolute(SceneDescription& scene, const std::string& folder) {
  const fs::path root = fs::absolute(folder);
  rename_files(scene, [&](const std::string& name, const FileLocation&) {
    return name.starts_with(kFolder) ? (root / name).lexically_normal().string() : name;
  });
}

}  // namespace cloudrenderer
