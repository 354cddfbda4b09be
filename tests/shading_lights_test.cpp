#include "shading/lights.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <glm/gtc/matrix_transform.hpp>
#include <random>
#include <set>

#include "film_support.h"
#include "shading/light_choice.h"

namespace cloudrenderer {
namespace {

using test::entity;
using test::reals;
using test::string;

Param color(const std::string& name, const Rgb& c) {
  Param p = reals(name, {c.x, c.y, c.z});
  p.type = ParamType::rgb;
  return p;
}
Param point(const std::string& name, const Vec3& v) {
  Param p = reals(name, {v.x, v.y, v.z});
  p.type = ParamType::point3;
  return p;
}
Param boolean(const std::string& name, bool v) {
  Param p = test::integer(name, v);
  p.type = ParamType::boolean;
  return p;
}

// A scene made of lights only.
struct Scene {
  SceneDescription description;
  std::vector<AreaLightId> shape_lights;
  std::vector<Vec3> positions;
  std::vector<Triangle> triangles;
  std::vector<MeshChunk> chunks;
  std::vector<QuadricRecord> quadrics;
  Warnings warnings;

  Scene& light(const std::string& type, std::vector<Param> params, const Transform& to_world = {}) {
    LightDesc desc = entity<LightDesc>(type, std::move(params));
    desc.light_to_world = to_world;
    description.lights.push_back(std::move(desc));
    return *this;
  }
  std::uint32_t emission(const Rgb& radiance, std::vector<Param> more = {}) {
    more.push_back(color("L", radiance));
    description.area_lights.push_back(entity("diffuse", std::move(more)));
    shape_lights.emplace_back(static_cast<std::uint32_t>(description.area_lights.size() - 1));
    return static_cast<std::uint32_t>(shape_lights.size() - 1);
  }
  Scene& quadric(const Quadric& q, const Rgb& radiance, bool reverse = false, std::vector<Param> more = {}) {
    QuadricRecord r;
    r.quadric = q;
    r.flip = reverse != q.object_to_world.swaps_handedness();
    r.light = emission(radiance, std::move(more));
    quadrics.push_back(r);
    return *this;
  }
  Scene& mesh(const std::vector<Vec3>& p, const std::vector<Triangle>& t, const Rgb& radiance,
              std::vector<Param> more = {}) {
    MeshChunk c;
    c.light = emission(radiance, std::move(more));
    c.first_triangle = static_cast<std::uint32_t>(triangles.size());
    c.triangle_count = static_cast<std::uint32_t>(t.size());
    c.first_vertex = static_cast<std::uint32_t>(positions.size());
    c.vertex_count = static_cast<std::uint32_t>(p.size());
    for (const Triangle& x : t) triangles.push_back(x + c.first_vertex);
    positions.insert(positions.end(), p.begin(), p.end());
    chunks.push_back(c);
    return *this;
  }
  std::unique_ptr<Lights> build() {
    Part part;
    part.positions = positions;
    part.triangles = triangles;
    part.chunks = chunks;
    part.quadrics = quadrics;
    return Lights::build(description, shape_lights, part, {Vec3(-1), Vec3(1)}, warnings);
  }
};

Quadric sphere(const Vec3& center, float radius) {
  Quadric q;
  q.radius = radius;
  q.z_min = -radius;
  q.z_max = radius;
  q.object_to_world = Transform(glm::translate(Mat4(1.f), center));
  return q;
}

const std::vector<Triangle> kTwoTriangles = {{0, 1, 2}, {0, 2, 3}};

struct Uniform {
  std::mt19937 engine{5};
  float operator()() { return static_cast<float>(engine() >> 8) * 0x1p-24f; }
  Vec2 pair() { return {(*this)(), (*this)()}; }
};

// What a white diffuse surface gets from light samples alone, without obstacles.
Rgb irradiance(const Lights& lights, const Vec3& p, const Vec3& n, int samples, const Vec3& hint) {
  Uniform u;
  glm::dvec3 sum(0);
  const int side = static_cast<int>(std::sqrt(samples));
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {  // jittered
      const Vec2 v((static_cast<float>(x) + u()) / static_cast<float>(side) * 0.9999999f,
                   (static_cast<float>(y) + u()) / static_cast<float>(side) * 0.9999999f);
      LightSample s;
      if (!lights.sample(p, hint, u(), v, s)) continue;
      EXPECT_NEAR(glm::length(s.wi), 1, 1e-5);
      sum += glm::dvec3(s.radiance * (std::max(0.f, glm::dot(n, s.wi)) / s.pdf));
    }
  return Rgb(sum / static_cast<double>(side * side));
}
Rgb irradiance(const Lights& lights, const Vec3& p, const Vec3& n, int samples = 10000) {
  return irradiance(lights, p, n, samples, n);
}

void expect_ratio(const Rgb& a, const Rgb& b, float tolerance = 0.01f) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(a[i] / b[i], 1, tolerance) << a[i] << " for " << b[i];
}

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
  const auto two = both.quadric(sphere({0, 0, 0}, 2), {1, 1, 1}, false, {boolean("twosided", true)}).build();
  expect_ratio(irradiance(*two, {0.3f, 0, 1}, {0, 1, 0}), Rgb(kPi));
  expect_ratio(irradiance(*two, {0, 0, 5}, {0, 0, -1}), Rgb(kPi * 4 / 25));
}

