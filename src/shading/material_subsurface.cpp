// pbrt's materials for subsurface scattering: a dielectric boundary around a medium. pbrt approximates the light's way
// through the medium by a diffusion profile; here it is walked (integrator/shade_subsurface.cpp).
#include <cmath>

#include "shading/material_kinds.h"
#include "shading/media.h"

namespace cloudrenderer {
namespace {

// Of diffuse light that meets the boundary, the share that is reflected, by the fit of Egan and Hilgeman (1979) as in pbrt-v2,
// which takes what passes by it of all light that its dipole brings back.
float reflected_inside(float eta) {
  const float i = 1.f / eta;
  const float share = eta >= 1.f ? -1.4399f * i * i + 0.7099f * i + 0.6681f + 0.0636f * eta
                                 : -0.4399f + 0.7099f * i - 0.3319f * i * i + 0.0636f * i * i * i;
  return std::clamp(share, 0.f, 1.f);
}

// The boundary: smooth in pbrt-v2, in pbrt-v3 also rough. Kr and Kt colour what it reflects and lets in.
class Boundary {
 public:
  explicit Boundary(MaterialInputs& in)
      : v3_(in.params.dialect() == Dialect::v3),
        kr_(in.params.rgb("Kr", Rgb(1.f))),
        index_(v3_ ? in.params.real("eta", 1.33f) : in.params.real("index", 1.3f)) {
    kt_.constant = Rgb(1.f);
    if (!v3_) return;
    kt_ = in.params.rgb("Kt", Rgb(1.f));
    roughness_.emplace(Roughness::two_axes(in, 0.f));
  }
  // The medium's numbers are for one index.
  float constant_index() const { return index_.texture ? (v3_ ? 1.33f : 1.3f) : index_.constant; }
  Lobe from_outside(const TexturePoint& at) const { return lobe(at, positive(kr_(at)), positive(kt_(at))); }
  void from_inside(const TexturePoint& at, SubsurfacePoint& out) const {
    out.boundary = lobe(at, Rgb(1.f), Rgb(1.f));
    out.eta = out.boundary.eta.x;
    if (!v3_) out.matte_exit = 1.f - reflected_inside(out.eta);
  }

 private:
  Lobe lobe(const TexturePoint& at, const Rgb& kr, const Rgb& kt) const {
    const float index = index_(at);
    if (!roughness_ || roughness_->smooth(at)) return bsdf::specular_dielectric(kr, kt, index, false);
    return bsdf::microfacet_dielectric(kr, kt, (*roughness_)(at), index);
  }

  bool v3_;
  TexturedRgb kr_, kt_;
  TexturedFloat index_;
  std::optional<Roughness> roughness_;
};

float read_g(MaterialInputs& in) {
  if (in.params.dialect() == Dialect::v2) return 0.f;
  const float g = in.params.params().real("g", 0.f);
  if (g > -1.f && g < 1.f) return g;
  throw SceneError(in.params.location(), "g of a medium must lie between -1 and 1, got " + std::to_string(g));
}

class SubsurfaceMaterial : public Material {
 public:
  explicit SubsurfaceMaterial(MaterialInputs& in)
      : boundary_(in), scale_(in.params.params().real("scale", 1.f)), g_(read_g(in)) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Lobe l = boundary_.from_outside(at);
    if (!is_black(l.scale) || !is_black(l.scale2)) out.add(l);
  }
  bool has_subsurface() const override { return true; }
  bool subsurface(const TexturePoint& at, SubsurfacePoint& out) const override {
    out.medium.g = g_;
    coefficients(at, out.medium.sigma_a, out.medium.sigma_s);
    out.medium = rounded_g(out.medium);
    boundary_.from_inside(at, out);
    return true;
  }

 protected:
  virtual void coefficients(const TexturePoint& at, Rgb& sigma_a, Rgb& sigma_s) const = 0;

  Boundary boundary_;
  float scale_;
  float g_;
};

// By its coefficients, or those of a measured medium by name (a millimetre, reduced: isotropic).
class ByCoefficients final : public SubsurfaceMaterial {
 public:
  explicit ByCoefficients(MaterialInputs& in) : SubsurfaceMaterial(in) {
    Rgb sigma_a(.0011f, .0024f, .014f), sigma_s(2.55f, 3.21f, 3.77f);
    const std::string name = in.params.params().string("name", "");
    const bool v2 = in.params.dialect() == Dialect::v2;
    if (!name.empty()) {
      if (find_measured_medium(name, in.params.dialect(), sigma_a, sigma_s))
        g_ = 0.f;
      else
        in.params.warn("there is no measured medium \"" + name + "\": the default is used");
    }
    sigma_a_ = in.params.rgb("sigma_a", sigma_a);
    sigma_s_ = in.params.rgb(v2 ? "sigma_prime_s" : "sigma_s", sigma_s);
  }

 private:
  void coefficients(const TexturePoint& at, Rgb& sigma_a, Rgb& sigma_s) const override {
    sigma_a = positive(scale_ * sigma_a_(at));
    sigma_s = positive(scale_ * sigma_s_(at));
  }

  TexturedRgb sigma_a_, sigma_s_;
};

// By the colour that a half-space of the medium would have, and a length.
class ByColor final : public SubsurfaceMaterial {
 public:
  explicit ByColor(MaterialInputs& in)
      : SubsurfaceMaterial(in),
        v2_(in.params.dialect() == Dialect::v2),
        albedo_(boundary_.constant_index(), boundary_.constant_index()),
        color_(in.params.rgb("Kd", Rgb(0.5f))) {
    if (v2_)
      free_path_ = in.params.real("meanfreepath", 1.f);
    else
      mfp_ = in.params.rgb("mfp", Rgb(1.f));
  }

 private:
  void coefficients(const TexturePoint& at, Rgb& sigma_a, Rgb& sigma_s) const override {
    const Rgb color = color_(at), length = v2_ ? Rgb(free_path_(at)) : scale_ * mfp_(at);
    for (int c = 0; c < 3; ++c) {
      const float reduced = albedo_.single_scattering(color[c]);
      float sigma_t = 1.f / std::max(length[c], 1e-9f), albedo = reduced;
      if (v2_)
        sigma_t /= std::sqrt(3.f - reduced);  // pbrt-v2 takes the length for that of diffusion, up to a factor
      else
        albedo = reduced / (1.f - g_ + g_ * reduced);  // similarity: sigma_s (1 - g) and sigma_a stay
      sigma_s[c] = albedo * sigma_t;
      sigma_a[c] = (1.f - albedo) * sigma_t;
    }
  }

  bool v2_;
  HalfSpaceAlbedo albedo_;
  TexturedRgb color_, mfp_;
  TexturedFloat free_path_;
};

}  // namespace

std::unique_ptr<Material> make_subsurface(MaterialInputs& in) {
  return std::make_unique<ByCoefficients>(in);
}

std::unique_ptr<Material> make_kdsubsurface(MaterialInputs& in) {
  return std::make_unique<ByColor>(in);
}

}  // namespace cloudrenderer
