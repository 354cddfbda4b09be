#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

class Translucent final : public Material {
 public:
  explicit Translucent(MaterialInputs& in)
      : v3_(in.params.dialect() == Dialect::v3),
        kd_(in.params.rgb("Kd", Rgb(0.25f))),
        ks_(in.params.rgb("Ks", Rgb(0.25f))),
        reflect_(in.params.rgb("reflect", Rgb(0.5f))),
        transmit_(in.params.rgb("transmit", Rgb(0.5f))),
        roughness_(Roughness::one(in, 0.1f)),
        most_(most_reflected(in)) {}

  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb r = positive(reflect_(at)), t = positive(transmit_(at)), kd = positive(kd_(at)),
              ks = positive(ks_(at));
    if (!is_black(r * kd)) out.add(bsdf::lambert(glm::min(r * kd, most_)));
    if (!is_black(t * kd)) out.add(bsdf::lambert(glm::min(t * kd, most_), true));
    if (is_black(ks) || (is_black(r) && is_black(t))) return;
    const bsdf::Microfacets m = roughness_(at);
    if (v3_) {
      out.add(bsdf::microfacet_dielectric(r * ks, t * ks, m, 1.5f));
      return;
    }
    // pbrt-v2 mirrors a reflection lobe to the other side.
    const bsdf::FresnelTerm f = bsdf::dielectric_one_sided(1.f / 1.5f);
    if (!is_black(r)) out.add(bsdf::microfacet(r * ks, m, f));
    if (!is_black(t)) out.add(bsdf::microfacet(t * ks, m, f, true));
  }

 private:
  bool v3_;
  TexturedRgb kd_, ks_, reflect_, transmit_;
  Roughness roughness_;
  Rgb most_;
};

}  // namespace

std::unique_ptr<Material> make_translucent(MaterialInputs& in) {
  return std::make_unique<Translucent>(in);
}

}  // namespace cloudrenderer
