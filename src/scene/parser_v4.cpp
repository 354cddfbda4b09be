// What only pbrt-v4 has.
#include <algorithm>

#include "scene/parser.h"

namespace cloudrenderer {

namespace {

// What `Attribute` can speak to, and the directives that listen.
struct Target {
  std::string_view name;
  std::string_view directives[2];
};
constexpr Target kTargets[] = {{"shape", {"Shape", ""}},
                               {"light", {"LightSource", "AreaLightSource"}},
                               {"material", {"Material", "MakeNamedMaterial"}},
                               {"medium", {"MakeNamedMedium", ""}},
                               {"texture", {"Texture", ""}}};

}  // namespace

void Parser::attribute(const Token& t) {
  const FileLocation where = location(t);
  const std::string target = read_string("what the attribute is of");
  const auto found = std::find_if(std::begin(kTargets), std::end(kTargets),
                                  [&](const Target& k) { return k.name == target; });
  params_.set_color_space(state_.color_space);
  params_.set_use(target == "light" ? ParamReader::SpectrumUse::light
                                    : ParamReader::SpectrumUse::reflectance);
  const ParamSet given = params_.read(lexer());
  if (found == std::end(kTargets))
    throw SceneError(where, "an attribute is of shape, light, material, medium or texture, not \"" +
                                target + "\"");
  const ParamSet* old = state_.attributes.find(target);
  ParamSet all = old ? *old : ParamSet();
  for (const Param& p : given.all()) all.add(p);
  state_.attributes.set(target, std::move(all));
}

void Parser::color_space(const Token& t) {
  const FileLocation where = location(t);
  const std::string name = read_string("the name of a colour space");
  const auto space = ColorSpace::find(name);
  if (!space)
    throw SceneError(where, "unknown colour space \"" + name +
                                "\", expected srgb, rec2020, dci-p3 or aces2065-1");
  state_.color_space = *space;
}

void Parser::import_file(const Token& t) {
  const std::size_t open = files_.size();
  if (saved_transforms_.size() >= kDeepestNesting)
    throw SceneError(location(t), "blocks are nested too deep");
  saved_states_.push_back(state_);
  saved_transforms_.push_back({ctm_, active_});
  include(t);
  if (files_.size() > open) files_.back().imported = true;
}

// pbrt-v4 wants a name and a value; its users also write them like parameters.
void Parser::option(const Token& t) {
  const FileLocation where = location(t);
  std::string name;
  bool off = false;
  if (lexer().peek().kind == Token::Kind::string &&
      lexer().peek().text.find(' ') == std::string_view::npos) {
    name = read_string("the name of an option");
    const Token value = lexer().next();
    const Token first = value.kind == Token::Kind::open ? lexer().next() : value;
    off = first.text == "false";
    if (value.kind == Token::Kind::open && first.kind != Token::Kind::close)
      lexer().skip_array();
    else if (value.kind == Token::Kind::end || value.kind == Token::Kind::close)
      throw SceneError(location(value), "expected the value of the option \"" + name +
                                            "\", found " + Lexer::describe(value));
  } else {
    const ParamSet given = params_.read(lexer());
    if (given.empty()) throw SceneError(where, "expected an option: its name and its value");
    const Param& p = given.all().front();
    name = p.name;
    off = p.type == ParamType::boolean && p.integers.size() == 1 && p.integers[0] == 0;
  }
  // Nothing that is seen hangs on these.
  if (off || name == "rendercoordsys" || name == "seed") return;
  builder_.warn_once(where, "the option \"" + name + "\" is ignored");
}

void Parser::complete_v4(std::string_view directive, Entity& e) {
  for (const Target& target : kTargets) {
    if (target.directives[0] != directive && target.directives[1] != directive) continue;
    if (const ParamSet* more = state_.attributes.find(target.name))
      for (const Param& p : more->all())
        if (!e.params.has(p.name)) {
          e.params.add(p);
          e.params.all().back().used = true;
        }
  }
  std::string type = e.type;
  if (directive == "MakeNamedMaterial") {
    directive = "Material";
    type = e.params.string("type", "");
  } else if (directive == "MakeNamedMedium") {
    type = e.params.string("type", "");
  }
  const LanguageRow* row = find_language(directive, type, kInV4);
  if (!row) return;
  auto& known = v4_params_[row];
  if (known.empty()) known = language_params(*row);
  std::vector<std::string> gone;
  for (const Param& p : e.params.all()) {
    if (p.name == "type" && directive.find("M") == 0) continue;
    const auto k = std::find_if(known.begin(), known.end(), [&](const LanguageParam& q) {
      return q.name == p.name && (q.dialects & kInV4) != 0;
    });
    if (k != known.end() &&
        (k->state == LanguageState::done || k->state == LanguageState::approximated))
      continue;
    gone.push_back(p.name);
    const std::string owner = std::string(directive) + " \"" + type + "\"";
    const std::string message = unused_message(owner, p.name, kInV4);
    if (!p.used && !message.empty()) builder_.warn_once(p.location, message);
  }
  for (const std::string& name : gone) e.params.take(name);
}

}  // namespace cloudrenderer
