#include <gtest/gtest.h>

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

#include "film/camera.h"
#include "film_support.h"

namespace cloudrenderer {
namespace {

using test::entity;
using test::reals;

FilmFrame frame(std::uint32_t w, std::uint32_t h) { return {w, h, 0, 0, w, h}; }

std::unique_ptr<Camera> camera(const std::string& type, std::vector<Param> params,
                               const FilmFrame& f, const Transform& world_to_camera = {}) {
  Warnings warnings;
  CameraDesc desc = entity<CameraDesc>(type, std::move(params));
  desc.world_to_camera = world_to_camera;
  auto out = Camera::build(desc, f, Dialect::v2, warnings);
  EXPECT_TRUE(warnings.list().empty());
  return out;
}

void expect_near(const Vec3& a, const Vec3& b, float tolerance = 1e-6f) {
  EXPECT_LT(glm::length(a - b), tolerance)
      << a.x << " " << a.y << " " << a.z << " against " << b.x << " " << b.y << " " << b.z;
}

TEST(PerspectiveCamera, LooksAlongItsAxisAndOverItsFieldOfView) {
  const auto c = camera("perspective", {reals("fov", {60})}, frame(200, 100));
  expect_near(c->ray({100, 50}, {}).direction, {0, 0, 1});
  const float t = std::tan(kPi / 6);  // fov is over the shorter axis: y
  expect_near(c->ray({0, 0}, {}).direction, glm::normalize(Vec3(-2 * t, t, 1)));
  expect_near(c->ray({200, 100}, {}).direction, glm::normalize(Vec3(2 * t, -t, 1)));
  expect_near(c->ray({0, 100}, {}).direction, glm::normalize(Vec3(-2 * t, -t, 1)));
  expect_near(c->ray({150, 25}, {}).direction, glm::normalize(Vec3(t, t / 2, 1)));
  EXPECT_FALSE(c->uses_lens());

  const auto tall = camera("perspective", {reals("fov", {60})}, frame(100, 200));
  expect_near(tall->ray({0, 0}, {}).direction, glm::normalize(Vec3(-t, 2 * t, 1)));
}

TEST(CameraMatrices, ProjectWhatARayOfThePixelMeets) {
  const Mat4 to_world = glm::translate(Mat4(1.f), Vec3(1, 2, 3)) * glm::rotate(Mat4(1.f), 0.7f, Vec3(0.6f, 0.8f, 0)) *
                        glm::scale(Mat4(1.f), Vec3(-1, 1, 1));
  for (const char* type : {"perspective", "orthographic"}) {
    const auto params = type == std::string("perspective") ? std::vector<Param>{reals("fov", {40})} : std::vector<Param>{};
    CameraDesc desc = entity<CameraDesc>(type, params);
    desc.world_to_camera = Transform(to_world).inverse();
    const auto matrices = camera_matrices(desc);
    const auto c = camera(type, params, frame(100, 100), desc.world_to_camera);
    for (const Vec2 at : {Vec2(0, 0), Vec2(100, 50), Vec2(20, 70)}) {
      const CameraRay ray = c->ray(at, {});
      const glm::vec4 p(ray.origin + 7.f * ray.direction, 1.f);
      const glm::vec4 ndc = matrices.at("worldToNDC") * p;
      EXPECT_NEAR(ndc.x / ndc.w, at.x / 100, 1e-5f) << type;
      EXPECT_NEAR(ndc.y / ndc.w, 1 - at.y / 100, 1e-5f) << type;
      const glm::vec4 in_camera = matrices.at("worldToCamera") * p;
      EXPECT_GT(in_camera.z, 6.f);
    }
  }
  EXPECT_FALSE(camera_matrices(entity<CameraDesc>("environment", {})).contains("worldToNDC")) << "it does not project";
}

TEST(PerspectiveCamera, TakesScreenWindowAndAspect) {
  const auto c =
      camera("perspective", {reals("fov", {90}), reals("screenwindow", {-0.5f, 1, -0.25f, 0.75f})},
             frame(10, 10));
  expect_near(c->ray({0, 0}, {}).direction, glm::normalize(Vec3(-0.5f, 0.75f, 1)));
  expect_near(c->ray({10, 10}, {}).direction, glm::normalize(Vec3(1, -0.25f, 1)));
  const auto a =
      camera("perspective", {reals("fov", {90}), reals("frameaspectratio", {3})}, frame(10, 10));
  expect_near(a->ray({10, 0}, {}).direction, glm::normalize(Vec3(3, 1, 1)));
}

TEST(PerspectiveCamera, StandsWhereTheTransformationPutsIt) {
  // Mirrored, as many pbrt scenes are, scaled and moved.
  const Mat4 to_world = glm::translate(Mat4(1.f), Vec3(1, 2, 3)) *
                        glm::rotate(Mat4(1.f), 0.5f * kPi, Vec3(0, 1, 0)) *
                        glm::scale(Mat4(1.f), Vec3(-2, 2, 2));
  const auto c =
      camera("perspective", {reals("fov", {90})}, frame(100, 100), Transform(to_world).inverse());
  const CameraRay r = c->ray({50, 50}, {});
  expect_near(r.origin, {1, 2, 3});
  expect_near(r.direction, {1, 0, 0});
  expect_near(c->ray({100, 50}, {}).direction, glm::normalize(Vec3(1, 0, 1)));
}

TEST(PerspectiveCamera, LensRaysMeetInThePlaneOfFocus) {
  const auto c = camera(
      "perspective", {reals("fov", {50}), reals("lensradius", {0.3f}), reals("focaldistance", {7})},
      frame(64, 48));
  const auto pinhole = camera("perspective", {reals("fov", {50})}, frame(64, 48));
  EXPECT_TRUE(c->uses_lens());
  for (const Vec2& film : {Vec2(3, 4), Vec2(32, 24), Vec2(60.5f, 1.25f)}) {
    const Vec3 d = pinhole->ray(film, {}).direction;
    const Vec3 focus = d * (7 / d.z);
    float widest = 0;
    for (int i = 0; i < 64; ++i) {
      const CameraRay r =
          c->ray(film, {static_cast<float>(i % 8) / 8.f, static_cast<float>(i / 8) / 8.f});
      EXPECT_NEAR(glm::length(r.direction), 1, 1e-6);
      EXPECT_EQ(r.origin.z, 0);
      widest = std::max(widest, glm::length(r.origin));
      expect_near(r.origin + r.direction * ((7 - r.origin.z) / r.direction.z), focus, 1e-5f);
    }
    EXPECT_LE(widest, 0.3001f);
    EXPECT_GT(widest, 0.25f);
  }
}

TEST(PerspectiveCamera, FocusMayBeAtInfinity) {
  const auto c = camera(
      "perspective", {reals("lensradius", {0.3f}), reals("focaldistance", {1e30f})}, frame(8, 8));
  expect_near(c->ray({4, 4}, {0.1f, 0.9f}).direction, {0, 0, 1});
}

TEST(PerspectiveCamera, ConesCoverTheirPixels) {
  const auto c = camera("perspective", {reals("fov", {70})}, frame(300, 200));
  // The solid angles of all pixels sum to that of the picture.
  double sum = 0;
  for (int y = 0; y < 200; ++y)
    for (int x = 0; x < 300; ++x) {
      const float s =
          c->ray({static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f}, {}).cone_spread;
      sum += static_cast<double>(s) * static_cast<double>(s);
    }
  const double b = std::tan(35 * 3.14159265358979 / 180), a = 1.5 * b;
  const double expected = 4 * std::asin(a * b / std::sqrt((1 + a * a) * (1 + b * b)));
  EXPECT_NEAR(sum / expected, 1, 1e-3);
}

TEST(OrthographicCamera, SendsParallelRays) {
  const auto c = camera("orthographic", {reals("screenwindow", {-4, 4, -2, 2})}, frame(80, 40));
  const CameraRay a = c->ray({0, 0}, {}), b = c->ray({60, 10}, {});
  expect_near(a.direction, {0, 0, 1});
  expect_near(b.direction, {0, 0, 1});
  expect_near(a.origin, {-4, 2, 0});
  expect_near(b.origin, {2, 1, 0});
  EXPECT_NEAR(a.cone_width, 0.1f, 1e-6);
  EXPECT_EQ(a.cone_spread, 0);
}

TEST(OrthographicCamera, HasItsLensOnTheAxisAsInPbrt) {
  const auto c = camera("orthographic", {reals("screenwindow", {-4, 4, -2, 2}), reals("lensradius", {.5f}), reals("focaldistance", {5})},
                        frame(80, 40));
  const CameraRay middle = c->ray({60, 10}, {.5f, .5f}), edge = c->ray({60, 10}, {0, .5f});
  expect_near(middle.origin, {0, 0, 0});
  EXPECT_NEAR(glm::length(edge.origin), .5f, 1e-6);
  for (const CameraRay& ray : {middle, edge}) expect_near(ray.origin + ray.direction * (5 / ray.direction.z), {2, 1, 5});  // in focus
}

TEST(EnvironmentCamera, SeesAllDirections) {
  const auto c = camera("environment", {}, frame(200, 100));
  expect_near(c->ray({0, 50}, {}).direction, {1, 0, 0});
  expect_near(c->ray({50, 50}, {}).direction, {0, 0, 1});
  expect_near(c->ray({17, 0}, {}).direction, {0, 1, 0});
  expect_near(c->ray({17, 100}, {}).direction, {0, -1, 0});
}

TEST(EqualAreaCamera, HasTheYAxisInTheMiddleAndEqualAreas) {
  const auto c = camera("environment", {test::string("mapping", "equalarea")}, frame(100, 100));
  expect_near(c->ray({50, 50}, {}).direction, {0, 1, 0});
  for (const Vec2 corner : {Vec2(0, 0), Vec2(100, 0), Vec2(100, 100)}) expect_near(c->ray(corner, {}).direction, {0, -1, 0});
  expect_near(c->ray({100, 50}, {}).direction, {1, 0, 0});
  expect_near(c->ray({50, 100}, {}).direction, {0, 0, 1});
  // Beyond the right edge the square goes on, mirrored.
  expect_near(c->ray({100.5f, 20}, {}).direction, c->ray({99.5f, 80}, {}).direction);
  double sum = 0;  // of y over the pixels: 0 on a sphere; and of y^2: a third
  for (int i = 0; i < 100; ++i)
    for (int j = 0; j < 100; ++j) {
      const Vec3 d = c->ray({static_cast<float>(i) + .5f, static_cast<float>(j) + .5f}, {}).direction;
      sum += static_cast<double>(d.y) * static_cast<double>(d.y);
    }
  EXPECT_NEAR(sum / 1e4, 1.0 / 3, 1e-3);
}

TEST(Camera, EightRaysHaveTheBitsOfEach) {
  const Transform tilted(glm::rotate(Mat4(1.f), 0.7f, Vec3(1, 2, 3)) * glm::translate(Mat4(1.f), Vec3(1, 5, -2)));
  const std::vector<Param> with_lens = {reals("lensradius", {0.3f}), reals("focaldistance", {4})};
  for (const auto& [type, params] : {std::pair<std::string, std::vector<Param>>{"perspective", {}},
                                     {"perspective", with_lens}, {"orthographic", with_lens}, {"environment", {}}}) {
    const auto c = camera(type, params, frame(640, 480), tilted);
    Vec2x8 film, lens;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const auto x = static_cast<float>(i);
      film.x.v[i] = 70.3f * x;
      film.y.v[i] = 11.f + 55.7f * x;
      lens.x.v[i] = i == 2 ? 0.5f : 0.11f * x;  // the middle of the lens
      lens.y.v[i] = i == 2 ? 0.5f : 0.97f - 0.1f * x;
    }
    const CameraRay8 eight = c->ray8(film, lens);
    for (std::size_t i = 0; i < kLanes; ++i) {
      const CameraRay one = c->ray(lanes::get(film, i), lanes::get(lens, i));
      EXPECT_EQ(one.origin, lanes::get(eight.origin, i)) << type;
      EXPECT_EQ(one.direction, lanes::get(eight.direction, i)) << type;
      EXPECT_EQ(one.cone_spread, lanes::get(eight.cone_spread, i)) << type;
      EXPECT_EQ(one.cone_width, lanes::get(eight.cone_width, i)) << type;
    }
  }
}

TEST(Camera, AcceptsWhatChangesNothing) {
  camera("perspective",
         {reals("hither", {0.1f}), reals("yon", {100}), reals("shutteropen", {0}),
          reals("shutterclose", {1})},
         frame(8, 8));
}

TEST(Camera, RefusesWhatMakesNoPicture) {
  EXPECT_THROW(camera("perspective", {reals("fov", {180})}, frame(8, 8)), SceneError);
  EXPECT_THROW(camera("perspective", {reals("fov", {-5})}, frame(8, 8)), SceneError);
  EXPECT_THROW(camera("perspective", {reals("screenwindow", {0, 0, 0, 1})}, frame(8, 8)),
               SceneError);
  EXPECT_THROW(
      camera("perspective", {}, frame(8, 8), Transform(glm::scale(Mat4(1.f), Vec3(0, 1, 1)))),
      SceneError);
}

TEST(Camera, WarnsAboutUnknownKindsAndParameters) {
  Warnings warnings;
  Camera::build(entity<CameraDesc>("fisheye", {reals("nonsense", {1})}), frame(8, 8), Dialect::v3,
                warnings);
  EXPECT_EQ(warnings.list().size(), 2u);
}

// A camera that moves is, at every time, the camera that stands there.
TEST(MovingCamera, IsAtEachTimeTheOneThatStandsThere) {
  const FilmFrame f = frame(40, 20);
  const glm::mat4 start = glm::translate(glm::mat4(1.f), Vec3(1, 2, 3)),
                  end = glm::rotate(glm::translate(glm::mat4(1.f), Vec3(3, 2, 3)), 1.2f, Vec3(0, 0, 1));
  for (const char* type : {"perspective", "orthographic", "environment"}) {
    Warnings warnings;
    CameraDesc desc = entity<CameraDesc>(type, {});
    if (std::string(type) != "environment") desc.params.add(reals("lensradius", {0.1f}));
    desc.world_to_camera = Transform(start).inverse();
    desc.motion = Motion{Transform(end).inverse(), 2, 4};
    const auto moving = Camera::build(desc, f, Dialect::v2, warnings);
    ASSERT_TRUE(moving->moves());
    for (const float time : {0.f, 2.f, 3.f, 3.5f, 4.f, 9.f}) {
      const float g = std::clamp((time - 2) / 2, 0.f, 1.f);
      desc.motion.reset();
      desc.world_to_camera =
          Transform(glm::rotate(glm::translate(glm::mat4(1.f), Vec3(1 + 2 * g, 2, 3)), 1.2f * g, Vec3(0, 0, 1))).inverse();
      const auto still = Camera::build(desc, f, Dialect::v2, warnings);
      ASSERT_FALSE(still->moves());
      for (const Vec2 film : {Vec2(0, 0), Vec2(31, 7)}) {
        CameraRay ray = moving->ray(film, {0.3f, 0.8f});
        moving->place(time, ray);
        const CameraRay expected = still->ray(film, {0.3f, 0.8f});
        expect_near(ray.origin, expected.origin, 1e-5f);
        expect_near(ray.direction, expected.direction, 1e-5f);
        EXPECT_FLOAT_EQ(ray.cone_spread, expected.cone_spread);
        EXPECT_NEAR(ray.cone_width, expected.cone_width, 1e-6f);
      }
    }
  }
}

TEST(MovingCamera, AShutterThatClosesBeforeItOpensIsTurnedRound) {
  Warnings warnings;
  const CameraDesc desc = entity<CameraDesc>("perspective", {reals("shutteropen", {2}), reals("shutterclose", {1})});
  Camera::build(desc, frame(8, 8), Dialect::v3, warnings);
  ASSERT_EQ(warnings.list().size(), 1u);
  EXPECT_NE(warnings.list()[0].find("swapped"), std::string::npos);
  EXPECT_EQ(shutter_of(desc).open, 1.f);
  EXPECT_EQ(shutter_of(desc).close, 2.f);
  EXPECT_THROW(shutter_of(entity<CameraDesc>("perspective", {reals("shutteropen", {std::nanf("")})})), SceneError);
}

}  // namespace
}  // namespace cloudrenderer
