#include "scene/scene_builder.h"

#include <limits>

#include <algorithm>
#include <array>
#include <span>

#include "scene/param_make.h"

namespace cloudrenderer {

namespace {

// Path segments keep the number of their medium in 16 bits.
constexpr std::size_t kMostMedia = 65000;

bool contains(std::span<const std::string_view> words, std::string_view word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

// Every material that pbrt-v2 or pbrt-v3 knows.
constexpr auto kMaterials = std::to_array<std::string_view>(
    {"matte", "plastic", "glass", "uber", "metal", "mirror", "substrate", "translucent", "mix",
     "none", "", "coateddiffuse", "coatedconductor", "thindielectric", "fourier", "measured", "shinymetal", "kdsubsurface", "subsurface", "disney",
     "hair"});

// Parameters that materials have and a shape may override. "filename" and "alpha" mean other things
// on shapes.
constexpr auto kMaterialParams = std::to_array<std::string_view>({"Kd",
                                                                  "Ks",
                                                                  "Kr",
                                                                  "Kt",
                                                                  "sigma",
                                                                  "roughness",
                                                                  "uroughness",
                                                                  "vroughness",
                                                                  "remaproughness",
                                                                  "bumpmap",
                                                                  "index",
                                                                  "eta",
                                                                  "k",
                                                                  "opacity",
                                                                  "reflect",
                                                                  "transmit",
                                                                  "amount",
                                                                  "bsdffile",
                                                                  "sigma_a",
                                                                  "sigma_s",
                                                                  "sigma_prime_s",
                                                                  "g",
                                                                  "meanfreepath",
                                                                  "mfp",
                                                                  "color",
                                                                  "metallic",
                                                                  "speculartint",
                                                                  "anisotropic",
                                                                  "sheen",
                                                                  "sheentint",
                                                                  "clearcoat",
                                                                  "clearcoatgloss",
                                                                  "spectrans",
                                                                  "scatterdistance",
                                                                  "thin",
                                                                  "flatness",
                                                                  "difftrans",
                                                                  "eumelanin",
                                                                  "pheomelanin",
                                                                  "beta_m",
                                                                  "beta_n"});

// Parameters that want a float texture where a float and a spectrum texture have the same name.
constexpr auto kFloatTextureParams = std::to_array<std::string_view>(
    {"roughness", "uroughness", "vroughness", "sigma", "bumpmap", "index", "alpha", "shadowalpha",
     "displacement", "g", "metallic", "anisotropic", "sheen", "clearcoat", "speculartint",
     "sheentint", "clearcoatgloss", "spectrans", "flatness", "difftrans", "eumelanin", "pheomelanin",
     "beta_m", "beta_n", "thickness", "interface.eta", "interface.uroughness", "interface.vroughness",
     "conductor.uroughness", "conductor.vroughness"});

void append_bytes(std::string& key, const void* data, std::size_t bytes) {
  const auto n = static_cast<std::uint64_t>(bytes);
  key.append(reinterpret_cast<const char*>(&n), sizeof n);
  key.append(static_cast<const char*>(data), bytes);
}

// All that distinguishes one material from another, as bytes.
std::string material_key(const MaterialDesc& material) {
  const std::string& type = material.type;
  std::string key;
  for (const MediumId medium : {material.inside, material.outside})
    append_bytes(key, &medium.value, sizeof medium.value);
  append_bytes(key, type.data(), type.size());
  for (const Param& p : material.params.all()) {
    key += static_cast<char>(p.type);
    append_bytes(key, p.name.data(), p.name.size());
    append_bytes(key, p.reals.view().data(), p.reals.view().size_bytes());
    append_bytes(key, p.integers.view().data(), p.integers.view().size_bytes());
    for (const std::string& s : p.strings) append_bytes(key, s.data(), s.size());
  }
  return key;
}

bool has_textures(const ParamSet& params) {
  return std::any_of(params.all().begin(), params.all().end(),
                     [](const Param& p) { return p.type == ParamType::texture; });
}

Entity entity_of(std::string type) {
  Entity e;
  e.type = std::move(type);
  return e;
}

}  // namespace

SceneBuilder::SceneBuilder(Dialect dialect, std::string source, Warnings& warnings)
    : is_v4_(dialect == Dialect::v4), warnings_(warnings) {
  const bool v2 = dialect == Dialect::v2;
  scene_.dialect = v2 ? Dialect::v2 : Dialect::v3;
  scene_.source = std::move(source);
  scene_.camera.type = "perspective";
  scene_.film = entity_of("image");
  scene_.sampler = entity_of(v2 ? "lowdiscrepancy" : "halton");
  scene_.filter = entity_of("box");
  scene_.integrator = entity_of(v2 ? "directlighting" : "path");
  if (dialect == Dialect::v4) {
    scene_.sampler = entity_of("sobol");
    scene_.filter = entity_of("gaussian");
    for (const char* radius : {"xwidth", "ywidth"})
      scene_.filter.params.add(make_real(radius, 1.5f, {}));
    scene_.integrator = entity_of("volpath");
  }
  default_material_ = std::make_shared<MaterialSource>();
  default_material_->entity = entity_of("matte");
  default_material_->textures_resolved = !v2;
}

void SceneBuilder::warn_once(const FileLocation& where, const std::string& message) {
  if (warned_.insert(message).second) warnings_.add(where, message);
}

ParamSet SceneBuilder::resolve_textures(const GraphicsState& state, const Entity& entity,
                                        std::optional<bool> is_float, bool may_come_later) {
  if (!has_textures(entity.params)) return entity.params;
  ParamSet out;
  for (const Param& given : entity.params.all()) {
    if (given.type != ParamType::texture) {
      out.add(given);
      continue;
    }
    Param p = given;
    if (p.strings.size() != 1)
      throw SceneError(p.location,
                       "the texture parameter \"" + p.name + "\" must name one texture");
    // "amount" of a mix texture is always a float; "eta" is a spectrum for metal only.
    const bool wants_float = is_float ? *is_float || p.name == "amount"
                                      : contains(kFloatTextureParams, p.name) ||
                                            (p.name == "eta" && entity.type != "metal");
    if (const std::string* found = find_texture(state, p.strings[0], wants_float)) {
      p.strings[0] = *found;
      p.reals = {};
    } else if (may_come_later) {
      p.strings[0] = later_texture(p.strings[0], wants_float);
    } else {
      warn_no_texture(state, p, p.strings[0]);
      if (p.reals.empty()) continue;
      p.type = p.reals.size() % 3 == 0 ? ParamType::rgb : ParamType::real;  // ParamReader::read_more
      p.strings.clear();
    }
    out.add(std::move(p));
  }
  return out;
}

const std::string* SceneBuilder::find_texture(const GraphicsState& state, const std::string& name, bool wants_float) const {
  const std::string* as_float = state.float_textures.find(name);
  const std::string* as_spectrum = state.spectrum_textures.find(name);
  const std::string* const own = wants_float ? as_float : as_spectrum;
  return own || !is_v4_ ? own : wants_float ? as_spectrum : as_float;
}

void SceneBuilder::warn_no_texture(const GraphicsState& state, const Param& p, const std::string& name) {
  const bool is_float = state.float_textures.find(name) != nullptr;
  if (is_float || state.spectrum_textures.find(name)) {
    warn_once(p.location, std::string("the texture \"") + name + "\" is of type " + (is_float ? "float, not spectrum" : "spectrum, not float") +
                              ": the parameter \"" + p.name + "\" is ignored, as in pbrt");
    return;
  }
  // In pbrt-v4 the parameter had another name in the file.
  warn_once(p.location, "there is no texture \"" + name + "\": the parameter " + (is_v4_ ? "" : '"' + p.name + "\" ") + "is ignored");
}

void SceneBuilder::add_texture(GraphicsState& state, const std::string& name, bool is_float,
                               Entity entity, const DMat4& ctm) {
  TextureDesc texture;
  entity.params = resolve_textures(state, entity, is_float);
  static_cast<Entity&>(texture) = std::move(entity);
  texture.is_float = is_float;
  texture.texture_to_world = to_transform(ctm);
  texture.name = name;
  while (!texture_names_.insert(texture.name).second)
    texture.name = name + "#" + std::to_string(++texture_counters_[name] + 1);
  (is_float ? state.float_textures : state.spectrum_textures).set(name, texture.name, is_v4_);
  scene_.textures.push_back(std::move(texture));
}

void SceneBuilder::take_normal_map(GraphicsState& state, Entity& material) {
  const std::string path = material.params.string("normalmap", "");
  const auto given = material.params.take("normalmap");
  if (path.empty()) return;
  const std::string name = "normal map " + path;
  if (!state.spectrum_textures.find(name)) {
    Entity image;
    image.type = "imagemap";
    image.location = given->location;
    image.params.add(make_string("filename", path, given->location));
    image.params.add(make_string("encoding", "linear", given->location));
    add_texture(state, name, false, std::move(image), DMat4(1.0));
  }
  Param texture = make_param(ParamType::texture, "normalmap", given->location);
  texture.strings = {name};
  material.params.add(std::move(texture));
}

// pbrt-v4 takes a mask that is constantly 0 from lamps, however it is written.
bool SceneBuilder::is_zero_texture(const GraphicsState& state, const Param& mask) const {
  if (mask.type != ParamType::texture || mask.strings.size() != 1) return false;
  const std::string* name = state.float_textures.find(mask.strings[0]);
  if (!name) return false;
  const auto found = std::ranges::find(scene_.textures, *name, &TextureDesc::name);
  return found != scene_.textures.end() && found->type == "constant" && found->params.real("value", 1.f) == 0.f;
}

void SceneBuilder::mask_by_chance(GraphicsState& state, Entity& shape) {
  const Param* given = shape.params.find("alpha");
  if (!given) return;
  if (state.area_light && is_zero_texture(state, *given)) {
    shape.params.add(make_real("alpha", 0.f, given->location));
    given = shape.params.find("alpha");
  }
  if (given->type == ParamType::real && given->reals.size() == 1 && given->reals[0] >= 1.f) {
    shape.params.take("alpha");  // nothing passes
    return;
  }
  const bool texture = given->type == ParamType::texture && given->strings.size() == 1;
  // What cannot be seen at all is left out by others, but shines where it is a light.
  const float least = state.area_light ? 0.f : std::numeric_limits<float>::min();
  if (!texture && !(given->reals.size() == 1 && given->reals[0] >= least && given->reals[0] < 1.f)) return;
  const std::string name = "alpha of " + (texture ? "texture " + given->strings[0] : std::to_string(given->reals[0]));
  Param mask = make_param(ParamType::texture, "alpha", given->location);
  mask.strings = {name};
  if (!state.float_textures.find(name)) {
    if (texture && !state.float_textures.find(given->strings[0])) return;  // others say it
    Entity scaled;
    scaled.type = "scale";
    scaled.location = given->location;
    Param value = *given;
    value.name = "tex";
    scaled.params.add(std::move(value));
    scaled.params.add(make_bool("chance", true, given->location));
    add_texture(state, name, true, std::move(scaled), DMat4(1.0));
  }
  const bool invisible = !texture && given->reals[0] == 0.f;
  if (invisible) shape.params.add(make_bool("invisible", true, mask.location));
  shape.params.add(std::move(mask));
}

void SceneBuilder::hide_lamp(GraphicsState& state, Entity& shape) {
  const Param* alpha = shape.params.find("alpha");
  const bool hidden = alpha && alpha->type == ParamType::real && alpha->reals.size() == 1 && alpha->reals[0] == 0.f;
  if (!state.area_light || !hidden || (shape.type != "trianglemesh" && shape.type != "plymesh")) return;
  shape.params.add(make_bool("weighed", true, shape.location));
  mask_by_chance(state, shape);
}

void SceneBuilder::lift_shadow(GraphicsState& state, Entity& shape) {
  const Param* given = shape.params.find("shadowalpha");
  const bool none = given && given->type == ParamType::real && given->reals.size() == 1 && given->reals[0] == 0.f;
  if (!none || (shape.type != "trianglemesh" && shape.type != "plymesh")) return;
  const std::string name = "shadowalpha 0";
  if (!state.float_textures.find(name)) {
    Entity zero;
    zero.type = "constant";
    zero.location = given->location;
    zero.params.add(make_real("value", 0.f, given->location));
    add_texture(state, name, true, std::move(zero), DMat4(1.0));
  }
  Param mask = make_param(ParamType::texture, "shadowalpha", given->location);
  mask.strings = {name};
  shape.params.add(std::move(mask));
}

void SceneBuilder::add_light(const GraphicsState& state, Entity entity, const DMat4& ctm) {
  LightDesc light;
  entity.params = resolve_textures(state, entity, std::nullopt);
  static_cast<Entity&>(light) = std::move(entity);
  light.light_to_world = to_transform(ctm);
  if (!light.light_to_world.is_invertible())
    throw SceneError(light.location, "the transformation of the light cannot be inverted");
  scene_.lights.push_back(std::move(light));
}

std::optional<GridDesc> SceneBuilder::add_volume(Entity entity, const DMat4& ctm) {
  scene_.media.emplace_back();
  return put_medium(MediumId(static_cast<std::uint32_t>(scene_.media.size() - 1)), std::move(entity), ctm);
}

std::optional<GridDesc> SceneBuilder::put_medium(MediumId id, Entity entity, const DMat4& ctm) {
  MediumDesc medium;
  static_cast<Entity&>(medium) = std::move(entity);
  medium.medium_to_world = to_transform(ctm);
  if (!medium.medium_to_world.is_invertible())
    throw SceneError(medium.location, "the transformation of the volume cannot be inverted");
  std::optional<GridDesc> grid = take_grid(medium, id, scene_.dialect);
  scene_.media[id.value] = std::move(medium);
  return grid;
}

void SceneBuilder::check_room_for_media(const FileLocation& where) const {
  if (scene_.media.size() >= kMostMedia) throw SceneError(where, "more than " + std::to_string(kMostMedia) + " participating media");
}

std::optional<GridDesc> SceneBuilder::add_named_medium(const std::string& name, Entity entity, const DMat4& ctm) {
  check_room_for_media(entity.location);
  const auto there = media_.find(name);
  if (there != media_.end() && scene_.media[there->second.value].type == '\1' + name) return put_medium(there->second, std::move(entity), ctm);
  media_[name] = MediumId(static_cast<std::uint32_t>(scene_.media.size()));
  return add_volume(std::move(entity), ctm);
}

MediumId SceneBuilder::find_medium(const std::string& name, const FileLocation& where) {
  if (name.empty()) return {};
  const auto found = media_.find(name);
  if (found != media_.end()) return found->second;
  check_room_for_media(where);
  const MediumId id(static_cast<std::uint32_t>(scene_.media.size()));
  Entity later;
  later.type = '\1' + name;  // until it is made, see finish()
  later.location = where;
  static_cast<Entity&>(scene_.media.emplace_back()) = std::move(later);
  return media_[name] = id;
}

std::shared_ptr<MaterialSource> SceneBuilder::make_material(const GraphicsState& state,
                                                            Entity entity, const DMat4& ctm,
                                                            bool is_named) {
  auto source = std::make_shared<MaterialSource>();
  // What only pbrt-v2 has, pbrt-v3 does not know.
  const bool v2_only = scene_.dialect == Dialect::v3 && !is_v4_ && (entity.type == "shinymetal" || entity.type == "measured");
  if (v2_only || !contains(kMaterials, entity.type)) {
    warnings_.add(entity.location,
                  "the material \"" + entity.type + "\" is unknown: " + default_name() + " is used");
    entity.type = "matte";
    if (is_v4_) entity.params = {};  // whose names are others
  }
  if (entity.type.empty()) entity.type = "none";
  if (entity.type == "mix") {
    for (const char* name : {"namedmaterial1", "namedmaterial2"}) {
      const std::string mixed = entity.params.string(name, "");
      const auto* found = state.named_materials.find(mixed);
      if (found && (*found)->expected) found = nullptr;  // what is mixed must be there
      if (!found)
        warnings_.add(entity.location, "there is no material \"" + mixed + "\"" +
                                           (is_v4_ ? std::string() : std::string(" for \"") + name + '"') + ": " + default_name() + " is mixed");
      const MaterialId id = intern(state, found ? **found : *default_material_, {});
      Param p;
      p.type = ParamType::string;
      p.name = name;
      p.location = entity.location;
      p.strings = {std::to_string(id.value)};
      entity.params.add(std::move(p));
    }
  }
  if (is_named || scene_.dialect == Dialect::v3) {
    entity.params = resolve_textures(state, entity, std::nullopt, is_v4_);
    source->textures_resolved = true;
  }
  source->entity = std::move(entity);
  source->object_to_world = to_transform(ctm);
  return source;
}

MaterialId SceneBuilder::intern(const GraphicsState& state, MaterialSource& source,
                                const ParamSet& overrides) {
  const bool is_interface = state.inside != state.outside;
  const bool as_it_is =
      !is_interface && overrides.empty() && (source.textures_resolved || !has_textures(source.entity.params));
  if (as_it_is && source.id) return source.id;

  MaterialDesc material;
  static_cast<Entity&>(material) = source.entity;
  material.object_to_world = source.object_to_world;
  if (is_interface) {
    material.inside = state.inside;
    material.outside = state.outside;
  }
  for (const Param& p : overrides.all()) material.params.add(p);
  if (!source.textures_resolved) material.params = resolve_textures(state, material, std::nullopt);
  const auto [it, is_new] =
      material_ids_.try_emplace(material_key(material),
                                MaterialId(static_cast<std::uint32_t>(scene_.materials.size())));
  if (is_new) {
    for (const Param& p : material.params.all()) p.used = false;
    scene_.materials.push_back(std::move(material));
  }
  if (as_it_is) source.id = it->second;
  if (is_new && source.expected) source.interned.push_back(it->second);
  return it->second;
}

MaterialId SceneBuilder::material_of(const GraphicsState& state, const ShapeDesc& shape) {
  MaterialSource* source = state.material ? state.material.get() : default_material_.get();
  bool named = false;
  if (!state.material_name.empty()) {
    if (const auto* found = state.named_materials.find(state.material_name)) {
      source = found->get();
      named = true;
    } else {
      warn_once(shape.location,
                "there is no material \"" + state.material_name + "\": the one before it is used");
    }
  }
  // In v2 a named material is made where it is named, out of reach of the shape's parameters.
  if (is_v4_ || (named && scene_.dialect == Dialect::v2)) return intern(state, *source, {});

  ParamSet overrides;
  for (const Param& p : shape.params.all()) {
    if (!contains(kMaterialParams, p.name)) continue;
    p.used = true;
    const Param* own = source->entity.params.find(p.name);
    // pbrt-v2 asks for textures first, the shape's and the material's, and only then for values.
    const bool hidden = scene_.dialect == Dialect::v2 && own && own->type == ParamType::texture &&
                        p.type != ParamType::texture;
    if (!hidden) overrides.add(p);
  }
  return intern(state, *source, overrides);
}

void SceneBuilder::finish_shape(const GraphicsState& state, ShapeDesc& shape) {
  // Before pbrt-v4 meshes alone have masks.
  if (!is_v4_ && shape.type != "trianglemesh" && shape.type != "plymesh")
    for (const char* mask : {"alpha", "shadowalpha"})
      if (const auto given = shape.params.take(mask))
        warn_once(given->location, "Shape \"" + shape.type + "\" has no \"" + mask + "\" before pbrt-v4: ignored");
  // v2 looks the material's textures up in this scope together with the shape's, so they keep their
  // names till then.
  if (scene_.dialect == Dialect::v3) shape.params = resolve_textures(state, shape, std::nullopt);
  shape.material = material_of(state, shape);
  if (scene_.dialect == Dialect::v2) shape.params = resolve_textures(state, shape, std::nullopt);

  if (state.area_light) {
    ShapeLight as;
    as.weighed = shape.params.take("weighed").has_value();
    as.invisible = shape.params.take("invisible").has_value();
    if (shape.object && is_v4_) {
      warn_once(shape.location, "area lights inside of objects do not shine: ignored");
    } else if (shape.motion) {
      warn_once(shape.location, "area lights on moving shapes do not shine, as in pbrt: ignored");
    } else {
      AreaLightSource& light = *state.area_light;
      static constexpr std::array<std::string_view, 4> kMeshes{"trianglemesh", "plymesh", "bilinearmesh", "loopsubdiv"};
      if (is_v4_ && light.entity.params.has("filename") && std::ranges::find(kMeshes, shape.type) == kMeshes.end())
        warn_once(shape.location, "a light's picture on a " + shape.type + ": its mean shines");
      if (shape.object) {
        warn_once(shape.location, "area lights inside of objects are seen, but light nothing, as in pbrt");
        as = {.only_seen = true};
      }
      if (shape.type == "bilinearmesh" && light.entity.params.has("power"))
        as.patches = std::max(1, static_cast<int>(shape.params.integers("indices").size() / 4));
      AreaLightId& id = light.ids[as];
      if (!id) {
        id = AreaLightId(static_cast<std::uint32_t>(scene_.area_lights.size()));
        scene_.area_lights.push_back(light.entity);
        ParamSet& params = scene_.area_lights.back().params;
        const auto tell = [&](const char* name, bool value) {
          if (value) params.add(make_bool(name, true, light.entity.location));
        };
        if (as.patches > 0) params.add(make_integer("patches", as.patches, light.entity.location));
        tell("invisible", as.invisible);
        tell("weighed", as.weighed);
        tell("onlyseen", as.only_seen);
      }
      shape.area_light = id;
    }
  }
}

}  // namespace cloudrenderer
