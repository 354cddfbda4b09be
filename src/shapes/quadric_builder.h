#pragma once
// Reading the parameters that quadrics share.
#include "shapes/builders.h"

namespace cloudrenderer {

// A quadric of this kind with transform and phi_max ("phimax", degrees) read. Throws for transforms
// that are not affine.
Quadric begin_quadric(const ShapeDesc& shape, QuadricKind kind, Dialect dialect);
// A finite parameter; a positive one. Throw SceneError.
float finite_parameter(const ShapeDesc& shape, const char* name, float otherwise);
float positive_parameter(const ShapeDesc& shape, const char* name, float otherwise);
// "zmin" and "zmax", in order; throws when they are equal.
void read_z_range(const ShapeDesc& shape, float z_min, float z_max, Quadric& q);

}  // namespace cloudrenderer
