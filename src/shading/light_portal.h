#pragma once
#include <optional>

#include "base/lanes.h"
#include "base/log.h"
#include "scene/description.h"

namespace cloudrenderer {

// A rectangle in the world through which alone an infinite light is seen, from the side away from `z` (PortalImageInfiniteLight
// of pbrt-v4). Private to the lights.
class Portal {
 public:
  // Of the light's parameter "portal", four corners one after another; none without it. Where they are of no rectangle, it is
  // pbrt's, with a warning. Throws SceneError for other than four, and where there is no area.
  static std::optional<Portal> of(const LightDesc& desc, Warnings& warnings);

  template <class F>
  Vec3Of<F> point(const Vec2Of<F>& u) const {
    return Vec3Of<F>(corner_) + Vec3Of<F>(x_) * (u.x * width_) + Vec3Of<F>(y_) * (u.y * height_);
  }
  // Whether light comes to p from `direction` (unit). density: by solid angle, of the directions to point() with even numbers,
  // which may also go the wrong way.
  template <class F>
  MaskOf<F> passes(const Vec3Of<F>& p, const Vec3Of<F>& direction, F& density) const {
    const F cosine = glm::dot(direction, Vec3Of<F>(z_)), ahead = glm::dot(Vec3Of<F>(corner_) - p, Vec3Of<F>(z_));
    const F t = ahead / cosine;
    const MaskOf<F> meets = t > 0.f && inside<F>(p + t * direction);
    density = lanes::select(meets, t * t / (lanes::abs(cosine) * (width_ * height_)), F(0.f));
    return meets && cosine > 0.f;
  }
  // Moves the origin of a ray that light takes against `towards` to where it comes in. False: it does not.
  bool enters(Vec3& origin, const Vec3& towards) const;

 private:
  template <class F>
  MaskOf<F> inside(const Vec3Of<F>& at) const {
    const Vec3Of<F> from = at - Vec3Of<F>(corner_);
    const F x = glm::dot(from, Vec3Of<F>(x_)), y = glm::dot(from, Vec3Of<F>(y_));
    return x >= 0.f && x <= F(width_) && y >= 0.f && y <= F(height_);
  }

  Vec3 corner_{}, x_{}, y_{}, z_{};
  float width_ = 0, height_ = 0;
};

}  // namespace cloudrenderer
