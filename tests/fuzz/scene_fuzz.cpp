// Scene text through the parser, in every dialect.
#include "fuzz/fuzz.h"
#include "scene/scene_codec.h"

using namespace cloudrenderer;

namespace {

struct Sink final : SceneSink {
  void begin_object(ObjectId, const std::string&) override {}
  void end_object(ObjectId) override {}
  void shape(ShapeDesc&& s, const SceneDescription& scene) override {
    fuzz::require(s.material.value < scene.materials.size(), "a shape's material is there");
    fuzz::require(!s.area_light || s.area_light.value < scene.area_lights.size(),
                  "a shape's light is there");
  }
  void instance(const InstanceDesc&, const SceneDescription&) override {}
};

void parse(const std::string& path, Dialect dialect) {
  Sink sink;
  Warnings warnings;
  try {
    ParseOptions options;
    options.dialect = dialect;
    const SceneDescription scene = parse_scene(path, options, sink, warnings);
    const std::string bytes = encode(scene);
    const auto again = decode_scene(std::as_bytes(std::span(bytes)));
    fuzz::require(static_cast<bool>(again), "a host takes every scene that can be read");
  } catch (const SceneError& e) {
    fuzz::require(std::string(e.what()).find("error: ") != std::string::npos, "an error says so");
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::MemoryFile file(fuzz::input(data, size));
  parse(file.path(), Dialect::v2);
  parse(file.path(), Dialect::v3);
  parse(file.path(), Dialect::v4);
  return 0;
}
