// Lights that shine through a picture.
#include "scene/param_make.h"
#include "shading_lights_support.h"

namespace cloudrenderer {
namespace {

using namespace test;

constexpr float kFar = 3.f;  // of the points that are lit, from the light

// The light that arrives in a direction of the light's space, times the squared distance; black
// when none is sampled.
Rgb intensity(const Lights& lights, const Transform& to_world, const Vec3& local) {
  const Vec3 from = to_world.point(Vec3(0.f)), p = to_world.point(kFar * local);
  LightSample s;
  if (!lights.sample(p, Vec3(0.f), 0.4f, {}, s)) return Rgb(0.f);
  EXPECT_TRUE(s.delta);
  EXPECT_EQ(s.pdf, 1.f);
  EXPECT_NEAR(s.distance, glm::length(p - from), 1e-4f);
  EXPECT_LT(glm::length(s.wi - glm::normalize(from - p)), 1e-5f);
  return s.radiance * s.distance * s.distance;
}

void expect_near(const Rgb& a, const Rgb& b, float tolerance = 1e-3f) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], tolerance * (1.f + b[i])) << i;
}

// Moved and turned, not distorted; mirrored.
Transform placed() {
  return Transform(glm::translate(Mat4(1.f), Vec3(1, -2, 0.5f)) * tilted().matrix());
}

TEST(Goniometric, HasThePictureAroundItsYAxis) {
  const MapFile map(16, 8, rough);
  for (const Transform& to_world : {Transform(), placed()}) {
    const auto lights = Scene()
                            .light("goniometric",
                                   {string("mapname", map.path()), color("I", {2, 4, 8}),
                                    color("scale", Rgb(0.5f))},
                                   to_world)
                            .build();
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 16; ++x) {  // at the texels' centres
        const double polar = (y + 0.5) / 8 * 3.14159265358979,
                     azimuth = (x + 0.5) / 16 * 2 * 3.14159265358979;
        const Vec3 direction(std::sin(polar) * std::cos(azimuth), std::cos(polar),
                             std::sin(polar) * std::sin(azimuth));
        expect_near(intensity(*lights, to_world, direction), Rgb(1, 2, 4) * rough(x, y));
      }
  }
}

TEST(Projection, ThrowsThePictureOnARectangle) {
  // Twice as wide as high: at z = 1 it is 2 high for 90 degrees, and 4 wide.
  const MapFile map(8, 4, rough);
  for (const Transform& to_world : {Transform(), placed()}) {
    const auto lights =
        Scene()
            .light("projection",
                   {string("mapname", map.path()), color("I", Rgb(5)), reals("fov", {90})},
                   to_world)
            .build();
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 8; ++x) {
        const Vec3 at((static_cast<float>(x) + 0.5f) / 2 - 2,
                      (static_cast<float>(y) + 0.5f) / 2 - 1, 1);
        expect_near(intensity(*lights, to_world, glm::normalize(at)), 5.f * rough(x, y));
        EXPECT_EQ(intensity(*lights, to_world, -glm::normalize(at)), Rgb(0.f));  // behind
      }
    for (const Vec2& outside : {Vec2(2.01f, 0), Vec2(-2.01f, 0), Vec2(0, 1.01f), Vec2(0, -1.01f)})
      EXPECT_EQ(intensity(*lights, to_world, glm::normalize(Vec3(outside, 1.f))), Rgb(0.f));
  }
}

TEST(Projection, OfPbrtV4HasTheNearestTexel) {
  const MapFile map(4, 4, rough);
  const Param v4 = make_bool("srgb", true, {});
  const auto lights = Scene().light("projection", {string("mapname", map.path()), reals("fov", {90}), v4}).build();
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 4; ++x)
      for (const float beside : {-0.49f, 0.f, 0.49f}) {
        const Vec3 at((static_cast<float>(x) + 0.5f + beside) / 2 - 1, (static_cast<float>(y) + 0.5f - beside) / 2 - 1, 1);
        expect_near(intensity(*lights, {}, glm::normalize(at)), rough(x, y));
      }
}