TEST(AreaLights, MirroredSphereStillShinesOutwards) {
  Quadric q = sphere(Vec3(0), 2);
  q.object_to_world = Transform(glm::scale(Mat4(1.f), Vec3(-1, 1, 1)));
  expect_ratio(irradiance(*Scene().quadric(q, Rgb(1)).build(), {0, 0, 5}, {0, 0, -1}), Rgb(kPi * 4 / 25));
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
  EXPECT_TRUE(is_black(irradiance(*lights, {0, 0, -300}, {0, 0, 1}))) << "the open side shows the dark inside";
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
  const auto lights = Scene().mesh({{0, 0, 2}, {0, 3, 2}, {1, 3, 2}, {1, 0, 2}}, kTwoTriangles, {1, 2, 4}).build();
  const double x = 0.5, y = 1.5, a = std::sqrt(1 + x * x), b = std::sqrt(1 + y * y);
  const double form = (x / a * std::atan(y / a) + y / b * std::atan(x / b)) / (2 * 3.14159265358979);
  expect_ratio(irradiance(*lights, Vec3(0), {0, 0, 1}), Rgb(1, 2, 4) * static_cast<float>(form * 3.14159265358979));
  EXPECT_TRUE(is_black(irradiance(*lights, {0, 0, 4}, {0, 0, -1}))) << "one-sided";
}

TEST(AreaLights, TrianglesShareTheWork) {
  // The same rectangle from triangles that are no parallelograms.
  const auto lights = Scene().mesh({{0, 0, 2}, {0, 3, 2}, {1, 3, 2}, {1, 0, 2}, {0.3f, 1.1f, 2}},
                                   {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}}, Rgb(1)).build();
  const double x = 0.5, y = 1.5, a = std::sqrt(1 + x * x), b = std::sqrt(1 + y * y);
  const double form = (x / a * std::atan(y / a) + y / b * std::atan(x / b)) / (2 * 3.14159265358979);
  expect_ratio(irradiance(*lights, Vec3(0), {0, 0, 1}, 90000), Rgb(static_cast<float>(form * 3.14159265358979)));
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
      EXPECT_TRUE(is_finite(s.wi) && std::isfinite(s.pdf) && s.pdf > 0 && std::isfinite(s.distance)) << d;
      EXPECT_NEAR(s.distance, d, 1.0001f + d * 1e-6f);
      EXPECT_NEAR(lights->emitted_pdf(0, p, n, s.wi, s.distance, p, n, 0) / s.pdf, 1, 1e-6);
    }
    if (d > 1.01f) {
      const double sine = 1 / static_cast<double>(d);
      const double pdf = 1 / (2 * 3.14159265358979 * (sine * sine / (1 + std::sqrt(1 - sine * sine))));
      EXPECT_NEAR(static_cast<double>(s.pdf) / pdf, 1, 1e-4) << d;
    }
  }
}

