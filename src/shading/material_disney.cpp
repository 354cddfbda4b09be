#include "shading/bsdf_disney.h"
#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

float square(float x) { return x * x; }
float share(float x) { return std::clamp(x, 0.f, 1.f); }

// Burley's principled material as pbrt-v3 has it: a diffuse, a glossy and a coat lobe, rough refraction, and a variant for
// thin surfaces, which lets diffuse light through.
class Disney final : public Material {
 public:
  explicit Disney(MaterialInputs& in)
      : color_(in.params.rgb("color", Rgb(0.5f))),
        metallic_(in.params.real("metallic", 0.f)),
        eta_(in.params.real("eta", 1.5f)),
        roughness_(in.params.real("roughness", 0.5f)),
        specular_tint_(in.params.real("speculartint", 0.f)),
        anisotropic_(in.params.real("anisotropic", 0.f)),
        sheen_(in.params.real("sheen", 0.f)),
        sheen_tint_(in.params.real("sheentint", 0.5f)),
        clearcoat_(in.params.real("clearcoat", 0.f)),
        gloss_(in.params.real("clearcoatgloss", 1.f)),
        transmission_(in.params.real("spectrans", 0.f)),
        flatness_(in.params.real("flatness", 0.f)),
        diffuse_transmission_(in.params.real("difftrans", 1.f)),
        distance_(in.params.rgb("scatterdistance", Rgb(0.f))),
        thin_(in.params.params().boolean("thin", false)) {
    if (!thin_ && (distance_.texture || !is_black(distance_.constant)))
      albedo_.emplace(eta_.texture ? 1.5f : eta_.constant, 1.f);
    in.tangents = in.tangents || anisotropic_.texture || anisotropic_.constant != 0.f;
  }

  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb color = positive(color_(at));
    const float metallic = share(metallic_(at)), transmission = share(transmission_(at)), rough = share(roughness_(at));
    const float diffuse = (1.f - metallic) * (1.f - transmission), through = share(0.5f * diffuse_transmission_(at));  // 2 is all
    const float light = luminance(color);
    const Rgb tint = light > 0.f ? color / light : Rgb(1.f);
    const float eta = eta_(at);
    const bool walks = diffuse > 0.f && albedo_ && !is_black(positive(distance_(at)));
    if (diffuse > 0.f)
      add_diffuse(at, diffuse * color, diffuse, tint, walks ? 0.f : thin_ ? 1.f - through : 1.f, rough, out);
    if (walks) out.add(bsdf::specular_transmission(Rgb(1.f), eta, false));

    const float aspect = std::sqrt(1.f - 0.9f * share(anisotropic_(at)));
    const auto microfacets = [&](float r) { return bsdf::trowbridge_reitz(square(r) / aspect, square(r) * aspect); };
    const bsdf::Microfacets m = bsdf::separable(microfacets(rough));
    const Rgb dielectric = square((eta - 1.f) / (eta + 1.f)) * glm::mix(Rgb(1.f), tint, share(specular_tint_(at)));
    out.add(bsdf::microfacet(Rgb(1.f), m, bsdf::disney_fresnel(glm::mix(dielectric, color, metallic), metallic, eta)));

    if (const float coat = clearcoat_(at); coat > 0.f) out.add(bsdf::disney_clearcoat(coat, gloss_(at)));
    // The square root: a path goes in and out.
    if (transmission > 0.f)
      out.add(bsdf::microfacet_dielectric(Rgb(0.f), transmission * glm::sqrt(color),
                                          thin_ ? microfacets((0.65f * eta - 0.35f) * rough) : m, eta));
    if (thin_ && through > 0.f && !is_black(color)) out.add(bsdf::lambert(through * color, true));
  }
  bool has_subsurface() const override { return albedo_.has_value(); }
  // The diffuse colour is that of a medium behind a boundary that bends light on its way in only. Its mean free path: the
  // profile of Burley's that has this width (Christensen and Burley 2015, "Approximate Reflectance Profiles for Efficient
  // Subsurface Scattering", for light that enters diffusely), a fifth of what the parameter says (Burley and Chiang to pbrt-v3).
  bool subsurface(const TexturePoint& at, SubsurfacePoint& out) const override {
    const Rgb distance = positive(distance_(at));
    const float diffuse = (1.f - share(metallic_(at))) * (1.f - share(transmission_(at)));
    if (!albedo_ || is_black(distance) || !(diffuse > 0.f)) return false;
    const Rgb color = diffuse * positive(color_(at));
    for (int c = 0; c < 3; ++c) {
      const float a = std::min(color[c], 1.f), albedo = albedo_->single_scattering(a);
      const float sigma_t = 1.f / std::max(0.2f * distance[c] * (1.9f - a + 3.5f * square(a - 0.8f)), 1e-9f);
      out.medium.sigma_s[c] = albedo * sigma_t;
      out.medium.sigma_a[c] = (1.f - albedo) * sigma_t;
    }
    out.medium.g = 0.f;
    out.medium = rounded_g(out.medium);
    out.boundary = bsdf::specular_dielectric(Rgb(1.f), Rgb(1.f), 1.f, false);
    out.eta = 1.f;
    return true;
  }

 private:
  void add_diffuse(const TexturePoint& at, const Rgb& color, float weight, const Rgb& tint, float reflected, float rough,
                   LobeSink& out) const {
    const float flat = thin_ ? share(flatness_(at)) : 0.f, sheen = std::max(0.f, sheen_(at));
    const Rgb sheen_color = weight * sheen * glm::mix(Rgb(1.f), tint, share(sheen_tint_(at)));
    if (is_black(color) && is_black(sheen_color)) return;
    out.add(bsdf::disney_diffuse(
        bsdf::DisneyDiffuse{color, reflected * (1.f - flat), reflected * flat, rough, sheen_color}));
  }

  TexturedRgb color_;
  TexturedFloat metallic_, eta_, roughness_, specular_tint_, anisotropic_, sheen_, sheen_tint_, clearcoat_, gloss_,
      transmission_, flatness_, diffuse_transmission_;
  TexturedRgb distance_;
  std::optional<HalfSpaceAlbedo> albedo_;  // of what scatters below the surface; none: nothing does
  bool thin_;
};

}  // namespace

std::unique_ptr<Material> make_disney(MaterialInputs& in) { return std::make_unique<Disney>(in); }

}  // namespace cloudrenderer
