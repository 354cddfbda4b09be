#include <gtest/gtest.h>

#include "shading/lights.h"
#include "shading_lights_support.h"

namespace cloudrenderer {
namespace {

using namespace test;

// Analytic irradiance.

TEST(AreaLights, SphereGivesItsIrradiance) {
  const auto lights = Scene().quadric(sphere({0, 0, 5}, 2), {1, 2, 3}).build();
  const Vec3 n = glm::normalize(Vec3(0.5f, 0.2f, 1));
  expect_ratio(irradiance(*lights, Vec3(0), n), Rgb(1, 2, 3) * (kPi * 4 / 25 * n.z));
  expect_ratio(irradiance(*lights, {0, 0, 2.9f}, {0, 0, 1}), Rgb(1, 2, 3) * (kPi * 4 / 4.41f));
  EXPECT_TRUE(is_black(irradiance(*lights, {0, 0, 5.5f}, n))) << "the inside is dark";
}

TEST(AreaLights, SphereShinesInwardsWhenReversed) {
  const auto lights = Scene().quadric(sphere({0, 0, 0}, 2), {1, 1, 1}, true).build();
  expect_ratio(irradiance(*lights, {0.3f, 0, 1}, {0, 1, 0}), Rgb(kPi));
  EXPECT_TRUE(is_black(irradiance(*lights, {0, 0, 5}, {0, 0, -1})));
  Scene both;
  both.description.dialect = Dialect::v3;
  const auto two =
      both.quadric(sphere({0, 0, 0}, 2), {1, 1, 1}, false, {boolean("twosided", true)}).build();
  expect_ratio(irradiance(*two, {0.3f, 0, 1}, {0, 1, 0}), Rgb(kPi));
  expect_ratio(irradiance(*two, {0, 0, 5}, {0, 0, -1}), Rgb(kPi * 4 / 25));
}

TEST(AreaLights, MirroredSphereStillShinesOutwards) {
  Quadric q = sphere(Vec3(0), 2);
  q.object_to_world = Transform(glm::scale(Mat4(1.f), Vec3(-1, 1, 1)));
  expect_ratio(irradiance(*Scene().quadric(q, Rgb(1)).build(), {0, 0, 5}, {0, 0, -1}),
               Rgb(kPi * 4 / 25));
}

TEST(AreaLights, StretchedSphereGivesItsIrradiance) {
  // From far away an ellipsoid is as bright as the ellipse it shows.
  Quadric q = sphere(Vec3(0), 1);
  q.object_to_world = Transform(glm::scale(Mat4(1.f), Vec3(2, 3, 0.5f)));
  const auto lights = Scene().quadric(q, Rgb(1)).build();
  expect_ratio(irradiance(*lights, {0, 0, 200}, {0, 0, -1}, 2500), Rgb(kPi * 6 / 40000));
  expect_ratio(irradiance(*lights, {200, 0, 0}, {-1, 0, 0}, 2500), Rgb(kPi * 1.5f / 40000));
}

TEST(AreaLights, HalfASphereShowsWhatIsThere) {
  Quadric q = sphere(Vec3(0), 1);
  q.z_min = 0;
  const auto lights = Scene().quadric(q, Rgb(1)).build();
  expect_ratio(irradiance(*lights, {0, 0, 300}, {0, 0, -1}), Rgb(kPi / 90000));
  expect_ratio(irradiance(*lights, {300, 0, 0}, {-1, 0, 0}), Rgb(kPi / 2 / 90000));
  EXPECT_TRUE(is_black(irradiance(*lights, {0, 0, -300}, {0, 0, 1})))
      << "the open side shows the dark inside";
}

TEST(AreaLights, DiskGivesItsIrradiance) {
  Quadric q;
  q.kind = QuadricKind::disk;
  q.radius = 3;
  q.object_to_world = Transform(glm::translate(Mat4(1.f), Vec3(0, 0, -2)));
  const auto lights = Scene().quadric(q, {2, 1, 1}).build();
  expect_ratio(irradiance(*lights, Vec3(0), {0, 0, -1}, 40000), Rgb(2, 1, 1) * (kPi * 9 / 13));
  EXPECT_TRUE(is_black(irradiance(*lights, {0, 0, -5}, {0, 0, 1})));
}

TEST(AreaLights, CylinderGivesItsIrradiance) {
  Quadric q;
  q.kind = QuadricKind::cylinder;
  q.radius = 1;
  q.z_min = -2;
  q.z_max = 2;
  const auto lights = Scene().quadric(q, Rgb(1)).build();
  expect_ratio(irradiance(*lights, {400, 0, 0}, {-1, 0, 0}), Rgb(8.f / 160000));
}

TEST(AreaLights, RectangleGivesItsIrradiance) {
  // Over one corner: the form factor of a parallel rectangle (any text book of heat transfer).
  const auto lights =
      Scene().mesh({{0, 0, 2}, {0, 3, 2}, {1, 3, 2}, {1, 0, 2}}, kTwoTriangles, {1, 2, 4}).build();
  const double x = 0.5, y = 1.5, a = std::sqrt(1 + x * x), b = std::sqrt(1 + y * y);
  const double form =
      (x / a * std::atan(y / a) + y / b * std::atan(x / b)) / (2 * 3.14159265358979);
  expect_ratio(irradiance(*lights, Vec3(0), {0, 0, 1}),
               Rgb(1, 2, 4) * static_cast<float>(form * 3.14159265358979));
  EXPECT_TRUE(is_black(irradiance(*lights, {0, 0, 4}, {0, 0, -1}))) << "one-sided";
}

TEST(AreaLights, TrianglesShareTheWork) {
  // The same rectangle from triangles that are no parallelograms.
  const auto lights = Scene()
                          .mesh({{0, 0, 2}, {0, 3, 2}, {1, 3, 2}, {1, 0, 2}, {0.3f, 1.1f, 2}},
                                {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}}, Rgb(1))
                          .build();
  const double x = 0.5, y = 1.5, a = std::sqrt(1 + x * x), b = std::sqrt(1 + y * y);
  const double form =
      (x / a * std::atan(y / a) + y / b * std::atan(x / b)) / (2 * 3.14159265358979);
  expect_ratio(irradiance(*lights, Vec3(0), {0, 0, 1}, 90000),
               Rgb(static_cast<float>(form * 3.14159265358979)));
}

TEST(AreaLights, FarAndNearSpheresStayFinite) {
  // 1e-9 steradian and less, and almost touching.
  const auto lights = Scene().quadric(sphere({0, 0, 0}, 1), Rgb(1)).build();
  for (const float d : {1.0000002f, 1.00001f, 1.1f, 1e3f, 5.6e4f, 1e6f, 1e9f, 1e15f}) {
    const Vec3 p = d * glm::normalize(Vec3(1, 2, -2));
    const Vec3 n = -glm::normalize(p);
    LightSample s;
    for (const Vec2& u : {Vec2(0, 0), Vec2(0.5f, 0.5f), Vec2(0.99999994f, 0.99999994f)}) {
      ASSERT_TRUE(lights->sample(p, n, 0, u, s)) << d;
      EXPECT_TRUE(is_finite(s.wi) && std::isfinite(s.pdf) && s.pdf > 0 && std::isfinite(s.distance))
          << d;
      EXPECT_NEAR(s.distance, d, 1.0001f + d * 1e-6f);
      EXPECT_NEAR(lights->emitted_pdf(0, p, n, s.wi, s.distance, p, n, 0) / s.pdf, 1, 1e-6);
    }
    if (d > 1.01f) {
      const double sine = 1 / static_cast<double>(d);
      const double pdf =
          1 / (2 * 3.14159265358979 * (sine * sine / (1 + std::sqrt(1 - sine * sine))));
      EXPECT_NEAR(static_cast<double>(s.pdf) / pdf, 1, 1e-4) << d;
    }
  }
}

TEST(AreaLights, ShineByTheirNormal) {
  Scene scene;
  scene.description.dialect = Dialect::v3;
  scene.quadric(sphere(Vec3(0), 1), {1, 2, 3}, false,
                {color("scale", Rgb(2)), test::integer("samples", 4)});
  scene.quadric(sphere(Vec3(5), 1), {1, 2, 3}, false, {boolean("twosided", true)});
  const auto lights = scene.build();
  EXPECT_EQ(lights->emitted(0, {0, 0, 1}, {0, 0, -1}, 0, {}), Rgb(2, 4, 6));
  EXPECT_EQ(lights->emitted(0, {0, 0, 1}, {0, 0, 1}, 0, {}), Rgb(0));
  EXPECT_EQ(lights->emitted(1, {0, 0, 1}, {0, 0, 1}, 0, {}), Rgb(1, 2, 3));
  EXPECT_TRUE(scene.warnings.list().empty());
}

// Where samples are taken on one side and rays find light on the other: as in pbrt-v2 on disks, in pbrt-v3 on what is mirrored.
TEST(AreaLights, MayDisagreeWithThemselves) {
  const auto disagrees = [](bool turned, bool two_sided, QuadricKind kind, float z_max = 1) {
    Quadric q = sphere(Vec3(0), 1);
    q.kind = kind;
    q.z_max = z_max;
    q.inside_out = turned;
    Scene scene;
    scene.description.dialect = Dialect::v3;
    scene.quadric(q, Rgb(1), false, {boolean("twosided", two_sided)});
    return scene.build()->disagrees();
  };
  EXPECT_TRUE(disagrees(true, false, QuadricKind::sphere));
  EXPECT_TRUE(disagrees(true, false, QuadricKind::disk));
  EXPECT_FALSE(disagrees(false, false, QuadricKind::sphere));
  EXPECT_FALSE(disagrees(true, true, QuadricKind::sphere));
  EXPECT_TRUE(disagrees(true, false, QuadricKind::sphere, 0.5f));
  EXPECT_TRUE(disagrees(true, false, QuadricKind::cylinder));
  EXPECT_FALSE(disagrees(false, false, QuadricKind::cylinder));
}

TEST(AreaLights, ThatNoRayFindsHaveAllWeightUnlessTheyAreWeighed) {
  for (const bool weighed : {false, true}) {
    Scene scene;
    scene.description.dialect = Dialect::v3;
    scene.mesh({{0, 0, 1}, {1, 0, 1}, {0, 1, 1}}, {{0, 2, 1}}, Rgb(1), {boolean("invisible", true), boolean("weighed", weighed)});
    const auto lights = scene.build();
    LightSample s;
    ASSERT_TRUE(lights->sample(Vec3(0), Vec3(0), 0.5f, {0.3f, 0.4f}, s));
    EXPECT_EQ(s.delta, !weighed);
    EXPECT_TRUE(scene.warnings.list().empty());
  }
}

// pbrt-v4: each primitive of a light with a power has it, whatever its size.
TEST(AreaLights, ShareOutPower) {
  const std::vector<Vec3> p{{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 1, 0}};
  const std::vector<Triangle> two{{0, 1, 2}, {0, 2, 3}};  // areas 2 and 1
  Scene scene;
  scene.description.dialect = Dialect::v3;
  scene.mesh(p, two, {1, 2, 3}, {reals("power", {6 * kPi})});
  scene.mesh(p, two, {1, 2, 3}, {reals("power", {6 * kPi}), boolean("twosided", true)});
  scene.mesh({{0, 0, 5}, {2, 0, 5}, {2, 2, 5}, {0, 2, 5}}, two, Rgb(1), {reals("power", {6 * kPi}), integer("patches", 1)});
  scene.quadric(sphere(Vec3(9), 2), Rgb(1), false, {reals("power", {32 * kPi * kPi})});
  const auto lights = scene.build();
  const auto radiance = [&](std::uint32_t light, std::uint32_t primitive) {
    return lights->emitted(light, {0, 0, 1}, {0, 0, -1}, primitive, {}).x;
  };
  EXPECT_FLOAT_EQ(radiance(0, 0), 3);
  EXPECT_FLOAT_EQ(radiance(0, 1), 6);
  EXPECT_FLOAT_EQ(lights->emitted(0, {0, 0, 1}, {0, 0, -1}, 1, {}).z, 18);
  EXPECT_FLOAT_EQ(radiance(1, 1), 3);
  EXPECT_FLOAT_EQ(radiance(2, 0), 1.5f);
  EXPECT_FLOAT_EQ(radiance(2, 1), 1.5f);
  EXPECT_FLOAT_EQ(radiance(3, 0), 2);
  // Samples agree with what rays find.
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(0.f, 1.f);
  int sampled = 0;
  for (int i = 0; i < 200; ++i) {
    LightSample s;
    const Vec3 from(uniform(random), uniform(random), 8);
    if (!lights->sample(from, {0, 0, -1}, uniform(random), {uniform(random), uniform(random)}, s)) continue;
    ++sampled;
    EXPECT_TRUE(s.radiance.x == 3 || s.radiance.x == 6 || std::fabs(s.radiance.x - 1.5f) < 1e-5f || std::fabs(s.radiance.x - 2) < 1e-5f)
        << s.radiance.x;
  }
  EXPECT_GT(sampled, 100);
}

TEST(AreaLights, ThatNoRayFindsHaveAllOfTheWeight) {
  Scene scene;
  scene.description.dialect = Dialect::v3;
  scene.mesh({{0, 0, 0}, {2, 0, 0}, {2, 2, 0}}, {{0, 1, 2}}, Rgb(1), {boolean("invisible", true)});
  scene.chunks[0].alpha_texture = 0;
  const auto lights = scene.build();
  LightSample s;
  ASSERT_TRUE(lights->sample({1, 1, 4}, {0, 0, -1}, .5f, Vec2(.3f), s));
  EXPECT_TRUE(s.delta);
}

TEST(AreaLights, LeaveUnsampledShapesToRays) {
  Quadric cone;
  cone.kind = QuadricKind::cone;
  cone.height = 1;
  const auto lights = Scene().quadric(cone, Rgb(3)).build();
  LightSample s;
  EXPECT_FALSE(lights->empty());
  EXPECT_FALSE(lights->sample({0, 0, 9}, {0, 0, -1}, 0.5f, Vec2(0.5f), s));
  EXPECT_EQ(lights->emitted(0, {0, 0, 1}, {0, 0, -1}, 0, {}), Rgb(3));
  EXPECT_EQ(lights->emitted_pdf(0, {0, 0, 9}, {0, 0, -1}, {0, 0, -1}, 8, {0, 0, 1}, {0, 0, 1}, 0),
            0);
}

// Lights that rays do not find.

TEST(DeltaLights, PointStandsAtFromPlusItsOrigin) {
  // As in pbrt, `from` is not turned or scaled.
  const Transform t(glm::translate(Mat4(1.f), Vec3(1, 0, 0)) * glm::scale(Mat4(1.f), Vec3(7)));
  const auto lights =
      Scene().light("point", {color("I", {8, 4, 2}), point("from", {0, 3, 0})}, t).build();
  LightSample s;
  ASSERT_TRUE(lights->sample({1, 1, 0}, {0, 1, 0}, 0.3f, {}, s));
  EXPECT_TRUE(s.delta);
  EXPECT_EQ(s.pdf, 1);
  EXPECT_EQ(s.wi, Vec3(0, 1, 0));
  EXPECT_EQ(s.distance, 2);
  EXPECT_EQ(s.radiance, Rgb(2, 1, 0.5f));
}

TEST(DeltaLights, SpotFallsOffByTheFourthPower) {
  const auto lights =
      Scene()
          .light("spot", {color("I", Rgb(1)), point("from", {0, 0, 0}), point("to", {0, 0, 5}),
                          reals("coneangle", {40}), reals("conedeltaangle", {10})})
          .build();
  const auto at = [&](double degrees) {
    const double a = degrees * 3.14159265358979 / 180;
    LightSample s;
    return lights->sample(Vec3(std::sin(a), 0, std::cos(a)), Vec3(0), 0, {}, s) ? s.radiance.x
                                                                                : 0.f;
  };
  EXPECT_NEAR(at(0), 1, 1e-5);
  EXPECT_NEAR(at(29), 1, 1e-5);
  EXPECT_EQ(at(41), 0);
  EXPECT_EQ(at(180), 0);
  const auto c = [](double d) { return std::cos(d * 3.14159265358979 / 180); };
  EXPECT_NEAR(at(35), std::pow((c(35) - c(40)) / (c(30) - c(40)), 4), 1e-5);
}

TEST(DeltaLights, DistantComesFromFrom) {
  const auto lights = Scene()
                          .light("distant", {color("L", {3, 2, 1}), point("from", {0, 10, 0})},
                                 Transform(glm::rotate(Mat4(1.f), kPi / 2, Vec3(0, 0, 1))))
                          .build();
  LightSample s;
  // From (0, 10, 0) to the default (0, 0, 1), turned by 90 degrees about z.
  ASSERT_TRUE(lights->sample(Vec3(4), Vec3(0), 0, {}, s));
  EXPECT_LT(glm::length(s.wi - glm::normalize(Vec3(-10, 0, -1))), 1e-6f);
  EXPECT_TRUE(std::isinf(s.distance));
  EXPECT_EQ(s.radiance, Rgb(3, 2, 1));
}

TEST(Lights, SayWhatIsLeftOut) {
  Scene scene;
  scene.light("laser", {}).light("maser", {}).light("point", {reals("bogus", {1})});
  scene.description.area_lights.push_back(entity("laser", {}));
  EXPECT_FALSE(scene.build()->empty());
  EXPECT_EQ(scene.warnings.list().size(), 4u);
  EXPECT_THROW(Scene().light("distant", {point("from", Vec3(1)), point("to", Vec3(1))}).build(),
               SceneError);
  EXPECT_TRUE(Scene().build()->empty());
  EXPECT_TRUE(Scene().light("point", {color("I", Rgb(0))}).build()->empty());
}

// Infinite lights.

TEST(InfiniteLights, ConstantGivesPi) {
  const auto lights =
      Scene().light("infinite", {color("L", {1, 2, 3}), color("scale", Rgb(2))}).build();
  EXPECT_TRUE(lights->has_infinite());
  const Vec3 n = glm::normalize(Vec3(1, -2, 3));
  expect_ratio(irradiance(*lights, Vec3(0), n), Rgb(2, 4, 6) * kPi, 1e-4f);
  expect_ratio(irradiance(*lights, Vec3(0), n, 40000, Vec3(0)), Rgb(2, 4, 6) * kPi);
}

TEST(InfiniteLights, MapPointsWherePbrtPointsIt) {
  // z is up, azimuth from x to y, the first row is at +z.
  const MapFile map(
      4, 2, [](int x, int y) { return Rgb(static_cast<float>(x), static_cast<float>(y), 1); });
  const auto lights =
      Scene().light("infinite", {string("mapname", map.path()), color("L", {1, 1, 2})}).build();
  const auto texel = [&](double phi, double theta) {
    return lights->escaped(
        Vec3(0), Vec3(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)));
  };
  const double quarter = 3.14159265358979 / 4;
  for (int y = 0; y < 2; ++y)
    for (int x = 0; x < 4; ++x) {
      const Rgb c = texel(quarter * (2 * x + 1), quarter * (2 * y + 1));  // middle of the texel
      EXPECT_NEAR(c.x, x, 1e-5);
      EXPECT_NEAR(c.y, y, 1e-5);
      EXPECT_NEAR(c.z, 2, 1e-5);
    }
  EXPECT_NEAR(texel(quarter * 2, quarter).x, 0.5, 1e-5) << "bilinear between";
  EXPECT_NEAR(texel(0, quarter).x, 1.5, 1e-5) << "around the seam";
}

