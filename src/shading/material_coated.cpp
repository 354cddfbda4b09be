#include "shading/bsdf_layered.h"
#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// The coat of pbrt-v4's layered materials: a dielectric with a medium whose mean free path is 1. Without albedo it absorbs.
class CoatInputs {
 public:
  CoatInputs(MaterialInputs& in, std::string_view index, const Roughness& roughness)
      : eta_(in.params.real(index, 1.5f)),
        thickness_(in.params.real("thickness", 0.01f)),
        g_(in.params.real("g", 0.f)),
        albedo_(in.params.rgb("albedo", Rgb(0.f))),
        roughness_(roughness),
        walks_(std::clamp(in.params.params().integer("nsamples", 1), 1, bsdf::kMostCoatWalks)),
        events_(std::clamp(in.params.params().integer("maxdepth", 10), 0, bsdf::kMostCoatEvents)) {
    in.estimated = true;
    if (!eta_.texture && !thickness_.texture) internal_ = bsdf::coat_internal(eta(TexturePoint()), thickness(TexturePoint()));
  }
  bsdf::Coat operator()(const TexturePoint& at) const {
    bsdf::Coat c;
    c.eta = eta(at);
    if (!roughness_.smooth(at)) {
      const bsdf::Microfacets m = roughness_(at);
      c.alpha_x = m.x;
      c.alpha_y = m.y;
    }
    c.thickness = thickness(at);
    c.albedo = glm::clamp(albedo_(at), 0.f, 1.f);
    c.g = bounded(g_(at), -0.99f, 0.99f);
    c.walks = walks_;
    c.events = events_;
    return c;
  }
  // See bsdf::coat_internal().
  float internal(const bsdf::Coat& c) const { return internal_ ? *internal_ : bsdf::coat_internal(c.eta, c.thickness); }

 private:
  static float bounded(float x, float least, float most) { return x >= least ? std::min(x, most) : least; }  // also no number
  float eta(const TexturePoint& at) const { return bounded(eta_(at), 1.f, 10.f); }
  float thickness(const TexturePoint& at) const { return bounded(thickness_(at), 0.f, 1e4f); }

  TexturedFloat eta_, thickness_, g_;
  TexturedRgb albedo_;
  Roughness roughness_;
  int walks_, events_;
  std::optional<float> internal_;  // when not textured
};

void add_layers(const bsdf::Layers& layers, LobeSink& out) {
  for (const Lobe& l : layers.all()) out.add(l);
}

class CoatedDiffuse final : public Material {
 public:
  explicit CoatedDiffuse(MaterialInputs& in)
      : reflectance_(in.params.rgb("reflectance", Rgb(0.5f))), coat_(in, "eta", Roughness::two_axes(in, 0.f)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const bsdf::Coat coat = coat_(at);
    add_layers(bsdf::coated_diffuse(coat, glm::clamp(reflectance_(at), 0.f, 1.f), coat_.internal(coat)), out);
  }

 private:
  TexturedRgb reflectance_;
  CoatInputs coat_;
};

class CoatedConductor final : public Material {
 public:
  explicit CoatedConductor(MaterialInputs& in)
      : conductor_(in, "conductor."), roughness_(Roughness::two_axes(in, 0.f, "conductor.")),
        coat_(in, "interface.eta", Roughness::two_axes(in, 0.f, "interface.")) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const bsdf::Coat coat = coat_(at);
    const auto [eta, k] = conductor_(at);
    float x = 0.f, y = 0.f;
    if (!roughness_.smooth(at)) {
      const bsdf::Microfacets m = roughness_(at);
      x = m.x;
      y = m.y;
    }
    // Indices count relative to the coat's, those that stand for a reflectance too, as in pbrt-v4.
    add_layers(bsdf::coated_conductor(coat, eta / coat.eta, k / coat.eta, x, y), out);
  }

 private:
  ConductorInputs conductor_;
  Roughness roughness_;
  CoatInputs coat_;
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
std::unique_ptr<Material> make_coatedconductor(MaterialInputs& in) {
  return std::make_unique<CoatedConductor>(in);
}
std::unique_ptr<Material> make_coateddiffuse(MaterialInputs& in) {
  return std::make_unique<CoatedDiffuse>(in);
}

}  // namespace cloudrenderer
