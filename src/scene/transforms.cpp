#include "scene/transforms.h"

#include <cmath>
#include <cstdint>

#include "base/portable_math.h"

namespace cloudrenderer {

DMat4 translate(const DVec3& by) {
  DMat4 m(1.0);
  m[3] = glm::dvec4(by, 1.0);
  return m;
}

DMat4 scale(const DVec3& by) {
  DMat4 m(1.0);
  for (int i = 0; i < 3; ++i) m[i][i] = by[i];
  return m;
}

std::optional<DMat4> rotate(double degrees, const DVec3& axis) {
  const double length = std::sqrt(glm::dot(axis, axis));
  if (!(length > 0) || !std::isfinite(length)) return std::nullopt;
  const DVec3 a = axis / length;
  // Whole quarter turns come off exactly, so that 90 degrees move no axis by a rounding error.
  degrees = std::fmod(degrees, 360.0);
  const double turns = std::nearbyint(degrees / 90);
  const double radians = (degrees - turns * 90) * (3.14159265358979323846 / 180);
  double s = portable::sin(radians), c = portable::cos(radians);
  const auto quarter = static_cast<std::int64_t>(turns) & 3;
  if (quarter & 1) {
    const double old = s;
    s = c;
    c = -old;
  }
  if (quarter & 2) {
    s = -s;
    c = -c;
  }
  DMat4 m(1.0);  // Rodrigues' formula; m[column][row]
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) m[j][i] = a[i] * a[j] * (1 - c) + (i == j ? c : 0.0);
  m[1][0] -= a.z * s;
  m[2][0] += a.y * s;
  m[0][1] += a.z * s;
  m[2][1] -= a.x * s;
  m[0][2] -= a.y * s;
  m[1][2] += a.x * s;
  return m;
}

std::optional<DMat4> look_at(const DVec3& eye, const DVec3& look, const DVec3& up) {
  const DVec3 dir = look - eye;
  const double dir_length = std::sqrt(glm::dot(dir, dir)), up_length = std::sqrt(glm::dot(up, up));
  if (!(dir_length > 0) || !(up_length > 0)) return std::nullopt;
  const DVec3 z = dir / dir_length;
  const DVec3 right = glm::cross(up / up_length, z);
  const double right_length = std::sqrt(glm::dot(right, right));
  if (!(right_length > 0)) return std::nullopt;
  const DVec3 x = right / right_length, y = glm::cross(z, x);
  DMat4 m(1.0);  // the inverse of the orthonormal camera frame is its transpose
  for (int i = 0; i < 3; ++i) m[i] = glm::dvec4(x[i], y[i], z[i], 0.0);
  m[3] = glm::dvec4(-glm::dot(x, eye), -glm::dot(y, eye), -glm::dot(z, eye), 1.0);
  return m;
}

Transform to_transform(const DMat4& m) { return Transform(Mat4(m)); }

}  // namespace cloudrenderer