TEST(InfiniteLights, MapsOfPbrtV2InTgaBeginAtTheLowestRow) {
  const MapFile map(4, 2, [](int, int y) { return y == 0 ? Rgb(0, 0, 1) : Rgb(1, 0, 0); }, ".tga");
  for (const Dialect dialect : {Dialect::v2, Dialect::v3}) {
    Scene scene;
    scene.description.dialect = dialect;
    const auto lights = scene.light("infinite", {string("mapname", map.path())}).build();
    const Rgb above = lights->escaped(Vec3(0), glm::normalize(Vec3(1, 1, std::sqrt(2.f))));  // middle of a texel
    EXPECT_NEAR(above.x, dialect == Dialect::v2 ? 1 : 0, 1e-5);
    EXPECT_NEAR(above.z, dialect == Dialect::v2 ? 0 : 1, 1e-5);
  }
}

TEST(InfiniteLights, MapsOfPbrtV4HaveTheColoursOfTheSpaceThatTheyName) {
  const MapFile aces(2, 2, [](int, int) { return Rgb(.5f, .25f, .2f); }, ".exr", {.7347f, .2653f, 0, 1, .0001f, -.077f, .32168f, .33767f});
  const auto shown = [&](bool v4) {
    return Scene().light("infinite", {string("mapname", aces.path()), boolean("srgb", v4)}).build()->escaped(Vec3(0), Vec3(0, 0, 1));
  };
  expect_ratio(shown(true), {.921f, .184f, .171f}, 5e-3f);
  expect_ratio(shown(false), {.5f, .25f, .2f}, 1e-6f);
}

