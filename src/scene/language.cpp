#include "scene/language.h"

#include <algorithm>
#include <array>

namespace cloudrenderer {

namespace {

constexpr std::string_view kBlank = " \n";

std::string_view trimmed(std::string_view s) {
  const std::size_t first = s.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return s.substr(first, s.find_last_not_of(kBlank) - first + 1);
}

LanguageParam parsed_param(std::string_view text, unsigned dialects) {
  LanguageParam p{{}, {}, dialects, LanguageState::done};
  if (text.front() == '~') p.state = LanguageState::approximated;
  if (text.front() == '-') p.state = LanguageState::ignored;
  if (text.front() == '!') p.state = LanguageState::missing;
  if (p.state != LanguageState::done) text.remove_prefix(1);
  if (const std::size_t at = text.find("@v"); at != std::string_view::npos) {
    p.dialects = 0;
    for (const char c : text.substr(at + 2)) p.dialects |= 1u << static_cast<unsigned>(c - '2');
    text = text.substr(0, at);
  }
  const std::size_t space = text.find(' ');
  p.type = text.substr(0, space);
  p.name = trimmed(text.substr(space + 1));
  return p;
}

// Edits that make one word of the other: what a slip of the finger may have done to a name.
std::size_t distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t corner = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = corner + (a[i] != b[j] ? 1 : 0);
      corner = row[j + 1];
      row[j + 1] = std::min({changed, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

std::string quoted(std::string_view s) { return "\"" + std::string(s) + "\""; }

}  // namespace

const char* state_word(LanguageState state) {
  static constexpr std::array kWords{"done", "approximated", "ignored", "missing"};
  return kWords[static_cast<std::size_t>(state)];
}

unsigned dialect_bit(Dialect dialect) { return 1u << static_cast<unsigned>(dialect); }

const char* dialect_name(Dialect dialect) {
  static constexpr std::array kNames{"pbrt-v2", "pbrt-v3", "pbrt-v4"};
  return kNames[static_cast<std::size_t>(dialect)];
}

std::vector<LanguageParam> language_params(const LanguageRow& row) {
  std::vector<LanguageParam> out;
  std::string_view rest = row.params;
  while (!rest.empty()) {
    const std::size_t comma = rest.find(',');
    if (const std::string_view one = trimmed(rest.substr(0, comma)); !one.empty())
      out.push_back(parsed_param(one, row.dialects));
    rest = comma == std::string_view::npos ? std::string_view{} : rest.substr(comma + 1);
  }
  return out;
}

std::vector<LanguageTable> language_tables() {
  return {language_directives(), language_options(), language_shapes(), language_materials(),
          language_textures(),   language_lights(),  language_media()};
}

const LanguageRow* find_language(std::string_view directive, std::string_view type,
                                 unsigned dialects) {
  for (const LanguageTable table : language_tables())
    for (const LanguageRow& row : table)
      if (row.directive == directive && row.type == type && (row.dialects & dialects) != 0)
        return &row;
  return nullptr;
}

std::string known_types(std::string_view directive, Dialect dialect) {
  std::string out;
  for (const LanguageTable table : language_tables())
    for (const LanguageRow& row : table)
      if (row.directive == directive && !row.type.empty() &&
          (row.dialects & dialect_bit(dialect)) != 0 && row.state != LanguageState::missing)
        out += (out.empty() ? "" : ", ") + std::string(row.type);
  return out;
}

std::string unused_message(std::string_view owner, std::string_view param, unsigned dialects) {
  const std::size_t space = owner.find(' ');
  const std::string_view directive = owner.substr(0, space);
  const std::string_view type = space == std::string_view::npos || owner.size() < space + 3
                                    ? std::string_view{}
                                    : owner.substr(space + 2, owner.size() - space - 3);
  std::string nearest;
  std::size_t nearest_distance = 3;  // more edits are another word
  for (const LanguageTable table : language_tables())
    for (const LanguageRow& row : table) {
      if (row.directive != directive || row.type != type || (row.dialects & dialects) == 0)
        continue;
      for (const LanguageParam& p : language_params(row)) {
        if ((p.dialects & dialects) == 0) continue;
        if (p.name == param) {
          if (p.state == LanguageState::ignored || p.state == LanguageState::approximated)
            return {};
          return std::string(owner) + ": the parameter " + quoted(param) +
                 (p.state == LanguageState::missing ? " is not supported: ignored"
                                                    : " has no meaning here: ignored");
        }
        const std::size_t d = distance(p.name, param);
        if (d < nearest_distance && d < param.size()) {
          nearest_distance = d;
          nearest = p.name;
        }
      }
    }
  return std::string(owner) + " has no parameter " + quoted(param) + ": ignored" +
         (nearest.empty() ? "" : "; is it " + quoted(nearest) + "?");
}

void LanguageUse::count(std::string_view directive, std::string_view type,
                        const ParamSet& params) {
  Type& t = types_[{std::string(directive), std::string(type)}];
  ++t.count;
  for (const Param& p : params.all())
    if (p.name != "type" || p.type != ParamType::string) ++t.params[p.name];
}

std::vector<LanguageUse::Line> LanguageUse::lines() const {
  const unsigned bit = dialect_bit(dialect_);
  std::vector<Line> out;
  for (const auto& [name, count] : directives_) {
    const LanguageRow* row = find_language(name, "", bit);
    if (!row) row = find_language(name, "");
    const bool has_types = std::any_of(types_.begin(), types_.end(), [&, n = &name](const auto& t) {
      return t.first.first == *n || (*n == "MakeNamedMaterial" && t.first.first == "Material");
    });
    if (row && !has_types)
      out.push_back({name, count, row->state, std::string(row->note), {}});
  }
  for (const auto& [key, use] : types_) {
    const auto& [directive, type] = key;
    Line line{directive + " " + quoted(type), use.count, LanguageState::missing, "", {}};
    const LanguageRow* row = find_language(directive, type, bit);
    if (!row) row = find_language(directive, type);
    if (!row) {
      line.note = "pbrt has no such type";
      out.push_back(std::move(line));
      continue;
    }
    line.state = row->state;
    line.note = row->note;
    const std::vector<LanguageParam> known = language_params(*row);
    for (const auto& [name, count] : use.params) {
      const auto p = std::find_if(known.begin(), known.end(),
                                  [&](const LanguageParam& k) { return k.name == name; });
      if (p == known.end()) {
        // A shape may carry parameters of its material.
        if (directive != "Shape") line.params.push_back({name, count, "unknown"});
      } else if (p->state != LanguageState::done) {
        line.params.push_back({name, count, state_word(p->state)});
      }
    }
    out.push_back(std::move(line));
  }
  return out;
}

}  // namespace cloudrenderer
