#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "film/aperture_image.h"
#include "film/camera.h"
#include "film/lens_system.h"
#include "film_support.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;
using test::entity;
using test::boolean;
using test::reals;
using test::string;

// A double convex lens with radii of 100 mm and index 1.5: a focal length of 100.3 mm for a thickness of 2 mm by the
// lensmaker's equation; a stop of 20 mm in front of it.
constexpr const char* kConvex =
    "# radius thickness index aperture\n"
    "0 1 0 20\n"
    "100 2 1.5 60\n"
    "-100 100 1 60\n";
constexpr double kFocal = 0.1003344;

class LensFile {
 public:
  explicit LensFile(const std::string& text)
      : path_(fs::temp_directory_path() / ("lens" + std::to_string(::getpid()) + ".dat")) {
    std::ofstream(path_) << text;
  }
  ~LensFile() { fs::remove(path_); }
  std::string path() const { return path_.string(); }

 private:
  fs::path path_;
};

LensSystem lens(const std::string& text, double aperture_mm, double focus) {
  Warnings warnings;
  return {LensSystem::read(LensFile(text).path(), aperture_mm, {}, warnings), focus, 0.035, {}};
}

std::string error_of(const std::string& text, double focus = 10) {
  try {
    lens(text, 5, focus);
  } catch (const SceneError& e) {
    return e.what();
  }
  return "";
}

TEST(LensSystem, HasTheFocalLengthOfTheLensmakersEquation) {
  EXPECT_NEAR(lens(kConvex, 20, 10).focal_length(), kFocal, 1e-6);
}

TEST(LensSystem, RaysFromTheFilmMeetInTheFocusedPoint) {
  for (const double focus : {0.6, 2., 50.}) {
    const LensSystem l = lens(kConvex, 4, focus);
    for (const double x : {-0.001, 0.0005, 0.0015}) {
      LensSystem::Ray out;
      ASSERT_TRUE(l.trace_from_film({{0, 0, 0}, {x, 0, l.rear_z()}}, out));
      const glm::dvec3 at = out.origin + out.direction * ((focus - out.origin.z) / out.direction.z);
      EXPECT_NEAR(at.x, 0, 2e-4 * focus) << "focus " << focus << ", through " << x;
    }
  }
}

TEST(LensSystem, StopsRaysThatLeaveAnAperture) {
  const LensSystem wide = lens(kConvex, 20, 10), narrow = lens(kConvex, 2, 10);
  LensSystem::Ray out;
  const auto to = [](const LensSystem& l, double x) { return LensSystem::Ray{{0, 0, 0}, {x, 0, l.rear_z()}}; };
  EXPECT_TRUE(wide.trace_from_film(to(wide, 0.009), out));
  EXPECT_FALSE(wide.trace_from_film(to(wide, 0.012), out));
  EXPECT_TRUE(narrow.trace_from_film(to(narrow, 0.0009), out));
  EXPECT_FALSE(narrow.trace_from_film(to(narrow, 0.0012), out));
}

TEST(LensSystem, ThePupilHoldsAllThatReachesTheScene) {
  const LensSystem l = lens(kConvex, 12, 3);
  std::mt19937 random(4711);
  std::uniform_real_distribution<double> film(0, 0.0175), rear(-0.045, 0.045);
  int open = 0;
  for (int i = 0; i < 200000; ++i) {
    const double x = film(random);
    const glm::dvec2 at(rear(random), rear(random));
    LensSystem::Ray out;
    if (!l.trace_from_film({{x, 0, 0}, {at.x - x, at.y, l.rear_z()}}, out)) continue;
    ++open;
    const LensSystem::Pupil& p = l.pupil(x);
    EXPECT_TRUE(at.x >= p.min.x && at.x <= p.max.x && at.y >= p.min.y && at.y <= p.max.y)
        << "film " << x << ", rear " << at.x << " " << at.y;
  }
  EXPECT_GT(open, 1000);
  // A disk of 12 mm fills pi/4 of its square, the margin takes a little more.
  EXPECT_NEAR(l.pupil(0).area(), 0.012 * 0.012, 0.1 * 0.012 * 0.012);
}

// Each of its points took seconds to find that it sees nothing.
TEST(LensSystem, AFilmBeyondItsImageIsNoWork) {
  Warnings warnings;
  const auto began = std::chrono::steady_clock::now();
  const LensSystem large(LensSystem::read(LensFile("0 100 0 20\n100 2 1.5 20\n-100 100 1 20\n").path(), 20, {}, warnings), 10, 4, {});
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(20));
  const double all = 1.5 * 2 * 0.01;
  EXPECT_NEAR(large.pupil(1.9).area(), all * all, 1e-9);
  EXPECT_LT(large.pupil(0.01).area(), 0.5 * all * all);
}

