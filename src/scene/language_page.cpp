// docs/language.md, made from the tables.
#include "scene/language.h"

namespace cloudrenderer {

namespace {

std::string versions(unsigned dialects) {
  if (dialects == kInAll) return "all";
  std::string out;
  for (const auto& [bit, name] : {std::pair{kInV2, "v2"}, {kInV3, "v3"}, {kInV4, "v4"}})
    if ((dialects & bit) != 0) out += (out.empty() ? "" : ", ") + std::string(name);
  return out;
}

std::string params_text(const LanguageRow& row) {
  std::string out;
  for (const LanguageParam& p : language_params(row)) {
    out += (out.empty() ? "`" : ", `") + std::string(p.type) + " " + std::string(p.name) + "`";
    std::string remark;
    if (p.dialects != row.dialects) remark = versions(p.dialects);
    if (p.state != LanguageState::done)
      remark += (remark.empty() ? "" : ": ") + std::string(state_word(p.state));
    if (!remark.empty()) out += " (" + remark + ")";
  }
  return out;
}

}  // namespace

std::string language_page() {
  std::string out =
      "# The scene language\n\n"
      "Every directive, type and parameter of pbrt-v2, v3 and v4, and what becomes of it here. Made "
      "from the tables in\n`src/scene/language_*.cpp` by `cloudrenderer info --language`; a test "
      "reads a scene for every row.\n\n"
      "*done*; *approximated*: something like it is made, with a warning; *ignored*: changes "
      "nothing; *missing*: left out with a\nwarning. Parameters without a remark are done.\n";
  std::string_view directive = "none";
  for (const LanguageTable table : language_tables())
    for (const LanguageRow& row : table) {
      const std::string_view heading = row.type.empty() ? "" : row.directive;
      if (heading != directive) {
        directive = heading;
        out += "\n## " + (heading.empty() ? std::string("Directives") : std::string(heading)) +
               (heading.empty() ? "\n\n| directive | pbrt | state | remarks |\n|---|---|---|---|\n"
                                : "\n\n| type | pbrt | state | parameters | remarks |\n"
                                  "|---|---|---|---|---|\n");
      }
      out += "| `" + std::string(row.type.empty() ? row.directive : row.type) + "` | " +
             versions(row.dialects) + " | " + state_word(row.state) + " | ";
      if (!row.type.empty()) out += params_text(row) + " | ";
      out += std::string(row.note) + " |\n";
    }
  return out;
}

}  // namespace cloudrenderer
