#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// Lambert, or Oren and Nayar 1994 with sigma in degrees.
class Matte final : public Material {
 public:
  explicit Matte(MaterialInputs& in)
      : kd_(in.params.rgb("Kd", Rgb(0.5f))), sigma_(in.params.real("sigma", 0.f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb kd = positive(kd_(at));
    if (!is_black(kd)) out.add(bsdf::oren_nayar(kd, sigma_(at)));
  }

 private:
  TexturedRgb kd_;
  TexturedFloat sigma_;
};

class Grey final : public Material {
 public:
  void add_lobes(const TexturePoint&, LobeSink& out) const override {
    out.add(bsdf::lambert(Rgb(0.5f)));
  }
};

}  // namespace

std::unique_ptr<Material> make_matte(MaterialInputs& in) { return std::make_unique<Matte>(in); }

std::unique_ptr<Material> make_grey(MaterialInputs& in) {
  in.params.warn("the material \"subsurface\" is not supported: a grey matte one is used");
  for (const Param& p : in.params.params().all()) p.used = true;  // one warning is enough
  return std::make_unique<Grey>();
}

}  // namespace cloudrenderer
