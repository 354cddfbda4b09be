// pbrt-v4: names are of the whole scene, and may be used before what they name is made.
#include <algorithm>
#include <array>
#include <ranges>
#include <set>
#include <string_view>

#include "scene/param_make.h"
#include "scene/scene_builder.h"

namespace cloudrenderer {

namespace {
// In front of the name of a texture that is not there yet: no name of a file begins so.
constexpr char kLaterFloat = '\1', kLaterSpectrum = '\2';
}  // namespace

std::string SceneBuilder::later_texture(const std::string& name, bool wants_float) {
  return (wants_float ? kLaterFloat : kLaterSpectrum) + name;
}

std::shared_ptr<MaterialSource> SceneBuilder::expect_material(GraphicsState& state, const std::string& name,
                                                              const FileLocation& where) {
  auto source = std::make_shared<MaterialSource>();
  source->entity.type = "\1" + name;  // a key like no other
  source->entity.location = where;
  source->textures_resolved = true;
  source->expected = true;
  state.named_materials.set(name, source, true);
  expected_.push_back({name, source});
  return source;
}

void SceneBuilder::fulfil(MaterialSource& expected, const MaterialSource& made) {
  expected.entity = made.entity;
  expected.object_to_world = made.object_to_world;
  expected.textures_resolved = made.textures_resolved;
  expected.expected = false;
  for (const MaterialId id : expected.interned) {
    MaterialDesc& material = scene_.materials[id.value];
    static_cast<Entity&>(material) = made.entity;
    material.object_to_world = made.object_to_world;
    for (const Param& p : material.params.all()) p.used = false;
  }
}

void SceneBuilder::define_material(GraphicsState& state, const std::string& name, std::shared_ptr<MaterialSource> made) {
  const auto* there = state.named_materials.find(name);
  if (there && (*there)->expected)
    fulfil(**there, *made);
  else
    state.named_materials.set(name, std::move(made), is_v4_);
}

void SceneBuilder::finish(const GraphicsState& state) {
  // These of pbrt-v3 put light into the pixel that it falls into.
  if (scene_.dialect == Dialect::v3 && !is_v4_ && (scene_.integrator.type == "sppm" || scene_.integrator.type == "mlt")) {
    if (scene_.filter.location.file && scene_.filter.type != "box")
      warnings_.add(scene_.filter.location, "integrator \"" + scene_.integrator.type + "\" has no pixel filter in pbrt: \"box\" is used");
    scene_.filter = {};
    scene_.filter.type = "box";
  }
  for (const auto& [name, source] : expected_) {
    if (!source->expected) continue;
    warnings_.add(source->entity.location, "there is no material \"" + name + "\": diffuse is used");
    fulfil(*source, *default_material_);
  }
  for (MediumDesc& m : scene_.media) {
    if (m.type.empty() || m.type[0] != '\1') continue;
    warnings_.add(m.location, "there is no medium \"" + m.type.substr(1) + "\": vacuum is used");
    m.type = "homogeneous";
    for (const char* name : {"sigma_a", "sigma_s"}) m.params.add(make_rgb(name, Rgb(0.f), m.location));
  }
  for (MaterialDesc& material : scene_.materials) {
    ParamSet known;
    bool changed = false;
    for (const Param& given : material.params.all()) {
      Param p = given;
      const char first = p.type == ParamType::texture && !p.strings.empty() && !p.strings[0].empty() ? p.strings[0][0] : '\0';
      if (first == kLaterFloat || first == kLaterSpectrum) {
        changed = true;
        const std::string name = p.strings[0].substr(1);
        const std::string* found = find_texture(state, name, first == kLaterFloat);
        if (!found) {
          warn_no_texture(state, p, name);
          continue;
        }
        p.strings[0] = *found;
      }
      known.add(std::move(p));
    }
    if (changed) material.params = std::move(known);
  }
  let_shadows_pass();
  if (is_v4_) limit_albedos();
}

// pbrt-v4's spectrum pictures are of three kinds by their use, and those of albedos end at 1.
void SceneBuilder::limit_albedos() {
  std::set<std::string> unbounded;
  const auto add = [&](const Param& p) {
    if (p.type == ParamType::texture && !p.strings.empty()) unbounded.insert(p.strings[0]);
  };
  constexpr std::array<std::string_view, 5> kUnbounded{"eta", "k", "sigma_a", "sigma_s", "mfp"};
  for (const MaterialDesc& material : scene_.materials)
    for (const Param& p : material.params.all())  // of a layer: "conductor.eta"
      if (std::ranges::find(kUnbounded, std::string_view(p.name).substr(p.name.rfind('.') + 1)) != kUnbounded.end()) add(p);
  for (TextureDesc& texture : scene_.textures | std::views::reverse) {  // behind those that they are made of
    if (unbounded.contains(texture.name))
      for (const Param& p : texture.params.all()) add(p);
    else if (texture.type == "imagemap" && !texture.is_float)
      texture.params.add(make_bool("albedo", true, texture.location));
  }
}

void SceneBuilder::let_shadows_pass() {
  const std::string& type = scene_.integrator.type;
  if (scene_.dialect == Dialect::v2 || !scene_.media.empty() || (type != "volpath" && type != "bdpt" && type != "mlt")) return;
  if (std::ranges::none_of(scene_.materials, [](const MaterialDesc& m) { return m.type == "none"; })) return;
  MediumDesc vacuum;
  vacuum.type = "homogeneous";
  vacuum.location = scene_.integrator.location;
  for (const char* name : {"sigma_a", "sigma_s"}) vacuum.params.add(make_rgb(name, Rgb(0.f), vacuum.location));
  scene_.media.push_back(std::move(vacuum));
}

}  // namespace cloudrenderer
