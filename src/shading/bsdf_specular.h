#pragma once
// Mirrors and smooth dielectrics. Private to the Bsdf; F: one vertex, or eight in lanes.
#include "shading/bsdf_math.h"

namespace cloudrenderer::bsdf {

template <class F>
bool is_thin(const LobeOf<F>& l) {
  return l.kind == LobeKind::specular_dielectric && l.transmits;
}

// Light that goes to and fro between two sides which each reflect f: 2 f / (1 + f) comes back.
template <class F>
F thin_reflectance(const LobeOf<F>& l, F c) {
  const F f = fresnel_dielectric<F>(c, l.eta.x);
  return 2.f * f / (1.f + f);
}

// The chance of reflecting at a dielectric (micro)facet with Fresnel factor f.
template <class F>
F reflect_chance(const LobeOf<F>& l, F f) {
  const F r = lanes::luminance(l.scale) * f, t = lanes::luminance(l.scale2) * (1.f - f);
  return lanes::select(r + t > 0.f, r / (r + t), F(0.f));
}

template <class F>
F incident_eta(const LobeOf<F>& l, const Vec3Of<F>& wo) {
  return lanes::select(wo.z > 0.f, l.eta.x, l.eta.y);
}

// As BsdfOf::sample() for a specular lobe that has been chosen with `chance`; `u` is a spare uniform number.
template <class F>
MaskOf<F> sample_specular(const LobeOf<F>& l, F chance, const Vec3Of<F>& wo, F u, const FrameOf<F>& frame,
                          BsdfSampleOf<F>& out) {
  using lanes::select;
  const F c = lanes::abs(wo.z), eta = incident_eta(l, wo);
  const MaskOf<F> outside = wo.z > 0.f;
  MaskOf<F> reflects{l.kind == LobeKind::specular_reflection};
  Vec3Of<F> weight;
  if (l.kind == LobeKind::specular_reflection) {
    weight = l.scale * fresnel(l, c, outside);
  } else {
    const F f = is_thin(l) ? thin_reflectance(l, c) : fresnel_dielectric(c, eta);
    if (l.kind == LobeKind::specular_dielectric) {
      const F reflecting = reflect_chance(l, f);
      reflects = u < reflecting;
      weight = select(reflects, l.scale * (f / reflecting), l.scale2 * ((1.f - f) / (1.f - reflecting)));
    } else {
      weight = l.scale * (1.f - f);
    }
  }
  Vec3Of<F> wi(-wo.x, -wo.y, wo.z);
  MaskOf<F> valid(true);
  out.eta = 1.f;
  if (is_thin(l)) {
    wi = select(reflects, wi, -wo);
  } else if (lanes::any(!reflects)) {
    Vec3Of<F> bent;
    const Vec3Of<F> normal(F(0.f), F(0.f), select(outside, F(1.f), F(-1.f)));
    valid = refract(wo, normal, eta, bent) || reflects;
    wi = select(reflects, wi, bent);
    if (l.scale_radiance) weight = select(reflects, weight, weight * (1.f / (eta * eta)));
    out.eta = select(reflects, F(1.f), eta);
  }
  out.specular = MaskOf<F>(true);
  out.pdf = 0.f;
  out.transmission = !reflects;
  out.weight = weight * (1.f / chance);
  out.wi = lanes::normalize(frame.to_world(wi));
  return valid && wo.z != 0.f && !lanes::is_black(out.weight);
}

}  // namespace cloudrenderer::bsdf
