#pragma once
#include <array>
#include <optional>
#include <string_view>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Linear RGB of one of pbrt-v4's colour spaces as linear RGB with Rec. 709 primaries.
class ColorSpace {
 public:
  ColorSpace() = default;  // srgb
  static std::optional<ColorSpace> find(std::string_view name);
  // The one with these x, y of red, green, blue and white, to a thousandth.
  static std::optional<ColorSpace> find(const std::array<float, 8>& chromaticities);

  bool is_working() const { return is_working_; }
  Rgb to_working(const Rgb& c) const;

 private:
  bool is_working_ = true;
  glm::dmat3 to_xyz_{1.0};
};

}  // namespace cloudrenderer
