#pragma once
#include <glm/glm.hpp>
#include <optional>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// pbrt's transformations in double, for points as columns: p' = M p. The same bits on every
// machine.
using DMat4 = glm::dmat4;
using DVec3 = glm::dvec3;

DMat4 translate(const DVec3& by);
DMat4 scale(const DVec3& by);
// Counterclockwise around the axis, seen against it. None for an axis without direction.
std::optional<DMat4> rotate(double degrees, const DVec3& axis);
// World to camera, for a left-handed camera that looks along +z. None where `up` or the viewing
// direction is singular.
std::optional<DMat4> look_at(const DVec3& eye, const DVec3& look, const DVec3& up);

// In float; the inverse is that of the float matrix, so that text which gives the matrix gives
// both. A singular matrix gives a transform that is not invertible.
Transform to_transform(const DMat4& m);

}  // namespace cloudrenderer