TEST(AreaLights, ShineByTheirNormal) {
  Scene scene;
  scene.description.dialect = Dialect::v3;
  scene.quadric(sphere(Vec3(0), 1), {1, 2, 3}, false, {color("scale", Rgb(2)), test::integer("samples", 4)});
  scene.quadric(sphere(Vec3(5), 1), {1, 2, 3}, false, {boolean("twosided", true)});
  const auto lights = scene.build();
  EXPECT_EQ(lights->emitted(0, {0, 0, 1}, {}, {0, 0, -1}), Rgb(2, 4, 6));
  EXPECT_EQ(lights->emitted(0, {0, 0, 1}, {}, {0, 0, 1}), Rgb(0));
  EXPECT_EQ(lights->emitted(1, {0, 0, 1}, {}, {0, 0, 1}), Rgb(1, 2, 3));
  EXPECT_TRUE(scene.warnings.list().empty());
}

TEST(AreaLights, LeaveUnsampledShapesToRays) {
  Quadric cone;
  cone.kind = QuadricKind::cone;
  cone.height = 1;
  const auto lights = Scene().quadric(cone, Rgb(3)).build();
  LightSample s;
  EXPECT_FALSE(lights->empty());
  EXPECT_FALSE(lights->sample({0, 0, 9}, {0, 0, -1}, 0.5f, Vec2(0.5f), s));
  EXPECT_EQ(lights->emitted(0, {0, 0, 1}, {}, {0, 0, -1}), Rgb(3));
  EXPECT_EQ(lights->emitted_pdf(0, {0, 0, 9}, {0, 0, -1}, {0, 0, -1}, 8, {0, 0, 1}, {0, 0, 1}, 0), 0);
}

// Lights that rays do not find.

TEST(DeltaLights, PointStandsAtFromPlusItsOrigin) {
  // As in pbrt, `from` is not turned or scaled.
  const Transform t(glm::translate(Mat4(1.f), Vec3(1, 0, 0)) * glm::scale(Mat4(1.f), Vec3(7)));
  const auto lights = Scene().light("point", {color("I", {8, 4, 2}), point("from", {0, 3, 0})}, t).build();
  LightSample s;
  ASSERT_TRUE(lights->sample({1, 1, 0}, {0, 1, 0}, 0.3f, {}, s));
  EXPECT_TRUE(s.delta);
  EXPECT_EQ(s.pdf, 1);
  EXPECT_EQ(s.wi, Vec3(0, 1, 0));
  EXPECT_EQ(s.distance, 2);
  EXPECT_EQ(s.radiance, Rgb(2, 1, 0.5f));
}

TEST(DeltaLights, SpotFallsOffByTheFourthPower) {
  const auto lights = Scene().light("spot", {color("I", Rgb(1)), point("from", {0, 0, 0}), point("to", {0, 0, 5}),
                                             reals("coneangle", {40}), reals("conedeltaangle", {10})}).build();
  const auto at = [&](double degrees) {
    const double a = degrees * 3.14159265358979 / 180;
    LightSample s;
    return lights->sample(Vec3(std::sin(a), 0, std::cos(a)), Vec3(0), 0, {}, s) ? s.radiance.x : 0.f;
  };
  EXPECT_NEAR(at(0), 1, 1e-5);
  EXPECT_NEAR(at(29), 1, 1e-5);
  EXPECT_EQ(at(41), 0);
  EXPECT_EQ(at(180), 0);
  const auto c = [](double d) { return std::cos(d * 3.14159265358979 / 180); };
  EXPECT_NEAR(at(35), std::pow((c(35) - c(40)) / (c(30) - c(40)), 4), 1e-5);
}

