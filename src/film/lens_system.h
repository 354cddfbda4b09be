#pragma once
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/log.h"
#include "cloudrenderer/math.h"
#include "film/aperture_image.h"

namespace cloudrenderer {

// Rays through the glass of a lens (Kolb, Mitchell and Hanrahan 1995; Pharr, Jakob and Humphreys, "Physically Based
// Rendering", 3rd ed., section 6.4). The film lies in the plane z = 0 and looks along +z; lengths in metres. All in double,
// with roots as the only functions: the same bits everywhere. Immutable once built; any thread.
class LensSystem {
 public:
  struct Ray {
    glm::dvec3 origin, direction;
  };
  // A rectangle of the plane of the rearmost element, for film points on the x axis.
  struct Pupil {
    glm::dvec2 min{0}, max{0};
    double area() const { return (max.x - min.x) * (max.y - min.y); }
    bool is_empty() const { return min.x > max.x; }
  };

  // One spherical surface or the aperture stop (curvature 0), as lens files list them, front to rear.
  struct Element {
    double curvature = 0;         // radius; positive: the centre lies towards the film
    double thickness = 0;         // along the axis to the next element; of the last one to the film
    double eta = 1;               // of what lies behind it, towards the film; 0: air
    double aperture_radius = 0;
  };
  // Reads rows of curvature radius, thickness, index, aperture diameter (millimetres; '#' comments). An aperture stop
  // narrower than the file's is set to `aperture_diameter`. Throws SceneError with the place in the file.
  static std::vector<Element> read(const std::string& path, double aperture_diameter_mm, const FileLocation& where,
                                   Warnings& warnings);

  // Moves the film so that points `focus_distance` in front of it are sharp (thick lens approximation, section 6.4.4).
  // film_diagonal: metres. aperture: of the stop, in place of a circle. Throws SceneError{where} if the lens cannot focus there.
  LensSystem(std::vector<Element> elements, double focus_distance, double film_diagonal, const FileLocation& where,
             std::optional<ApertureImage> aperture = std::nullopt);

  double rear_z() const { return elements_.back().thickness; }
  double focal_length() const { return focal_length_; }
  // From the film towards the scene; the share that the aperture lets through, 0 if the ray is stopped.
  double trace_from_film(const Ray& in, Ray& out) const;
  // Where on the rear element rays must go that reach the scene from a film point at this distance from the axis.
  const Pupil& pupil(double distance_from_axis) const;

 private:
  bool trace_from_scene(const Ray& in, Ray& out) const;
  double focused(double distance, double film_diagonal, const FileLocation& where);
  void search(double film_x, const Pupil& in, int cells, Pupil& found) const;
  Pupil opening(double film_x, const Pupil& near, int most_cells) const;
  void find_pupils();
  bool reaches_scene(double film_x, const glm::dvec2& rear) const;

  std::vector<Element> elements_;
  std::optional<ApertureImage> aperture_;
  double focal_length_ = 0, half_diagonal_ = 0;
  std::vector<Pupil> pupils_;  // by distance from the axis, up to half the diagonal
};

}  // namespace cloudrenderer
