#pragma once
#include <cstddef>
#include <span>
#include <string>

#include "base/error.h"
#include "scene/description.h"

namespace cloudrenderer {

namespace proto {
class SceneDescription;  // generated from scene.proto: include "scene/scene.pb.h"
}

// A scene description as protobuf message and back, without loss. Decoding trusts nothing: it fails
// with a reason for counts beyond every scene, values that do not fit their type, and references to
// what is not there.
void to_proto(const SceneDescription& scene, proto::SceneDescription& out);
Result<SceneDescription> from_proto(const proto::SceneDescription& in);

// The same as bytes, equal for equal descriptions.
std::string encode(const SceneDescription& scene);
Result<SceneDescription> decode_scene(std::span<const std::byte> bytes);

}  // namespace cloudrenderer
