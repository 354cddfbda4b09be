#include "scene/parser.h"

#include <algorithm>
#include <filesystem>

#include "scene/dialect.h"

namespace cloudrenderer {

namespace {
constexpr std::size_t kDeepestInclude = 100;
}  // namespace

const std::map<std::string_view, Parser::Handler>& Parser::handlers() {
  static const std::map<std::string_view, Handler> table{
      {"Accelerator", &Parser::accelerator},
      {"ActiveTransform", &Parser::active_transform},
      {"AreaLightSource", &Parser::area_light_source},
      {"Attribute", &Parser::attribute},
      {"AttributeBegin", &Parser::attribute_begin},
      {"AttributeEnd", &Parser::attribute_end},
      {"Camera", &Parser::camera},
      {"ColorSpace", &Parser::color_space},
      {"ConcatTransform", &Parser::concat_transform},
      {"CoordSysTransform", &Parser::coord_sys_transform},
      {"CoordinateSystem", &Parser::coordinate_system},
      {"Film", &Parser::film},
      {"Identity", &Parser::identity},
      {"Import", &Parser::import_file},
      {"Include", &Parser::include},
      {"Integrator", &Parser::integrator},
      {"LightSource", &Parser::light_source},
      {"LookAt", &Parser::look_at_directive},
      {"MakeNamedMaterial", &Parser::make_named_material},
      {"MakeNamedMedium", &Parser::make_named_medium},
      {"Material", &Parser::material},
      {"MediumInterface", &Parser::medium_interface},
      {"NamedMaterial", &Parser::named_material},
      {"ObjectBegin", &Parser::object_begin},
      {"ObjectEnd", &Parser::object_end},
      {"ObjectInstance", &Parser::object_instance},
      {"Option", &Parser::option},
      {"PixelFilter", &Parser::pixel_filter},
      {"Renderer", &Parser::renderer},
      {"ReverseOrientation", &Parser::reverse_orientation},
      {"Rotate", &Parser::rotate_directive},
      {"Sampler", &Parser::sampler},
      {"Scale", &Parser::scale_directive},
      {"Shape", &Parser::shape},
      {"SurfaceIntegrator", &Parser::integrator},
      {"Texture", &Parser::texture},
      {"Transform", &Parser::transform},
      {"TransformBegin", &Parser::transform_begin},
      {"TransformEnd", &Parser::transform_end},
      {"TransformTimes", &Parser::transform_times},
      {"Translate", &Parser::translate_directive},
      {"Volume", &Parser::volume},
      {"VolumeIntegrator", &Parser::volume_integrator},
      {"WorldBegin", &Parser::world_begin},
      {"WorldEnd", &Parser::world_end},
  };
  return table;
}

std::vector<std::string> Parser::directives() {
  std::vector<std::string> out;
  for (const auto& [word, handler] : handlers()) out.emplace_back(word);
  return out;
}

Parser::Parser(const std::string& path, Dialect dialect, SceneSink& sink, Warnings& warnings, const ParseOptions& options)
    : dialect_(dialect),
      paths_(path, options.confine, options.files),
      sink_(sink),
      warnings_(warnings),
      use_(options.use),
      builder_(dialect, path, warnings),
      params_(dialect, paths_, warnings),
      types_(dialect),
      v4_([this](const FileLocation& where, const std::string& message) {
        builder_.warn_once(where, message);
      }) {
  paths_.check(path, {});
  if (options.files) options.files->insert(std::filesystem::absolute(path).lexically_normal().string());
  open_file(path, {});
}

SceneDescription Parser::parse() {
  while (!files_.empty() && block_ != Block::done) {
    const Token t = lexer().next();
    if (t.kind == Token::Kind::end) {
      if (files_.size() == 1) {
        if (block_ == Block::options) throw SceneError(location(t), "the scene has no WorldBegin");
        if (!is_v4()) warnings_.add(location(t), "the file ends without WorldEnd");
        world_end(t);
        break;
      }
      close_file();
      continue;
    }
    const auto handler = t.kind == Token::Kind::word ? handlers().find(t.text) : handlers().end();
    if (handler == handlers().end()) {
      const char* what =
          t.kind == Token::Kind::word ? "unknown directive " : "expected a directive, found ";
      throw SceneError(location(t), what + Lexer::describe(t));
    }
    if (use_) use_->count(t.text);
    (this->*handler->second)(t);
  }
  // Before pbrt-v4 the camera is made at the world's end, and stands in what is outside then.
  if (!is_v4()) builder_.scene().camera.medium = state_.outside;
  place_early_instances();
  if (is_v4()) v4_.expose(builder_.scene().camera, builder_.scene().film);
  builder_.finish(state_);
  return std::move(builder_.scene());
}

void Parser::open_file(const std::string& path, const FileLocation& named_at) {
  auto text = SourceText::open(path);
  if (!text) throw SceneError(named_at, text.error());
  files_.push_back({canonical_file(path), Lexer(*text)});
}

void Parser::close_file() {
  if (files_.back().imported && !saved_states_.empty() && !saved_transforms_.empty()) {
    state_ = std::move(saved_states_.back());
    saved_states_.pop_back();
    ctm_ = saved_transforms_.back().ctm;
    active_ = saved_transforms_.back().active;
    saved_transforms_.pop_back();
  }
  files_.pop_back();
}

void Parser::include(const Token& t) {
  const FileLocation where = location(t);
  const std::string path = paths_.find(read_string("the name of a file"), *lexer().source().name(), where);
  const std::string same = canonical_file(path);
  if (std::any_of(files_.begin(), files_.end(), [&](const OpenFile& f) { return f.path == same; }))
    throw SceneError(where, "'" + path + "' includes itself");
  if (files_.size() >= kDeepestInclude)
    throw SceneError(where,
                     "more than " + std::to_string(kDeepestInclude) + " files include each other");
  open_file(path, where);
}

void Parser::world_begin(const Token& t) {
  if (block_ == Block::world) {
    warnings_.add(location(t), "WorldBegin inside of the world: ignored");
    return;
  }
  if (skip_world(t)) return;
  block_ = Block::world;
  ctm_ = {};
  active_ = Active::all;
  coordinate_systems_["world"] = ctm_;
  if (std::optional<Motion>& moves = builder_.scene().camera.motion) {  // TransformTimes may stand behind it
    moves->start_time = builder_.scene().transform_start;
    moves->end_time = builder_.scene().transform_end;
  }
}

// Of renderers of pbrt-v2 that make no picture but a file, most often for the world behind theirs.
bool Parser::skip_world(const Token& t) {
  std::optional<Entity>& renderer = builder_.scene().renderer;
  if (!renderer || (renderer->type != "surfacepoints" && renderer->type != "createprobes")) return false;
  Lexer ahead = lexer();
  std::optional<Lexer> behind;
  for (Token next = ahead.next(); next.kind != Token::Kind::end; next = ahead.next()) {
    if (next.kind == Token::Kind::open) ahead.skip_array();
    if (next.kind != Token::Kind::word) continue;
    if (behind && next.text == "WorldBegin") {
      builder_.warn_once(location(t), "the world of Renderer \"" + renderer->type + "\" is left out: it has no picture");
      lexer() = std::move(*behind);
      renderer.reset();
      ctm_ = {};
      active_ = Active::all;
      return true;
    }
    if (!behind && next.text == "WorldEnd") behind = ahead;
  }
  builder_.warn_once(location(t), "Renderer \"" + renderer->type + "\" has no picture: the surface integrator is used");
  return false;
}

void Parser::world_end(const Token& t) {
  if (block_ != Block::world) throw SceneError(location(t), "WorldEnd without WorldBegin");
  if (open_object_) {
    warnings_.add(location(t), "ObjectEnd is missing");
    close_object();
  }
  if (!saved_states_.empty())
    warnings_.add(location(t), "AttributeEnd is missing");
  else if (!saved_transforms_.empty())
    warnings_.add(location(t), "TransformEnd is missing");
  block_ = Block::done;
  // pbrt renders here and may go on with another world.
  try {
    if (files_.size() == 1 && lexer().peek().kind != Token::Kind::end)
      warnings_.add(location(lexer().peek()),
                    "only the first world of a file is rendered: the rest is ignored");
  } catch (const SceneError& e) {
    warnings_.add({}, e.what());
  }
}

void Parser::attribute_begin(const Token& t) {
  if (!in_world(t)) return;
  if (saved_transforms_.size() >= kDeepestNesting)
    throw SceneError(location(t), "blocks are nested too deep");
  saved_states_.push_back(state_);
  saved_transforms_.push_back({ctm_, active_});
}

void Parser::attribute_end(const Token& t) {
  if (!in_world(t)) return;
  if (saved_states_.empty()) {
    warnings_.add(location(t), std::string(t.text) + " without AttributeBegin: ignored");
    return;
  }
  state_ = std::move(saved_states_.back());
  saved_states_.pop_back();
  if (saved_transforms_.empty()) return;  // a TransformEnd has taken it
  ctm_ = std::move(saved_transforms_.back().ctm);
  active_ = saved_transforms_.back().active;
  saved_transforms_.pop_back();
}

// pbrt-v4 takes these blocks for attribute blocks.
void Parser::transform_begin(const Token& t) {
  if (is_v4()) return attribute_begin(t);
  if (!in_world(t)) return;
  if (saved_transforms_.size() >= kDeepestNesting)
    throw SceneError(location(t), "blocks are nested too deep");
  saved_transforms_.push_back({ctm_, active_});
}

void Parser::transform_end(const Token& t) {
  if (is_v4()) return attribute_end(t);
  if (!in_world(t)) return;
  if (saved_transforms_.empty()) {
    warnings_.add(location(t), "TransformEnd without TransformBegin: ignored");
    return;
  }
  ctm_ = std::move(saved_transforms_.back().ctm);
  active_ = saved_transforms_.back().active;
  saved_transforms_.pop_back();
}

// As in pbrt, an object block is an attribute block too, on the same stack.
void Parser::object_begin(const Token& t) {
  const FileLocation where = location(t);
  const std::string name = read_string("the name of an object");
  if (!in_world(t)) return;
  attribute_begin(t);
  if (open_object_) {
    warnings_.add(where, "ObjectBegin inside of an object: that object ends here");
    close_object();
  }
  if (objects_.count(name)) warnings_.add(where, "the object \"" + name + "\" is defined again");
  open_object_ = ObjectId(object_count_++);
  objects_[name] = open_object_;
  sink_.begin_object(open_object_, name);
}

void Parser::close_object() {
  sink_.end_object(open_object_);
  open_object_ = {};
}

void Parser::object_end(const Token& t) {
  if (!in_world(t)) return;
  if (!open_object_) {
    // What is left of an ObjectBegin that came inside of an object.
    warnings_.add(location(t), "ObjectEnd without ObjectBegin: ignored");
    if (saved_states_.empty()) return;
  } else {
    close_object();
  }
  attribute_end(t);
}

void Parser::object_instance(const Token& t) {
  InstanceDesc instance;
  instance.location = location(t);
  const std::string name = read_string("the name of an object");
  if (!in_world(t)) return;
  // Inside of an object it becomes part of that object, which pbrt does not allow.
  const auto found = objects_.find(name);
  // In pbrt-v4 it may be defined later.
  const bool later = found == objects_.end() && is_v4() && !open_object_;
  if (found == objects_.end() && !later) {
    warn_no_object(instance.location, name);
    return;
  }
  if (!later) instance.object = found->second;
  instance.instance_to_world = to_transform(ctm_.start);
  if (!instance.instance_to_world.is_invertible()) {
    builder_.warn_once(instance.location,
                       "the transformation of the instance cannot be inverted: ignored");
    return;
  }
  instance.motion = motion(instance.location, "instance");
  if (!later) {
    sink_.instance(instance, builder_.scene());
    return;
  }
  // They wait in memory; where there are many, files define objects first.
  constexpr std::size_t kMostEarly = 1'000'000;
  if (early_instances_.size() == kMostEarly)
    throw SceneError(instance.location, "more than " + std::to_string(kMostEarly) + " instances come before their objects");
  early_instances_.emplace_back(name, instance);
}

void Parser::warn_no_object(const FileLocation& where, const std::string& name) {
  builder_.warn_once(where, "there is no object \"" + name + "\": its instances are ignored");
}

void Parser::place_early_instances() {
  for (auto& [name, instance] : early_instances_) {
    const auto found = objects_.find(name);
    if (found == objects_.end()) {
      warn_no_object(instance.location, name);
      continue;
    }
    instance.object = found->second;
    sink_.instance(instance, builder_.scene());
  }
  early_instances_.clear();
}

bool Parser::in_world(const Token& t) {
  if (block_ == Block::world) return true;
  builder_.warn_once(location(t), std::string(t.text) + " before WorldBegin: ignored");
  return false;
}

bool Parser::in_options(const Token& t) {
  if (block_ == Block::options) return true;
  builder_.warn_once(location(t), std::string(t.text) + " after WorldBegin: ignored");
  return false;
}

std::string Parser::read_string(const char* what) {
  Token t = lexer().next();
  const bool bracketed = t.kind == Token::Kind::open;
  if (bracketed) t = lexer().next();
  if (t.kind != Token::Kind::string)
    throw SceneError(location(t),
                     std::string("expected ") + what + " in quotes, found " + Lexer::describe(t));
  if (bracketed)
    if (const Token close = lexer().next(); close.kind != Token::Kind::close)
      throw SceneError(location(close), "expected ']', found " + Lexer::describe(close));
  return Lexer::unescape(t.text);
}

Entity Parser::read_entity(const Token& directive, bool reads_files) {
  Entity e;
  e.location = location(directive);
  e.type = read_string("a type");
  if (is_v4()) {
    params_.set_color_space(state_.color_space);
    params_.set_use(directive.text == "LightSource" || directive.text == "AreaLightSource"
                        ? ParamReader::SpectrumUse::light
                        : ParamReader::SpectrumUse::reflectance);
  }
  e.params = params_.read(lexer(), reads_files);
  while (read_included_params(e.params, reads_files)) params_.read_more(lexer(), e.params, reads_files);
  // An included file may end between a directive and more of its parameters.
  for (std::size_t i = files_.size() - 1; i > 0 && !files_[i].imported && files_[i].lexer.peek().kind == Token::Kind::end; --i)
    params_.read_more(files_[i - 1].lexer, e.params, reads_files);
  if (use_) count_use(directive.text, e);
  if (is_v4())
    complete_v4(directive.text, e);
  else
    types_.check(directive.text, e, warnings_);
  return e;
}

// Before v4 files are included as text, so that one may hold some parameters of a directive (the
// samples of a density grid, say).
bool Parser::read_included_params(ParamSet& params, bool reads_files) {
  if (is_v4() || lexer().peek().kind != Token::Kind::word || lexer().peek().text != "Include")
    return false;
  Lexer ahead = lexer();
  ahead.next();
  const Token name = ahead.next();
  if (name.kind != Token::Kind::string) return false;
  const auto text =
      SourceText::open(paths_.find(Lexer::unescape(name.text), *lexer().source().name(), ahead.location(name)));
  if (!text) return false;  // `include` says it
  Lexer inner(*text);
  if (inner.peek().kind != Token::Kind::string) return false;
  params_.read_more(inner, params, reads_files);
  if (const Token& end = inner.peek(); end.kind != Token::Kind::end)
    throw SceneError(inner.location(end),
                     "expected nothing but parameters in a file that is included between "
                     "parameters, found " + Lexer::describe(end));
  lexer() = ahead;
  return true;
}

// What is named has its type among its parameters.
void Parser::count_use(std::string_view directive, const Entity& e) {
  if (directive == "MakeNamedMaterial" || directive == "MakeNamedMedium") {
    const Param* type = e.params.find("type");
    if (!type || type->strings.size() != 1) return;
    use_->count(directive == "MakeNamedMaterial" ? "Material" : directive, type->strings[0],
                e.params);
  } else {
    use_->count(directive, e.type, e.params);
  }
}

SceneDescription parse_scene(const std::string& path, const ParseOptions& options, SceneSink& sink,
                             Warnings& warnings) {
  const Dialect dialect = options.dialect ? *options.dialect : detect_dialect(path, options.confine);
  if (options.use) options.use->set_dialect(dialect);
  return Parser(path, dialect, sink, warnings, options).parse();
}

}  // namespace cloudrenderer
