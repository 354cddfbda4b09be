#include "film/camera.h"

#include <algorithm>
#include <cmath>

#include "base/equal_area.h"
#include "base/portable_math.h"
#include "base/sampling.h"
#include "film/camera_realistic.h"

namespace cloudrenderer {
namespace {

// The affine map from raster positions to pbrt's screen window.
struct Screen {
  float x = 0, y = 0, dx = 0, dy = 0;  // corner at raster (0, 0), step of one pixel
  template <class F>
  Vec2Of<F> at(const Vec2Of<F>& film) const {
    return {x + film.x * dx, y + film.y * dy};
  }
};

template <class F>
Vec3Of<F> transformed(const Mat4& m, const Vec3Of<F>& v) {
  const auto column = [&](int i) { return Vec3Of<F>(Vec3(m[i])); };
  return column(0) * v.x + column(1) * v.y + column(2) * v.z;
}
// m is affine.
template <class F>
Vec3Of<F> transformed_point(const Mat4& m, const Vec3Of<F>& p) {
  return transformed(m, p) + Vec3Of<F>(Vec3(m[3]));
}

bool keeps_angles(const Transform& t) {
  const Vec3 x = t.vector({1, 0, 0}), y = t.vector({0, 1, 0}), z = t.vector({0, 0, 1});
  const float a = glm::dot(x, x), tolerance = 1e-3f * a;
  return std::fabs(glm::dot(y, y) - a) < tolerance && std::fabs(glm::dot(z, z) - a) < tolerance &&
         std::fabs(glm::dot(x, y)) < tolerance && std::fabs(glm::dot(x, z)) < tolerance && std::fabs(glm::dot(y, z)) < tolerance;
}

// Fills in origin, direction and distance of the ray from `origin` in the camera's space.
bool look(const Transform& to_world, const Vec3& origin, const Vec3& p, CameraView& out) {
  out.origin = to_world.point(origin);
  const Vec3 way = p - out.origin;
  out.distance = glm::length(way);
  out.direction = way / out.distance;
  return out.distance > 0.f && out.distance < kInfinity;
}

struct Lens {
  float radius = 0, focal_distance = 1e6f;
};

class PerspectiveCamera final : public Camera {
 public:
  PerspectiveCamera(const Transform& camera_to_world, const Screen& image_plane, const Lens& lens)
      : to_world_(camera_to_world),
        plane_(image_plane),
        lens_(lens),
        pixel_area_(std::fabs(image_plane.dx * image_plane.dy)),
        eye_(camera_to_world.point(Vec3(0.f))) {
    views_ = keeps_angles(camera_to_world);
  }

  bool view(const Vec3& p, const Vec2& lens, CameraView& out) const override {
    const Vec2 l = lens_.radius > 0.f ? lens_.radius * sample_disk<float>(lens) : Vec2(0.f);
    const Vec3 at = Vec3(to_world_.inverse_matrix() * glm::vec4(p, 1.f)) - Vec3(l, 0.f);
    if (!(at.z > 0.f) || !look(to_world_, Vec3(l, 0.f), p, out)) return false;
    const Vec2 d = Vec2(at) / at.z + l / lens_.focal_distance;
    out.film = {(d.x - plane_.x) / plane_.dx, (d.y - plane_.y) / plane_.dy};
    out.density = density(out.direction, out.distance);
    return true;
  }
  float density(const Vec3& direction, float t) const override {
    const Vec3 d = Vec3(to_world_.inverse_matrix() * glm::vec4(direction, 0.f));
    const float c = d.z / glm::length(d);
    return 1.f / (pixel_area_ * c * c * c * t * t);
  }

  template <class F>
  CameraRayOf<F> make_ray(const Vec2Of<F>& film, const Vec2Of<F>& lens) const {
    CameraRayOf<F> out;
    Vec2Of<F> d = plane_.at(film);  // at z = 1
    // cosine of the angle to the axis; a pixel has the solid angle area * cos^3
    const F c = 1.f / lanes::sqrt(1.f + d.x * d.x + d.y * d.y);
    out.cone_spread = lanes::sqrt(pixel_area_ * c * c * c);
    out.origin = Vec3Of<F>(eye_);
    if (lens_.radius > 0.f) {
      const Vec2Of<F> l = F(lens_.radius) * sample_disk<F>(lens);
      out.origin = transformed_point<F>(to_world_.matrix(), {l.x, l.y, F(0.f)});
      // towards the point in focus, divided by its distance, which may be 1e30
      d -= l / F(lens_.focal_distance);
    }
    out.direction = lanes::normalize(transformed<F>(to_world_.matrix(), {d.x, d.y, F(1.f)}));
    return out;
  }
  CameraRay ray(const Vec2& film, const Vec2& lens) const override { return make_ray<float>(film, lens); }
  CameraRay8 ray8(const Vec2x8& film, const Vec2x8& lens) const override { return make_ray<Float8>(film, lens); }
  bool uses_lens() const override { return lens_.radius > 0.f; }

