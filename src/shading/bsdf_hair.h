#pragma once
// Scattering of hair by lobes of reflected (p = 0), transmitted (1) and inside reflected light (2 and more) of a rough
// dielectric cylinder: Chiang, Bitterli, Tappan and Burley, "A Practical and Controllable Hair and Fur Model for
// Production Path Tracing", 2016. The shading frame has x along the hair.
#include "shading/bsdf.h"

namespace cloudrenderer::bsdf {

struct HairFiber {
  float h;  // offset along the width, -1 to 1
  float eta;
  Rgb sigma_a;           // per radius
  float beta_m, beta_n;  // roughness along and around
  float alpha;           // tilt of the scales, degrees
  bool tilts_out = false;  // pbrt-v4 tilts the direction that light leaves in, the other way; before it the one that it comes from
};
Lobe hair(const HairFiber& fiber);

// Absorption from the concentrations of pigments, and of hair that has a colour when there is much of it.
Rgb hair_absorption(float eumelanin, float pheomelanin);
Rgb hair_absorption_of(const Rgb& color, float beta_n);

// f without the cosine, and the density of sampling.
Rgb hair_value(const Lobe& l, const Vec3& wo, const Vec3& wi, float& pdf);
// Three uniform numbers. False for the few directions that the scales tilt over the end of the hair.
bool sample_hair(const Lobe& l, const Vec3& wo, float u, const Vec2& u2, Vec3& wi);

}  // namespace cloudrenderer::bsdf
