#pragma once
// What rays of lights are aimed at. Private to the lights.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "parts/part.h"

namespace cloudrenderer {

// Spheres, half of the rays evenly to each of them, half by how large they look. Densities have the same bits on any host.
class LightAims {
 public:
  LightAims() = default;
  // The spheres around the boxes; only the first kMostSpecularBoxes count.
  explicit LightAims(std::span<const Bounds3> boxes);
  bool empty() const { return aims_.empty(); }

  // Those that light from a point can reach.
  class View {
   public:
    bool empty() const { return count_ == 0; }
    // Chooses one, and a direction (unit) to it. False: the point is inside of the one that was chosen, and the direction
    // is to be chosen as if there were none, with the numbers that u has been given.
    bool choose(Vec2& u, Vec3& direction);
    // By solid angle, of the direction that was chosen, or of any if none was; `inside`: the density of `direction` where the
    // point is inside.
    float pdf(const Vec3& direction, float inside) const;

   private:
    friend class LightAims;
    struct Cone {
      Vec3 to;  // the centre
      float radius = 0;
      float most = 0;  // 1 - cos of its angle; 0: the point is inside
      float chance = 0;
    };
    std::array<Cone, kMostSpecularBoxes> cones_;
    std::size_t count_ = 0, chosen_ = kMostSpecularBoxes;
  };
  // From p, for light that leaves within the cone around `axis` (unit) whose angle is at most a right one and has this
  // cosine; a cosine of -1: on all sides.
  View from(const Vec3& p, const Vec3& axis, float cosine) const;

  // Parallel light: a point on a line along `direction` (unit) that meets a sphere, and the density of such lines by the
  // area across, of one that has been chosen for `chosen` or of any.
  static constexpr std::size_t kNoneChosen = kMostSpecularBoxes;
  Vec3 choose_across(const Vec3& direction, Vec2 u, std::size_t& chosen) const;
  float pdf_across(const Vec3& p, const Vec3& direction, std::size_t chosen) const;

 private:
  struct Aim {
    Vec3 center;
    float radius = 0;
    float chance = 0;  // for parallel light
  };
  std::vector<Aim> aims_;
};

// Directions around the unit vector `axis`, evenly by solid angle, 1 - cos from 0 to `most`.
Vec3 sample_cone(const Vec3& axis, float most, const Vec2& u);

}  // namespace cloudrenderer
