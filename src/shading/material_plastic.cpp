#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// A diffuse and a glossy lobe. Both versions of pbrt give the Fresnel term the indices in the order
// (1.5, 1), so that it reflects totally beyond 42 degrees; pbrt-v2 for light from either side,
// pbrt-v3 from outside.
class Plastic final : public Material {
 public:
  explicit Plastic(MaterialInputs& in)
      : kd_(in.params.rgb("Kd", Rgb(0.25f))),
        ks_(in.params.rgb("Ks", Rgb(0.25f))),
        roughness_(Roughness::one(in, 0.1f)),
        fresnel_(in.params.dialect() == Dialect::v2 ? bsdf::dielectric_one_sided(1.f / 1.5f)
                                                    : bsdf::dielectric(1.f / 1.5f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb kd = positive(kd_(at)), ks = positive(ks_(at));
    if (!is_black(kd)) out.add(bsdf::lambert(kd));
    if (!is_black(ks)) out.add(bsdf::microfacet(ks, roughness_(at), fresnel_));
  }

 private:
  TexturedRgb kd_, ks_;
  Roughness roughness_;
  bsdf::FresnelTerm fresnel_;
};

}  // namespace

std::unique_ptr<Material> make_plastic(MaterialInputs& in) { return std::make_unique<Plastic>(in); }

}  // namespace cloudrenderer
