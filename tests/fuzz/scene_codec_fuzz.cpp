#include "fuzz/fuzz.h"
#include "scene/scene_codec.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Result<SceneDescription> scene = decode_scene(fuzz::input(data, size));
  if (!scene) return 0;
  const std::string once = encode(*scene);
  const Result<SceneDescription> again = decode_scene(std::as_bytes(std::span(once)));
  fuzz::require(static_cast<bool>(again), "what was accepted can be sent on");
  fuzz::require(encode(*again) == once, "nothing is lost on the way");
  return 0;
}
