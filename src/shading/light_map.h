#pragma once
// Pictures that lights shine through or have their radiance from. Private to the lights.
#include <span>
#include <string>
#include <vector>

#include "base/log.h"
#include "scene/description.h"
#include "shading/light_record.h"

namespace cloudrenderer {

struct LightMap {
  int width = 0, height = 0;
  std::vector<Rgb> texels;
  bool empty() const { return texels.empty(); }
};

// The picture of the light's parameter `name`, times `scale`; its rows are in the order of pbrt's reader. Values are as in the
// file, of 8 bits too, but for pbrt-v4 ("srgb"), which decodes them unless they are floats. Without `read` the file is only opened. Empty without the parameter
// and, with a warning that ends with `instead`, when it cannot be read.
LightMap read_light_map(const Entity& light, const char* name, Dialect dialect, const Rgb& scale, bool read, const char* instead,
                        Warnings& warnings);

Rgb mean(const LightMap& map);  // 1 of an empty one
// As pbrt-v4 looks up the picture of an area light: bilinear, clamped, the first row at v = 1. Any uv.
Rgb clamped(const LightMap& map, Vec2 uv);

// Bilinear and repeating, as pbrt's level 0; the first row is at v = 0. uv in [0, 1].
inline Rgb bilinear(std::span<const Rgb> texels, int width, int height, const Vec2& uv) {
  const float s = uv.x * static_cast<float>(width) - 0.5f,
              t = uv.y * static_cast<float>(height) - 0.5f;
  const float s0 = std::floor(s), t0 = std::floor(t), ds = s - s0, dt = t - t0;
  const int left = static_cast<int>(s0), x0 = left < 0 ? width - 1 : left, x1 = x0 + 1 == width ? 0 : x0 + 1;
  const int top = static_cast<int>(t0), y0 = top < 0 ? height - 1 : top, y1 = y0 + 1 == height ? 0 : y0 + 1;
  const auto texel = [&](int x, int y) {
    return texels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  };
  return (texel(x0, y0) * (1.f - ds) + texel(x1, y0) * ds) * (1.f - dt) +
         (texel(x0, y1) * (1.f - ds) + texel(x1, y1) * ds) * dt;
}

// The nearest texel; the first row is at v = 0. uv in [0, 1].
inline Rgb nearest(std::span<const Rgb> texels, int width, int height, const Vec2& uv) {
  const auto at = [](float x, int size) {
    return static_cast<std::size_t>(std::clamp(static_cast<int>(x * static_cast<float>(size)), 0, size - 1));
  };
  return texels[at(uv.y, height) * static_cast<std::size_t>(width) + at(uv.x, width)];
}

// Brings what either of them reads into the cache, but for what lies across the map's border.
inline void prefetch_texels(std::span<const Rgb> texels, int width, int height, const Vec2& uv) {
  const auto at = [](float x, int size) { return static_cast<std::size_t>(std::clamp(static_cast<int>(x * static_cast<float>(size) - 0.5f), 0, size - 1)); };
  const std::size_t first = at(uv.y, height) * static_cast<std::size_t>(width) + at(uv.x, width);
  __builtin_prefetch(&texels[first]);
  __builtin_prefetch(&texels[std::min(first + static_cast<std::size_t>(width), texels.size() - 1)]);
}

// What a point light's intensity is multiplied with, by direction.
class DirectionalMap {
 public:
  // LightSource "goniometric": the intensity as measured, over the whole sphere. "projection": a
  // picture thrown on a rectangle in front of the light.
  enum class Kind { goniometric, projection };
  DirectionalMap(Kind kind, const LightDesc& desc, Dialect dialect, bool read, Warnings& warnings);

  Rgb factor(const Vec3& world_direction) const;
  const Rgb& largest() const { return largest_; }  // of each channel
  // The smallest cosine to the light's z axis that has light, in the light's space.
  float cos_widest() const;
  std::uint64_t bytes() const { return map_.texels.size() * sizeof(Rgb); }

 private:
  Rgb lookup(const Vec2& uv) const;
  // pbrt-v4: the light gives so much in all directions together, for an intensity of 1.
  void set_power(float power);

  Kind kind_;
  bool equal_area_ = false;  // goniometric: pbrt-v4's square map
  bool nearest_ = false;     // as pbrt-v4 looks them up
  LightMap map_;  // empty: 1 everywhere
  glm::mat3 world_to_light_{1.f};
  Vec2 screen_{1.f};   // projection: half sizes of the rectangle
  float tangent_ = 1;  // projection: of half the angle that the shorter side spans
  Rgb largest_{1.f};
};

// Both kinds. Nothing for a light that gives no light.
std::optional<EmitterAndBounds> make_mapped(const LightDesc& desc, const DirectionalMap& map, Warnings& warnings);
bool sample_mapped(const Emitter& e, const DirectionalMap& map, const Vec3& p, LightSample& out);

}  // namespace cloudrenderer
