// Materials of pbrt whose model is not here: the nearest one, with a warning.
#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// The diffuse colour of the medium in place of the light's way through it, below a smooth surface.
class KdSubsurface final : public Material {
 public:
  explicit KdSubsurface(MaterialInputs& in)
      : kd_(in.params.rgb("Kd", Rgb(0.5f))),
        kr_(in.params.rgb("Kr", Rgb(1.f))),
        index_(in.params.dialect() == Dialect::v3 ? in.params.real("eta", 1.33f) : in.params.real("index", 1.3f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb kd = positive(kd_(at)), kr = positive(kr_(at));
    if (!is_black(kd)) out.add(bsdf::lambert(kd));
    if (!is_black(kr)) out.add(bsdf::specular_reflection(kr, bsdf::dielectric(index_(at))));
  }

 private:
  TexturedRgb kd_, kr_;
  TexturedFloat index_;
};

void approximated(const MaterialInputs& in, const char* as) {
  in.params.warn(std::string("the material \"kdsubsurface\" is approximated: ") + as);
  for (const Param& p : in.params.params().all()) p.used = true;  // one warning is enough
}

}  // namespace

std::unique_ptr<Material> make_kdsubsurface(MaterialInputs& in) {
  approximated(in, "a diffuse surface of colour Kd with a smooth coat");
  return std::make_unique<KdSubsurface>(in);
}

}  // namespace cloudrenderer