TEST(DeltaLights, DistantComesFromFrom) {
  const auto lights = Scene().light("distant", {color("L", {3, 2, 1}), point("from", {0, 10, 0})},
                                    Transform(glm::rotate(Mat4(1.f), kPi / 2, Vec3(0, 0, 1)))).build();
  LightSample s;
  // From (0, 10, 0) to the default (0, 0, 1), turned by 90 degrees about z.
  ASSERT_TRUE(lights->sample(Vec3(4), Vec3(0), 0, {}, s));
  EXPECT_LT(glm::length(s.wi - glm::normalize(Vec3(-10, 0, -1))), 1e-6f);
  EXPECT_TRUE(std::isinf(s.distance));
  EXPECT_EQ(s.radiance, Rgb(3, 2, 1));
}

TEST(Lights, SayWhatIsLeftOut) {
  Scene scene;
  scene.light("goniometric", {}).light("projection", {}).light("point", {reals("bogus", {1})});
  scene.description.area_lights.push_back(entity("laser", {}));
  EXPECT_FALSE(scene.build()->empty());
  EXPECT_EQ(scene.warnings.list().size(), 4u);
  EXPECT_THROW(Scene().light("distant", {point("from", Vec3(1)), point("to", Vec3(1))}).build(), SceneError);
  EXPECT_TRUE(Scene().build()->empty());
  EXPECT_TRUE(Scene().light("point", {color("I", Rgb(0))}).build()->empty());
}

// Infinite lights.

class MapFile {
 public:
  MapFile(int width, int height, const std::function<Rgb(int, int)>& f) {
    path_ = (std::filesystem::temp_directory_path() / ("lights_test_" + std::to_string(::getpid()) + ".exr")).string();
    std::vector<Rgb> pixels;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) pixels.push_back(f(x, y));
    const auto out = OIIO::ImageOutput::create(path_);
    const OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::FLOAT);
    if (!out || !out->open(path_, spec) || !out->write_image(OIIO::TypeDesc::FLOAT, pixels.data()) || !out->close())
      throw std::runtime_error("cannot write " + path_);
  }
  ~MapFile() { std::filesystem::remove(path_); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

Rgb rough(int x, int y) {
  const auto h = static_cast<float>((x * 7919 + y * 104729) % 101) / 100.f;
  return (x == 11 && y == 3) ? Rgb(90, 80, 50) : Rgb(h * h, 0.2f * h, x < 8 ? 1.f : 0.f);
}

Transform tilted() {
  return Transform(glm::rotate(Mat4(1.f), 1.f, glm::normalize(Vec3(1, 2, 3))) * glm::scale(Mat4(1.f), Vec3(1, 1, -1)));
}

Vec3 uniform_direction(Uniform& u) { return sample_uniform_sphere(u.pair()); }

TEST(InfiniteLights, ConstantGivesPi) {
  const auto lights = Scene().light("infinite", {color("L", {1, 2, 3}), color("scale", Rgb(2))}).build();
  EXPECT_TRUE(lights->has_infinite());
  const Vec3 n = glm::normalize(Vec3(1, -2, 3));
  expect_ratio(irradiance(*lights, Vec3(0), n), Rgb(2, 4, 6) * kPi, 1e-4f);
  expect_ratio(irradiance(*lights, Vec3(0), n, 40000, Vec3(0)), Rgb(2, 4, 6) * kPi);
}

TEST(InfiniteLights, MapPointsWherePbrtPointsIt) {
  // z is up, azimuth from x to y, the first row is at +z.
  const MapFile map(4, 2, [](int x, int y) { return Rgb(static_cast<float>(x), static_cast<float>(y), 1); });
  const auto lights = Scene().light("infinite", {string("mapname", map.path()), color("L", {1, 1, 2})}).build();
  const auto texel = [&](double phi, double theta) {
    return lights->escaped(Vec3(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)));
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

TEST(InfiniteLights, MapSamplesAgreeWithUniformOnes) {
  const MapFile map(24, 12, rough);
  for (const Transform& t : {Transform(), tilted(), Transform(glm::scale(Mat4(1.f), Vec3(1, 1, 3)))}) {
    const auto lights = Scene().light("infinite", {string("mapname", map.path())}, t).build();
    const Vec3 n = glm::normalize(Vec3(1, 1, 2));
    Uniform u;
    glm::dvec3 sum(0);
    constexpr int kSide = 700;
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const Vec3 d = sample_uniform_sphere({(static_cast<float>(x) + 0.5f) / kSide, (static_cast<float>(y) + 0.5f) / kSide});
        sum += glm::dvec3(lights->escaped(d) * std::max(0.f, glm::dot(n, d)));
      }
    const Rgb expected = Rgb(sum * (4 * 3.14159265358979 / (kSide * kSide)));
    expect_ratio(irradiance(*lights, Vec3(0), n, 90000), expected);
  }
}

TEST(InfiniteLights, DensityIntegratesToOneAndIsThatOfSamples) {
  const MapFile map(24, 12, rough);
  const auto lights = Scene().light("infinite", {string("mapname", map.path())}, tilted()).light("infinite", {}).build();
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
    EXPECT_EQ(radiance, lights->escaped(s.wi));
  }
}