 private:
  Transform to_world_;
  Screen plane_;
  Lens lens_;
  float pixel_area_;
  Vec3 eye_;
};

class OrthographicCamera final : public Camera {
 public:
  OrthographicCamera(const Transform& camera_to_world, const Screen& screen, const Lens& lens)
      : to_world_(camera_to_world), screen_(screen), lens_(lens) {
    cone_width_ = std::sqrt(glm::length(
        glm::cross(to_world_.vector({screen.dx, 0, 0}), to_world_.vector({0, screen.dy, 0}))));
    views_ = keeps_angles(camera_to_world) && lens.radius == 0.f;
  }

  bool view(const Vec3& p, const Vec2&, CameraView& out) const override {
    const Vec3 at = Vec3(to_world_.inverse_matrix() * glm::vec4(p, 1.f));
    if (!(at.z > 0.f) || !look(to_world_, {at.x, at.y, 0.f}, p, out)) return false;
    out.film = {(at.x - screen_.x) / screen_.dx, (at.y - screen_.y) / screen_.dy};
    out.density = density(out.direction, out.distance);
    return true;
  }
  float density(const Vec3&, float) const override { return 1.f / (cone_width_ * cone_width_); }

  template <class F>
  CameraRayOf<F> make_ray(const Vec2Of<F>& film, const Vec2Of<F>& lens) const {
    CameraRayOf<F> out;
    Vec2Of<F> o = screen_.at(film), d(F(0.f));
    if (lens_.radius > 0.f) {
      const Vec2Of<F> l = F(lens_.radius) * sample_disk<F>(lens);
      d = (o - l) / F(lens_.focal_distance);  // of all pbrt's: one lens on the axis for all pixels
      o = l;
    }
    out.origin = transformed_point<F>(to_world_.matrix(), {o.x, o.y, F(0.f)});
    out.direction = lanes::normalize(transformed<F>(to_world_.matrix(), {d.x, d.y, F(1.f)}));
    out.cone_width = cone_width_;
    return out;
  }
  CameraRay ray(const Vec2& film, const Vec2& lens) const override { return make_ray<float>(film, lens); }
  CameraRay8 ray8(const Vec2x8& film, const Vec2x8& lens) const override { return make_ray<Float8>(film, lens); }
  bool uses_lens() const override { return lens_.radius > 0.f; }

 private:
  Transform to_world_;
  Screen screen_;
  Lens lens_;
  float cone_width_;
};

// All directions: longitude along x, polar angle from the camera's y axis along y. Or, in pbrt-v4, on a square that keeps
// areas, with the y axis in its middle.
class EnvironmentCamera final : public Camera {
 public:
  EnvironmentCamera(const Transform& camera_to_world, const FilmFrame& frame, bool equal_area)
      : to_world_(camera_to_world),
        eye_(camera_to_world.point(Vec3(0.f))),
        step_(2 * kPi / static_cast<float>(frame.width), kPi / static_cast<float>(frame.height)),
        pixel_(1.f / static_cast<float>(frame.width), 1.f / static_cast<float>(frame.height)),
        equal_area_(equal_area) {}

  CameraRay ray(const Vec2& film, const Vec2&) const override {
    CameraRay out;
    out.origin = eye_;
    out.direction = glm::normalize(to_world_.vector(equal_area_ ? on_square(film) : on_sphere(film, out.cone_spread)));
    if (equal_area_) out.cone_spread = std::sqrt(4 * kPi * pixel_.x * pixel_.y);
    return out;
  }
  CameraRay8 ray8(const Vec2x8& film, const Vec2x8& lens) const override { return one_by_one(film, lens); }
  bool uses_lens() const override { return false; }

