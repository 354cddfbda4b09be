#include "scene/scene_text.h"

#include <array>
#include <charconv>
#include <cmath>
#include <ostream>

#include "scene/material_order.h"

namespace cloudrenderer {

namespace {

// pbrt-v2 has no points and vectors of two dimensions.
std::string_view type_word(ParamType type, Dialect dialect) {
  const bool flat = type == ParamType::point2 || type == ParamType::vector2;
  return dialect == Dialect::v2 && flat ? "float" : type_word(type);
}

void write_param(std::ostream& out, const Param& p, Dialect dialect) {
  write_quoted(out, std::string(type_word(p.type, dialect)) + " " + p.name);
  out << " [";
  constexpr std::size_t kPerLine = 12;  // keeps lines of big arrays readable
  const auto separate = [&](std::size_t i) {
    out << (i != 0 && i % kPerLine == 0 ? "\n    " : " ");
  };
  for (std::size_t i = 0; i < p.reals.size(); ++i) {
    separate(i);
    write_float(out, p.reals[i]);
  }
  for (std::size_t i = 0; i < p.integers.size(); ++i) {
    separate(i);
    if (p.type == ParamType::boolean)
      out << (p.integers[i] ? "\"true\"" : "\"false\"");
    else
      out << p.integers[i];
  }
  for (std::size_t i = 0; i < p.strings.size(); ++i) {
    separate(i);
    write_quoted(out, p.strings[i]);
  }
  out << " ]";
}

// In a mix the materials stand as numbers; in text they have names.
ParamSet with_material_names(const ParamSet& params) {
  ParamSet out;
  for (Param p : params.all()) {
    if (p.name == "namedmaterial1" || p.name == "namedmaterial2")
      for (std::string& s : p.strings) s.insert(s.begin(), 'm');
    out.add(std::move(p));
  }
  return out;
}

}  // namespace

void write_float(std::ostream& out, float v) {
  if (!std::isfinite(v)) {  // pbrt has no word for it, and reads this as infinity
    out << (std::isnan(v) ? "0" : v < 0 ? "-1e39" : "1e39");
    return;
  }
  std::array<char, 32> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), v).ptr;
  out.write(buffer.data(), end - buffer.data());
}

void write_quoted(std::ostream& out, std::string_view text) {
  out << '"';
  for (const char c : text) {
    if (c == '"' || c == '\\')
      out << '\\' << c;
    else if (c == '\n')
      out << "\\n";
    else
      out << c;
  }
  out << '"';
}

void write_transform(std::ostream& out, const Transform& t) {
  out << "Transform [";
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r) {
      out << ' ';
      write_float(out, t.matrix()[c][r]);
    }
  out << " ]\n";
}

void write_motion(std::ostream& out, const Transform& start, const Transform& end) {
  out << "ActiveTransform StartTime\n";
  write_transform(out, start);
  out << "ActiveTransform EndTime\n";
  write_transform(out, end);
  out << "ActiveTransform All\n";
}

void write_params(std::ostream& out, const ParamSet& params, Dialect dialect) {
  for (const Param& p : params.all()) {
    out << "  ";
    write_param(out, p, dialect);
    out << '\n';
  }
}

void write_entity(std::ostream& out, std::string_view directive, const Entity& entity,
                  Dialect dialect) {
  out << directive << ' ';
  write_quoted(out, entity.type);
  out << '\n';
  write_params(out, entity.params, dialect);
}

namespace {

std::string medium_name(MediumId id) { return id ? "n" + std::to_string(id.value) : ""; }

void write_medium_interface(std::ostream& out, MediumId inside, MediumId outside) {
  out << "MediumInterface ";
  write_quoted(out, medium_name(inside));
  out << ' ';
  write_quoted(out, medium_name(outside));
  out << '\n';
}

// Before everything else, since the camera may stand in one of them.
void write_named_media(std::ostream& out, const SceneDescription& scene) {
  for (std::size_t i = 0; i < scene.media.size(); ++i) {
    const MediumDesc& m = scene.media[i];
    write_transform(out, m.medium_to_world);
    out << "MakeNamedMedium ";
    write_quoted(out, medium_name(MediumId(static_cast<std::uint32_t>(i))));
    if (is_grid(m, scene.dialect)) {  // its densities are in the parts
      out << " \"string type\" \"homogeneous\" \"rgb sigma_a\" [0 0 0] \"rgb sigma_s\" [0 0 0]\n";
    } else {
      out << " \"string type\" ";
      write_quoted(out, m.type);
      out << '\n';
      write_params(out, m.params, scene.dialect);
    }
    out << "Identity\n";
  }
  if (scene.camera.medium) write_medium_interface(out, scene.camera.medium, scene.camera.medium);
}

}  // namespace