TEST(InfiniteLights, MissingMapIsConstantWithAWarning) {
  Scene scene;
  const auto lights = scene.light("infinite", {string("mapname", "/no/such/map.exr"), color("L", Rgb(3))}).build();
  EXPECT_EQ(scene.warnings.list().size(), 1u);
  EXPECT_EQ(lights->escaped({0, 0, 1}), Rgb(3));
}

// Distributions.

// Pearson's test of directions sampled against a density over the sphere; bins by z and azimuth.
void expect_distribution(const std::function<bool(const Vec2&, Vec3&)>& sample, const std::function<float(const Vec3&)>& pdf) {
  constexpr int kZ = 12, kPhi = 24, kCount = 60000, kSub = 24;
  std::vector<double> seen(kZ * kPhi), expected(kZ * kPhi);
  Uniform u;
  for (int i = 0; i < kCount; ++i) {
    Vec3 d;
    if (!sample(u.pair(), d)) continue;
    const double phi = std::atan2(static_cast<double>(d.y), static_cast<double>(d.x)) / (2 * 3.14159265358979) + 0.5;
    const int z = std::min(kZ - 1, static_cast<int>((d.z * 0.5f + 0.5f) * kZ)), p = std::min(kPhi - 1, static_cast<int>(phi * kPhi));
    seen[static_cast<std::size_t>(z * kPhi + p)] += 1;
  }
  for (int z = 0; z < kZ; ++z)
    for (int p = 0; p < kPhi; ++p)
      for (int i = 0; i < kSub * kSub; ++i) {
        const double cz = 2 * (z + (i % kSub + 0.5) / kSub) / kZ - 1;
        const double phi = 2 * 3.14159265358979 * ((p + (i / kSub + 0.5) / kSub) / kPhi - 0.5);
        const double r = std::sqrt(1 - cz * cz);
        expected[static_cast<std::size_t>(z * kPhi + p)] += static_cast<double>(pdf(Vec3(r * std::cos(phi), r * std::sin(phi), cz)));
      }
  double statistic = 0, rest_seen = 0, rest_expected = 0;
  int freedom = -1;
  const auto add = [&](double o, double e) {
    statistic += (o - e) * (o - e) / e;
    ++freedom;
  };
  for (std::size_t b = 0; b < seen.size(); ++b) {
    const double e = expected[b] * 4 * 3.14159265358979 / (kZ * kPhi * kSub * kSub) * kCount;
    if (e < 20) {
      rest_seen += seen[b];
      rest_expected += e;
    } else {
      add(seen[b], e);
    }
  }
  if (rest_expected > 20) add(rest_seen, rest_expected);
  else EXPECT_LT(rest_seen, 60);
  // Wilson and Hilferty: about normal, so 4.5 is a chance of 3e-6. Integrating the density on a grid adds a little.
  const double k = freedom, z = (std::cbrt(statistic / k) - (1 - 2 / (9 * k))) / std::sqrt(2 / (9 * k));
  EXPECT_LT(z, 4.5) << "chi-squared " << statistic << " with " << freedom << " degrees of freedom";
}

