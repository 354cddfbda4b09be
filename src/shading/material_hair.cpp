#include "shading/bsdf_hair.h"
#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// Hair along u, v across its width. Absorption is given, or comes from a colour, or from the amounts of pigments.
class Hair final : public Material {
 public:
  explicit Hair(MaterialInputs& in)
      : eta_(in.params.real("eta", 1.55f)),
        beta_m_(in.params.real("beta_m", 0.3f)),
        beta_n_(in.params.real("beta_n", 0.3f)),
        alpha_(in.params.real("alpha", 2.f)),
        tilts_out_(in.params.params().boolean("tiltsout", false)) {
    const auto given = [&](const char* name) { return in.params.params().find(name) != nullptr; };
    if (given("sigma_a")) {
      source_ = Source::absorption;
      rgb_ = in.params.rgb("sigma_a", Rgb(0.f));
      leave_out(in, "sigma_a", {"color", "eumelanin", "pheomelanin"});
    } else if (given("color")) {
      source_ = Source::color;
      rgb_ = in.params.rgb("color", Rgb(0.5f));
      leave_out(in, "color", {"eumelanin", "pheomelanin"});
    } else {
      const bool pigments = given("eumelanin") || given("pheomelanin");
      eumelanin_ = in.params.real("eumelanin", pigments ? 0.f : 1.3f);
      pheomelanin_ = in.params.real("pheomelanin", 0.f);
    }
    in.tangents = true;
    in.params.needs().uv = true;
    in.params.set_textured();  // by v
  }

  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const float n = beta_n_(at);
    out.add(bsdf::hair({2.f * at.uv.y - 1.f, eta_(at), absorption(at, n), beta_m_(at), n, alpha_(at), tilts_out_}));
  }

 private:
  enum class Source { absorption, color, pigments };

  static void leave_out(const MaterialInputs& in, const std::string& given, std::initializer_list<const char*> others) {
    for (const char* name : others)
      if (const Param* p = in.params.params().find(name)) {
        p->used = true;
        in.params.warn("hair material: \"" + given + "\" is given, so \"" + name + "\" does not count");
      }
  }
  Rgb absorption(const TexturePoint& at, float beta_n) const {
    if (source_ == Source::absorption) return positive(rgb_(at));
    if (source_ == Source::color) return bsdf::hair_absorption_of(rgb_(at), beta_n);
    return bsdf::hair_absorption(eumelanin_(at), pheomelanin_(at));
  }

  TexturedFloat eta_, beta_m_, beta_n_, alpha_;
  bool tilts_out_;
  Source source_ = Source::pigments;
  TexturedRgb rgb_;
  TexturedFloat eumelanin_, pheomelanin_;
};

}  // namespace

std::unique_ptr<Material> make_hair(MaterialInputs& in) { return std::make_unique<Hair>(in); }

}  // namespace cloudrenderer
