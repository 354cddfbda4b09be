#pragma once
#include <memory>

#include "film/film.h"

namespace cloudrenderer {

struct CameraRay {
  Vec3 origin{}, direction{};  // world, unit direction
  float weight = 1;
  // The pixel's footprint as a cone: width at the origin and growth per unit of distance (both for
  // one pixel).
  float cone_width = 0, cone_spread = 0;
};

// perspective (with lens), orthographic, environment. Immutable; any thread.
class Camera {
 public:
  static std::unique_ptr<Camera> build(const CameraDesc& desc, const FilmFrame& frame,
                                       Dialect dialect, Warnings& warnings);
  virtual ~Camera() = default;
  // film: raster position in pixels of the full film (x right, y down); lens: uniform square.
  virtual CameraRay ray(const Vec2& film, const Vec2& lens) const = 0;
  virtual bool uses_lens() const = 0;
};

// The pixel filter, importance-sampled: every sample counts for its own pixel only.
class Filter {
 public:
  // The dialects differ in "sinc" only.
  static std::unique_ptr<Filter> build(const Entity& desc, Warnings& warnings,
                                       Dialect dialect = Dialect::v2);
  virtual ~Filter() = default;
  // Offset from the pixel's centre in pixels, and the weight (+-const for filters with negative
  // lobes; mean 1).
  virtual Vec2 sample(const Vec2& u, float& weight) const = 0;
};

}  // namespace cloudrenderer
