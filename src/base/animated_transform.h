#pragma once
// Transformations that move while the shutter is open, as pbrt interpolates them: each end is taken apart into
// translation, rotation and scale (Shoemake and Duff 1992, "Matrix Animation and Polar Decomposition"), the rotation
// goes the short way round at a constant speed (Shoemake 1985), the rest goes straight.
#include <span>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// x -> m x + t, in double: rounded once, when all that moves a shape has been put together.
struct Affine {
  glm::dmat3 m{1.0};
  glm::dvec3 t{0.0};

  Affine() = default;
  Affine(const glm::dmat3& linear, const glm::dvec3& offset) : m(linear), t(offset) {}
  explicit Affine(const Mat4& matrix);  // its last row counts as 0 0 0 1
  glm::dvec3 point(const glm::dvec3& p) const { return m * p + t; }
  Affine inverse() const;
  friend Affine operator*(const Affine& a, const Affine& b) { return {a.m * b.m, a.m * b.t + a.t}; }
};

struct TimeSpan {
  float start = 0, end = 1;
};

// Immutable; any thread; the same bits on every host.
class AnimatedTransform {
 public:
  // What pbrt interpolates: pbrt-v3 object to world, pbrt-v2 world to object (for all but cameras), which leads along
  // another way wherever something turns that is not at the origin.
  enum class Interpolates : std::uint32_t { forward, inverse };

  // Both ends take object to world, are invertible, and can_move() from one to the other. What starts at `times.start`
  // stays there before, and at the end after.
  AnimatedTransform(const Mat4& start, const Mat4& end, TimeSpan times, Interpolates interpolates);
  // False where one end is mirrored and the other is not: the shape would be flat on its way.
  static bool can_move(const Mat4& start, const Mat4& end);

  Affine at(float time) const { return at(time, between(time)); }
  Affine inverse_at(float time) const { return inverse_at(time, between(time)); }
  // A box that holds every point of `box` at every time between `from` and `to`.
  Bounds3 bounds(const Bounds3& box, float from, float to) const;
  // Into so many steps a movement is to be divided for bounds that are tight.
  int steps() const;
  TimeSpan times() const { return times_; }

 private:
  struct Parts {  // translation, rotation as a unit quaternion x y z w, symmetric scale
    glm::dvec3 translation;
    glm::dvec4 rotation;
    glm::dmat3 scale;
  };
  static Parts take_apart(const Affine& a);
  friend Transform placed(const Affine& fixed, std::span<const AnimatedTransform> moves, float time);
  double fraction(float time) const;
  // What is interpolated, at a fraction of the time; and what follows from it.
  Affine between(double fraction) const;
  Affine between(float time) const { return between(fraction(time)); }
  Affine at(float time, const Affine& between) const;
  Affine inverse_at(float time, const Affine& between) const;
  double acceleration(const glm::dvec3& p) const;

  TimeSpan times_;
  bool inverse_;
  bool turns_, stretches_;
  Affine start_, end_, start_inverse_, end_inverse_;  // start_, end_: object to world
  // Of what is interpolated: at the start, and how far the end is from it.
  glm::dvec3 translation_, translation_step_;
  glm::dmat3 scale_, scale_step_;
  glm::dvec4 rotation_, rotation_across_;  // q(f) = rotation_ cos(f angle_) + rotation_across_ sin(f angle_)
  double angle_ = 0;                       // between the quaternions: half of what is turned by
  double scale_norm_ = 0, unscale_norm_ = 0;  // of scale_step_, and of the inverse scale at most
};

// fixed * moves[0](time) * moves[1](time) * ...: what takes the points of a moving object to the world. Matrix and inverse
// are each rounded from double.
Transform placed(const Affine& fixed, std::span<const AnimatedTransform> moves, float time);
// Its inverse alone, to the bit: what takes rays to the object.
Mat4 entering(const Affine& fixed_inverse, std::span<const AnimatedTransform> moves, float time);
// A box that holds all points of `box`, moved so, at all times.
Bounds3 moved_bounds(const Affine& fixed, std::span<const AnimatedTransform> moves, const Bounds3& box);

}  // namespace cloudrenderer
