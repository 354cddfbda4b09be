#include "scene/param_types.h"

#include <algorithm>
#include <array>

namespace cloudrenderer {
namespace {

// Parameters of one type that are lists; every other one has one value.
constexpr std::array<std::string_view, 15> kLists{"indices", "faceIndices", "P",      "Pw",      "N",            "S",          "uv",         "st",
                                                  "Pz",      "uknots",      "vknots", "density", "screenwindow", "cropwindow", "pixelbounds"};

bool is_list(std::string_view name) { return std::ranges::find(kLists, name) != kLists.end(); }

bool fits(std::string_view wanted, ParamType given, bool textures, bool any_value) {
  using enum ParamType;
  if (given == texture) return textures || (wanted != "bool" && wanted != "integer" && wanted != "string");
  if (wanted == "bool") return given == boolean;
  if (wanted == "integer") return given == integer;
  if (wanted == "string") return given == string;
  const bool number = given != boolean && given != string;
  if (wanted == "float") return number && given != rgb;
  if (wanted == "spectrum") return given == rgb || (any_value && number);
  if (wanted == "point" || wanted == "point3") return given == point3;
  if (wanted == "vector" || wanted == "vector3") return given == vector3;
  return true;
}

std::size_t count_of(const Param& p) {
  using enum ParamType;
  switch (p.type) {
    case boolean:
    case integer:
      return p.integers.size();
    case real:
      return p.reals.size();
    case point2:
    case vector2:
      return p.reals.size() / 2;
    case string:
    case texture:
      return p.strings.size();
    default:
      return p.reals.size() / 3;
  }
}

}  // namespace

void ParamTypes::check(std::string_view directive, Entity& e, Warnings& warnings) {
  const bool named = directive == "MakeNamedMaterial" || directive == "MakeNamedMedium";
  const std::string type = named ? e.params.string("type", "") : e.type;
  if (directive == "MakeNamedMaterial") directive = "Material";
  const auto [slot, fresh] = known_.try_emplace({std::string(directive), type});
  if (fresh)
    if (const LanguageRow* row = find_language(directive, type, dialect_bit(dialect_))) slot->second = language_params(*row);
  if (slot->second.empty()) return;
  // A texture's values are of its own kind.
  const bool texture = directive == "Texture", textures = texture || directive == "Material";
  std::vector<std::string> gone;
  std::vector<std::pair<std::string, std::size_t>> shortened;
  for (const Param& p : e.params.all()) {
    const auto known = std::ranges::find_if(slot->second, [&](const LanguageParam& k) {
      return k.name == p.name && (k.dialects & dialect_bit(dialect_)) != 0;
    });
    if (known == slot->second.end()) continue;
    std::string what;
    // Lists of points or vectors are taken for what they are meant to be.
    const bool meant = is_list(p.name) && (known->type.starts_with("point") || known->type.starts_with("vector"));
    if (!meant && !fits(known->type, p.type, textures, texture))
      what = std::string("is of type ") + type_word(p.type) + ", not " + std::string(known->type);
    else if (const std::size_t n = count_of(p); n != 1 && !is_list(p.name))
      what = "has " + std::to_string(n) + " values, not one";
    if (what.empty()) continue;
    // pbrt-v3's materials look the value up as that of a texture, which takes the first.
    const std::size_t first = p.type == ParamType::real ? 1 : p.type == ParamType::rgb ? 3 : 0;
    if (dialect_ == Dialect::v3 && directive == "Material" && first != 0 && p.reals.size() > first && fits(known->type, p.type, true, false)) {
      warnings.add(p.location, "parameter \"" + p.name + "\" " + what + ": the first is used, as in pbrt");
      shortened.push_back({p.name, first});
      continue;
    }
    warnings.add(p.location, "parameter \"" + p.name + "\" " + what + ": ignored, as in pbrt");
    gone.push_back(p.name);
  }
  for (const std::string& name : gone) e.params.take(name);
  for (const auto& [name, numbers] : shortened) {
    Param p = *e.params.take(name);
    p.reals = BulkArray<float>(std::vector<float>(p.reals.begin(), p.reals.begin() + static_cast<std::ptrdiff_t>(numbers)));
    e.params.add(std::move(p));
  }
}

}  // namespace cloudrenderer
