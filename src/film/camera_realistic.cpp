#include "film/camera_realistic.h"

#include <cmath>

#include "film/lens_system.h"

namespace cloudrenderer {
namespace {

class RealisticCamera final : public Camera {
 public:
  RealisticCamera(const Transform& camera_to_world, const FilmFrame& frame, double diagonal, LensSystem lens, bool simple, Shutter shutter)
      : to_world_(camera_to_world), lens_(std::move(lens)), simple_(simple), open_(simple ? 1.0 : shutter.close - shutter.open) {
    const double width = frame.width, height = frame.height;
    pitch_ = diagonal / std::sqrt(width * width + height * height);
    half_ = glm::dvec2(width, height) * 0.5;
    spread_ = static_cast<float>(pitch_ / std::fabs(lens_.focal_length()));
  }

  CameraRay ray(const Vec2& film, const Vec2& lens) const override {
    // The lens turns the picture around, but a camera's x axis points to the right and raster rows go down.
    const glm::dvec3 start((half_.x - film.x) * pitch_, (film.y - half_.y) * pitch_, 0);
    const double distance = std::sqrt(start.x * start.x + start.y * start.y);
    const LensSystem::Pupil& pupil = lens_.pupil(distance);
    const glm::dvec2 at = pupil.min + glm::dvec2(lens) * (pupil.max - pupil.min);
    // The pupil is known for points on the x axis.
    const glm::dvec2 turn = distance > 0 ? glm::dvec2(start) / distance : glm::dvec2(1, 0);
    const glm::dvec3 rear(turn.x * at.x - turn.y * at.y, turn.y * at.x + turn.x * at.y, lens_.rear_z());

    CameraRay out;
    out.cone_spread = spread_;
    LensSystem::Ray through;
    const double share = lens_.trace_from_film({start, rear - start}, through);
    if (share == 0) {
      // Light is lost in the lens: a ray of no weight that no one traces (traceable() refuses its origin).
      out.weight = 0;
      out.origin = Vec3(kInfinity);
      out.direction = glm::normalize(to_world_.vector({0, 0, 1}));
      return out;
    }
    const double cosine = (rear - start).z / glm::length(rear - start), cosine2 = cosine * cosine;
    const double against = simple_ ? lens_.pupil(0).area() : lens_.rear_z() * lens_.rear_z();
    out.weight = static_cast<float>(share * open_ * cosine2 * cosine2 * pupil.area() / against);
    out.origin = to_world_.point(Vec3(through.origin));
    out.direction = glm::normalize(to_world_.vector(Vec3(glm::normalize(through.direction))));
    return out;
  }
  CameraRay8 ray8(const Vec2x8& film, const Vec2x8& lens) const override { return one_by_one(film, lens); }
  bool uses_lens() const override { return true; }

 private:
  Transform to_world_;
  LensSystem lens_;
  bool simple_;
  double open_;  // how long the shutter is, where that counts
  double pitch_;  // of the film's pixels, metres
  glm::dvec2 half_;
  float spread_;
};

}  // namespace

std::unique_ptr<Camera> realistic_camera(const CameraDesc& desc, const Transform& camera_to_world, const FilmFrame& frame,
                                         float film_diagonal, Warnings& warnings) {
  const std::string file = desc.params.string("lensfile", "");
  if (file.empty()) throw SceneError(desc.location, "the realistic camera needs a \"lensfile\"");
  const float aperture = desc.params.real("aperturediameter", 1.f), focus = desc.params.real("focusdistance", 10.f);
  const bool simple = desc.params.boolean("simpleweighting", true);
  if (!(aperture > 0.f && aperture < kInfinity)) throw SceneError(desc.location, "aperturediameter must be above 0");
  if (!(focus > 0.f && focus < kInfinity)) throw SceneError(desc.location, "focusdistance must be above 0");
  if (!(film_diagonal > 0.f && film_diagonal < kInfinity))
    throw SceneError(desc.location, "the film's \"diagonal\" must be above 0 millimetres");
  const double diagonal = film_diagonal * 1e-3;
  std::optional<ApertureImage> image;
  if (const std::string shape = desc.params.string("aperture", ""); !shape.empty())
    image = ApertureImage::make(shape, desc.params.find("aperture")->location);
  LensSystem lens(LensSystem::read(file, aperture, desc.location, warnings), focus, diagonal, desc.location, std::move(image));
  return std::make_unique<RealisticCamera>(camera_to_world, frame, diagonal, std::move(lens), simple,
                                           desc.params.boolean("exposed", false) ? Shutter() : shutter_of(desc));
}

}  // namespace cloudrenderer
