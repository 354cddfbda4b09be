#pragma once
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "scene/description.h"

namespace cloudrenderer {

// The scene language as it is read here: every directive, type and parameter of pbrt-v2, v3 and v4
// with its state. `info`, docs/language.md and the words of warnings about parameters come from
// these tables, and a test reads a scene for every row (tests/cli_language_test.cpp), so that a row
// cannot say what is not so.
enum class LanguageState : std::uint8_t {
  done,
  approximated,  // read, and something like it is made
  ignored,       // changes nothing here, or nothing at all: no warning
  missing        // ignored with a warning
};
const char* state_word(LanguageState state);

inline constexpr unsigned kInV2 = 1, kInV3 = 2, kInV4 = 4, kInAll = 7;
unsigned dialect_bit(Dialect dialect);
const char* dialect_name(Dialect dialect);  // "pbrt-v2"

// A row is added where its directive's table is (language_*.cpp). `params` lists the parameters,
// separated by commas, each `type name`, with a mark in front where it is not done ('~'
// approximated, '-' ignored, '!' missing) and `@v2`, `@v34` and so on behind the name where not all
// of the row's dialects have it.
struct LanguageRow {
  std::string_view directive;
  std::string_view type;  // "": the directive itself
  unsigned dialects;
  LanguageState state;
  std::string_view params;
  std::string_view note;  // what is made instead, or why
};

struct LanguageParam {
  std::string_view type, name;
  unsigned dialects;
  LanguageState state;
};
std::vector<LanguageParam> language_params(const LanguageRow& row);

using LanguageTable = std::span<const LanguageRow>;
std::vector<LanguageTable> language_tables();  // in the order of the page
// The row of a type in a dialect, or else in any; null when pbrt has no such type.
const LanguageRow* find_language(std::string_view directive, std::string_view type,
                                 unsigned dialects = kInAll);
// All types of a directive that are not missing, for messages: "cone, cylinder, ...".
std::string known_types(std::string_view directive, Dialect dialect);

// What to say of a parameter that nothing here asked for, "" when it is to be ignored; `owner` is
// e.g. `Shape "sphere"`.
std::string unused_message(std::string_view owner, std::string_view param,
                           unsigned dialects = kInAll);

// docs/language.md.
std::string language_page();

// What a scene uses, counted while it is read.
class LanguageUse {
 public:
  explicit LanguageUse(Dialect dialect = Dialect::v2) : dialect_(dialect) {}
  void set_dialect(Dialect dialect) { dialect_ = dialect; }
  Dialect dialect() const { return dialect_; }

  void count(std::string_view directive) { ++directives_[std::string(directive)]; }
  void count(std::string_view directive, std::string_view type, const ParamSet& params);

  struct Line {
    std::string what;  // `Shape "sphere"`
    std::uint64_t count = 0;
    LanguageState state = LanguageState::done;
    std::string note;
    // Parameters that are not done: name, how often, state.
    struct Parameter {
      std::string name;
      std::uint64_t count = 0;
      std::string state;
    };
    std::vector<Parameter> params;
  };
  std::vector<Line> lines() const;

 private:
  struct Type {
    std::uint64_t count = 0;
    std::map<std::string, std::uint64_t, std::less<>> params;
  };
  Dialect dialect_;
  std::map<std::string, std::uint64_t, std::less<>> directives_;
  std::map<std::pair<std::string, std::string>, Type> types_;
};

// The tables, each beside what it is of.
LanguageTable language_directives();
LanguageTable language_options();
LanguageTable language_shapes();
LanguageTable language_materials();
LanguageTable language_textures();
LanguageTable language_lights();
LanguageTable language_media();

}  // namespace cloudrenderer