 private:
  Vec3 on_sphere(const Vec2& film, float& spread) const {
    float sin_phi, cos_phi, sin_theta, cos_theta;
    portable::sincos(film.x * step_.x, sin_phi, cos_phi);
    portable::sincos(film.y * step_.y, sin_theta, cos_theta);
    spread = std::sqrt(step_.x * step_.y * std::fabs(sin_theta));
    return {sin_theta * cos_phi, cos_theta, sin_theta * sin_phi};
  }
  Vec3 on_square(const Vec2& film) const {
    Vec2 uv = film * pixel_;
    // The filter reaches over the edges: beyond each the square goes on, mirrored.
    for (int i = 0; i < 2; ++i)
      if (uv[i] < 0.f || uv[i] > 1.f) {
        uv[i] = uv[i] < 0.f ? -uv[i] : 2.f - uv[i];
        uv[1 - i] = 1.f - uv[1 - i];
      }
    const Vec3 d = equal_area_square_to_sphere(uv);
    return {d.x, d.z, d.y};
  }

  Transform to_world_;
  Vec3 eye_;
  Vec2 step_, pixel_;
  bool equal_area_;
};

Screen screen_window(const CameraDesc& desc, const FilmFrame& frame, Warnings& warnings) {
  const float width = static_cast<float>(frame.width), height = static_cast<float>(frame.height);
  const float aspect = desc.params.real("frameaspectratio", width / height);
  if (!(aspect > 0.f && aspect < kInfinity))
    throw SceneError{desc.location, "frameaspectratio must be above 0"};
  float w[4] = {-1, 1, -1, 1};  // x0 x1 y0 y1, the shorter axis spans 2
  if (aspect > 1.f) {
    w[0] = -aspect;
    w[1] = aspect;
  } else {
    w[2] = -1.f / aspect;
    w[3] = 1.f / aspect;
  }
  if (const BulkArray<float> given = desc.params.reals("screenwindow"); given.size() == 4) {
    std::copy(given.begin(), given.end(), w);
  } else if (!given.empty()) {
    warnings.add(desc.location, "screenwindow must have 4 values, got " + std::to_string(given.size()) + ": ignored, as in pbrt");
  }
  const Screen out{w[0], w[3], (w[1] - w[0]) / width, (w[2] - w[3]) / height};
  if (!std::isfinite(out.dx) || !std::isfinite(out.dy) || out.dx == 0.f || out.dy == 0.f)
    throw SceneError{desc.location, "screenwindow must have a finite size above 0"};
  return out;
}

Lens lens(const CameraDesc& desc) {
  const Lens out{desc.params.real("lensradius", 0.f), desc.params.real("focaldistance", 1e6f)};
  if (!(out.radius >= 0.f && out.radius < kInfinity))
    throw SceneError{desc.location, "lensradius must be 0 or more"};
  if (out.radius > 0.f && !(out.focal_distance > 0.f)) throw SceneError{desc.location, "focaldistance must be above 0"};
  return out;
}

float field_of_view(const CameraDesc& desc) {
  float fov = desc.params.real("fov", 90.f);
  const float half =
      desc.params.real("halffov", -1.f);  // of scenes that were made for other programs
  if (half > 0.f) fov = 2.f * half;
  if (!(fov > 0.f && fov < 180.f))
    throw SceneError{desc.location,
                     "fov must be between 0 and 180 degrees, got " + std::to_string(fov)};
  return fov;
}

// Camera to world.
AnimatedTransform motion_of(const CameraDesc& desc) {
  return {desc.world_to_camera.inverse_matrix(), desc.motion->end.inverse_matrix(),
          TimeSpan{desc.motion->start_time, desc.motion->end_time}, AnimatedTransform::Interpolates::forward};
}

}  // namespace

float film_diagonal(const Entity& film) { return film.params.real("diagonal", 35.f); }

CameraRay8 Camera::one_by_one(const Vec2x8& film, const Vec2x8& lens) const {
  CameraRay8 out;
  for (std::size_t i = 0; i < kLanes; ++i) {
    const CameraRay one = ray(lanes::get(film, i), lanes::get(lens, i));
    lanes::put(out.origin, i, one.origin);
    lanes::put(out.direction, i, one.direction);
    lanes::put(out.cone_width, i, one.cone_width);
    lanes::put(out.cone_spread, i, one.cone_spread);
    lanes::put(out.weight, i, one.weight);
  }
  return out;
}

bool Camera::view(const Vec3&, const Vec2&, CameraView&) const { return false; }
float Camera::density(const Vec3&, float) const { return 0.f; }

void Camera::place(float time, CameraRay& ray) const {
  const Transform to_world = placed(Affine(), {&*motion_, 1}, time);
  ray.origin = to_world.point(ray.origin);
  ray.direction = glm::normalize(to_world.vector(ray.direction));
  ray.cone_width *= scale_;
}

float Camera::depth(const Vec3& p, float time) const {
  const Mat4 m = motion_ ? placed(Affine(), {&*motion_, 1}, time).inverse().matrix() : to_camera_;
  return m[0][2] * p.x + m[1][2] * p.y + m[2][2] * p.z + m[3][2];
}

std::map<std::string, Mat4> camera_matrices(const CameraDesc& desc) {
  Transform to_camera = desc.world_to_camera;
  if (desc.motion) {
    const AnimatedTransform motion = motion_of(desc);
    to_camera = placed(Affine(), {&motion, 1}, shutter_of(desc).open).inverse();
  }
  std::map<std::string, Mat4> out{{"worldToCamera", to_camera.matrix()}};
  if (desc.type == "environment" || desc.type == "realistic") return out;
  Mat4 to_screen(1.f);
  if (desc.type != "orthographic") {
    constexpr float kNear = 0.01f, kFar = 1000.f;
    const float scale = 1.f / portable::tan(field_of_view(desc) * (kPi / 360.f));
    to_screen = Mat4(0.f);
    to_screen[0][0] = to_screen[1][1] = scale;
    to_screen[2][2] = kFar / (kFar - kNear);
    to_screen[3][2] = -kFar * kNear / (kFar - kNear);
    to_screen[2][3] = 1.f;
  }
  Mat4 to_ndc(0.5f);
  to_ndc[3] = {0.5f, 0.5f, 0.5f, 1.f};
  out["worldToNDC"] = to_ndc * to_screen * to_camera.matrix();
  return out;
}

std::unique_ptr<Camera> Camera::build(const CameraDesc& desc, const FilmFrame& frame, Dialect,
                                      Warnings& warnings, float film_diagonal) {
  const Transform at_start = desc.world_to_camera.inverse();
  const Transform to_world = desc.motion ? Transform() : at_start;
  if (!at_start.is_invertible() || !desc.world_to_camera.is_invertible())
    throw SceneError{desc.location, "the camera's transformation cannot be inverted"};
  for (const char* name : {"hither", "yon"}) desc.params.real(name, 0.f);  // clipping planes change nothing
  if (desc.params.real("shutterclose", 1.f) < desc.params.real("shutteropen", 0.f))
    warnings.add(desc.location, "shutterclose is before shutteropen: they are swapped");

  std::unique_ptr<Camera> camera;
  if (desc.type == "environment") {
    for (const char* name : {"lensradius", "focaldistance", "frameaspectratio"})
      desc.params.real(name, 0.f);
    desc.params.reals("screenwindow");
    camera = std::make_unique<EnvironmentCamera>(to_world, frame, desc.params.string("mapping", "") == "equalarea");
  } else if (desc.type == "realistic") {
    camera = realistic_camera(desc, to_world, frame, film_diagonal, warnings);
  } else if (desc.type == "orthographic") {
    camera = std::make_unique<OrthographicCamera>(to_world, screen_window(desc, frame, warnings), lens(desc));
  } else {
    if (!desc.type.empty() && desc.type != "perspective")
      warnings.add(desc.location,
                   "camera \"" + desc.type + "\" is not supported, \"perspective\" is used");
    Screen plane = screen_window(desc, frame, warnings);
    const float half = portable::tan(field_of_view(desc) * (kPi / 360.f));
    for (float* v : {&plane.x, &plane.y, &plane.dx, &plane.dy}) *v *= half;
    camera = std::make_unique<PerspectiveCamera>(to_world, plane, lens(desc));
  }
  camera->to_camera_ = desc.world_to_camera.matrix();
  if (desc.motion) {
    camera->motion_ = motion_of(desc);
    camera->scale_ = std::sqrt(glm::length(glm::cross(at_start.vector({1, 0, 0}), at_start.vector({0, 1, 0}))));
  }
  desc.params.report_unused("Camera \"" + desc.type + "\"", warnings);
  return camera;
}

}  // namespace cloudrenderer
