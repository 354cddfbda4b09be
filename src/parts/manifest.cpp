#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <xxhash.h>

#include <limits>

#include "parts/manifest.pb.h"
#include "parts/manifest_hash.h"
#include "parts/part.h"
#include "scene/scene_codec.h"

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kVersion = 1;
using Floats = google::protobuf::RepeatedField<float>;

void write_box(const Bounds3& b, Floats* out) {
  if (b.empty()) return;
  for (const Vec3& v : {b.min, b.max})
    for (int a = 0; a < 3; ++a) out->Add(v[a]);
}

// False when the six numbers from `first` on are no box.
bool read_box(const Floats& in, int first, Bounds3& b) {
  for (int a = 0; a < 3; ++a) {
    b.min[a] = in[first + a];
    b.max[a] = in[first + 3 + a];
  }
  return is_finite(b.min) && is_finite(b.max) && !b.empty();
}

bool read_boxes(const Floats& in, std::vector<Bounds3>& boxes) {
  for (int i = 0; i + 6 <= in.size(); i += 6)
    if (!read_box(in, i, boxes.emplace_back())) return false;
  return in.size() % 6 == 0;
}

// A box that may be absent.
bool read_bounds(const Floats& in, Bounds3& b) {
  b = {};
  return in.empty() || (in.size() == 6 && read_box(in, 0, b));
}

void write(const Manifest& m, proto::Manifest& out) {
  out.set_version(kVersion);
  to_proto(m.scene, *out.mutable_scene());
  for (const PartInfo& p : m.parts) {
    proto::PartEntry* e = out.add_parts();
    for (const Bounds3& b : p.boxes) write_box(b, e->mutable_boxes());
    e->set_file_bytes(p.file_bytes);
    e->set_loaded_bytes(p.loaded_bytes);
    e->set_triangles(p.triangles);
    e->mutable_prototypes()->Add(p.prototypes.begin(), p.prototypes.end());
    e->set_features(p.features);
    e->set_checksum(p.checksum);
  }
  for (const PrototypeInfo& p : m.prototypes) {
    proto::PrototypeEntry* e = out.add_prototypes();
    e->set_name(p.name);
    write_box(p.bounds, e->mutable_bounds());
    e->set_file_bytes(p.file_bytes);
    e->set_loaded_bytes(p.loaded_bytes);
    e->set_triangles(p.triangles);
    e->set_shapes(p.shapes);
    e->set_checksum(p.checksum);
  }
  for (const AreaLightId id : m.shape_lights) out.add_shape_lights(id.value);
  out.set_total_triangles(m.total_triangles);
  write_box(m.bounds, out.mutable_bounds());
  out.set_content_hash(m.content_hash);
  out.set_moves(m.moves);
  for (const std::uint32_t medium : m.bounded_media) out.add_bounded_media(medium);
  for (const Bounds3& b : m.specular_boxes) write_box(b, out.mutable_specular_boxes());
}

// Null when all is well, else what is wrong.
const char* read(const proto::Manifest& in, Manifest& m) {
  if (in.parts().empty()) return "no parts";
  for (const proto::PrototypeEntry& e : in.prototypes()) {
    PrototypeInfo p;
    p.name = e.name();
    if (!read_bounds(e.bounds(), p.bounds)) return "a prototype's box is no box";
    p.file_bytes = e.file_bytes();
    p.loaded_bytes = e.loaded_bytes();
    p.triangles = e.triangles();
    p.shapes = e.shapes();
    p.checksum = e.checksum();
    m.prototypes.push_back(std::move(p));
  }
  for (const proto::PartEntry& e : in.parts()) {
    PartInfo p;
    if (!read_boxes(e.boxes(), p.boxes)) return "a part's boxes are no boxes";
    if (p.boxes.empty() && !m.parts.empty()) return "a part without boxes";
    p.file_bytes = e.file_bytes();
    p.loaded_bytes = e.loaded_bytes();
    p.triangles = e.triangles();
    for (const std::uint32_t prototype : e.prototypes()) {
      if (prototype >= m.prototypes.size()) return "a part needs a prototype that is not there";
      p.prototypes.push_back(prototype);
    }
    p.features = e.features();
    p.checksum = e.checksum();
    m.parts.push_back(std::move(p));
  }
  for (const std::uint32_t id : in.shape_lights()) {
    if (id >= m.scene.area_lights.size()) return "a shape has an area light that is not there";
    m.shape_lights.emplace_back(id);
  }
  m.total_triangles = in.total_triangles();
  if (!read_bounds(in.bounds(), m.bounds)) return "the scene's box is no box";
  m.content_hash = in.content_hash();
  m.moves = in.moves();
  for (const std::uint32_t medium : in.bounded_media()) {
    if (medium >= m.scene.media.size() || (!m.bounded_media.empty() && medium <= m.bounded_media.back())) return "a bounded medium is none";
    m.bounded_media.push_back(medium);
  }
  if (!read_boxes(in.specular_boxes(), m.specular_boxes) || m.specular_boxes.size() > kMostSpecularBoxes)
    return "the boxes of specular surfaces are no boxes";
  return nullptr;
}

std::string serialized(const proto::Manifest& message) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    message.SerializeToCodedStream(&coded);
  }
  return bytes;
}

}  // namespace

std::string encode(const Manifest& m) {
  proto::Manifest message;
  write(m, message);
  return serialized(message);
}

Result<Manifest> decode_manifest(std::span<const std::byte> bytes) {
  const auto failure = [](const std::string& why) {
    return Result<Manifest>::failure("manifest: " + why);
  };
  proto::Manifest message;
  if (bytes.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()) ||
      !message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    return failure("not a manifest");
  if (message.version() != kVersion) return failure("unknown version");
  Result<SceneDescription> scene = from_proto(message.scene());
  if (!scene) return failure(scene.error());
  Manifest m;
  m.scene = std::move(*scene);
  if (const char* why = read(message, m)) return failure(why);
  return m;
}

std::uint64_t manifest_hash(const Manifest& m) {
  proto::Manifest message;
  write(m, message);
  message.clear_content_hash();
  message.mutable_scene()->clear_source();
  message.mutable_scene()->clear_files();
  const std::string bytes = serialized(message);
  return XXH3_64bits(bytes.data(), bytes.size());
}

}  // namespace cloudrenderer
