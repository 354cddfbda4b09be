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
  glm::mat3 from_working() const;
  std::string_view name() const { return name_; }
  const std::array<float, 8>& chromaticities() const { return chromaticities_; }  // as those above

 private:
  bool is_working_ = true;
  std::string_view name_ = "srgb";
  std::array<float, 8> chromaticities_{.64f, .33f, .3f, .6f, .15f, .06f, .3127f, .329f};
  glm::dmat3 to_xyz_{1.0};
};

}  // namespace cloudrenderer
