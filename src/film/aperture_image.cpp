#include "film/aperture_image.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "base/portable_math.h"
#include "film/film.h"

namespace cloudrenderer {
namespace {

constexpr int kSide = 256;  // pixels of what is built in, as in pbrt-v4

std::vector<glm::dvec2> pentagon() {
  std::vector<glm::dvec2> corners;
  for (int i = 0; i < 5; ++i) {
    const double angle = (0.25 - i / 5.) * 2 * std::numbers::pi;
    corners.push_back(0.8 * glm::dvec2(portable::cos(angle), portable::sin(angle)));
  }
  return corners;
}

std::vector<glm::dvec2> star() {
  std::vector<glm::dvec2> corners;
  for (int i = 0; i < 10; ++i) {
    // The tips' radius is 1, between them that of a regular pentagram.
    const double angle = i / 10. * 2 * std::numbers::pi;
    const double radius = i % 2 ? 1 : portable::cos(0.4 * std::numbers::pi) / portable::cos(0.2 * std::numbers::pi);
    corners.push_back(radius * glm::dvec2(portable::cos(angle), portable::sin(angle)));
  }
  return corners;
}

// Crossings of a line from p along +x.
bool is_inside(const std::vector<glm::dvec2>& corners, const glm::dvec2& p) {
  bool inside = false;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const glm::dvec2 &a = corners[i], &b = corners[(i + 1) % corners.size()];
    if ((a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y)) inside = !inside;
  }
  return inside;
}

}  // namespace

// Rows are turned over: pbrt-v4 draws its shapes from the top.
template <class Value>
ApertureImage ApertureImage::sampled(Value value) {
  ApertureImage out(kSide, kSide);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      out.texels_[static_cast<std::size_t>(y * kSide + x)] = value(glm::dvec2(2 * (x + 0.5) / kSide - 1, 1 - 2 * (y + 0.5) / kSide));
  return out;
}

ApertureImage ApertureImage::polygon(const std::vector<glm::dvec2>& corners) {
  return sampled([&](const glm::dvec2& p) { return is_inside(corners, p) ? 1.f : 0.f; });
}

ApertureImage ApertureImage::make(const std::string& name, const FileLocation& where) {
  ApertureImage out(0, 0);
  if (name == "gaussian") {
    out = sampled([](const glm::dvec2& p) { return static_cast<float>(std::max(0., portable::exp(-glm::dot(p, p)) - portable::exp(-1.))); });
  } else if (name == "square") {
    out = sampled([](const glm::dvec2& p) { return std::max(std::fabs(p.x), std::fabs(p.y)) < 0.5 ? 1.f : 0.f; });
  } else if (name == "pentagon") {
    out = polygon(pentagon());
  } else if (name == "star") {
    out = polygon(star());
  } else {
    Image picture;
    try {
      picture = read_image(name);
    } catch (const std::runtime_error& e) {
      throw SceneError(where, std::string("the aperture: ") + e.what() + "; built in are gaussian, square, pentagon and star");
    }
    out = ApertureImage(static_cast<int>(picture.width), static_cast<int>(picture.height));
    for (std::size_t y = 0; y < picture.height; ++y)
      for (std::size_t x = 0; x < picture.width; ++x) {
        const Rgb& c = picture.pixels[(picture.height - 1 - y) * picture.width + x];
        const float mean = (c.x + c.y + c.z) / 3.f;
        out.texels_[y * picture.width + x] = mean > 0.f && std::isfinite(mean) ? mean : 0.f;
      }
  }
  double sum = 0;
  for (const float t : out.texels_) sum += static_cast<double>(t);
  if (!(sum > 0)) throw SceneError(where, "the aperture '" + name + "' lets no light through: it is black");
  const double scale = std::numbers::pi / 4 * static_cast<double>(out.texels_.size()) / sum;
  for (float& t : out.texels_) t = static_cast<float>(scale * static_cast<double>(t));
  return out;
}

float ApertureImage::texel(int x, int y) const {
  return x < 0 || y < 0 || x >= width_ || y >= height_ ? 0.f
                                                       : texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)];
}

double ApertureImage::at(const glm::dvec2& p) const {
  if (!(std::max(std::fabs(p.x), std::fabs(p.y)) < 2)) return 0;  // also no number
  const double s = (p.x + 1) / 2 * width_ - 0.5, t = (p.y + 1) / 2 * height_ - 0.5;
  const int x = static_cast<int>(std::floor(s)), y = static_cast<int>(std::floor(t));
  const double ds = s - x, dt = t - y;
  const auto row = [&](int r) { return (1 - ds) * static_cast<double>(texel(x, r)) + ds * static_cast<double>(texel(x + 1, r)); };
  return (1 - dt) * row(y) + dt * row(y + 1);
}

}  // namespace cloudrenderer
