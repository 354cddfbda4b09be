// Area lights that show a picture, as in pbrt-v4.
#include "shading_lights_support.h"

namespace cloudrenderer {
namespace {

using namespace test;

// A quadrilateral, not square, turned, with a part of the picture on it.
const std::vector<Vec3> kCorners{{-0.5f, -0.4f, 1}, {0.7f, -0.6f, 1.3f}, {0.8f, 0.4f, 1.4f}, {-0.4f, 0.6f, 1.1f}};
const std::vector<Triangle> kFacingDown{{0, 2, 1}, {0, 3, 2}};
const std::vector<Vec2> kUvs{{0.1f, 0}, {0.9f, 0.1f}, {1, 1}, {0, 0.8f}};

Scene screen(const std::string& picture, std::vector<Param> more = {}) {
  Scene scene;
  scene.description.dialect = Dialect::v3;
  more.push_back(string("filename", picture));
  scene.mesh(kCorners, kFacingDown, {2, 1, 0.5f}, std::move(more)).with_uvs(kUvs);
  return scene;
}

// Bilinear between the texels' middles, the first row above.
TEST(LightPictures, AreClampedAndStandUpright) {
  const MapFile map(3, 2, [](int x, int y) { return Rgb(x, y, 1); });
  const auto lights = screen(map.path()).build();
  EXPECT_TRUE(lights->has_pictures());
  const auto at = [&](float u, float v) { return lights->emitted(0, {0, 0, -1}, {0, 0, 1}, 0, {u, v}) / Rgb(2, 1, 0.5f); };
  EXPECT_EQ(at(0.5f, 0.75f), Rgb(1, 0, 1));
  EXPECT_EQ(at(0.5f, 0.25f), Rgb(1, 1, 1));
  EXPECT_EQ(at(0, 1), Rgb(0, 0, 1));
  EXPECT_EQ(at(1, 0), Rgb(2, 1, 1));
  expect_ratio(at(2.f / 3, 0.5f) + Rgb(1), Rgb(2.5f, 1.5f, 2), 1e-5f);
  for (const float far : {-5.f, 1e30f, kInfinity, std::nanf("")}) EXPECT_TRUE(is_finite(at(far, far)));
}

// Samples bring what rays find: the radiance of each, and the sum.
TEST(LightPictures, AreSampledAsTheyAreSeen) {
  const MapFile map(16, 8, rough);
  const auto lights = screen(map.path()).build();
  Uniform u;
  const Vec3 p(0.1f, 0.2f, -0.5f);
  for (int i = 0; i < 2000; ++i) {
    LightSample s;
    ASSERT_TRUE(lights->sample(p, Vec3(0), u(), u.pair(), s));
    const Vec3 on = p + s.wi * s.distance;
    // Where that is, by hand.
    Rgb seen(-1);
    for (std::uint32_t t = 0; t < 2; ++t) {
      const auto corner = [&](int k) { return glm::dvec3(kCorners[kFacingDown[t][k]]); };
      const glm::dvec3 e0 = corner(1) - corner(0), e1 = corner(2) - corner(0), w = glm::dvec3(on) - corner(0), n = glm::cross(e0, e1);
      const double b0 = glm::dot(glm::cross(w, e1), n) / glm::dot(n, n), b1 = glm::dot(glm::cross(e0, w), n) / glm::dot(n, n);
      if (b0 < -1e-6 || b1 < -1e-6 || b0 + b1 > 1 + 1e-6 || std::fabs(glm::dot(w, n)) > 1e-5) continue;
      const auto uv = [&](int k) { return glm::dvec2(kUvs[kFacingDown[t][k]]); };
      seen = lights->emitted(0, -s.wi, s.wi, t, Vec2(uv(0) + b0 * (uv(1) - uv(0)) + b1 * (uv(2) - uv(0))));
    }
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(s.radiance[c], seen[c], 2e-3f * (1 + seen[c])) << "seed 5";
  }
}

// The eight sample as the one.
TEST(LightPictures, AreTheSameForEight) {
  const MapFile map(16, 8, rough);
  const auto lights = screen(map.path()).build();
  Uniform u;
  for (int i = 0; i < 50; ++i) {
    Vec3x8 p, n(Float8(0.f));
    Vec2x8 numbers;
    Float8 choice(0.f);
    std::array<std::tuple<Vec3, float, Vec2>, kLanes> one;
    for (std::size_t k = 0; k < kLanes; ++k) {
      one[k] = {{u(), u(), -u()}, u(), u.pair()};
      const auto& [at, chosen, pair] = one[k];
      lanes::put(p, k, at);
      lanes::put(choice, k, chosen);
      lanes::put(numbers.x, k, pair.x);
      lanes::put(numbers.y, k, pair.y);
    }
    LightSample8 eight;
    const Mask8 found = lights->sample(Mask8(true), p, n, choice, numbers, eight);
    for (std::size_t k = 0; k < kLanes; ++k) {
      const auto& [at, chosen, pair] = one[k];
      LightSample s;
      ASSERT_EQ(lights->sample(at, Vec3(0), chosen, pair, s), (lanes::to_bits(found) >> k & 1) != 0);
      if (lanes::to_bits(found) >> k & 1) {
        EXPECT_EQ(lanes::get(eight.radiance, k), s.radiance);
      }
    }
  }
}

TEST(LightPictures, OfOneColourAreThatColour) {
  const MapFile map(4, 4, [](int, int) { return Rgb(0.5f, 1, 2); });
  const auto lights = screen(map.path()).build();
  Scene even;
  even.description.dialect = Dialect::v3;
  even.mesh(kCorners, kFacingDown, {1, 1, 1});
  const auto plain = even.build();
  EXPECT_FALSE(plain->has_pictures());
  const Vec3 p(0.1f, 0.2f, -0.5f), n(0, 0, 1);
  expect_ratio(irradiance(*lights, p, n), irradiance(*plain, p, n), 0.01f);
}

// pbrt-v4: the light's power, whatever the picture's brightness.
TEST(LightPictures, HaveThePowerThatIsGiven) {
  const auto flux = [](const Lights& lights) {
    Uniform u;
    double sum = 0;
    constexpr int kSamples = 40000;
    for (int i = 0; i < kSamples; ++i) {
      LightRay ray;
      if (lights.emit(u(), u.pair(), u.pair(), ray)) sum += static_cast<double>(luminance(ray.weight));
    }
    return sum / kSamples;
  };
  for (const float brightness : {1.f, 7.f}) {
    // Even but for its brightness: each triangle has the power, and shows a part of the picture only.
    const MapFile map(16, 8, [&](int, int) { return Rgb(brightness); });
    Scene scene;
    scene.description.dialect = Dialect::v3;
    scene.mesh(kCorners, kFacingDown, Rgb(1), {string("filename", map.path()), reals("power", {5})}).with_uvs(kUvs);
    EXPECT_NEAR(flux(*scene.build()), 10, 0.05);
  }
}

// pbrt-v4 decodes what is stored in integers.
TEST(LightPictures, OfBytesAreDecodedWhereTheSceneSaysSo) {
  const MapFile map(2, 2, [](int, int) { return Rgb(0.5f); }, ".png");
  const auto radiance = [&](std::vector<Param> more) {
    return screen(map.path(), std::move(more)).build()->emitted(0, {0, 0, -1}, {0, 0, 1}, 0, {0.5f, 0.5f}).y;
  };
  EXPECT_NEAR(radiance({}), 128 / 255.f, 1e-3f);
  EXPECT_NEAR(radiance({boolean("srgb", true)}), 0.2158f, 1e-3f);
  const MapFile real(2, 2, [](int, int) { return Rgb(0.5f); });
  EXPECT_NEAR(screen(real.path(), {boolean("srgb", true)}).build()->emitted(0, {0, 0, -1}, {0, 0, 1}, 0, {0.5f, 0.5f}).y, 0.5f, 1e-6f);
}

// Without triangles there is no place for it: the mean.
TEST(LightPictures, OnOtherShapesShineByTheirMean) {
  const MapFile map(2, 1, [](int x, int) { return Rgb(x == 0 ? 1.f : 3.f); });
  Scene scene;
  scene.description.dialect = Dialect::v3;
  scene.quadric(sphere(Vec3(0), 1), Rgb(1), false, {string("filename", map.path())});
  EXPECT_EQ(scene.build()->emitted(0, {0, 0, -1}, {0, 0, 1}, 0, {0.1f, 0.5f}), Rgb(2));
}

}  // namespace
}  // namespace cloudrenderer
