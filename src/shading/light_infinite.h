#pragma once
#include <vector>

#include "base/log.h"
#include "base/sampling.h"
#include "scene/description.h"

namespace cloudrenderer {

// LightSource "infinite": radiance from all directions, constant or from a latitude-longitude map
// (z is up, u runs with the azimuth from x to y, v from +z down), bilinear and repeating as pbrt's
// level 0, or from pbrt-v4's square map of equal areas, where the nearest texel counts. Private to the
// lights.
class InfiniteLight {
 public:
  // A map that cannot be read is a warning, and the light is constant, as in pbrt.
  // Without `read` it is only opened.
  InfiniteLight(const LightDesc& desc, Warnings& warnings, bool read = true);

  const Rgb& mean() const { return mean_; }  // over the sphere
  Rgb radiance(const Vec3& direction) const;
  // n: normal at the point, or zero. Constant lights are sampled by the cosine to n, maps by their
  // luminance.
  bool sample(const Vec3& n, const Vec2& u, Vec3& direction, float& pdf, Rgb& radiance) const;
  float pdf(const Vec3& n, const Vec3& direction) const;
  // Both of a direction in one pass.
  Rgb radiance_and_pdf(const Vec3& n, const Vec3& direction, float& pdf) const;
  std::uint64_t bytes() const { return texels_.size() * sizeof(Rgb) + sizeof(float) * cells_; }

 private:
  struct MapPoint {
    Vec2 uv;
    float sine;     // of the polar angle
    float stretch;  // solid angle in light space over that in the world
  };
  bool has_map() const { return !texels_.empty(); }
  void prepare_sampling();
  void prepare_equal_area();
  Rgb nearest(const Vec2& uv) const;
  double illuminance() const;  // of an upward patch, as pbrt-v4 sums it up
  MapPoint map_point(const Vec3& direction) const;
  Rgb lookup(const Vec2& uv) const;
  float map_pdf(const MapPoint& m) const;

  glm::mat3 to_world_{1.f}, to_light_{1.f};
  float inverse_volume_ = 1;  // 1 / |det to_world_|
  Rgb constant_{1.f}, mean_{1.f};
  bool equal_area_ = false;
  int width_ = 0, height_ = 0;
  std::vector<Rgb> texels_;
  Distribution2D distribution_;
  std::uint64_t cells_ = 0;
};

}  // namespace cloudrenderer
