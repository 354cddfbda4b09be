#pragma once
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "base/animated_transform.h"
#include "base/lanes.h"
#include "film/film.h"

namespace cloudrenderer {

// F: one ray, or eight in lanes.
template <class F>
struct CameraRayOf {
  Vec3Of<F> origin, direction;  // world, unit direction
  // The pixel's footprint as a cone: width at the origin and growth per unit of distance (both for
  // one pixel).
  F cone_width = 0, cone_spread = 0;
  F weight = 1;  // of the radiance that arrives: what a lens in front of the film leaves of it
};
using CameraRay = CameraRayOf<float>;
using CameraRay8 = CameraRayOf<Float8>;

// How a camera sees a point, for paths from lights.
struct CameraView {
  Vec3 origin, direction;  // of the camera's ray through the point, unit
  float distance = 0;      // to it
  Vec2 film{};             // raster position
  float density = 0;       // pixels of the film per area at the point across the ray
};

// perspective (with lens), orthographic, environment, realistic. Immutable; any thread. One that moves makes its rays as it stands
// at the origin, and they are to be placed().
class Camera {
 public:
  // film_diagonal: for lenses. Throws SceneError.
  static std::unique_ptr<Camera> build(const CameraDesc& desc, const FilmFrame& frame,
                                       Dialect dialect, Warnings& warnings,
                                       float film_diagonal = 35.f);
  virtual ~Camera() = default;
  // film: raster position in pixels of the full film (x right, y down); lens: uniform square.
  virtual CameraRay ray(const Vec2& film, const Vec2& lens) const = 0;
  virtual CameraRay8 ray8(const Vec2x8& film, const Vec2x8& lens) const = 0;  // the same bits in each lane
  virtual bool uses_lens() const = 0;

  // Whether view() and density() are there: for cameras that project, stand still and keep angles.
  bool views_points() const { return views_ && !moves(); }
  // False: p is not before the camera. `lens` as for ray(). What is outside of the film is seen too.
  virtual bool view(const Vec3& p, const Vec2& lens, CameraView& out) const;
  // CameraView::density on a ray of the camera, t along it.
  virtual float density(const Vec3& direction, float t) const;

  bool moves() const { return motion_.has_value(); }
  // z of camera space: how far p lies behind the camera's plane at that time.
  float depth(const Vec3& p, float time) const;
  // A ray of a camera that moves, at a time.
  void place(float time, CameraRay& ray) const;

 protected:
  // ray8() of cameras whose formulas are not made for lanes.
  CameraRay8 one_by_one(const Vec2x8& film, const Vec2x8& lens) const;
  bool views_ = false;

 private:
  std::optional<AnimatedTransform> motion_;  // camera to world
  float scale_ = 1;                          // of lengths, by it
  Mat4 to_camera_{1.f};                      // of one that stands still
};

// For the header of the picture, when the shutter opens: "worldToCamera", and of cameras that project "worldToNDC", which
// as in pbrt-v4 maps pbrt's screen from -1 .. 1 to 0 .. 1 (y up) and depths by its planes at 0.01 and 1000.
// Only for scenes that build() takes.
std::map<std::string, Mat4> camera_matrices(const CameraDesc& desc);

float film_diagonal(const Entity& film);  // of `Film`, in millimetres

// The pixel filter, importance-sampled: every sample counts for its own pixel only.
class Filter {
 public:
  // The dialects differ in "sinc" only.
  static std::unique_ptr<Filter> build(const Entity& desc, Warnings& warnings,
                                       Dialect dialect = Dialect::v2);
  virtual ~Filter() = default;
  // Offset from the pixel's centre in pixels, with a density as the filter without its sign.
  virtual Vec2 sample(const Vec2& u) const = 0;
  virtual Vec2x8 sample8(const Vec2x8& u) const = 0;
  // Whether sample(u) is where the filter is below zero.
  virtual bool negative(const Vec2& u) const = 0;
  virtual FilterLobes lobes() const { return {}; }
  // The filter itself, of an integral of 1: what sample() has the density of, times its whole integral without sign.
  virtual float value(const Vec2& offset) const = 0;
  virtual Vec2 width() const = 0;  // value() is 0 beyond
};

}  // namespace cloudrenderer
