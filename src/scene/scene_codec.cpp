#include "scene/scene_codec.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <cmath>
#include <limits>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/animated_transform.h"
#include "scene/material_order.h"
#include "scene/scene.pb.h"

namespace cloudrenderer {

namespace {

// Beyond every scene; they bound what a foreign message can make a host hold and do.
constexpr int kMostParams = 1000;      // of a directive: ParamReader's limit, and its few additions
constexpr int kMostEntries = 1 << 24;  // textures, materials, ...
constexpr int kMostFiles = 1 << 20;
constexpr std::size_t kLongestString = std::size_t{1} << 20;

class Encoder {
 public:
  explicit Encoder(proto::SceneDescription& out) : out_(out) {}

  void location(const FileLocation& in, proto::SceneLocation* out) {
    if (in.file) {
      const auto [it, is_new] =
          files_.try_emplace(*in.file, static_cast<std::uint32_t>(files_.size() + 1));
      if (is_new) out_.add_files(*in.file);
      out->set_file(it->second);
    }
    out->set_line(in.line);
    out->set_column(in.column);
  }
  void entity(const Entity& in, proto::SceneEntity* out) {
    out->set_type(in.type);
    location(in.location, out->mutable_location());
    for (const Param& p : in.params.all()) {
      proto::SceneParam* q = out->add_params();
      q->set_type(static_cast<std::uint32_t>(p.type));
      q->set_name(p.name);
      q->mutable_reals()->Add(p.reals.begin(), p.reals.end());
      q->mutable_integers()->Add(p.integers.begin(), p.integers.end());
      for (const std::string& s : p.strings) q->add_strings(s);
      location(p.location, q->mutable_location());
      q->set_used(p.used);
    }
  }
  static void transform(const Transform& in, proto::SceneTransform* out) {
    if (in.is_identity() && in.inverse_matrix() == Mat4(1.f)) return;
    for (int c = 0; c < 4; ++c)
      for (int r = 0; r < 4; ++r) {
        out->add_matrix(in.matrix()[c][r]);
        out->add_inverse(in.inverse_matrix()[c][r]);
      }
  }

 private:
  proto::SceneDescription& out_;
  std::unordered_map<std::string, std::uint32_t> files_;
};

// As the messages have it: 0 is vacuum.
std::uint32_t number_of(MediumId id) { return id ? id.value + 1 : 0; }

// Thrown and caught in this file only: decoding is deeply nested, and every step can fail.
struct Malformed {
  std::string why;
};

void check(bool ok, const char* why) {
  if (!ok) throw Malformed{why};
}

std::string text(const std::string& s) {
  check(s.size() <= kLongestString, "a string is too long");
  return s;
}

std::size_t components(ParamType type) {
  switch (type) {
    case ParamType::real:
      return 1;
    case ParamType::point2:
    case ParamType::vector2:
      return 2;
    case ParamType::point3:
    case ParamType::vector3:
    case ParamType::normal3:
    case ParamType::rgb:
      return 3;
    default:
      return 0;
  }
}

class Decoder {
 public:
  explicit Decoder(const proto::SceneDescription& in) {
    check(in.files_size() <= kMostFiles, "too many file names");
    for (const std::string& name : in.files())
      files_.push_back(std::make_shared<const std::string>(text(name)));
  }

  FileLocation location(const proto::SceneLocation& in) const {
    FileLocation out;
    check(in.file() <= files_.size(), "a location in a file that is not listed");
    if (in.file() != 0) out.file = files_[in.file() - 1];
    out.line = in.line();
    out.column = in.column();
    return out;
  }

  Param param(const proto::SceneParam& in) const {
    Param p;
    check(in.type() <= static_cast<std::uint32_t>(ParamType::texture),
          "a parameter of unknown type");
    p.type = static_cast<ParamType>(in.type());
    p.name = text(in.name());
    const std::size_t per_value = components(p.type);
    const bool is_text = p.type == ParamType::string || p.type == ParamType::texture;
    const bool is_integer = p.type == ParamType::integer || p.type == ParamType::boolean;
    check(per_value ? in.reals_size() % static_cast<int>(per_value) == 0 : in.reals_size() == 0,
          "a parameter with the wrong number of components");
    check(is_integer || in.integers_size() == 0, "integers in a parameter of another type");
    check(is_text || in.strings_size() == 0, "strings in a parameter of another type");
    check(p.type != ParamType::texture || in.strings_size() == 1,
          "a texture parameter without its texture");
    if (in.reals_size() != 0)
      p.reals = BulkArray<float>(std::vector<float>(in.reals().begin(), in.reals().end()));
    if (in.integers_size() != 0)
      p.integers = BulkArray<std::int32_t>(
          std::vector<std::int32_t>(in.integers().begin(), in.integers().end()));
    if (p.type == ParamType::boolean)
      for (const std::int32_t v : p.integers)
        check(v == 0 || v == 1, "a boolean that is neither 0 nor 1");
    for (const std::string& s : in.strings()) p.strings.push_back(text(s));
    p.location = location(in.location());
    p.used = in.used();
    return p;
  }

