#pragma once
// Sums of octaves of noise (base/noise.h). Made of IEEE operations only: the same bits on every host.
#include "base/noise.h"
#include "shading/texture_mapping.h"

namespace cloudrenderer {

// Octaves, each 1.99 times the frequency of the one before and `roughness` times its weight. Those
// that vary more than once in two pixels of the footprint are left out, the last is faded in.
struct Octaves {
  float roughness = 0.5f;
  int count = 8;
  float beyond = -1;  // what the footprint has room for besides: in pbrt-v2 two octaves more than in later ones
  static float beyond_of(Dialect dialect) { return dialect == Dialect::v2 ? 1.f : -1.f; }
};
float fbm(const SolidCoordinates& at, const Octaves& octaves);

// Sums of absolute values. Octaves that are left out count with their mean, 0.2: in pbrt-v2 without
// their weights, in pbrt-v3 with them and also where the octave fades in.
float turbulence(const SolidCoordinates& at, const Octaves& octaves, Dialect dialect);

// The parameters "octaves" and "roughness". Notes that the texture is filtered.
Octaves read_octaves(TextureInputs& in);

}  // namespace cloudrenderer