TEST(LightDistributions, InfiniteMap) {
  const MapFile map(16, 8, rough);
  const auto lights = Scene().light("infinite", {string("mapname", map.path())}, tilted()).build();
  expect_distribution(
      [&](const Vec2& u, Vec3& d) {
        LightSample s;
        const bool ok = lights->sample(Vec3(0), Vec3(0), 0, u, s);
        d = s.wi;
        return ok;
      },
      [&](const Vec3& d) {
        float pdf;
        lights->escaped(Vec3(0), Vec3(0), d, pdf);
        return pdf;
      });
}

void expect_quadric_distribution(const Quadric& q, const Vec3& p) {
  const auto lights = Scene().quadric(q, Rgb(1)).build();
  expect_distribution(
      [&](const Vec2& u, Vec3& d) {
        LightSample s;
        const bool ok = lights->sample(p, Vec3(0), 0, u, s);
        d = s.wi;
        return ok;
      },
      [&](const Vec3& d) {
        QuadricHit hit;
        if (!intersect(q, p, d, 0, kInfinity, hit)) return 0.f;
        const SurfacePoint s = surface_point(q, q.object_to_world.swaps_handedness(), p, d, hit.t);
        if (is_black(lights->emitted(0, s.ng, {}, d))) return 0.f;
        return lights->emitted_pdf(0, p, Vec3(0), d, hit.t, s.p, s.ng, 0);
      });
}

TEST(LightDistributions, Sphere) { expect_quadric_distribution(sphere({1, 2, 2}, 2.5f), Vec3(0)); }

TEST(LightDistributions, Ellipsoid) {
  Quadric q = sphere(Vec3(0), 1);
  q.object_to_world = Transform(glm::translate(Mat4(1.f), Vec3(1, 2, 2)) * glm::rotate(Mat4(1.f), 0.7f, glm::normalize(Vec3(1, 1, 0))) *
                                glm::scale(Mat4(1.f), Vec3(2.4f, 1.2f, -1.8f)));
  expect_quadric_distribution(q, Vec3(0));
}

TEST(LightDistributions, Disk) {
  Quadric q;
  q.kind = QuadricKind::disk;
  q.radius = 3;
  q.object_to_world = Transform(glm::rotate(Mat4(1.f), 0.4f, Vec3(1, 0, 0)));
  expect_quadric_distribution(q, {0.5f, 0.2f, 1.5f});
}

TEST(LightDistributions, ParallelogramDensityFitsItsSamples) {
  const auto lights = Scene().mesh({{-2, -1, 1}, {1, -1, 2}, {2, 1, 2}, {-1, 1, 1}}, kTwoTriangles, Rgb(1)).build();
  Uniform u;
  const Vec3 n = glm::normalize(glm::cross(Vec3(3, 0, 1), Vec3(1, 2, 0))), p = Vec3(-0.5f, 0.3f, 0) + 4.f * n;
  double inverse = 0;
  constexpr int kCount = 20000;
  for (int i = 0; i < kCount; ++i) {
    LightSample s;
    ASSERT_TRUE(lights->sample(p, -n, 0, u.pair(), s));
    for (std::uint32_t primitive : {0u, 1u})
      EXPECT_NEAR(lights->emitted_pdf(0, p, -n, s.wi, s.distance, p + s.wi * s.distance, n, primitive) / s.pdf, 1, 1e-4);
    inverse += 1 / static_cast<double>(s.pdf);
  }
  // The mean of 1/pdf is the solid angle: here of two triangles (Van Oosterom and Strackee 1983).
  const auto triangle = [&](Vec3 a, Vec3 b, Vec3 c) {
    const glm::dvec3 x = glm::normalize(glm::dvec3(a - p)), y = glm::normalize(glm::dvec3(b - p)), z = glm::normalize(glm::dvec3(c - p));
    return 2 * std::atan2(std::fabs(glm::dot(x, glm::cross(y, z))), 1 + glm::dot(x, y) + glm::dot(y, z) + glm::dot(z, x));
  };
  const double angle = triangle({-2, -1, 1}, {1, -1, 2}, {2, 1, 2}) + triangle({-2, -1, 1}, {2, 1, 2}, {-1, 1, 1});
  EXPECT_NEAR(inverse / kCount / angle, 1, 0.01);
}

