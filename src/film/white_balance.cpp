#include "film/white_balance.h"

#include "scene/spectrum.h"

namespace cloudrenderer {
namespace {

glm::dmat3 rgb_of_xyz() { return {xyz_to_rgb(1, 0, 0), xyz_to_rgb(0, 1, 0), xyz_to_rgb(0, 0, 1)}; }

// XYZ of the white, Y = 1.
glm::dvec3 white_of(double kelvin) {
  // Temperatures of daylight are older than today's second radiation constant.
  const double t = kelvin * 1.4388 / 1.4380;
  if (t < 4000) {
    const glm::dvec3 black_body = glm::inverse(rgb_of_xyz()) * glm::dvec3(blackbody_to_rgb(kelvin, Dialect::v3));
    return black_body / black_body.y;
  }
  const double x = t <= 7000 ? ((-4.6070e9 / t + 2.9678e6) / t + 0.09911e3) / t + 0.244063
                             : ((-2.0064e9 / t + 1.9018e6) / t + 0.24748e3) / t + 0.237040;
  const double y = (-3 * x + 2.870) * x - 0.275;
  return {x / y, 1, (1 - x - y) / y};
}

}  // namespace

glm::mat3 white_balance(float kelvin, const Vec2& white) {
  // Cone responses: rows as published.
  const glm::dmat3 to_cones = glm::transpose(glm::dmat3(0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296));
  const glm::dvec2 xy(white);
  const glm::dvec3 wanted(xy.x / xy.y, 1, (1 - xy.x - xy.y) / xy.y);
  const glm::dvec3 gain = (to_cones * wanted) / (to_cones * white_of(static_cast<double>(kelvin)));
  const glm::dmat3 scaled(gain.x, 0, 0, 0, gain.y, 0, 0, 0, gain.z);
  const glm::dmat3 to_rgb = rgb_of_xyz();
  return glm::mat3(to_rgb * glm::inverse(to_cones) * scaled * to_cones * glm::inverse(to_rgb));
}

}  // namespace cloudrenderer
