#include "shading/material_kinds.h"
#include "shading/subsurface.h"

namespace cloudrenderer {
namespace {

// pbrt-v4's coated diffuse surface: a dielectric coat over a diffuse base. v4 walks through the
// layers; here the light between them is a geometric series of diffuse light (Saunderson 1942), which is
// exact for a smooth and thin coat; absorption in the coat is left out.
class CoatedDiffuse final : public Material {
 public:
  explicit CoatedDiffuse(MaterialInputs& in)
      : reflectance_(in.params.rgb("reflectance", Rgb(0.5f))),
        eta_(in.params.real("eta", 1.5f)),
        roughness_(Roughness::two_axes(in, 0.f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb base = glm::clamp(reflectance_(at), 0.f, 1.f);
    const float eta = std::clamp(eta_(at), 1.f, 10.f), internal = 1.f - bsdf::diffuse_transmittance(1.f / eta);
    // Refraction spreads what enters over the whole hemisphere: eta^2 (Mitsuba 0.5's "plastic" has the same form).
    const Rgb diffuse = base / (eta * eta * (1.f - base * internal));
    if (!is_black(diffuse)) out.add(bsdf::coated_lambert(diffuse, eta));
    if (roughness_.smooth(at))
      out.add(bsdf::specular_reflection(Rgb(1.f), bsdf::dielectric_one_sided(eta)));
    else
      out.add(bsdf::microfacet(Rgb(1.f), roughness_(at), bsdf::dielectric_one_sided(eta)));
  }

 private:
  TexturedRgb reflectance_;
  TexturedFloat eta_;
  Roughness roughness_;
};

class ThinDielectric final : public Material {
 public:
  explicit ThinDielectric(MaterialInputs& in) : eta_(in.params.real("eta", 1.5f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    out.add(bsdf::thin_dielectric(eta_(at)));
  }

 private:
  TexturedFloat eta_;
};

}  // namespace

std::unique_ptr<Material> make_thindielectric(MaterialInputs& in) {
  return std::make_unique<ThinDielectric>(in);
}
std::unique_ptr<Material> make_coateddiffuse(MaterialInputs& in) {
  return std::make_unique<CoatedDiffuse>(in);
}

}  // namespace cloudrenderer
