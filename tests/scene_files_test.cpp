// Parses real scenes.
#include <gtest/gtest.h>

#include <iostream>

#include "scene/scene_codec.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

const std::string kScenes = std::string(CLOUDRENDERER_SHARED_DIR) + "/scenes";

// Every top-level scene: what has a camera.
std::vector<std::string> scenes_in(const std::string& folder) {
  std::vector<std::string> out;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".pbrt") continue;
    std::ifstream file(entry.path());
    std::string head(20000, '\0');
    file.read(head.data(), static_cast<std::streamsize>(head.size()));
    if (head.find("Camera") != std::string::npos) out.push_back(entry.path().string());
  }
  return out;
}

void parses_all(const std::string& version, Dialect dialect) {
  if (!fs::exists(kScenes)) GTEST_SKIP() << "the scenes are not here: " << kScenes;
  const auto files = scenes_in(kScenes + "/" + version);
  EXPECT_GE(files.size(), 10u);
  for (const std::string& file : files) {
    SCOPED_TRACE(file);
    SceneCounter sink;
    Warnings warnings;
    try {
      const SceneDescription scene = parse_scene(file, {}, sink, warnings);
      EXPECT_GT(sink.shapes, 0u);
      // One original has nothing that tells its version.
      if (file.find("buddha-fractal.pbrt") == std::string::npos) {
        EXPECT_EQ(scene.dialect, dialect);
      }
      const std::string bytes = encode(scene);
      const auto again = decode_scene(std::as_bytes(std::span(bytes)));
      ASSERT_TRUE(again) << again.error();
      EXPECT_EQ(encode(*again), bytes);
      std::cout << file << ": " << sink.shapes << " shapes, " << sink.instances << " instances, "
                << sink.numbers << " numbers, " << scene.materials.size() << " materials, "
                << warnings.list().size() << " warnings\n"
                << joined(warnings);
    } catch (const std::exception& e) {
      ADD_FAILURE() << e.what();
    }
  }
}

TEST(SceneFiles, ParsesEveryV2Scene) { parses_all("v2", Dialect::v2); }
TEST(SceneFiles, ParsesEveryV3Scene) { parses_all("v3", Dialect::v3); }

}  // namespace
}  // namespace cloudrenderer