// The choice of a light.

EmitterBounds emitter(Uniform& u, int kind) {
  EmitterBounds b;
  b.center = Vec3(u(), u(), u()) * 10.f;
  b.axis = uniform_direction(u);
  b.strength = 0.1f + u();
  switch (kind % 5) {
    case 0: break;
    case 1: b.shape = EmitterShape::planar; b.radius = 0.3f; break;
    case 2: b.shape = EmitterShape::planar_two_sided; b.radius = 0.1f; break;
    case 3: b.shape = EmitterShape::cone; b.cos_spread = 1; b.cos_emission = 0.5f; break;
    default: b.radius = 0.5f;
  }
  return b;
}

TEST(LightChoice, ChancesSumToOneAndAreThoseOfSamples) {
  for (const int count : {2, 16, 17, 300}) {
    SCOPED_TRACE(count);
    Uniform u;
    std::vector<EmitterBounds> all;
    for (int i = 0; i < count; ++i) all.push_back(emitter(u, i));
    all[0].shape = EmitterShape::everywhere;
    if (count > 100)
      for (int i = 1; i < 40; ++i) all[static_cast<std::size_t>(i)].shape = EmitterShape::distant;
    const LightChoice choice(all);
    for (int round = 0; round < 5; ++round) {
      const Vec3 p = Vec3(u(), u(), u()) * 10.f, n = round == 0 ? Vec3(0) : uniform_direction(u);
      double sum = 0;
      for (std::uint32_t i = 0; i < all.size(); ++i) sum += static_cast<double>(choice.chance(i, p, n));
      EXPECT_LE(sum, 1.0001);
      std::vector<int> seen(all.size());
      int missed = 0;
      constexpr int kCount = 20000;
      for (int i = 0; i < kCount; ++i) {
        float chance;
        const std::int64_t e = choice.sample(p, n, (static_cast<float>(i) + u()) / kCount * 0.9999999f, chance);
        if (e < 0) {
          ++missed;
          continue;
        }
        ++seen[static_cast<std::size_t>(e)];
        EXPECT_NEAR(chance / choice.chance(static_cast<std::uint32_t>(e), p, n), 1, 1e-4);
      }
      EXPECT_NEAR(missed / static_cast<double>(kCount), 1 - sum, 0.01) << "only dead ends are missing";
      for (std::uint32_t i = 0; i < all.size(); ++i) {
        const double expected = kCount * static_cast<double>(choice.chance(i, p, n));
        EXPECT_NEAR(seen[i], expected, 3 + 0.02 * expected) << i;
        if (importance(all[i], p, n) > 0) { EXPECT_GT(choice.chance(i, p, n), 0) << i; }
      }
    }
  }
}