  Entity entity(const proto::SceneEntity& in) const {
    Entity e;
    e.type = text(in.type());
    e.location = location(in.location());
    check(in.params_size() <= kMostParams + 100, "too many parameters");
    std::set<std::string_view> names;
    for (const proto::SceneParam& p : in.params()) {
      check(names.insert(p.name()).second, "two parameters of the same name");
      e.params.add(param(p));
    }
    // Textures come before what refers to them.
    for (const Param& p : e.params.all())
      check(p.type != ParamType::texture || textures_.count(p.strings[0]),
            "a reference to a texture that is not there");
    return e;
  }

  static Transform transform(const proto::SceneTransform& in) {
    if (in.matrix_size() == 0 && in.inverse_size() == 0) return {};
    check(in.matrix_size() == 16 && in.inverse_size() == 16,
          "a transformation without its 16 numbers");
    Mat4 m, inverse;
    for (int c = 0; c < 4; ++c)
      for (int r = 0; r < 4; ++r) {
        m[c][r] = in.matrix(c * 4 + r);
        inverse[c][r] = in.inverse(c * 4 + r);
      }
    return {m, inverse};
  }

  void textures(const proto::SceneDescription& in, SceneDescription& out) {
    check(in.textures_size() <= kMostEntries, "too many textures");
    for (const proto::SceneTexture& t : in.textures()) {
      TextureDesc d;
      static_cast<Entity&>(d) = entity(t.entity());
      d.name = text(t.name());
      d.is_float = t.is_float();
      d.texture_to_world = transform(t.texture_to_world());
      check(textures_.insert(d.name).second, "two textures of the same name");
      out.textures.push_back(std::move(d));
    }
  }

  void materials(const proto::SceneDescription& in, SceneDescription& out) const {
    check(in.materials_size() <= kMostEntries, "too many materials");
    for (const proto::SceneMaterial& m : in.materials()) {
      MaterialDesc d;
      static_cast<Entity&>(d) = entity(m.entity());
      d.object_to_world = transform(m.object_to_world());
      d.inside = medium(m.inside(), in);
      d.outside = medium(m.outside(), in);
      if (d.type == "mix") check_mix(d, static_cast<std::size_t>(in.materials_size()));
      out.materials.push_back(std::move(d));
    }
    try {
      material_order(out);
    } catch (const SceneError& e) {
      throw Malformed{e.what()};
    }
  }

  static MediumId medium(std::uint32_t number, const proto::SceneDescription& in) {
    check(number <= static_cast<std::uint32_t>(in.media_size()), "a medium that is not there");
    return number ? MediumId(number - 1) : MediumId();
  }

  void media(const proto::SceneDescription& in, SceneDescription& out) const {
    check(in.media_size() <= kMostEntries, "too many media");
    for (const proto::SceneMedium& m : in.media()) {
      MediumDesc d;
      static_cast<Entity&>(d) = entity(m.entity());
      d.medium_to_world = transform(m.medium_to_world());
      out.media.push_back(std::move(d));
    }
  }

 private:
  static void check_mix(const MaterialDesc& mix, std::size_t materials) {
    for (const char* name : kMixed) {
      const auto index = mixed_material(mix.params, name);
      check(index && *index < materials, "a mix of materials that are not there");
    }
  }

