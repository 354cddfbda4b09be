#pragma once
// What the scene tests share: a sink that keeps everything, and scenes written to temporary files.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "scene/description.h"

namespace cloudrenderer {

struct SceneCollector : SceneSink {
  std::vector<ShapeDesc> shapes;
  std::vector<InstanceDesc> instances;
  std::vector<std::string> objects;  // by ObjectId
  std::vector<std::string> events;   // "begin x", "end", "shape sphere", "instance"

  void begin_object(ObjectId id, const std::string& name) override {
    EXPECT_EQ(id.value, objects.size());
    objects.push_back(name);
    events.push_back("begin " + name);
  }
  void end_object(ObjectId) override { events.emplace_back("end"); }
  void shape(ShapeDesc&& s, const SceneDescription& scene) override {
    EXPECT_LT(s.material.value, scene.materials.size());
    if (s.area_light) {
      EXPECT_LT(s.area_light.value, scene.area_lights.size());
    }
    events.push_back("shape " + s.type);
    shapes.push_back(std::move(s));
  }
  void instance(const InstanceDesc& i, const SceneDescription&) override {
    events.emplace_back("instance");
    instances.push_back(i);
  }
};

// Counts and keeps nothing, for big scenes.
struct SceneCounter : SceneSink {
  std::size_t shapes = 0, instances = 0, objects = 0, numbers = 0;
  void begin_object(ObjectId, const std::string&) override { ++objects; }
  void end_object(ObjectId) override {}
  void shape(ShapeDesc&& s, const SceneDescription&) override {
    ++shapes;
    for (const Param& p : s.params.all()) numbers += p.reals.size() + p.integers.size();
  }
  void instance(const InstanceDesc&, const SceneDescription&) override { ++instances; }
};

// A folder that is gone after the test.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name =
        (std::filesystem::temp_directory_path() / "cloudrenderer-test-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("no temporary folder");
    path_ = std::filesystem::canonical(name).string();
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }

  std::string path(const std::string& name) const { return path_ + "/" + name; }
  std::string write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
    std::filesystem::remove(
        path(name));  // replacing a file's bytes makes some file systems write to the disk at once
    std::ofstream(path(name), std::ios::binary) << text;
    return path(name);
  }

 private:
  std::string path_;
};

struct ParsedScene {
  SceneDescription scene;
  SceneCollector sink;
  Warnings warnings;
};

inline ParsedScene parse_text(const std::string& text,
                              std::optional<Dialect> dialect = std::nullopt) {
  const TemporaryFolder folder;
  ParsedScene out;
  ParseOptions options;
  options.dialect = dialect;
  out.scene = parse_scene(folder.write("scene.pbrt", text), options, out.sink, out.warnings);
  return out;
}

inline std::string joined(const Warnings& warnings) {
  std::string all;
  for (const std::string& w : warnings.list()) all += w + "\n";
  return all;
}

}  // namespace cloudrenderer