TEST(LightChoice, ManyLightsGiveTheSumOfTheirLight) {
  for (const int count : {5, 60}) {
    Scene scene;
    Uniform u;
    glm::dvec3 expected(0);
    const Vec3 p(5, 0.5f, 5), n = glm::normalize(Vec3(0.2f, 1, 0.1f));
    for (int i = 0; i < count; ++i) {
      const Vec3 at = Vec3(u(), u(), u()) * 10.f;
      const Rgb intensity(0.5f + u(), u(), 1);
      scene.light("point", {color("I", intensity), point("from", at)});
      const Vec3 w = at - p;
      const float d = glm::length(w);
      expected += glm::dvec3(intensity * std::max(0.f, glm::dot(w, n)) / (d * d * d));
    }
    const auto lights = scene.build();
    expect_ratio(irradiance(*lights, p, n, 40000), Rgb(expected), 0.02f);
    // The estimate is right for a wrong normal too, only with more noise.
    expect_ratio(irradiance(*lights, p, n, 250000, -n), Rgb(expected), 0.03f);
  }
}

TEST(LightChoice, NearLightsAreChosenMoreOften) {
  Scene scene;
  for (int i = 0; i < 100; ++i) scene.light("point", {point("from", {static_cast<float>(i) * 10.f, 5, 0})});
  const auto lights = scene.build();
  Uniform u;
  int near = 0;
  for (int i = 0; i < 1000; ++i) {
    LightSample s;
    ASSERT_TRUE(lights->sample({400, 0, 0}, {0, 1, 0}, u(), u.pair(), s));
    near += s.distance < 12;
  }
  EXPECT_GT(near, 700) << "three of a hundred lights";
}

TEST(LightChoice, EqualPlacesDoNotMakeEndlessTrees) {
  std::vector<EmitterBounds> all(5000);
  for (EmitterBounds& b : all) b.strength = 1;
  const LightChoice choice(all);
  EXPECT_NEAR(choice.chance(4321, Vec3(1), Vec3(0)) * 5000.f, 1, 1e-3);
  // Distances that double: median splits take over before a trail is too long.
  for (std::size_t i = 0; i < all.size(); ++i) all[i].center.x = std::exp2(static_cast<float>(i % 120) - 60.f);
  const LightChoice far(all);
  float chance;
  EXPECT_GE(far.sample(Vec3(1), Vec3(0), 0.7f, chance), 0);
}

TEST(Lights, SingleLightCostsNoChoice) {
  const auto lights = Scene().quadric(sphere({0, 0, 5}, 1), Rgb(1)).build();
  LightSample a, b;
  ASSERT_TRUE(lights->sample(Vec3(0), {0, 0, -1}, 0.1f, Vec2(0.3f), a));
  ASSERT_TRUE(lights->sample(Vec3(0), {1, 0, 0}, 0.9f, Vec2(0.3f), b));
  EXPECT_EQ(a.pdf, b.pdf);
  EXPECT_EQ(a.wi, b.wi);
}

TEST(Lights, MixedKindsAgreeOnTheirDensities) {
  Scene scene;
  scene.light("infinite", {}).light("point", {}).quadric(sphere({0, 4, 0}, 1), Rgb(2));
  scene.mesh({{-1, -1, 5}, {-1, 1, 5}, {1, 1, 5}, {1, -1, 5}}, kTwoTriangles, Rgb(4));
  const auto lights = scene.build();
  Uniform u;
  std::set<bool> kinds;
  const Vec3 p(0.2f, 0.3f, 1), n = glm::normalize(Vec3(0, 1, 1));
  for (int i = 0; i < 2000; ++i) {
    LightSample s;
    if (!lights->sample(p, n, u(), u.pair(), s) || s.delta) continue;
    kinds.insert(std::isinf(s.distance));
    float pdf = 0;
    if (std::isinf(s.distance)) {
      lights->escaped(p, n, s.wi, pdf);
    } else if (s.radiance.x == 2) {
      pdf = lights->emitted_pdf(0, p, n, s.wi, s.distance, p + s.wi * s.distance, -s.wi, 0);
    } else {
      pdf = lights->emitted_pdf(1, p, n, s.wi, s.distance, p + s.wi * s.distance, {0, 0, -1}, 1);
    }
    EXPECT_NEAR(pdf / s.pdf, 1, 1e-4);
  }
  EXPECT_EQ(kinds.size(), 2u);
}

}  // namespace
}  // namespace cloudrenderer
