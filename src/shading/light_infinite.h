#pragma once
#include <vector>

#include "base/lanes.h"
#include "base/log.h"
#include "base/sampling.h"
#include "scene/description.h"
#include "shading/light_portal.h"

namespace cloudrenderer {

// LightSource "infinite": radiance from all directions, constant or from a latitude-longitude map
// (z is up, u runs with the azimuth from x to y, v from +z down), bilinear and repeating as pbrt's
// level 0, or from pbrt-v4's square map of equal areas, where the nearest texel counts. Private to the
// lights.
class InfiniteLight {
 public:
  // A map that cannot be read is a warning, and the light is constant, as in pbrt.
  // Without `read` it is only opened.
  InfiniteLight(const LightDesc& desc, Dialect dialect, Warnings& warnings, bool read = true);

  const Rgb& mean() const { return mean_; }  // over the sphere
  // What follows is for one direction or eight, of which the `active` ones are looked at.
  template <class F>
  Vec3Of<F> radiance(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& direction) const;  // at p, through the portal
  // n: normal at the point, or zero. Constant lights are sampled by the cosine to n, maps by their
  // luminance.
  template <class F>
  MaskOf<F> sample(MaskOf<F> active, const Vec3Of<F>& n, const Vec2Of<F>& u, Vec3Of<F>& direction, F& pdf,
                   Vec3Of<F>& radiance) const;
  // Radiance and what sample() has for the direction.
  template <class F>
  Vec3Of<F> radiance_and_pdf(MaskOf<F> active, const Vec3Of<F>& n, const Vec3Of<F>& direction, F& pdf) const;
  // Both at the point p, where a portal counts: half of the samples go through it.
  template <class F>
  MaskOf<F> sample_at(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& n, const Vec2Of<F>& u, Vec3Of<F>& direction, F& pdf,
                      Vec3Of<F>& radiance) const;
  template <class F>
  Vec3Of<F> radiance_and_pdf_at(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& n, const Vec3Of<F>& direction, F& pdf) const;
  const std::optional<Portal>& portal() const { return portal_; }
  std::uint64_t bytes() const { return texels_.size() * sizeof(Rgb) + distribution_.bytes(); }

 private:
  template <class F>
  struct MapPoint {
    Vec2Of<F> uv;
    F sine;     // of the polar angle
    F stretch;  // solid angle in light space over that in the world
  };
  bool has_map() const { return !texels_.empty(); }
  void prepare_sampling();
  void prepare_equal_area();
  double illuminance() const;  // of an upward patch, as pbrt-v4 sums it up
  template <class F>
  MapPoint<F> map_point(MaskOf<F> active, const Vec3Of<F>& direction) const;
  template <class F>
  Vec3Of<F> lookup(MaskOf<F> active, const Vec2Of<F>& uv) const;
  template <class F>
  F map_pdf(MaskOf<F> active, const MapPoint<F>& m) const;

  glm::mat3 to_world_{1.f}, to_light_{1.f};
  float inverse_volume_ = 1;  // 1 / |det to_world_|
  Rgb constant_{1.f}, mean_{1.f};
  std::optional<Portal> portal_;
  bool equal_area_ = false;
  int width_ = 0, height_ = 0;
  std::vector<Rgb> texels_;
  Distribution2D distribution_;
};

}  // namespace cloudrenderer