  std::vector<std::shared_ptr<const std::string>> files_;
  std::set<std::string> textures_;
};

}  // namespace

void to_proto(const SceneDescription& scene, proto::SceneDescription& out) {
  out.Clear();
  Encoder e(out);
  out.set_dialect(static_cast<std::uint32_t>(scene.dialect));
  out.set_source(scene.source);
  e.entity(scene.camera, out.mutable_camera()->mutable_entity());
  Encoder::transform(scene.camera.world_to_camera, out.mutable_camera()->mutable_world_to_camera());
  out.mutable_camera()->set_medium(number_of(scene.camera.medium));
  if (scene.camera.motion)
    Encoder::transform(scene.camera.motion->end, out.mutable_camera()->mutable_world_to_camera_end());
  if (scene.transform_start != 0.f || scene.transform_end != 1.f) {
    out.add_transform_times(scene.transform_start);
    out.add_transform_times(scene.transform_end);
  }
  e.entity(scene.film, out.mutable_film());
  e.entity(scene.sampler, out.mutable_sampler());
  e.entity(scene.filter, out.mutable_filter());
  e.entity(scene.integrator, out.mutable_integrator());
  if (scene.renderer) e.entity(*scene.renderer, out.mutable_renderer());
  if (scene.volume_integrator) e.entity(*scene.volume_integrator, out.mutable_volume_integrator());
  for (const TextureDesc& t : scene.textures) {
    proto::SceneTexture* o = out.add_textures();
    e.entity(t, o->mutable_entity());
    o->set_name(t.name);
    o->set_is_float(t.is_float);
    Encoder::transform(t.texture_to_world, o->mutable_texture_to_world());
  }
  for (const MaterialDesc& m : scene.materials) {
    proto::SceneMaterial* o = out.add_materials();
    e.entity(m, o->mutable_entity());
    Encoder::transform(m.object_to_world, o->mutable_object_to_world());
    o->set_inside(number_of(m.inside));
    o->set_outside(number_of(m.outside));
  }
  for (const LightDesc& l : scene.lights) {
    proto::SceneLight* o = out.add_lights();
    e.entity(l, o->mutable_entity());
    Encoder::transform(l.light_to_world, o->mutable_light_to_world());
  }
  for (const Entity& a : scene.area_lights) e.entity(a, out.add_area_lights());
  for (const MediumDesc& m : scene.media) {
    proto::SceneMedium* o = out.add_media();
    e.entity(m, o->mutable_entity());
    Encoder::transform(m.medium_to_world, o->mutable_medium_to_world());
  }
}

Result<SceneDescription> from_proto(const proto::SceneDescription& in) {
  try {
    SceneDescription out;
    check(in.dialect() <= static_cast<std::uint32_t>(Dialect::v3), "an unknown dialect");
    out.dialect = static_cast<Dialect>(in.dialect());
    out.source = text(in.source());
    Decoder d(in);
    d.textures(in, out);
    d.materials(in, out);
    static_cast<Entity&>(out.camera) = d.entity(in.camera().entity());
    out.camera.world_to_camera = Decoder::transform(in.camera().world_to_camera());
    out.camera.medium = Decoder::medium(in.camera().medium(), in);
    d.media(in, out);
    if (in.transform_times_size() != 0) {
      check(in.transform_times_size() == 2, "transform times that are not two");
      out.transform_start = in.transform_times(0);
      out.transform_end = in.transform_times(1);
      check(std::isfinite(out.transform_start) && std::isfinite(out.transform_end) &&
                out.transform_start <= out.transform_end,
            "transform times that are no times");
    }
    if (in.camera().has_world_to_camera_end()) {
      const Transform end = Decoder::transform(in.camera().world_to_camera_end());
      check(end.is_invertible() && out.camera.world_to_camera.is_invertible() &&
                AnimatedTransform::can_move(out.camera.world_to_camera.matrix(), end.matrix()),
            "a camera that cannot move so");
      out.camera.motion = Motion{end, out.transform_start, out.transform_end};
    }
    out.film = d.entity(in.film());
    out.sampler = d.entity(in.sampler());
    out.filter = d.entity(in.filter());
    out.integrator = d.entity(in.integrator());
    if (in.has_renderer()) out.renderer = d.entity(in.renderer());
    if (in.has_volume_integrator()) out.volume_integrator = d.entity(in.volume_integrator());
    check(in.lights_size() <= kMostEntries && in.area_lights_size() <= kMostEntries,
          "too many lights");
    for (const proto::SceneLight& l : in.lights()) {
      LightDesc light;
      static_cast<Entity&>(light) = d.entity(l.entity());
      light.light_to_world = Decoder::transform(l.light_to_world());
      out.lights.push_back(std::move(light));
    }
    for (const proto::SceneEntity& a : in.area_lights()) out.area_lights.push_back(d.entity(a));
    return out;
  } catch (const Malformed& e) {
    return Result<SceneDescription>::failure("malformed scene description: " + e.why);
  }
}

std::string encode(const SceneDescription& scene) {
  proto::SceneDescription message;
  to_proto(scene, message);
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    message.SerializeToCodedStream(&coded);
  }
  return bytes;
}

Result<SceneDescription> decode_scene(std::span<const std::byte> bytes) {
  proto::SceneDescription message;
  if (bytes.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()) ||
      !message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    return Result<SceneDescription>::failure(
        "malformed scene description: no protobuf message of this kind");
  return from_proto(message);
}

}  // namespace cloudrenderer
