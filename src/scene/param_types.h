#pragma once
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/log.h"
#include "scene/language.h"

namespace cloudrenderer {

// pbrt-v2 and pbrt-v3 look a parameter up among those of one type that have one value (but for lists): any other is not
// there, and the default counts. Which type that is the language's tables say.
class ParamTypes {
 public:
  explicit ParamTypes(Dialect dialect) : dialect_(dialect) {}
  // Takes such parameters out, with a warning each. Those that have a reading all the same stay: integers for numbers,
  // textures, lists of points and vectors.
  void check(std::string_view directive, Entity& e, Warnings& warnings);

 private:
  Dialect dialect_;
  std::map<std::pair<std::string, std::string>, std::vector<LanguageParam>> known_;
};

}  // namespace cloudrenderer
