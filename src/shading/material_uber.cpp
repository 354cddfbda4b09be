#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

TexturedFloat index_param(MaterialInputs& in) {
  TexturedFloat index;
  if (in.params.dialect() == Dialect::v3 && in.params.optional_real("eta", index)) return index;
  return in.params.real("index", 1.5f);
}

// Everything at once. pbrt-v2 gives its dielectrics the indices in the order (index, 1), pbrt-v3
// (1, index).
class Uber final : public Material {
 public:
  explicit Uber(MaterialInputs& in)
      : v3_(in.params.dialect() == Dialect::v3),
        kd_(in.params.rgb("Kd", Rgb(0.25f))),
        ks_(in.params.rgb("Ks", Rgb(0.25f))),
        kr_(in.params.rgb("Kr", Rgb(0.f))),
        kt_(in.params.rgb("Kt", Rgb(0.f))),
        opacity_(in.params.rgb("opacity", Rgb(1.f))),
        roughness_(Roughness::overridden(in, 0.1f, Roughness::V::follows_u)),
        index_(index_param(in)) {}

  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb opacity = positive(opacity_(at)), through = positive(Rgb(1.f) - opacity);
    if (!is_black(through)) out.add(bsdf::specular_transmission(through, 1.f, false));
    const Rgb kd = opacity * positive(kd_(at)), ks = opacity * positive(ks_(at));
    const Rgb kr = opacity * positive(kr_(at)), kt = opacity * positive(kt_(at));
    const float index = v3_ ? index_(at) : 1.f / index_(at);
    if (!is_black(kd)) out.add(bsdf::lambert(kd));
    if (!is_black(ks))
      out.add(bsdf::microfacet(ks, roughness_(at),
                               v3_ ? bsdf::dielectric(index) : bsdf::dielectric_one_sided(index)));
    if (!is_black(kr)) out.add(bsdf::specular_reflection(kr, bsdf::dielectric(index)));
    if (!is_black(kt)) out.add(bsdf::specular_transmission(kt, index, v3_));
  }

 private:
  bool v3_;
  TexturedRgb kd_, ks_, kr_, kt_, opacity_;
  Roughness roughness_;
  TexturedFloat index_;
};

}  // namespace

std::unique_ptr<Material> make_uber(MaterialInputs& in) { return std::make_unique<Uber>(in); }

}  // namespace cloudrenderer