void write_options(std::ostream& out, const SceneDescription& scene) {
  const Dialect d = scene.dialect;
  if (d == Dialect::v3) write_named_media(out, scene);
  if (scene.transform_start != 0.f || scene.transform_end != 1.f) {
    out << "TransformTimes ";
    write_float(out, scene.transform_start);
    out << ' ';
    write_float(out, scene.transform_end);
    out << '\n';
  }
  if (scene.camera.motion)
    write_motion(out, scene.camera.world_to_camera, scene.camera.motion->end);
  else if (!scene.camera.world_to_camera.is_identity())
    write_transform(out, scene.camera.world_to_camera);
  write_entity(out, "Camera", scene.camera, d);
  write_entity(out, "Film", scene.film, d);
  write_entity(out, "Sampler", scene.sampler, d);
  write_entity(out, "PixelFilter", scene.filter, d);
  write_entity(out, d == Dialect::v2 ? "SurfaceIntegrator" : "Integrator", scene.integrator, d);
  if (scene.renderer) write_entity(out, "Renderer", *scene.renderer, d);
  if (scene.volume_integrator) write_entity(out, "VolumeIntegrator", *scene.volume_integrator, d);
}

void write_world_head(std::ostream& out, const SceneDescription& scene) {
  out << "WorldBegin\n";
  for (const TextureDesc& t : scene.textures) {
    const bool moved = !t.texture_to_world.is_identity();
    if (moved) {
      out << "TransformBegin\n";
      write_transform(out, t.texture_to_world);
    }
    out << "Texture ";
    write_quoted(out, t.name);
    write_entity(out, t.is_float ? " \"float\"" : " \"spectrum\"", t, scene.dialect);
    if (moved) out << "TransformEnd\n";
  }
  for (const std::uint32_t i : material_order(scene)) {
    const MaterialDesc& m = scene.materials[i];
    out << "MakeNamedMaterial ";
    write_quoted(out, material_name(MaterialId(i)));
    out << " \"string type\" ";
    write_quoted(out, m.type);
    out << '\n';
    write_params(out, m.type == "mix" ? with_material_names(m.params) : m.params, scene.dialect);
  }
  if (scene.dialect == Dialect::v2)
    for (const MediumDesc& m : scene.media) {
      if (is_grid(m, scene.dialect)) continue;  // its densities are in the parts
      out << "AttributeBegin\n";
      write_transform(out, m.medium_to_world);
      write_entity(out, "Volume", m, scene.dialect);
      out << "AttributeEnd\n";
    }
  for (const LightDesc& l : scene.lights) {
    out << "AttributeBegin\n";
    if (!l.light_to_world.is_identity()) write_transform(out, l.light_to_world);
    write_entity(out, "LightSource", l, scene.dialect);
    out << "AttributeEnd\n";
  }
}

std::string material_name(MaterialId id) {
  std::string name = std::to_string(id.value);
  name.insert(name.begin(), 'm');
  return name;
}

void write_material_use(std::ostream& out, const SceneDescription& scene, MaterialId id) {
  if (id.value >= scene.materials.size()) {
    out << "Material \"matte\"\n";
    return;
  }
  const MaterialDesc& material = scene.materials[id.value];
  if (scene.camera.medium || material.is_interface())
    write_medium_interface(out, material.inside, material.outside);
  // pbrt-v3 knows nothing of the null material by another name.
  const std::string& type = scene.materials[id.value].type;
  if (type == "none" || type.empty()) {
    out << "Material \"none\"\n";
    return;
  }
  out << "NamedMaterial ";
  write_quoted(out, material_name(id));
  out << '\n';
}

void write_area_light(std::ostream& out, const SceneDescription& scene, AreaLightId id) {
  if (id.value >= scene.area_lights.size()) return;
  Entity light = scene.area_lights[id.value];
  light.params.take("onlyseen");  // the object around it says so
  write_entity(out, "AreaLightSource", light, scene.dialect);
}

}  // namespace cloudrenderer
