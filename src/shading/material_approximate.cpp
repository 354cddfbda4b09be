// Materials of pbrt whose model is not here: the nearest one, with a warning.
#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// Burley's principled material reduced to metal, diffuse and a dielectric coat.
class Disney final : public Material {
 public:
  explicit Disney(MaterialInputs& in)
      : color_(in.params.rgb("color", Rgb(0.5f))),
        metallic_(in.params.real("metallic", 0.f)),
        roughness_(in.params.real("roughness", 0.5f)),
        transmission_(in.params.real("spectrans", 0.f)),
        eta_(in.params.real("eta", 1.5f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb color = positive(color_(at));
    const float metal = std::clamp(metallic_(at), 0.f, 1.f),
                rough = std::clamp(roughness_(at), 0.f, 1.f);
    const float glass = (1.f - metal) * std::clamp(transmission_(at), 0.f, 1.f),
                rest = 1.f - metal - glass;
    const float alpha = rough * rough, eta = eta_(at);
    const bsdf::Microfacets m = bsdf::trowbridge_reitz(alpha, alpha);
    // A metal of real index whose reflectance at normal incidence is the colour.
    const Rgb root = glm::sqrt(glm::clamp(color, 0.f, 0.999f));
    if (metal > 0.f)
      out.add(
          bsdf::microfacet(Rgb(metal), m, bsdf::conductor((1.f + root) / (1.f - root), Rgb(0.f))));
    if (glass > 0.f)
      out.add(bsdf::microfacet_dielectric(Rgb(glass), glass * glm::sqrt(color), m, eta));
    if (rest > 0.f) {
      if (!is_black(color)) out.add(bsdf::lambert(rest * color));
      out.add(bsdf::microfacet(Rgb(rest), m, bsdf::dielectric(eta)));
    }
  }

 private:
  TexturedRgb color_;
  TexturedFloat metallic_, roughness_, transmission_, eta_;
};

// The diffuse colour of the medium in place of the light's way through it, below a smooth surface.
class KdSubsurface final : public Material {
 public:
  explicit KdSubsurface(MaterialInputs& in)
      : kd_(in.params.rgb("Kd", Rgb(0.5f))),
        kr_(in.params.rgb("Kr", Rgb(1.f))),
        index_(in.params.real("index", 1.3f)) {}
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
  in.params.warn(std::string("this kind of material is approximated: ") + as);
  for (const Param& p : in.params.params().all()) p.used = true;  // one warning is enough
}

}  // namespace

std::unique_ptr<Material> make_disney(MaterialInputs& in) {
  approximated(
      in, "metal, diffuse and dielectric lobes from color, metallic, roughness, spectrans and eta");
  return std::make_unique<Disney>(in);
}

std::unique_ptr<Material> make_kdsubsurface(MaterialInputs& in) {
  approximated(in, "a diffuse surface of colour Kd with a smooth coat");
  return std::make_unique<KdSubsurface>(in);
}

}  // namespace cloudrenderer
