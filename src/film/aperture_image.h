#pragma once
#include <string>
#include <vector>

#include "base/error.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// How much light passes each place of an aperture stop: pbrt-v4's "aperture" of realistic cameras. All in the square that
// the stop's circle fits in. Scaled so that a stop lets as much through as an open circle. Immutable; any thread.
class ApertureImage {
 public:
  // "gaussian", "square", "pentagon", "star", or of a picture's file the mean of red, green and blue. Throws SceneError{where}.
  static ApertureImage make(const std::string& name, const FileLocation& where);

  // p: in [-1, 1] on the stop, y up; 0 outside.
  double at(const glm::dvec2& p) const;

 private:
  ApertureImage(int width, int height) : width_(width), height_(height), texels_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {}
  template <class Value>
  static ApertureImage sampled(Value value);
  static ApertureImage polygon(const std::vector<glm::dvec2>& corners);
  float texel(int x, int y) const;

  int width_, height_;
  std::vector<float> texels_;  // rows from y = -1 up
};

}  // namespace cloudrenderer
