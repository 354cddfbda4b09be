// The directives that describe something with parameters.
#include "scene/parser.h"

#include "scene/param_make.h"

namespace cloudrenderer {

// Before the world there are no textures to refer to: such parameters go, with a warning.
Entity Parser::read_option(const Token& t, bool reads_files) {
  Entity e = read_entity(t, reads_files);
  e.params = builder_.resolve_textures(GraphicsState{}, e, std::nullopt);
  return e;
}

void Parser::camera(const Token& t) {
  CameraDesc camera;
  static_cast<Entity&>(camera) = read_option(t, true);
  if (is_v4()) v4_.camera(camera);
  if (!in_options(t)) return;
  camera.world_to_camera = to_transform(ctm_.start);
  if (!camera.world_to_camera.is_invertible())
    throw SceneError(camera.location, "the transformation of the camera cannot be inverted");
  camera.medium = state_.outside;  // of pbrt-v4
  camera.motion = motion(camera.location, "camera");
  coordinate_systems_["camera"] = ctm_.inverse();
  builder_.scene().camera = std::move(camera);
}

void Parser::film(const Token& t) {
  Entity e = read_option(t, false);
  if (is_v4()) v4_.film(e);
  if (!state_.color_space.is_working()) e.params.add(make_string("colorspace", std::string(state_.color_space.name()), e.location));
  if (in_options(t)) builder_.scene().film = std::move(e);
}

void Parser::sampler(const Token& t) {
  Entity e = read_option(t, true);
  if (is_v4()) v4_.sampler(e);
  if (in_options(t)) builder_.scene().sampler = std::move(e);
}

void Parser::pixel_filter(const Token& t) {
  Entity e = read_option(t, true);
  if (is_v4()) v4_.pixel_filter(e);
  if (in_options(t)) builder_.scene().filter = std::move(e);
}

void Parser::integrator(const Token& t) {
  Entity e = read_option(t, true);
  if (is_v4()) v4_.integrator(e);
  if (in_options(t)) builder_.scene().integrator = std::move(e);
}

void Parser::renderer(const Token& t) {
  Entity e = read_option(t, false);
  if (!in_options(t)) return;
  if (!find_language("Renderer", e.type)) builder_.warn_once(e.location, "unknown renderer \"" + e.type + "\": the surface integrator is used");
  builder_.scene().renderer = std::move(e);
}

void Parser::volume_integrator(const Token& t) {
  Entity e = read_option(t, true);
  if (in_options(t)) builder_.scene().volume_integrator = std::move(e);
}

void Parser::accelerator(const Token& t) {
  const Entity e = read_entity(t);  // Embree is the accelerator
  if (in_options(t) && !find_language("Accelerator", e.type)) builder_.warn_once(e.location, "unknown accelerator \"" + e.type + "\": ignored");
}

void Parser::light_source(const Token& t) {
  Entity e = read_entity(t);
  if (!in_world(t)) return;
  stands_still(e.location, "light");
  DMat4 to_world = ctm_.start;
  if (is_v4()) v4_.light(e, to_world);
  builder_.add_light(state_, std::move(e), to_world);
}

void Parser::area_light_source(const Token& t) {
  Entity e = read_entity(t);
  if (!in_world(t)) return;
  if (is_v4()) v4_.area_light(e);
  e.params = builder_.resolve_textures(state_, e, std::nullopt);
  state_.area_light = std::make_shared<AreaLightSource>();
  state_.area_light->entity = std::move(e);
}

void Parser::material(const Token& t) {
  Entity e = read_entity(t);
  if (!in_world(t)) return;
  if (is_v4()) {
    v4_.material(e);
    builder_.take_normal_map(state_, e);
  }
  state_.material = builder_.make_material(state_, std::move(e), ctm_.start, false);
  state_.material_name.clear();
}

void Parser::make_named_material(const Token& t) {
  Entity e = read_entity(t);  // the "type" read here is the name
  if (!in_world(t)) return;
  const std::string name = e.type;
  if (!e.params.has("type"))
    warnings_.add(e.location, "MakeNamedMaterial without \"string type\": matte is used");
  e.type = e.params.string("type", is_v4() ? "diffuse" : "matte");
  ParamSet others;
  for (const Param& p : e.params.all())
    if (p.name != "type") others.add(p);
  e.params = std::move(others);
  // pbrt-v2 takes what is not given from the material that is set.
  if (builder_.scene().dialect == Dialect::v2 && state_.material)
    for (const Param& p : state_.material->entity.params.all())
      if (!e.params.has(p.name)) {
        e.params.add(p);
        e.params.find(p.name)->used = true;
      }
  if (is_v4()) {
    v4_.material(e);
    builder_.take_normal_map(state_, e);
  }
  builder_.define_material(state_, name, builder_.make_material(state_, std::move(e), ctm_.start, true));
}

void Parser::named_material(const Token& t) {
  const FileLocation where = location(t);
  const std::string name = read_string("the name of a material");
  if (!in_world(t)) return;
  if (builder_.scene().dialect == Dialect::v2) {
    state_.material_name = name;
  } else if (const auto* found = state_.named_materials.find(name)) {
    state_.material = *found;
  } else if (is_v4()) {
    state_.material = builder_.expect_material(state_, name, where);
  } else {
    warnings_.add(where, "there is no material \"" + name + "\": the one before it is used");
  }
}

void Parser::texture(const Token& t) {
  const std::string name = read_string("the name of a texture");
  const Token kind = lexer().peek();
  const std::string type = read_string("float or spectrum");
  Entity e = read_entity(t);
  if (!in_world(t)) return;
  if (type != "float" && type != "spectrum" && type != "color") {
    const std::string what = "a texture must be \"float\" or \"spectrum\", found \"" + type + "\"";
    if (is_v4()) throw SceneError(location(kind), what);
    builder_.warn_once(location(kind), what + ": ignored, as in pbrt");
    return;
  }
  if (!is_v4() && !find_language("Texture", e.type)) {
    builder_.warn_once(e.location, "unknown texture \"" + e.type + "\", expected one of " + known_types("Texture", builder_.scene().dialect) +
                                       ": what refers to it takes its default");
    return;
  }
  stands_still(e.location, "texture");
  DMat4 to_world = ctm_.start;
  if (is_v4()) v4_.texture(e, to_world);
  builder_.add_texture(state_, name, type == "float", std::move(e), to_world);
}

void Parser::shape(const Token& t) {
  ShapeDesc shape;
  static_cast<Entity&>(shape) = read_entity(t);
  if (!in_world(t)) return;
  shape.object_to_world = to_transform(ctm_.start);
  if (!shape.object_to_world.is_invertible()) {
    builder_.warn_once(shape.location,
                       "the transformation of the shape cannot be inverted: ignored");
    return;
  }
  shape.motion = motion(shape.location, "shape");
  shape.reverse_orientation = state_.reverse_orientation;
  shape.object = open_object_;
  if (is_v4())
    builder_.mask_by_chance(state_, shape);
  else
    builder_.hide_lamp(state_, shape);
  if (builder_.scene().dialect == Dialect::v3 && !is_v4()) builder_.lift_shadow(state_, shape);
  builder_.finish_shape(state_, shape);
  if (is_v4() && shape.area_light && shape.material &&
      builder_.scene().materials[shape.material.value].type == "none") {
    builder_.warn_once(shape.location, "area lights on surfaces without material do not shine, as in pbrt: ignored");
    shape.area_light = {};
  }
  sink_.shape(std::move(shape), builder_.scene());
}

void Parser::make_named_medium(const Token& t) {
  Entity e = read_entity(t);  // the "type" read here is the name
  const std::string name = e.type;
  e.type = e.params.string("type", "");
  ParamSet others;
  for (const Param& p : e.params.all())
    if (p.name != "type") others.add(p);
  e.params = std::move(others);
  e.params = builder_.resolve_textures(state_, e, std::nullopt);
  if (is_v4()) v4_.medium(e);
  if (auto grid = builder_.add_named_medium(name, std::move(e), ctm_.start)) sink_.grid(std::move(*grid));
}

void Parser::medium_interface(const Token& t) {
  const FileLocation where = location(t);
  const std::string inside = read_string("the name of a medium");
  // One name stands for both sides.
  const std::string outside = lexer().peek().kind == Token::Kind::string ? read_string("the name of a medium") : inside;
  state_.inside = builder_.find_medium(inside, where);
  state_.outside = builder_.find_medium(outside, where);
}

void Parser::volume(const Token& t) {
  Entity e = read_entity(t);
  if (!in_world(t)) return;
  e.params = builder_.resolve_textures(state_, e, std::nullopt);
  if (auto grid = builder_.add_volume(std::move(e), ctm_.start)) sink_.grid(std::move(*grid));
}

void Parser::reverse_orientation(const Token& t) {
  if (in_world(t)) state_.reverse_orientation = !state_.reverse_orientation;
}

}  // namespace cloudrenderer
