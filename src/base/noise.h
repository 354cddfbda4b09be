#pragma once
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Gradient noise on a lattice of integers (Perlin, "Improving noise", SIGGRAPH 2002), of IEEE operations only: the same
// bits on every host. About -1 to 1, 0 at the lattice points and for what is no number, repeats every 256 units.
float noise(const Vec3& p);

}  // namespace cloudrenderer
