#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// Copper, from the measured spectrum that pbrt has as its default, integrated with the CIE 1931
// observer: pbrt-v2 divides by the integral of y, pbrt-v3 by 470/471 more.
constexpr float kV3 = 470.f / 471.f;
const Rgb kCopperEta(0.200416f, 0.924047f, 1.102217f);
const Rgb kCopperK(3.912948f, 2.452838f, 2.142200f);

class Metal final : public Material {
 public:
  explicit Metal(MaterialInputs& in)
      : v2_(in.params.dialect() == Dialect::v2),
        conductor_(in),
        roughness_(Roughness::overridden(in, 0.01f, Roughness::V::keeps_roughness)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const auto [eta, k] = conductor_(at);
    if (roughness_.is_v4() && roughness_.smooth(at))  // in older pbrts the facets are never quite flat
      out.add(bsdf::specular_reflection(Rgb(1.f), bsdf::conductor(eta, k)));
    else
      out.add(bsdf::microfacet(Rgb(1.f), roughness_(at),
                               v2_ ? bsdf::conductor_v2(eta, k) : bsdf::conductor(eta, k)));
  }

 private:
  bool v2_;
  ConductorInputs conductor_;
  Roughness roughness_;
};

// The real index whose reflectance at normal incidence is r.
Rgb index_of(const Rgb& r) {
  const Rgb root = glm::sqrt(glm::clamp(r, 0.f, 0.999f));
  return (1.f + root) / (1.f - root);
}

// pbrt-v2: a glossy and a mirror lobe, reflectances given at normal incidence, no absorption.
class ShinyMetal final : public Material {
 public:
  explicit ShinyMetal(MaterialInputs& in)
      : ks_(in.params.rgb("Ks", Rgb(1.f))),
        kr_(in.params.rgb("Kr", Rgb(1.f))),
        roughness_(Roughness::one(in, 0.1f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    out.add(bsdf::microfacet(Rgb(1.f), roughness_(at),
                             bsdf::conductor_v2(index_of(ks_(at)), Rgb(0.f))));
    out.add(bsdf::specular_reflection(Rgb(1.f), bsdf::conductor_v2(index_of(kr_(at)), Rgb(0.f))));
  }

 private:
  TexturedRgb ks_, kr_;
  Roughness roughness_;
};

}  // namespace

ConductorInputs::ConductorInputs(MaterialInputs& in, std::string_view prefix)
    : eta_(in.params.rgb(std::string(prefix) + "eta", in.params.dialect() == Dialect::v2 ? kCopperEta : kCopperEta * kV3)),
      k_(in.params.rgb(std::string(prefix) + "k", in.params.dialect() == Dialect::v2 ? kCopperK : kCopperK * kV3)) {
  if (in.params.params().has("reflectance")) reflectance_ = in.params.rgb("reflectance", Rgb(0.5f));
}

ConductorInputs::Index ConductorInputs::operator()(const TexturePoint& at) const {
  if (!reflectance_) return {positive(eta_(at)), positive(k_(at))};
  // pbrt-v4: the absorption that reflects so much at normal incidence with an index of 1.
  const Rgb r = glm::clamp((*reflectance_)(at), 0.f, 0.9999f);
  return {Rgb(1.f), 2.f * glm::sqrt(r) / glm::sqrt(1.f - r)};
}

std::unique_ptr<Material> make_metal(MaterialInputs& in) { return std::make_unique<Metal>(in); }
std::unique_ptr<Material> make_shinymetal(MaterialInputs& in) {
  return std::make_unique<ShinyMetal>(in);
}

}  // namespace cloudrenderer
