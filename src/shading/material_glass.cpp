#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

class Mirror final : public Material {
 public:
  explicit Mirror(MaterialInputs& in) : kr_(in.params.rgb("Kr", Rgb(0.9f))) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb kr = positive(kr_(at));
    if (!is_black(kr)) out.add(bsdf::specular_reflection(kr, bsdf::no_fresnel()));
  }

 private:
  TexturedRgb kr_;
};

TexturedFloat index_param(MaterialInputs& in) {
  TexturedFloat index;
  if (in.params.dialect() == Dialect::v3 && in.params.optional_real("eta", index)) return index;
  return in.params.real("index", 1.5f);
}

class Glass final : public Material {
 public:
  explicit Glass(MaterialInputs& in)
      : v3_(in.params.dialect() == Dialect::v3),
        kr_(in.params.rgb("Kr", Rgb(1.f))),
        kt_(in.params.rgb("Kt", Rgb(1.f))),
        index_(index_param(in)) {
    if (v3_) roughness_.emplace(Roughness::two_axes(in, 0.f));  // pbrt-v2's glass is always smooth
  }
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb kr = positive(kr_(at)), kt = positive(kt_(at));
    if (is_black(kr) && is_black(kt)) return;
    const float index = index_(at);
    if (!v3_ || roughness_->smooth(at))
      out.add(bsdf::specular_dielectric(kr, kt, index, v3_));
    else
      out.add(bsdf::microfacet_dielectric(kr, kt, (*roughness_)(at), index));
  }

 private:
  bool v3_;
  TexturedRgb kr_, kt_;
  TexturedFloat index_;
  std::optional<Roughness> roughness_;
};

}  // namespace

std::unique_ptr<Material> make_mirror(MaterialInputs& in) { return std::make_unique<Mirror>(in); }
std::unique_ptr<Material> make_glass(MaterialInputs& in) { return std::make_unique<Glass>(in); }

}  // namespace cloudrenderer
