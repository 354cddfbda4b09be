#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// Lambert, or Oren and Nayar 1994 with sigma in degrees.
class Matte final : public Material {
 public:
  explicit Matte(MaterialInputs& in)
      : kd_(in.params.rgb("Kd", Rgb(0.5f))), sigma_(in.params.real("sigma", 0.f)), most_(most_reflected(in)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb kd = glm::min(positive(kd_(at)), most_);
    if (!is_black(kd)) out.add(bsdf::oren_nayar(kd, sigma_(at)));
  }

 private:
  TexturedRgb kd_;
  TexturedFloat sigma_;
  Rgb most_;
};

}  // namespace

std::unique_ptr<Material> make_matte(MaterialInputs& in) { return std::make_unique<Matte>(in); }

}  // namespace cloudrenderer
