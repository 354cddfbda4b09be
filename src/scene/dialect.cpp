#include "scene/dialect.h"

#include <algorithm>
#include <array>
#include <set>

#include "scene/file_paths.h"
#include "scene/lexer.h"

namespace cloudrenderer {

namespace {

constexpr unsigned kV2 = 1, kV3 = 2, kV4 = 4;

// Words that only some of the dialects have.
struct Sign {
  std::string_view directive, type;  // no type: the directive alone decides
  unsigned dialects;
};
constexpr auto kSigns = std::to_array<Sign>({{"SurfaceIntegrator", "", kV2},
                                             {"VolumeIntegrator", "", kV2},
                                             {"Renderer", "", kV2},
                                             {"Volume", "", kV2},
                                             {"Integrator", "", kV3 | kV4},
                                             {"MakeNamedMedium", "", kV3 | kV4},
                                             {"MediumInterface", "", kV3 | kV4},
                                             {"Shape", "plymesh", kV3 | kV4},
                                             {"Shape", "curve", kV3 | kV4},
                                             {"Sampler", "sobol", kV3 | kV4},
                                             {"Sampler", "zerotwosequence", kV3},
                                             {"Sampler", "maxmindist", kV3},
                                             {"Film", "image", kV2 | kV3},
                                             {"WorldEnd", "", kV2 | kV3},
                                             {"Material", "matte", kV2 | kV3},
                                             {"Material", "plastic", kV2 | kV3},
                                             {"Material", "glass", kV2 | kV3},
                                             {"Material", "metal", kV2 | kV3},
                                             {"Material", "uber", kV2 | kV3},
                                             {"Attribute", "", kV4},
                                             {"ColorSpace", "", kV4},
                                             {"Import", "", kV4},
                                             {"Option", "", kV4},
                                             {"Film", "rgb", kV4},
                                             {"Film", "gbuffer", kV4},
                                             {"Film", "spectral", kV4},
                                             {"Sampler", "independent", kV4},
                                             {"Sampler", "paddedsobol", kV4},
                                             {"Sampler", "pmj02bn", kV4},
                                             {"Sampler", "zsobol", kV4},
                                             {"Shape", "bilinearmesh", kV4},
                                             {"Material", "coatedconductor", kV4},
                                             {"Material", "coateddiffuse", kV4},
                                             {"Material", "conductor", kV4},
                                             {"Material", "dielectric", kV4},
                                             {"Material", "diffuse", kV4},
                                             {"Material", "diffusetransmission", kV4},
                                             {"Material", "interface", kV4},
                                             {"Material", "thindielectric", kV4}});
// Parameters that only pbrt-v4 has.
constexpr auto kV4Params = std::to_array<std::string_view>(
    {"rgb reflectance", "spectrum reflectance", "texture reflectance", "float illuminance",
     "float xradius"});

class Detector {
 public:
  Detector(const std::string& path, const std::string& confine) : paths_(path, confine) {}

  Dialect scan_all(const std::string& path) {
    try {
      paths_.check(path, {});
      scan(path);
    } catch (const SceneError&) {  // what is wrong with a file, the parser says
    }
    if ((possible_ & kV2) != 0) return Dialect::v2;
    return (possible_ & kV3) != 0 ? Dialect::v3 : Dialect::v4;
  }

 private:
  bool decided() const { return (possible_ & (possible_ - 1)) == 0; }

  // Returns true when there is no more to read.
  bool scan(const std::string& path) {
    constexpr std::size_t kDeepest = 64;
    // A file that was read once has no more to say.
    if (depth_ == kDeepest || !seen_.insert(path).second) return false;
    const auto text = SourceText::open(path);
    if (!text) return false;
    ++depth_;
    const bool done = scan_text(*text, path);
    --depth_;
    return done;
  }

  void see(std::string_view directive, std::string_view type) {
    for (const Sign& sign : kSigns)
      if (sign.directive == directive && (sign.type.empty() || sign.type == type) &&
          (possible_ & sign.dialects) != 0)
        possible_ &= sign.dialects;
  }

  bool scan_text(const std::shared_ptr<const SourceText>& text, const std::string& path) {
    Lexer lexer(text);
    for (Token t = lexer.next(); t.kind != Token::Kind::end; t = lexer.next()) {
      if (t.kind == Token::Kind::open) lexer.skip_array();
      if (t.kind == Token::Kind::string) {
        if (std::find(kV4Params.begin(), kV4Params.end(), t.text) != kV4Params.end() &&
            (possible_ & kV4) != 0)
          possible_ = kV4;
        if (t.text == "string type") {  // of a named material
          if (lexer.peek().kind == Token::Kind::open) lexer.next();
          if (lexer.peek().kind == Token::Kind::string) see("Material", lexer.peek().text);
        }
      }
      if (t.kind == Token::Kind::word) {
        const bool has_type = lexer.peek().kind == Token::Kind::string;
        see(t.text, has_type ? lexer.peek().text : std::string_view{});
        if (!decided() && t.text == "Include" && has_type &&
            scan(paths_.find(Lexer::unescape(lexer.peek().text), path)))
          return true;
        if (t.text == "WorldEnd") return true;
      }
      if (decided()) return true;
    }
    return false;
  }

  FilePaths paths_;
  std::set<std::string> seen_;
  std::size_t depth_ = 0;
  unsigned possible_ = kV2 | kV3 | kV4;
};

}  // namespace

Dialect detect_dialect(const std::string& path, const std::string& confine) {
  return Detector(path, confine).scan_all(path);
}

}  // namespace cloudrenderer
