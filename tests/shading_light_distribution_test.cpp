// Every sampler of lights: chi-squared of its directions against its density.
#include <gtest/gtest.h>

#include <functional>

#include "chi_squared.h"
#include "shading/lights.h"
#include "shading_lights_support.h"

namespace cloudrenderer {
namespace {

using namespace test;

constexpr int kTests = 22;  // calls of expect_distribution

using Density = std::function<float(const Vec3&)>;

void expect_distribution(const Lights& lights, const Vec3& p, const Vec3& n, const Density& density, int parts = 6) {
  constexpr int kSamples = 60000;
  testing::SphereCells cells;
  const double inside = cells.integrate(density, parts);
  EXPECT_LE(inside, 1 + 1e-3);
  Uniform u;
  int lost = 0;
  for (int i = 0; i < kSamples; ++i) {
    LightSample s;
    if (lights.sample(p, n, u(), u.pair(), s))
      cells.add(s.wi);
    else
      ++lost;
  }
  const double out = static_cast<double>(lost) / kSamples;
  EXPECT_NEAR(inside + out, 1, 1e-3 + 5 * std::sqrt(out / kSamples));
  EXPECT_GT(cells.p_value(kSamples), testing::corrected_level(kTests)) << "seed 5";
}

float infinite_density(const Lights& lights, const Vec3& p, const Vec3& n, const Vec3& d) {
  float pdf;
  lights.escaped(p, n, d, pdf);
  return pdf;
}
float quadric_density(const Lights& lights, std::uint32_t light, const Quadric& q, const Vec3& p, const Vec3& n, const Vec3& d) {
  QuadricHit hit;
  if (!intersect(q, p, d, 0, kInfinity, hit)) return 0.f;
  const SurfacePoint s = surface_point(q, q.object_to_world.swaps_handedness(), p, d, hit.t);
  if (is_black(lights.emitted(light, s.ng, d, 0, {}))) return 0.f;
  return lights.emitted_pdf(light, p, n, d, hit.t, s.p, s.ng, 0);
}
float mesh_density(const Lights& lights, std::uint32_t light, const std::vector<Vec3>& vertices, const std::vector<Triangle>& triangles,
                   const Vec3& p, const Vec3& n, const Vec3& d) {
  float sum = 0;
  for (std::uint32_t i = 0; i < triangles.size(); ++i) {
    const auto corner = [&](int k) { return glm::dvec3(vertices[triangles[i][k]]); };
    const glm::dvec3 a = corner(0) - glm::dvec3(p), e0 = corner(1) - corner(0), e1 = corner(2) - corner(0), w(d);
    const glm::dvec3 normal = glm::cross(e0, e1), side = glm::cross(a, w);
    const double volume = glm::dot(w, normal), t = glm::dot(a, normal) / volume;
    const double b0 = glm::dot(e1, side) / volume, b1 = -glm::dot(e0, side) / volume;
    if (!(t > 0 && b0 >= 0 && b1 >= 0 && b0 + b1 <= 1)) continue;
    const Vec3 ng(glm::normalize(normal));
    if (is_black(lights.emitted(light, ng, d, i, {}))) continue;
    sum += lights.emitted_pdf(light, p, n, d, static_cast<float>(t), p + d * static_cast<float>(t), ng, i);
  }
  return sum;
}

TEST(LightDistributions, InfiniteMap) {
  const MapFile map(16, 8, rough);
  for (const Transform& t : {Transform(), tilted()}) {
    const auto lights = Scene().light("infinite", {string("mapname", map.path())}, t).build();
    expect_distribution(*lights, Vec3(0), Vec3(0), [&](const Vec3& d) { return infinite_density(*lights, Vec3(0), Vec3(0), d); }, 2);
  }
}

TEST(LightDistributions, InfiniteWithoutMap) {
  const auto lights = Scene().light("infinite", {}).build();
  const Vec3 n = glm::normalize(Vec3(1, 2, 3));
  for (const Vec3& normal : {Vec3(0), n})
    expect_distribution(*lights, Vec3(0), normal, [&](const Vec3& d) { return infinite_density(*lights, Vec3(0), normal, d); }, 2);
}

// Half of the samples go to the portal, whichever side it is seen from.
TEST(LightDistributions, InfiniteWithPortals) {
  const MapFile map(16, 8, rough);
  const auto high = portal({-1, -2, 1.5f}, {-1, 1, 1.5f}, {2, 1, 1.5f}), away = portal({3, 1, -1}, {3, -1, -1}, {3, -1, 1});
  for (const Vec3& p : {Vec3(0), Vec3(0.5f, 0.2f, 2.f)}) {
    const auto one = Scene().light("infinite", {string("mapname", map.path()), high}).build();
    expect_distribution(*one, p, Vec3(0), [&](const Vec3& d) { return infinite_density(*one, p, Vec3(0), d); }, 8);
    const auto two = Scene().light("infinite", {string("mapname", map.path()), high}).light("infinite", {away}).build();
    expect_distribution(*two, p, Vec3(0), [&](const Vec3& d) { return infinite_density(*two, p, Vec3(0), d); }, 8);
  }
}

TEST(Portals, ShowLightOnOneSideOnly) {
  const auto lights = Scene().light("infinite", {portal({-1, -1, 1}, {-1, 1, 1}, {1, 1, 1})}).build();
  const auto seen = [&](const Vec3& p, const Vec3& d) {
    float pdf;
    const Vec3 w = glm::normalize(d);
    EXPECT_EQ(lights->escaped(p, Vec3(0), w, pdf), lights->escaped(p, w));
    return lights->escaped(p, w).x;
  };
  EXPECT_EQ(seen({0, 0, 0}, {0, 0, 1}), 1.f);
  EXPECT_EQ(seen({0, 0, 0}, {0.99f, -0.99f, 1}), 1.f);
  EXPECT_EQ(seen({0, 0, 0}, {1.01f, 0, 1}), 0.f);
  EXPECT_EQ(seen({5, 0, 0}, {-5, 0, 1}), 1.f);
  EXPECT_EQ(seen({0, 0, 2}, {0, 0, 1}), 0.f) << "behind it";
  EXPECT_EQ(seen({0, 0, 2}, {0, 0, -1}), 0.f) << "from behind";
  EXPECT_EQ(seen({0, 0, 0}, {1, 0, 0}), 0.f);
}

void expect_quadric_distribution(const Quadric& q, const Vec3& p) {
  const auto lights = Scene().quadric(q, Rgb(1)).build();
  expect_distribution(*lights, p, Vec3(0), [&](const Vec3& d) { return quadric_density(*lights, 0, q, p, Vec3(0), d); });
}

TEST(LightDistributions, Sphere) {
  expect_quadric_distribution(sphere({1, 2, 2}, 2.5f), Vec3(0));
  expect_quadric_distribution(sphere({0, 1, 2}, 0.5f), Vec3(0));
}

TEST(LightDistributions, Ellipsoid) {
  Quadric q = sphere(Vec3(0), 1);
  q.object_to_world = Transform(glm::translate(Mat4(1.f), Vec3(1, 2, 2)) *
                                glm::rotate(Mat4(1.f), 0.7f, glm::normalize(Vec3(1, 1, 0))) *
                                glm::scale(Mat4(1.f), Vec3(2.4f, 1.2f, -1.8f)));
  expect_quadric_distribution(q, Vec3(0));
}

TEST(LightDistributions, Disk) {
  Quadric q;
  q.kind = QuadricKind::disk;
  q.radius = 3;
  q.object_to_world = Transform(glm::rotate(Mat4(1.f), 0.4f, Vec3(1, 0, 0)));
  expect_quadric_distribution(q, {0.5f, 0.2f, 1.5f});
  expect_quadric_distribution(q, {4.f, 2.f, 0.5f});
}

// Sampled by area, which from a point outside is twice as much as the side that is seen.
TEST(LightDistributions, Cylinder) {
  Quadric q;
  q.kind = QuadricKind::cylinder;
  q.radius = 1;
  q.z_min = -2;
  q.z_max = 1.5f;
  q.object_to_world = Transform(glm::rotate(Mat4(1.f), 0.4f, Vec3(1, 0, 0)));
  expect_quadric_distribution(q, {2.f, 0.4f, 0.3f});
}

TEST(LightDistributions, Triangles) {
  // A triangle alone, and a fan that is no parallelogram.
  const std::vector<Vec3> v = {{-2, -1, 2}, {1, -1, 2}, {2, 1, 3}, {-1, 1, 2.5f}, {0.1f, 0.2f, 1.5f}};
  for (const std::vector<Triangle>& t :
       {std::vector<Triangle>{{0, 2, 1}}, std::vector<Triangle>{{0, 4, 1}, {1, 4, 2}, {2, 4, 3}, {3, 4, 0}}}) {
    const auto lights = Scene().mesh(v, t, Rgb(1)).build();
    expect_distribution(*lights, Vec3(0), Vec3(0, 0, 1), [&](const Vec3& d) { return mesh_density(*lights, 0, v, t, Vec3(0), {0, 0, 1}, d); }, 24);
  }
}

// The choice among lights of all kinds, which depends on the place and the normal, and the samplers together.
TEST(LightDistributions, ManyKindsAtOnce) {
  const MapFile map(16, 8, rough);
  const std::vector<Vec3> v = {{-1, -1, 5}, {-1, 1, 5}, {1, 1, 5}, {1, -1, 5}};
  const Quadric ball = sphere({0, 4, 0}, 1), lamp = sphere({-2, 0, -1}, 0.5f);
  Scene scene;
  scene.light("infinite", {string("mapname", map.path())}).quadric(ball, Rgb(2)).quadric(lamp, Rgb(30));
  scene.mesh(v, kTwoTriangles, Rgb(40));
  const auto lights = scene.build();
  const Vec3 p(0.2f, 0.3f, 1);
  for (const Vec3& n : {Vec3(0), glm::normalize(Vec3(0, 1, 1))})
    expect_distribution(*lights, p, n, [&](const Vec3& d) {
      return infinite_density(*lights, p, n, d) + quadric_density(*lights, 0, ball, p, n, d) +
             quadric_density(*lights, 1, lamp, p, n, d) + mesh_density(*lights, 2, v, kTwoTriangles, p, n, d);
    });
}

// By solid angle where they fill much of the view: from their middle, aside, almost in their plane; by area from far away, and from so near
// to their plane that single precision would not do.
TEST(LightDistributions, Rectangles) {
  const std::vector<Vec3> v = {{-1, -2, 2}, {-1, 2, 2}, {1, 2, 2}, {1, -2, 2}};
  const auto lights = Scene().mesh(v, kTwoTriangles, Rgb(1)).build();
  for (const Vec3& p : {Vec3(0.1f, 0.2f, 1), Vec3(2.5f, -1, 1.2f), Vec3(0.3f, -0.4f, 1.92f), Vec3(4, 3, -9)}) {
    SCOPED_TRACE("from " + std::to_string(p.x) + " " + std::to_string(p.z));
    expect_distribution(*lights, p, Vec3(0, 0, 1), [&](const Vec3& d) { return mesh_density(*lights, 0, v, kTwoTriangles, p, {0, 0, 1}, d); }, 24);
  }
  // The mean of 1 / pdf is the solid angle, 4 atan(a b / (d sqrt(a^2 + b^2 + d^2))); where it is sampled, every pdf is.
  Uniform u;
  for (const float z : {1.f, 1.99f}) {
    constexpr int kCount = 20000;
    const double d = 2 - static_cast<double>(z), angle = 4 * std::atan(2 / (d * std::sqrt(5 + d * d)));
    double mean = 0;
    for (int i = 0; i < kCount; ++i) {
      LightSample s;
      ASSERT_TRUE(lights->sample({0, 0, z}, Vec3(0, 0, 1), 0, u.pair(), s));
      mean += 1 / static_cast<double>(s.pdf) / kCount;
      if (z == 1) {
        ASSERT_NEAR(static_cast<double>(s.pdf) * angle, 1, 1e-5);
      }
    }
    EXPECT_NEAR(mean / angle, 1, z == 1 ? 1e-5 : 0.15) << z;
  }
}

TEST(LightDistributions, RectanglesOfAllSizesAreAlike) {
  float pdf = 0;
  for (const float scale : {1.f, 0x1p-38f, 0x1p30f}) {
    std::vector<Vec3> v = {{-1, -2, 2}, {-1, 2, 2}, {1, 2, 2}, {1, -2, 2}};
    for (Vec3& x : v) x *= scale;
    LightSample s;
    ASSERT_TRUE(Scene().mesh(v, kTwoTriangles, Rgb(1)).build()->sample(scale * Vec3(0.3f, 0.2f, 1), Vec3(0, 0, 1), 0, {0.3f, 0.6f}, s)) << scale;
    if (scale == 1) pdf = s.pdf;
    EXPECT_EQ(s.pdf, pdf) << scale;
  }
}

TEST(LightDistributions, ParallelogramDensityFitsItsSamples) {
  const auto lights =
      Scene().mesh({{-2, -1, 1}, {1, -1, 2}, {2, 1, 2}, {-1, 1, 1}}, kTwoTriangles, Rgb(1)).build();
  Uniform u;
  const Vec3 n = glm::normalize(glm::cross(Vec3(3, 0, 1), Vec3(1, 2, 0))),
             p = Vec3(-0.5f, 0.3f, 0) + 4.f * n;
  double inverse = 0;
  constexpr int kCount = 20000;
  for (int i = 0; i < kCount; ++i) {
    LightSample s;
    ASSERT_TRUE(lights->sample(p, -n, 0, u.pair(), s));
    for (std::uint32_t primitive : {0u, 1u})
      EXPECT_NEAR(
          lights->emitted_pdf(0, p, -n, s.wi, s.distance, p + s.wi * s.distance, n, primitive) /
              s.pdf,
          1, 1e-4);
    inverse += 1 / static_cast<double>(s.pdf);
  }
  // The mean of 1/pdf is the solid angle: here of two triangles (Van Oosterom and Strackee 1983).
  const auto triangle = [&](Vec3 a, Vec3 b, Vec3 c) {
    const glm::dvec3 x = glm::normalize(glm::dvec3(a - p)), y = glm::normalize(glm::dvec3(b - p)),
                     z = glm::normalize(glm::dvec3(c - p));
    return 2 * std::atan2(std::fabs(glm::dot(x, glm::cross(y, z))),
                          1 + glm::dot(x, y) + glm::dot(y, z) + glm::dot(z, x));
  };
  const double angle =
      triangle({-2, -1, 1}, {1, -1, 2}, {2, 1, 2}) + triangle({-2, -1, 1}, {2, 1, 2}, {-1, 1, 1});
  EXPECT_NEAR(inverse / kCount / angle, 1, 0.01);
}

}  // namespace
}  // namespace cloudrenderer
