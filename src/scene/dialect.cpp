#include "scene/dialect.h"

#include <algorithm>
#include <array>
#include <optional>
#include <set>

#include "scene/file_paths.h"
#include "scene/lexer.h"

namespace cloudrenderer {

namespace {

struct Sign {
  std::string_view directive, type;  // no type: the directive alone decides
  Dialect dialect;
};
constexpr auto kSigns = std::to_array<Sign>({{"SurfaceIntegrator", "", Dialect::v2},
                                             {"VolumeIntegrator", "", Dialect::v2},
                                             {"Renderer", "", Dialect::v2},
                                             {"Volume", "", Dialect::v2},
                                             {"Integrator", "", Dialect::v3},
                                             {"MakeNamedMedium", "", Dialect::v3},
                                             {"MediumInterface", "", Dialect::v3},
                                             {"Shape", "plymesh", Dialect::v3},
                                             {"Shape", "curve", Dialect::v3},
                                             {"Sampler", "sobol", Dialect::v3},
                                             {"Sampler", "zerotwosequence", Dialect::v3},
                                             {"Sampler", "maxmindist", Dialect::v3}});

class Detector {
 public:
  explicit Detector(const std::string& path) : paths_(path) {}

  std::optional<Dialect> scan(const std::string& path) {
    constexpr std::size_t kDeepest = 64;
    // A file that was read once has no more to say.
    if (depth_ == kDeepest || !seen_.insert(path).second) return std::nullopt;
    const auto text = SourceText::open(path);
    if (!text) return std::nullopt;
    ++depth_;
    const std::optional<Dialect> found = scan_text(*text, path);
    --depth_;
    return found;
  }

 private:
  std::optional<Dialect> scan_text(const std::shared_ptr<const SourceText>& text,
                                   const std::string& path) {
    Lexer lexer(text);
    for (Token t = lexer.next(); t.kind != Token::Kind::end; t = lexer.next()) {
      if (t.kind == Token::Kind::open) lexer.skip_array();
      if (t.kind != Token::Kind::word) continue;
      const bool has_type = lexer.peek().kind == Token::Kind::string;
      for (const Sign& sign : kSigns)
        if (t.text == sign.directive &&
            (sign.type.empty() || (has_type && lexer.peek().text == sign.type)))
          return sign.dialect;
      if (t.text == "Include" && has_type)
        if (const auto found = scan(paths_.find(Lexer::unescape(lexer.peek().text), path)))
          return found;
      if (t.text == "WorldEnd") return std::nullopt;
    }
    return std::nullopt;
  }

  FilePaths paths_;
  std::set<std::string> seen_;
  std::size_t depth_ = 0;
};

}  // namespace

Dialect detect_dialect(const std::string& path) {
  try {
    return Detector(path).scan(path).value_or(Dialect::v2);
  } catch (const SceneError&) {
    return Dialect::v2;
  }
}

}  // namespace cloudrenderer
