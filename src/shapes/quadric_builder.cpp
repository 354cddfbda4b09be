#include "shapes/quadric_builder.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

namespace cloudrenderer {

Quadric begin_quadric(const ShapeDesc& shape, QuadricKind kind, Dialect dialect) {
  const Mat4& m = shape.object_to_world.matrix();
  if (m[0].w != 0.f || m[1].w != 0.f || m[2].w != 0.f || m[3].w != 1.f)
    throw SceneError(shape.location,
                     fmt::format("Shape \"{}\" cannot have a perspective transform", shape.type));
  const float degrees = finite_parameter(shape, "phimax", 360.f);
  if (!(degrees > 0.f))
    throw EmptyShape(location_of(shape, "phimax"),
                     fmt::format("phimax must be > 0, got {}", degrees));
  Quadric q;
  q.kind = kind;
  q.object_to_world = shape.object_to_world;
  q.phi_max = degrees >= 360.f ? 2 * kPi : degrees * (kPi / 180.f);
  q.inside_out = dialect == Dialect::v3 && shape.object_to_world.swaps_handedness() ? 1 : 0;
  return q;
}

float finite_parameter(const ShapeDesc& shape, const char* name, float otherwise) {
  const float value = shape.params.real(name, otherwise);
  if (!std::isfinite(value))
    throw SceneError(location_of(shape, name),
                     fmt::format("{} must be a finite number, got {}", name, value));
  return value;
}

float positive_parameter(const ShapeDesc& shape, const char* name, float otherwise) {
  const float value = finite_parameter(shape, name, otherwise);
  if (!(value > 0.f))
    throw EmptyShape(location_of(shape, name), fmt::format("{} must be > 0, got {}", name, value));
  return value;
}

void read_z_range(const ShapeDesc& shape, float z_min, float z_max, Quadric& q) {
  const float a = finite_parameter(shape, "zmin", z_min),
              b = finite_parameter(shape, "zmax", z_max);
  if (a == b)
    throw EmptyShape(location_of(shape, "zmin"),
                     fmt::format("zmin and zmax must differ, both are {}", a));
  q.z_min = std::min(a, b);
  q.z_max = std::max(a, b);
}

}  // namespace cloudrenderer