TEST(LensSystem, SaysWhatIsWrong) {
  EXPECT_NE(error_of("").find("has no elements"), std::string::npos);
  EXPECT_NE(error_of("100 2 1.5").find("four numbers"), std::string::npos);
  EXPECT_NE(error_of("100 2 1.5 x").find(":1:"), std::string::npos) << error_of("100 2 1.5 x");
  EXPECT_NE(error_of("100 2 -1.5 30").find("index of refraction"), std::string::npos);
  EXPECT_NE(error_of("100 2 1.5 -30").find("aperture"), std::string::npos);
  EXPECT_NE(error_of("1e30 2 1.5 30").find("too large"), std::string::npos);
  EXPECT_NE(error_of(kConvex, 0.2).find("cannot focus"), std::string::npos) << error_of(kConvex, 0.2);
}

TEST(RealisticCamera, SeesAsAPinholeOfItsImageDistance) {
  const LensFile file(kConvex);
  const FilmFrame frame{90, 60, 0, 0, 90, 60};
  Warnings warnings;
  const auto desc = entity<CameraDesc>("realistic", {string("lensfile", file.path()), reals("aperturediameter", {0.5f}),
                                                     reals("focusdistance", {5})});
  const auto camera = Camera::build(desc, frame, Dialect::v3, warnings, 35.f);
  EXPECT_TRUE(warnings.list().empty());
  EXPECT_TRUE(camera->uses_lens());
  const double distance = 1 / (1 / kFocal - 1 / 4.9), pitch = 0.035 / std::hypot(90, 60);
  int seen = 0;
  for (const Vec2 film : {Vec2(0, 0), Vec2(90, 0), Vec2(45, 30), Vec2(10, 50)}) {
    const CameraRay ray = camera->ray(film, Vec2(0.5f));
    if (ray.weight == 0.f) continue;
    ++seen;
    // The picture is upright: left is left, and rows go down.
    EXPECT_NEAR(ray.direction.x / ray.direction.z, (film.x - 45) * pitch / distance, 2e-3);
    EXPECT_NEAR(ray.direction.y / ray.direction.z, (30 - film.y) * pitch / distance, 2e-3);
    EXPECT_GT(ray.weight, 0.9f);
    EXPECT_LT(ray.weight, 1.1f);
  }
  EXPECT_EQ(seen, 4);
  const CameraRay lost = camera->ray({45, 30}, {0.f, 0.f});  // a corner of the pupil's square
  EXPECT_EQ(lost.weight, 0.f);
}

// Only where the weighting is not simple, and not for pbrt-v4, whose film counts it.
TEST(RealisticCamera, CountsHowLongTheShutterIsOpen) {
  const LensFile file(kConvex);
  const auto weight = [&](bool simple, float close, bool v4) {
    Warnings warnings;
    const auto desc = entity<CameraDesc>("realistic", {string("lensfile", file.path()), reals("aperturediameter", {0.5f}), reals("focusdistance", {5}),
                                                       boolean("simpleweighting", simple), reals("shutterclose", {close}), boolean("exposed", v4)});
    return Camera::build(desc, {90, 60, 0, 0, 90, 60}, Dialect::v3, warnings, 35.f)->ray({45, 30}, Vec2(0.5f)).weight;
  };
  EXPECT_GT(weight(false, 1, false), 0.f);
  EXPECT_EQ(weight(false, 0.5f, false), 0.5f * weight(false, 1, false));
  EXPECT_EQ(weight(false, 0.5f, true), weight(false, 1, false));
  EXPECT_EQ(weight(true, 0.5f, false), weight(true, 1, false));
}

TEST(RealisticCamera, RefusesWhatMakesNoPicture) {
  Warnings warnings;
  const FilmFrame frame{9, 6, 0, 0, 9, 6};
  const auto build = [&](std::vector<Param> params, float diagonal = 35) {
    Camera::build(entity<CameraDesc>("realistic", std::move(params)), frame, Dialect::v3, warnings, diagonal);
  };
  const LensFile file(kConvex);
  EXPECT_THROW(build({}), SceneError);
  EXPECT_THROW(build({string("lensfile", "/no/such/file.dat")}), SceneError);
  EXPECT_THROW(build({string("lensfile", file.path()), reals("focusdistance", {0})}), SceneError);
  EXPECT_THROW(build({string("lensfile", file.path()), reals("aperturediameter", {-1})}), SceneError);
  EXPECT_THROW(build({string("lensfile", file.path())}, 0), SceneError);
  EXPECT_TRUE(warnings.list().empty());
  build({string("lensfile", file.path()), reals("aperturediameter", {50})});
  EXPECT_EQ(warnings.list().size(), 1u) << "the stop is only 20 mm wide";
}

