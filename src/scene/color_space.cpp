#include "scene/color_space.h"

#include <algorithm>
#include <cmath>

#include "scene/spectrum.h"

namespace cloudrenderer {

namespace {

struct Chromaticities {
  std::string_view name;
  double red[2], green[2], blue[2], white[2];
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
    const std::array<double, 8> known{c.red[0], c.red[1], c.green[0], c.green[1], c.blue[0], c.blue[1], c.white[0], c.white[1]};
    const auto near = [](float a, double b) { return std::abs(static_cast<double>(a) - b) < 1e-3; };
    if (std::ranges::equal(chromaticities, known, near)) return find(c.name);
  }
  return std::nullopt;
}

Rgb ColorSpace::to_working(const Rgb& c) const {
  if (is_working_) return c;
  const glm::dvec3 v = to_xyz_ * glm::dvec3(c);
  return xyz_to_rgb(v.x, v.y, v.z);
}

}  // namespace cloudrenderer
