#pragma once
// The lobes of pbrt-v3's disney material that are of no other kind (Burley, "Physically Based Shading at Disney", 2012,
// and "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering", 2015). In the shading frame.
#include "shading/bsdf_math.h"

namespace cloudrenderer::bsdf {

// What the diffuse lobe is made of.
struct DisneyDiffuse {
  Rgb color;
  float diffuse, flat;  // shares of the diffuse term and of that for subsurface scattering in thin surfaces
  float roughness;
  Rgb sheen;
};
Lobe disney_diffuse(const DisneyDiffuse& d);

// gloss: 0 satin, 1 shiny.
Lobe disney_clearcoat(float weight, float gloss);
Rgb clearcoat_value(const Lobe& l, const Vec3& wo, const Vec3& wi, const Vec3& wh, float dot, float& pdf);
bool sample_clearcoat(const Lobe& l, const Vec3& wo, const Vec2& u, Vec3& wi);
float clearcoat_albedo(float cosine);  // of weight 1, roughly

// Diffuse reflection that fades at grazing angles, retro-reflection by roughness (Burley 2015, equation 4), the
// approximation for thin subsurface scattering after Hanrahan and Krueger, and sheen. `dot`: of the half vector.
template <class F>
Vec3Of<F> disney_diffuse(const LobeOf<F>& l, F co, F ci, F dot) {
  const F fo = pow5<F>(lanes::max(0.f, 1.f - co)), fi = pow5<F>(lanes::max(0.f, 1.f - ci));
  const F rough = l.k.z * dot * dot, retro = 2.f * rough;
  const F diffuse = (1.f - 0.5f * fo) * (1.f - 0.5f * fi);
  const F flat = (1.f + fo * (rough - 1.f)) * (1.f + fi * (rough - 1.f));
  const F thin = 1.25f * (flat * (1.f / lanes::max(co + ci, 1e-6f) - 0.5f) + 0.5f);
  const F back = retro * (fo + fi + fo * fi * (retro - 1.f));
  return l.scale * (kInvPi * (l.k.x * diffuse + l.k.y * thin + back)) + l.scale2 * pow5<F>(lanes::max(0.f, 1.f - dot));
}

}  // namespace cloudrenderer::bsdf