// Over the square around its circle each lets as much through as the circle.
TEST(ApertureImage, BuiltInShapes) {
  const double circle = std::numbers::pi / 4;
  const auto mean = [](const ApertureImage& a) {
    constexpr int kGrid = 512;
    double sum = 0;
    for (int i = 0; i < kGrid * kGrid; ++i) {
      const glm::dvec2 p(2 * (i % kGrid + 0.5) / kGrid - 1, 2 * (i / kGrid + 0.5) / kGrid - 1);
      sum += a.at(p);
    }
    return sum / (kGrid * kGrid);
  };
  for (const char* name : {"gaussian", "square", "pentagon", "star"})
    EXPECT_NEAR(mean(ApertureImage::make(name, {})), circle, 0.01) << name;
  EXPECT_NEAR(ApertureImage::make("square", {}).at({0.4, -0.4}), circle / 0.25, 1e-3);
  EXPECT_EQ(ApertureImage::make("square", {}).at({0.6, 0}), 0);
  // exp(-r^2) - exp(-1)
  const ApertureImage gaussian = ApertureImage::make("gaussian", {});
  EXPECT_NEAR(gaussian.at({0.5, 0}) / gaussian.at({0, 0}), (std::exp(-0.25) - std::exp(-1)) / (1 - std::exp(-1)), 1e-3);
  // One tip of the pentagon and its axis point down in the lens, a tip of the star to the side.
  const ApertureImage pentagon = ApertureImage::make("pentagon", {}), star = ApertureImage::make("star", {});
  EXPECT_GT(pentagon.at({0, -0.75}), 0);
  EXPECT_EQ(pentagon.at({0, 0.75}), 0);
  EXPECT_EQ(pentagon.at({0, -0.85}), 0);
  EXPECT_GT(star.at({-0.9, 0}), 0);
  EXPECT_EQ(star.at({0.9, 0}), 0);
  EXPECT_EQ(star.at({0, 5}), 0);
}

TEST(ApertureImage, PicturesAreUprightInTheLens) {
  const std::string path = testing::TempDir() + "aperture" + std::to_string(::getpid()) + ".pfm";
  const auto write = [&](float top) {  // rows from the bottom up
    const float rows[2][2][3]{{{0, 0, 0}, {0, 0, 0}}, {{top, top, top}, {0, 0, 3 * top}}};
    std::ofstream(path, std::ios::binary).write("PF\n2 2\n-1\n", 10).write(reinterpret_cast<const char*>(rows), sizeof rows);
  };
  write(0.5f);
  const ApertureImage made = ApertureImage::make(path, {});
  for (const double x : {-0.5, 0.5}) EXPECT_NEAR(made.at({x, 0.5}), std::numbers::pi / 2, 1e-6);
  EXPECT_EQ(made.at({0.5, -0.5}), 0);
  write(0);
  EXPECT_THROW(ApertureImage::make(path, {}), SceneError);  // black
  std::remove(path.c_str());
  EXPECT_THROW(ApertureImage::make(path, {}), SceneError);
}

// A film point gets as much light by any of them as by an open circle.
TEST(RealisticCamera, HasApertures) {
  const LensFile file(kConvex);
  const auto weights = [&](std::vector<Param> more) {
    std::vector<Param> params{string("lensfile", file.path()), reals("aperturediameter", {20}), reals("focusdistance", {5}),
                              boolean("simpleweighting", false)};
    for (Param& p : more) params.push_back(std::move(p));
    Warnings warnings;
    const auto camera = Camera::build(entity<CameraDesc>("realistic", std::move(params)), {90, 60, 0, 0, 90, 60}, Dialect::v3, warnings, 35.f);
    EXPECT_TRUE(warnings.list().empty());
    constexpr int kGrid = 200;
    double sum = 0;
    for (int i = 0; i < kGrid * kGrid; ++i) sum += static_cast<double>(camera->ray({45, 30}, Vec2(static_cast<float>(i % kGrid) + 0.5f, static_cast<float>(i / kGrid) + 0.5f) / float{kGrid}).weight);
    return sum / (kGrid * kGrid);
  };
  const double round = weights({});
  EXPECT_GT(round, 0);
  for (const char* name : {"gaussian", "square", "pentagon", "star"}) EXPECT_NEAR(weights({string("aperture", name)}) / round, 1, 0.02) << name;
  EXPECT_THROW(weights({string("aperture", "/no/such/file.png")}), SceneError);
}

}  // namespace
}  // namespace cloudrenderer
