#pragma once
// What the two lobes of a coated surface say of its layers. Private to the Bsdf.
#include "shading/bsdf_layered.h"

namespace cloudrenderer::bsdf {

// The coat's lobe has in scale2 the medium's thickness, g and the number of walks with kWalks times that of events; in eta.x its
// index, or in norm where eta is the mirror's below. The layered lobe has in scale2 the medium's albedo, and a diffuse base's reflectance in k.
struct Slab {
  static constexpr int kWalks = 2 * kMostCoatWalks;

  explicit Slab(const Lobe& l)
      : base(l),
        coat(*(&l - 1)),
        eta(coat.fresnel == Fresnel::coated_conductor ? coat.norm : coat.eta.x),
        thickness(coat.scale2.x),
        g(coat.scale2.y),
        walks(static_cast<int>(coat.scale2.z) % kWalks),
        events(static_cast<int>(coat.scale2.z) / kWalks),
        rough(coat.kind == LobeKind::microfacet),
        scatters(thickness > 0.f && !is_black(l.scale2)) {}
  bool diffuse() const { return base.fresnel == Fresnel::none; }
  bool mirror() const { return !diffuse() && base.alpha_x == 0.f; }

  const Lobe& base;
  const Lobe& coat;
  float eta, thickness, g;
  int walks, events;
  bool rough;     // the coat
  bool scatters;  // the medium; else it only absorbs
};

}  // namespace cloudrenderer::bsdf
