#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

class Substrate final : public Material {
 public:
  explicit Substrate(MaterialInputs& in)
      : kd_(in.params.rgb("Kd", Rgb(0.5f))),
        ks_(in.params.rgb("Ks", Rgb(0.5f))),
        roughness_(Roughness::two_axes(in, 0.1f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb kd = positive(kd_(at)), ks = positive(ks_(at));
    if (!is_black(kd) || !is_black(ks)) out.add(bsdf::fresnel_blend(kd, ks, roughness_(at)));
  }

 private:
  TexturedRgb kd_, ks_;
  Roughness roughness_;
};

}  // namespace

std::unique_ptr<Material> make_substrate(MaterialInputs& in) {
  return std::make_unique<Substrate>(in);
}

}  // namespace cloudrenderer