TEST(Projection, OfAHighPictureIsHigher) {
  const MapFile map(2, 6, [](int, int) { return Rgb(1.f); });
  const auto lights =
      Scene().light("projection", {string("mapname", map.path()), reals("fov", {60})}).build();
  const float t = std::tan(kPi / 6);
  EXPECT_GT(intensity(*lights, {}, glm::normalize(Vec3(0, 2.99f * t, 1))).x, 0.9f);
  EXPECT_EQ(intensity(*lights, {}, glm::normalize(Vec3(0, 3.01f * t, 1))).x, 0.f);
  EXPECT_GT(intensity(*lights, {}, glm::normalize(Vec3(0.99f * t, 0, 1))).x, 0.9f);
  EXPECT_EQ(intensity(*lights, {}, glm::normalize(Vec3(1.01f * t, 0, 1))).x, 0.f);
}

// What a surface gets, as the sum over the lights that a fine comb of numbers chooses: the chances,
// which must be above its pitch, do not count.
Rgb sum_of_chosen(const Lights& lights, const Vec3& p, const Vec3& n) {
  constexpr int kTeeth = 20000;
  Rgb sum(0.f);
  Vec3 before(0.f);
  for (int i = 0; i < kTeeth; ++i) {
    LightSample s;
    if (!lights.sample(p, n, (static_cast<float>(i) + 0.5f) / kTeeth, {}, s)) continue;
    if (s.wi != before) sum += s.radiance * std::max(0.f, glm::dot(n, s.wi));
    before = s.wi;  // each light has its part of [0, 1), and its place
  }
  return sum;
}

TEST(MappedLights, AreChosenWhereverTheyShine) {
  const MapFile map(8, 4, [](int x, int y) { return Rgb(x == 7 && y == 3 ? 100.f : 0.1f); });
  const Transform distorted(glm::scale(Mat4(1.f), Vec3(1, 3, 0.5f)));
  const auto add = [&](Scene& scene, int which) {
    if (which == 0 || which < 0)
      scene.light("projection", {string("mapname", map.path())}, placed());
    if (which == 1 || which < 0)
      scene.light("projection", {string("mapname", map.path())}, distorted);
    if (which == 2 || which < 0)
      scene.light("goniometric", {string("mapname", map.path())},
                  Transform(glm::translate(Mat4(1.f), Vec3(-3, 0, 1))));
    if (which == 3 || which < 0) scene.light("point", {point("from", {0, 4, 0})});
  };
  Scene all;
  add(all, -1);
  const auto together = all.build();
  Uniform u;
  int lit = 0;
  for (int i = 0; i < 100; ++i) {
    const Vec3 p = 5.f * uniform_direction(u), n = uniform_direction(u);
    Rgb sum(0.f);
    for (int which = 0; which < 4; ++which) {
      Scene one;
      add(one, which);
      const Rgb alone = irradiance(*one.build(), p, n, 1);
      lit += which < 2 && alone.x > 0.f;
      sum += alone;
    }
    if (sum.x > 0.f) expect_ratio(sum_of_chosen(*together, p, n), sum, 1e-4f);
  }
  EXPECT_GT(lit, 5);
}

TEST(MappedLights, AMissingPictureIsAWarningAndAnEvenLight) {
  for (const char* type : {"goniometric", "projection"}) {
    Scene scene;
    const auto lights =
        scene.light(type, {string("mapname", "/no/such/map.exr"), color("I", Rgb(3))}).build();
    ASSERT_EQ(scene.warnings.list().size(), 1u);
    EXPECT_NE(scene.warnings.list()[0].find("/no/such/map.exr"), std::string::npos);
    expect_near(intensity(*lights, {}, {0, 0, 1}), Rgb(3));
    EXPECT_TRUE(Scene().light(type, {color("I", Rgb(0))}).build()->empty());
  }
  EXPECT_THROW(Scene().light("projection", {reals("fov", {180})}).build(), SceneError);
  EXPECT_THROW(Scene().light("projection", {reals("fov", {-1})}).build(), SceneError);
}

}  // namespace
}  // namespace cloudrenderer
