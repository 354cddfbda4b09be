#include "scene/dialect.h"

#include <algorithm>
#include <array>
#include <set>

#include "scene/file_paths.h"
#include "scene/language.h"
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
                                             {"Sampler", "02sequence", kV3},
                                             {"Material", "disney", kV3},
                                             {"Material", "fourier", kV3},
                                             {"Material", "none", kV3},
                                             {"Material", "hair", kV3 | kV4},
                                             {"Camera", "realistic", kV3 | kV4},
                                             {"Sampler", "maxmindist", kV3},
                                             {"Film", "image", kV2 | kV3},
                                             {"WorldEnd", "", kV2 | kV3},
                                             {"Material", "matte", kV2 | kV3},
                                             {"Material", "plastic", kV2 | kV3},
                                             {"Material", "glass", kV2 | kV3},
                                             {"Material", "metal", kV2 | kV3},
                                             {"Material", "uber", kV2 | kV3},
                                             {"Material", "shinymetal", kV2},
                                             {"Sampler", "bestcandidate", kV2},
                                             {"Sampler", "adaptive", kV2},
                                             {"Accelerator", "grid", kV2},
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
// Parameters that only pbrt-v4 has, and such that pbrt-v2 does not have; without a name those of this type.
struct ParamSign {
  std::string_view type, name;
  unsigned dialects;
};
constexpr auto kParamSigns = std::to_array<ParamSign>({{"rgb", "reflectance", kV4},
                                                       {"spectrum", "reflectance", kV4},
                                                       {"texture", "reflectance", kV4},
                                                       {"float", "illuminance", kV4},
                                                       {"float", "xradius", kV4},
                                                       {"point2", "", kV3 | kV4},
                                                       {"point3", "", kV3 | kV4},
                                                       {"vector2", "", kV3 | kV4},
                                                       {"vector3", "", kV3 | kV4},
                                                       {"normal3", "", kV3 | kV4},
                                                       {"bool", "twosided", kV3 | kV4},
                                                       {"bool", "remaproughness", kV3 | kV4},
                                                       {"float", "eta", kV3 | kV4},
                                                       {"rgb", "mfp", kV3 | kV4},
                                                       {"color", "mfp", kV3},
                                                       {"float", "diagonal", kV3 | kV4},
                                                       {"float", "maxsampleluminance", kV3},
                                                       {"float", "maxcomponentvalue", kV4},
                                                       {"float", "shadowalpha", kV3},
                                                       {"texture", "shadowalpha", kV3},
                                                       {"bool", "samplepixelcenter", kV3},
                                                       {"bool", "gamma", kV3},
                                                       {"float", "gamma", kV2},
                                                       {"integer", "levels", kV3 | kV4},
                                                       {"integer", "dimensions", kV3},
                                                       {"string", "normalmap", kV4},
                                                       {"texture", "displacement", kV4}});
// Of light sources, whose other parameters have these names elsewhere.
constexpr auto kLightSigns =
    std::to_array<ParamSign>({{"string", "filename", kV4}, {"float", "power", kV4}, {"integer", "samples", kV3}, {"string", "mapname", kV2 | kV3}});
// Signs that count only where nothing else contradicts them: pbrt-v3 passes over a number where its lights have a colour.
constexpr auto kWeakLightSigns = std::to_array<ParamSign>({{"float", "scale", kV4}});
// Likewise of films.
constexpr auto kFilmSigns = std::to_array<ParamSign>({{"float", "scale", kV3}});

class Detector {
 public:
  Detector(const std::string& path, const std::string& confine) : paths_(path, confine) {}

  Dialect scan_all(const std::string& path) {
    try {
      paths_.check(path, {});
      // The world of pbrt-v4 ends with the file.
      if (!scan(path) && world_ && possible_ == (kV3 | kV4)) return Dialect::v4;
    } catch (const SceneError&) {  // what is wrong with a file, the parser says
    }
    narrow(weak_);
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
      if (sign.directive == directive && (sign.type.empty() || sign.type == type)) narrow(sign.dialects);
  }
  // Materials that have kept their names have got parameters.
  void see_material_param(const LanguageRow& material, std::string_view name) {
    for (const LanguageParam& p : language_params(material))
      if (p.name == name && (p.dialects & kV2) == 0) narrow(p.dialects);
  }
  // What contradicts all that came before it is no sign.
  void narrow(unsigned dialects) {
    if ((possible_ & dialects) != 0) possible_ &= dialects;
  }

  bool scan_text(const std::shared_ptr<const SourceText>& text, const std::string& path) {
    Lexer lexer(text);
    bool of_light = false, of_film = false;
    const LanguageRow* material = nullptr;  // that pbrt-v2 has, too
    for (Token t = lexer.next(); t.kind != Token::Kind::end; t = lexer.next()) {
      if (t.kind == Token::Kind::open) lexer.skip_array();
      if (t.kind == Token::Kind::string) {
        std::string_view rest = t.text;
        const std::string_view param = take_word(rest), name = take_word(rest);
        for (const ParamSign& sign : kParamSigns)
          if (sign.type == param && (sign.name.empty() ? !name.empty() : sign.name == name)) narrow(sign.dialects);
        for (const ParamSign& sign : kLightSigns)
          if (of_light && sign.type == param && sign.name == name) narrow(sign.dialects);
        for (const ParamSign& sign : kWeakLightSigns)
          if (of_light && sign.type == param && sign.name == name) weak_ &= sign.dialects;
        for (const ParamSign& sign : kFilmSigns)
          if (of_film && sign.type == param && sign.name == name) narrow(sign.dialects);
        if (param == "string" && name == "type") {  // of a named material
          if (lexer.peek().kind == Token::Kind::open) lexer.next();
          if (lexer.peek().kind == Token::Kind::string) {
            see("Material", lexer.peek().text);
            material = find_language("Material", lexer.peek().text, kV2);
          }
        } else if (material) {
          see_material_param(*material, name);
        }
      }
      if (t.kind == Token::Kind::word) {
        const bool has_type = lexer.peek().kind == Token::Kind::string;
        of_light = t.text == "LightSource" || t.text == "AreaLightSource";
        of_film = t.text == "Film";
        world_ = world_ || t.text == "WorldBegin";
        material = t.text == "Material" && has_type ? find_language("Material", lexer.peek().text, kV2) : nullptr;
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
  unsigned possible_ = kV2 | kV3 | kV4, weak_ = kV2 | kV3 | kV4;
  bool world_ = false;  // WorldBegin was there
};

}  // namespace

Dialect detect_dialect(const std::string& path, const std::string& confine) {
  return Detector(path, confine).scan_all(path);
}

bool is_of_v4(const SceneDescription& scene) { return scene.film.params.boolean("keepsnegative", false); }

}  // namespace cloudrenderer
