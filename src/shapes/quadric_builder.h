#pragma once
// Reading the parameters that quadrics share.
#include <stdexcept>
#include <string>
#include <utility>

#include "shapes/builders.h"

namespace cloudrenderer {

// A quadric of this kind with transform and phi_max ("phimax", degrees) read. Throws for transforms
// that are not affine.
Quadric begin_quadric(const ShapeDesc& shape, QuadricKind kind, Dialect dialect);
// Nothing of a shape is left, by its numbers: pbrt's rays never hit it. Caught by make_geometry().
struct EmptyShape : std::runtime_error {
  EmptyShape(FileLocation where, const std::string& why) : runtime_error(why), location(std::move(where)) {}
  FileLocation location;
};

// A finite parameter, else SceneError; a positive one, else EmptyShape.
float finite_parameter(const ShapeDesc& shape, const char* name, float otherwise);
float positive_parameter(const ShapeDesc& shape, const char* name, float otherwise);
// "zmin" and "zmax", in order; EmptyShape when they are equal.
void read_z_range(const ShapeDesc& shape, float z_min, float z_max, Quadric& q);

}  // namespace cloudrenderer
