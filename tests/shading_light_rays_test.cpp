// Rays that leave lights: the flux that they carry, aimed or not.
#include <gtest/gtest.h>

#include <functional>

#include "chi_squared.h"
#include "shading/light_aims.h"
#include "shading_lights_support.h"

namespace cloudrenderer {
namespace {

using namespace test;

Bounds3 around(const Vec3& center, const Vec3& half) { return {center - half, center + half}; }

// What the rays carry through a sphere, and its standard error.
struct Flux {
  double mean = 0, error = 0;
};

const Vec3 kTarget(0.3f, 0.2f, -0.4f);
constexpr float kRadius = 0.25f;

Flux flux(const Lights& lights, int samples) {
  Uniform u;
  double sum = 0, squares = 0;
  int dark = 0, rays = 0;
  for (int i = 0; i < samples; ++i) {
    LightRay ray;
    if (!lights.emit(u(), u.pair(), u.pair(), ray)) continue;
    EXPECT_NEAR(glm::length(ray.direction), 1, 1e-5);
    const Vec3 to = kTarget - ray.origin;
    const float along = glm::dot(to, ray.direction);
    if (along < 0 || glm::dot(to, to) - along * along > kRadius * kRadius) continue;
    const double x = static_cast<double>(ray.weight.y);
    sum += x;
    squares += x * x;
    ++rays;
    // A ray that has no emission would have no weight against other ways to find its light.
    dark += !(lights.emission(ray.emitter, ray.origin + along * ray.direction, -ray.direction, along) > 0.f);
  }
  EXPECT_LE(dark, rays / 1000);
  const double n = samples, mean = sum / n;
  return {mean, std::sqrt(std::max(0.0, squares / n - mean * mean) / n)};
}

// Boxes around the target, others, and one that the lights of these tests stand in.
std::vector<Bounds3> boxes(bool lights_inside) {
  std::vector<Bounds3> all{around(kTarget, Vec3(0.16f)), around({-0.7f, 0.1f, 0.2f}, {0.1f, 0.3f, 0.05f}), around({0.35f, 0.1f, -0.5f}, Vec3(0.2f))};
  if (lights_inside) all.push_back(around({0.1f, -0.2f, 0.8f}, Vec3(0.3f)));
  return all;
}

void expect_same_flux(const std::function<Scene()>& scene, double known = 0) {
  constexpr int kSamples = 200000;
  const Flux even = flux(*scene().build(), kSamples);
  EXPECT_GT(even.mean, 0);
  if (known > 0) {
    EXPECT_NEAR(even.mean, known, 5 * even.error) << "seed 5";
  }
  for (const bool inside : {false, true})
    for (const float share : {0.25f, 1.f}) {
      const auto lights = scene().build();
      lights->aim(boxes(inside), share);
      const Flux aimed = flux(*lights, kSamples);
      EXPECT_NEAR(aimed.mean, even.mean, 5 * (aimed.error + even.error)) << "share " << share << ", seed 5";
      if (!inside && share == 1.f) {
        EXPECT_LT(aimed.error, even.error);
        if (known > 0) {
          EXPECT_NEAR(aimed.mean, known, 5 * aimed.error) << "seed 5";
        }
      }
    }
}

const Vec3 kPlace(0.1f, -0.2f, 0.8f);

TEST(LightRays, OfAPoint) {
  const Vec3 to = kTarget - kPlace;
  const double most = 1 - std::sqrt(1 - static_cast<double>(kRadius * kRadius / glm::dot(to, to)));
  expect_same_flux([&] { return Scene().light("point", {point("from", kPlace), color("I", Rgb(3))}); }, 3 * 2 * static_cast<double>(kPi) * most);
}

TEST(LightRays, OfASpot) {
  expect_same_flux([] {
    return Scene().light("spot", {point("from", kPlace), point("to", kTarget), color("I", Rgb(2)), reals("coneangle", {20}), reals("conedeltaangle", {5})});
  });
  expect_same_flux([] {
    return Scene().light("spot", {point("from", kPlace), point("to", {0.9f, 0.2f, -0.4f}), color("I", Rgb(2)), reals("coneangle", {35})});
  });
}

TEST(LightRays, OfADistantLight) {
  expect_same_flux([] { return Scene().light("distant", {point("from", {0.2f, 0.3f, 1}), point("to", Vec3(0)), color("L", Rgb(2))}); },
                   2 * static_cast<double>(kPi * kRadius * kRadius));
}

TEST(LightRays, OfASky) {
  expect_same_flux([] { return Scene().light("infinite", {color("L", Rgb(0.5f))}); }, 0.5 * 4 * static_cast<double>(kPi * kPi * kRadius * kRadius));
}

TEST(LightRays, OfShapes) {
  for (const bool two_sided : {false, true})
    expect_same_flux([&] {
      return Scene().mesh({kPlace, kPlace + Vec3(0.1f, 0, 0.05f), kPlace + Vec3(0, 0.2f, 0)}, {{0, 2, 1}}, Rgb(4), {boolean("twosided", two_sided)});
    });
  expect_same_flux([] { return Scene().quadric(sphere(kPlace, 0.1f), Rgb(2)); });
  Quadric cylinder;
  cylinder.kind = QuadricKind::cylinder;
  cylinder.radius = 0.1f;
  cylinder.z_min = -0.1f;
  cylinder.z_max = 0.2f;
  cylinder.object_to_world = Transform(glm::translate(Mat4(1.f), kPlace) * glm::rotate(Mat4(1.f), 0.7f, Vec3(1, 0, 0)));
  expect_same_flux([&] { return Scene().quadric(cylinder, Rgb(2)); });
}

TEST(LightRays, OfAPicture) {
  const MapFile map(16, 8, rough);
  expect_same_flux([&] {
    Scene scene;
    scene.description.dialect = Dialect::v3;
    scene.mesh({kPlace, kPlace + Vec3(0.1f, 0, 0.05f), kPlace + Vec3(0, 0.2f, 0)}, {{0, 2, 1}}, Rgb(4), {string("filename", map.path())});
    return scene.with_uvs({{0, 0}, {1, 0}, {0, 1}});
  });
}

// What was aimed counts as aimed, however small the aim is that a direction in float can hardly tell.
TEST(LightRays, KnowWhatTheyWereAimedAtFromFarAway) {
  for (const float distance : {10.f, 1e3f, 1e5f, 1e7f}) {
    const auto lights = Scene().light("point", {point("from", {0.3f * distance, distance, -0.2f * distance}), color("I", Rgb(1))}).build();
    lights->aim(std::vector<Bounds3>{around({0, 1, 1.5f}, Vec3(0.001f))}, 0.25f);
    Uniform u;
    constexpr int kSamples = 100000;
    int aimed = 0;
    for (int i = 0; i < kSamples; ++i) {
      LightRay ray;
      ASSERT_TRUE(lights->emit(u(), u.pair(), u.pair(), ray));
      EXPECT_LE(ray.weight.x, 4 * kPi / 0.75f * 1.01f);
      aimed += ray.weight.x < 0.1f;
      if (ray.weight.x < 0.1f) {
        EXPECT_GT(lights->emission(0, {0, 1, 1.5f}, -ray.direction, glm::length(ray.origin - Vec3(0, 1, 1.5f))) * distance * distance, 1) << distance;
      }
    }
    EXPECT_NEAR(aimed, 0.25 * kSamples, 5 * std::sqrt(0.1875 * kSamples)) << "from " << distance << ", seed 5";
  }
}

TEST(LightRays, OfManyLights) {
  expect_same_flux([] {
    return Scene()
        .light("infinite", {color("L", Rgb(0.1f))})
        .light("infinite", {color("L", Rgb(0.2f))})
        .light("point", {point("from", kPlace), color("I", Rgb(1))})
        .quadric(sphere({-0.6f, 0.5f, 0.3f}, 0.2f), Rgb(2));
  });
}

// From outside of all aims, within one, and at one whose sphere the point's horizon cuts.
TEST(LightAims, ChooseByTheirDensity) {
  constexpr int kSamples = 60000, kTests = 9;
  for (const Vec3& p : {kPlace, kTarget, Vec3(-0.7f, 0.1f, 0.5f)})
    for (const float cosine : {-1.f, 0.f, 0.8f}) {
      const Vec3 axis = glm::normalize(Vec3(0.3f, -0.5f, -1));
      const LightAims::View view = LightAims(boxes(false)).from(p, axis, cosine);
      ASSERT_FALSE(view.empty());
      constexpr float kInside = 0.25f / kPi;
      testing::SphereCells cells;
      EXPECT_NEAR(cells.integrate([&](const Vec3& d) { return view.pdf(d, kInside); }, 8), 1, 5e-3);
      Uniform u;
      for (int i = 0; i < kSamples; ++i) {
        Vec2 numbers = u.pair();
        Vec3 direction;
        LightAims::View choice = view;
        if (!choice.choose(numbers, direction)) direction = sample_uniform_sphere<float>(numbers);
        cells.add(direction);
      }
      EXPECT_GT(cells.p_value(kSamples), testing::corrected_level(kTests)) << "seed 5";
    }
}

TEST(LightAims, ThoseOutOfTheConeAreLeftOut) {
  const LightAims aims(boxes(false));
  EXPECT_TRUE(aims.from(kPlace, Vec3(0, 0, 1), 0.f).empty());
  EXPECT_FALSE(aims.from(kPlace, Vec3(0, 0, 1), -1.f).empty());
  EXPECT_TRUE(aims.from(kPlace, Vec3(0, 1, 0), 0.99f).empty());
}

TEST(LightAims, OfBoxesWithoutSizeOrWithAHugeOneAreNone) {
  EXPECT_TRUE(LightAims().empty());
  EXPECT_TRUE(LightAims(std::vector<Bounds3>{{Vec3(1), Vec3(1)}, {Vec3(-1e18f), Vec3(1e18f)}}).empty());
}

}  // namespace
}  // namespace cloudrenderer
