#pragma once
// BSDFs of every kind, and what pbrt's models promise of them.
#include <string>
#include <vector>

#include "shading/bsdf_disney.h"
#include "shading/bsdf_hair.h"
#include "shading/bsdf_layered.h"
#include "shading/bsdf_lobes.h"
#include "shading/subsurface.h"
#include "shading_fourier_support.h"
#include "shading_measured_support.h"
#include "shading_rgl_support.h"

namespace cloudrenderer::testing {

struct BsdfCase {
  std::string name;
  std::vector<Lobe> lobes;
  bool reciprocal = true;
  bool conserves = true;  // scatters at most what arrives
  bool estimated = false;  // the value has noise: in the last bit of a direction begins another estimate
};

inline Bsdf make_bsdf(const BsdfCase& c, const Vec3& wo, const Frame& frame = Frame()) {
  Bsdf b(frame, frame.n);
  b.add(std::span<const Lobe>(c.lobes));
  b.finish(wo);
  return b;
}

inline constexpr int kBsdfKinds = 27;

// A BSDF of a kind with the numbers that `u` gives, each in [0, 1).
//   Not reciprocal are refraction (it compresses radiance), tables (fourier only at the nodes of its splines; the RGL's have
// other errors between the angles of one direction than of the other), and hair (its lobes are weighed by one of the two
// directions, and the scales tilt them).
//   More than what arrives may come from Blinn's distribution (V-grooves mask too little near grazing angles), fresnel_blend
// (gloss is not masked at all), disney (retro-reflection and sheen are added to a full diffuse term) and tilted hair. What
// the two lobes of TranslucentV3 refract and scatter is not told apart by the sample's index.
template <class Random>
BsdfCase random_case(int kind, Random&& u) {
  using namespace bsdf;
  const auto color = [&](float most = 1.f) { return most * Rgb(u(), u(), u()); };
  const auto rough = [&] { return 0.03f + 0.97f * u(); };
  const Rgb kd = color(), ks = (Rgb(1.f) - kd) * u();
  const Rgb eta(0.2f + 2.f * u(), 0.2f + 2.f * u(), 0.2f + 2.f * u()), k = color(4.f);
  const float index = 1.05f + u();
  static const MeasuredReflectance flat = formula(0.6f, 0.f, 1.f), satin = formula(0.3f, 0.4f, 20.f);
  static const auto layered = fourier_table({.albedo = 0.9f, .through = 0.3f}), colored = fourier_table({.channels = 3});
  static const auto brushed = rgl_table({.alpha_x = 0.1, .alpha_y = 0.4, .phis = 9, .folds = 2});
  static const auto lacquer = rgl_table({.alpha_x = 0.2, .alpha_y = 0.2, .diffuse = 0.4, .gloss = 0.5});
  switch (kind) {
    case 0:
      return {"Lambert", {lambert(kd), lambert(Rgb(1.f) - kd, true)}};
    case 1:
      return {"OrenNayar", {oren_nayar(kd, 90.f * u())}};
    case 2:
      return {"PlasticV2", {lambert(kd), microfacet(ks, blinn(rough()), dielectric_one_sided(1.f / 1.5f))}, true, false};
    case 3:
      return {"PlasticV3", {lambert(kd), microfacet(ks, trowbridge_reitz(rough(), rough()), dielectric(1.f / 1.5f))}};
    case 4:
      return {"MetalV2", {microfacet(Rgb(1.f), blinn(rough()), conductor_v2(eta, k))}, true, false};
    case 5:
      return {"MetalV3", {microfacet(Rgb(1.f), trowbridge_reitz(rough(), rough()), conductor(eta, k))}};
    case 6:
      return {"SubstrateV2", {fresnel_blend(kd, color(), blinn_anisotropic(rough(), rough()))}, true, false};
    case 7:
      return {"SubstrateV3", {fresnel_blend(kd, color(), trowbridge_reitz(rough(), rough()))}, true, false};
    case 8: {
      const FresnelTerm f = dielectric_one_sided(1.f / 1.5f);
      const Microfacets m = blinn(rough());
      return {"TranslucentV2", {lambert(0.5f * kd), lambert(0.5f * kd, true), microfacet(ks, m, f), microfacet(ks, m, f, true)}, true, false};
    }
    case 9:
      return {"TranslucentV3", {lambert(0.5f * kd), lambert(0.5f * kd, true),
              microfacet_dielectric(0.5f * ks, 0.5f * ks, trowbridge_reitz(rough(), rough()), index)}, false, false};
    case 10:
      return {"RoughGlass", {microfacet_dielectric(Rgb(u()), Rgb(u()), trowbridge_reitz(rough(), rough()), index)}, false};
    case 11:
      return {"SmoothGlass", {specular_dielectric(color(), color(), index, true)}, false};
    case 12:
      return {"Uber", {lambert(0.25f * kd), specular_reflection(0.25f * ks, dielectric(index)), specular_transmission(0.25f * ks, index, true),
              specular_transmission(Rgb(0.25f), 1.f, false), microfacet(0.25f * ks, trowbridge_reitz(rough(), rough()), dielectric(index))}, false};
    case 13:
      return {"Measured", {measured(u() < 0.5f ? flat : satin)}};
    case 14:
      return {"Fourier", {fourier(*layered)}, false};
    case 15:
      return {"FourierMixed", {fourier(*colored), lambert(Rgb(0.1f))}, false};
    case 16:
      return {"DisneyDiffuse", {disney_diffuse(DisneyDiffuse{kd, u(), u(), u(), color()})}, true, false};
    case 17:
      return {"DisneyGloss", {microfacet(Rgb(1.f), separable(trowbridge_reitz(rough(), rough())), disney_fresnel(color(), u(), index))}};
    case 18:
      return {"DisneyCoat", {disney_diffuse(DisneyDiffuse{kd, 1.f, 0.f, u(), Rgb(0.f)}), disney_clearcoat(u(), u())}, true, false};
    case 19:
      return {"DisneyThrough", {microfacet_dielectric(Rgb(0.f), color(), separable(trowbridge_reitz(rough(), rough())), index)}, false};
    case 20:
      return {"HairStraight", {hair({2.f * u() - 1.f, index, color(2.f), rough(), rough(), 0.f})}, false};
    case 21:  // near grazing angles too few of the samples see the diffuse lobe; a test of its own has the energy
      return {"Coated", {coated_lambert(kd / (index * index), index), specular_reflection(Rgb(1.f), dielectric_one_sided(index))}, true, false};
    case 22:
      return {"DiffuseExit", {diffuse_exit(index)}, false};
    case 23:
      return {"Rgl", {measured(u() < 0.5f ? *brushed : *lacquer)}, false};
    case 24:
      return {"HairTilted", {hair({2.f * u() - 1.f, index, color(2.f), rough(), rough(), 4.f * u(), u() < 0.5f})}, false, false};
    default: {  // few samples do not see the tail of a walk's weights
      const bool smooth = u() < 0.3f, mirror = u() < 0.3f, clear = u() < 0.3f;
      Coat coat{index, smooth ? 0.f : rough(), smooth ? 0.f : rough(), 3.f * u() * u(), clear ? Rgb(0.f) : color(), 1.9f * u() - 0.95f, 1};
      const Layers layers = kind == 25 ? coated_diffuse(coat, kd, coat_internal(coat.eta, coat.thickness))
                                       : coated_conductor(coat, eta, k, mirror ? 0.f : rough(), mirror ? 0.f : rough());
      return {kind == 25 ? "CoatedDiffuse" : "CoatedConductor", {layers.all().begin(), layers.all().end()}, false, false, true};
    }
  }
}

}  // namespace cloudrenderer::testing
