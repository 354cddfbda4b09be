#pragma once
// Makes lobes with everything precomputed that does not depend on directions.
#include "shading/bsdf.h"

namespace cloudrenderer::bsdf {

Lobe lambert(const Rgb& reflectance, bool transmits = false);
// scale / pi times what a smooth dielectric of index eta lets in from one direction and out to the other;
// thickness: in mean free paths of a medium in it that absorbs.
Lobe coated_lambert(const Rgb& scale, float eta, float thickness = 0.f);
// sigma in degrees; 0 gives a Lambert lobe.
Lobe oren_nayar(const Rgb& reflectance, float sigma);

// What a microfacet lobe is made of: pbrt-v2's Blinn exponents from roughness, or Trowbridge-Reitz
// widths.
struct Microfacets {
  Distribution distribution;
  float x, y;
};
Microfacets blinn(float roughness);
Microfacets blinn_anisotropic(float u_roughness, float v_roughness);
Microfacets trowbridge_reitz(float alpha_x, float alpha_y);
Microfacets separable(Microfacets trowbridge_reitz);  // see Distribution
// pbrt-v3's map from a roughness in [0, 1] to a Trowbridge-Reitz width.
float roughness_to_alpha(float roughness);

// A Fresnel term for the lobes below.
struct FresnelTerm {
  Fresnel kind;
  Rgb eta, k;
};
FresnelTerm no_fresnel();
FresnelTerm dielectric(float inside_over_outside);
FresnelTerm dielectric_one_sided(float beyond_over_incident);
FresnelTerm conductor(const Rgb& eta, const Rgb& k);
FresnelTerm conductor_v2(const Rgb& eta, const Rgb& k);
// normal: the reflectance at normal incidence as far as metallic.
FresnelTerm disney_fresnel(const Rgb& normal, float metallic, float eta);

Lobe microfacet(const Rgb& scale, const Microfacets& m, const FresnelTerm& f,
                bool transmits = false);
// Trowbridge-Reitz only, in either form. A smooth surface where eta is too near 1 for the facets to matter.
Lobe microfacet_dielectric(const Rgb& reflectance, const Rgb& transmittance, const Microfacets& m,
                           float eta);
Lobe fresnel_blend(const Rgb& diffuse, const Rgb& specular, const Microfacets& m);
// Tables that outlive the lobe.
Lobe measured(const ScatteringTable& table);
Lobe fourier(const ScatteringTable& table);
Lobe specular_reflection(const Rgb& scale, const FresnelTerm& f);
// eta: inside over outside; 1 lets the ray through unbent.
Lobe specular_transmission(const Rgb& scale, float eta, bool scale_radiance);
Lobe specular_dielectric(const Rgb& reflectance, const Rgb& transmittance, float eta,
                         bool scale_radiance);
// A sheet of glass: what its two sides reflect between them in all, the rest straight through.
Lobe thin_dielectric(float eta);

// The lobe times a factor.
void scale_lobe(Lobe& lobe, const Rgb& factor);

// The lobe for eight vertices, and another one's numbers in one lane.
LobeOf<Float8> in_all_lanes(const Lobe& lobe);
void put(LobeOf<Float8>& out, std::size_t lane, const Lobe& lobe);

}  // namespace cloudrenderer::bsdf