TEST(InfiniteLights, MapSamplesAgreeWithUniformOnes) {
  const MapFile map(24, 12, rough);
  for (const Transform& t :
       {Transform(), tilted(), Transform(glm::scale(Mat4(1.f), Vec3(1, 1, 3)))}) {
    const auto lights = Scene().light("infinite", {string("mapname", map.path())}, t).build();
    const Vec3 n = glm::normalize(Vec3(1, 1, 2));
    Uniform u;
    glm::dvec3 sum(0);
    constexpr int kSide = 700;
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const Vec3 d = sample_uniform_sphere<float>(
            {(static_cast<float>(x) + 0.5f) / kSide, (static_cast<float>(y) + 0.5f) / kSide});
        sum += glm::dvec3(lights->escaped(Vec3(0), d) * std::max(0.f, glm::dot(n, d)));
      }
    const Rgb expected = Rgb(sum * (4 * 3.14159265358979 / (kSide * kSide)));
    expect_ratio(irradiance(*lights, Vec3(0), n, 90000), expected);
  }
}

TEST(InfiniteLights, DensityIntegratesToOneAndIsThatOfSamples) {
  const MapFile map(24, 12, rough);
  const auto lights = Scene()
                          .light("infinite", {string("mapname", map.path())}, tilted())
                          .light("infinite", {})
                          .build();
  Uniform u;
  double total = 0;
  constexpr int kCount = 200000;
  for (int i = 0; i < kCount; ++i) {
    float pdf;
    lights->escaped(Vec3(0), Vec3(0), uniform_direction(u), pdf);
    total += static_cast<double>(pdf);
  }
  EXPECT_NEAR(total / kCount * 4 * 3.14159265358979, 1, 0.02);
  for (int i = 0; i < 1000; ++i) {
    LightSample s;
    ASSERT_TRUE(lights->sample(Vec3(0), Vec3(0), u(), u.pair(), s));
    float pdf;
    const Rgb radiance = lights->escaped(Vec3(0), Vec3(0), s.wi, pdf);
    EXPECT_NEAR(pdf / s.pdf, 1, 1e-4);
    EXPECT_EQ(radiance, s.radiance);
    EXPECT_EQ(radiance, lights->escaped(Vec3(0), s.wi));
  }
}

TEST(InfiniteLights, MissingMapIsConstantWithAWarning) {
  Scene scene;
  const auto lights =
      scene.light("infinite", {string("mapname", "/no/such/map.exr"), color("L", Rgb(3))}).build();
  EXPECT_EQ(scene.warnings.list().size(), 1u);
  EXPECT_EQ(lights->escaped(Vec3(0), {0, 0, 1}), Rgb(3));
}

}  // namespace
}  // namespace cloudrenderer
