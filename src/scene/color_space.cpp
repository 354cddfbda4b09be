#include "scene/color_space.h"

#include <algorithm>
#include <cmath>

#include "scene/spectrum.h"

namespace cloudrenderer {

namespace {

struct Chromaticities {
  std::string_view name;
  double red[2], green[2], blue[2], white[2];
  std::array<float, 8> xy() const {
    const auto f = [](double x) { return static_cast<float>(x); };
    return {f(red[0]), f(red[1]), f(green[0]), f(green[1]), f(blue[0]), f(blue[1]), f(white[0]), f(white[1])};
  }
};

// ITU-R BT.709, ITU-R BT.2020, SMPTE RP 431-2 primaries with a D65 white, SMPTE ST 2065-1.
constexpr Chromaticities kSpaces[] = {
    {"srgb", {0.64, 0.33}, {0.30, 0.60}, {0.15, 0.06}, {0.3127, 0.3290}},
    {"rec2020", {0.708, 0.292}, {0.170, 0.797}, {0.131, 0.046}, {0.3127, 0.3290}},
    {"dci-p3", {0.680, 0.320}, {0.265, 0.690}, {0.150, 0.060}, {0.3127, 0.3290}},
    {"aces2065-1", {0.7347, 0.2653}, {0.0, 1.0}, {0.0001, -0.0770}, {0.32168, 0.33767}},
};

glm::dvec3 xyz(const double (&xy)[2]) {
  return {xy[0] / xy[1], 1.0, (1 - xy[0] - xy[1]) / xy[1]};
}

}  // namespace

std::optional<ColorSpace> ColorSpace::find(std::string_view name) {
  if (name == "srgb") return ColorSpace();
  for (const Chromaticities& c : kSpaces) {
    if (c.name != name) continue;
    ColorSpace out;
    out.is_working_ = false;
    out.name_ = c.name;
    out.chromaticities_ = c.xy();
    const glm::dmat3 primaries(xyz(c.red), xyz(c.green), xyz(c.blue));
    const glm::dvec3 scale = glm::inverse(primaries) * xyz(c.white);
    out.to_xyz_ =
        glm::dmat3(primaries[0] * scale.x, primaries[1] * scale.y, primaries[2] * scale.z);
    return out;
  }
  return std::nullopt;
}

std::optional<ColorSpace> ColorSpace::find(const std::array<float, 8>& chromaticities) {
  for (const Chromaticities& c : kSpaces) {
    const auto near = [](float a, float b) { return std::abs(a - b) < 1e-3f; };
    if (std::ranges::equal(chromaticities, c.xy(), near)) return find(c.name);
  }
  return std::nullopt;
}

Rgb ColorSpace::to_working(const Rgb& c) const {
  if (is_working_) return c;
  const glm::dvec3 v = to_xyz_ * glm::dvec3(c);
  return xyz_to_rgb(v.x, v.y, v.z);
}

glm::mat3 ColorSpace::from_working() const {
  if (is_working_) return glm::mat3(1.f);
  const glm::dmat3 rgb_of_xyz(xyz_to_rgb(1, 0, 0), xyz_to_rgb(0, 1, 0), xyz_to_rgb(0, 0, 1));
  return glm::mat3(glm::inverse(rgb_of_xyz * to_xyz_));
}

}  // namespace cloudrenderer
