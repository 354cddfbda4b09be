#include "scene/param_types.h"

#include <algorithm>

namespace cloudrenderer {
namespace {

bool fits(std::string_view wanted, ParamType given, bool textures, bool any_value) {
  using enum ParamType;
  if (given == texture) return textures || (wanted != "bool" && wanted != "integer" && wanted != "string");
  if (wanted == "bool") return given == boolean;
  if (wanted == "integer") return given == integer;
  if (wanted == "string") return given == string;
  const bool number = given != boolean && given != string;
  if (wanted == "float") return number && given != rgb;
  if (wanted == "spectrum") return given == rgb || (any_value && number);
  return true;
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
  const auto wanted = [&](const Param& p) -> std::string_view {
    const auto found = std::ranges::find_if(slot->second, [&](const LanguageParam& k) {
      return k.name == p.name && (k.dialects & dialect_bit(dialect_)) != 0;
    });
    return found == slot->second.end() || fits(found->type, p.type, textures, texture) ? std::string_view() : found->type;
  };
  std::vector<std::string> gone;
  for (const Param& p : e.params.all())
    if (const std::string_view type_wanted = wanted(p); !type_wanted.empty()) {
      warnings.add(p.location, "parameter \"" + p.name + "\" is of type " + type_word(p.type) + ", not " + std::string(type_wanted) +
                                   ": ignored, as in pbrt");
      gone.push_back(p.name);
    }
  for (const std::string& name : gone) e.params.take(name);
}

}  // namespace cloudrenderer
