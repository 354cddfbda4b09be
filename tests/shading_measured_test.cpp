// Tables of measured reflectances: their two formats, and what is wrong with a broken file.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "shading/material.h"
#include "shading/measured.h"
#include "shading_measured_support.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

Vec3 polar(double theta, double phi) {
  return {static_cast<float>(std::sin(theta) * std::cos(phi)),
          static_cast<float>(std::sin(theta) * std::sin(phi)), static_cast<float>(std::cos(theta))};
}

template <class F>
std::string error_of(F read) {
  try {
    read();
  } catch (const SceneError& e) {
    return e.what();
  }
  return "no error";
}

class Measured : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::temp_directory_path() / ("shading_measured_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string write(const std::string& name, const std::string& bytes) const {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    return path;
  }
  // A MERL table; value(half, difference, around, channel) by cell.
  template <class F>
  std::string merl(const std::string& name, F value) const {
    std::string bytes(12 + std::size_t{3} * 90 * 90 * 180 * 8, '\0');
    const std::int32_t counts[3]{90, 90, 180};
    std::memcpy(bytes.data(), counts, sizeof counts);
    char* to = bytes.data() + sizeof counts;
    for (int c = 0; c < 3; ++c)
      for (int h = 0; h < 90; ++h)
        for (int d = 0; d < 90; ++d)
          for (int a = 0; a < 180; ++a, to += 8) {
            const double v = value(h, d, a, c);
            std::memcpy(to, &v, 8);
          }
    return write(name, bytes);
  }

  std::filesystem::path folder_;
  FileLocation where_{std::make_shared<std::string>("scene.pbrt"), 7, 3};
};

// Cells that tell their numbers: exact in float.
double numbered(int h, int d, int a, int) { return h * 16384 + d * 182 + a; }

TEST_F(Measured, MerlTablesAreLookedUpByHalfAndDifferenceAngles) {
  const std::string path = merl("numbers.binary", numbered);
  const auto table = read_merl(path, where_);
  EXPECT_EQ(table->bytes(), 90u * 90 * 180 * 12);
  const auto expect_cell = [&](const Vec3& wo, const Vec3& wi, int h, int d, int a) {
    const Rgb v = table->value(wo, wi);
    const double n = numbered(h, d, a, 0);
    EXPECT_NEAR(v.x * 1500, n, 0.5) << h << ' ' << d << ' ' << a;
    EXPECT_NEAR(v.y * 1500, 1.15 * n, 0.5);
    EXPECT_NEAR(v.z * 1500, 1.66 * n, 0.5);
  };
  constexpr double kDegree = 3.14159265358979323846 / 180;
  // Half vector and difference given, the directions made of them by rotation: first about y to
  // the half vector's angle, then about z to its azimuth.
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  int tried = 0;
  while (tried < 500) {
    const double half = 80 * uniform(random) * kDegree, turn = 6.28 * uniform(random);
    const int d = static_cast<int>(88 * uniform(random)),
              a = static_cast<int>(179 * uniform(random));
    const double difference = (d + 0.5) * kDegree, around = (a + 0.5) * kDegree;
    const double root = std::sqrt(half / (90 * kDegree)) * 90;
    const int h = static_cast<int>(root);
    if (root - h < 0.02 || root - h > 0.98) continue;  // float has it in the next cell
    const auto in_world = [&](const glm::dvec3& v) {
      const glm::dvec3 y(v.x * std::cos(half) + v.z * std::sin(half), v.y,
                         v.z * std::cos(half) - v.x * std::sin(half));
      return Vec3(y.x * std::cos(turn) - y.y * std::sin(turn),
                  y.x * std::sin(turn) + y.y * std::cos(turn), y.z);
    };
    const glm::dvec3 light(std::sin(difference) * std::cos(around),
                           std::sin(difference) * std::sin(around), std::cos(difference));
    const Vec3 wi = in_world(light), wo = in_world({-light.x, -light.y, light.z});
    if (wi.z < 0.01f || wo.z < 0.01f) continue;
    ++tried;
    expect_cell(wo, wi, h, d, a);
    expect_cell(wi, wo, h, d, a);    // symmetric
    expect_cell(-wo, -wi, h, d, a);  // the same from below
    if (HasFailure()) return;
  }
  EXPECT_TRUE(is_finite(table->value({0, 0, 1}, {0, 0, -1})));
  EXPECT_NEAR(table->value({0, 0, 1}, {0, 0, 1}).x, 0.f, 0.2f);  // row 0, column 0
}

TEST_F(Measured, MerlTablesHaveNoNegativeValuesAndOneSize) {
  const std::string path = merl("minus.binary", [](int, int, int, int) { return -1.0; });
  EXPECT_EQ(read_merl(path, where_)->value(polar(0.3, 1), polar(0.8, 2)), Rgb(0.f));
  std::filesystem::resize_file(path, 34992011);
  EXPECT_EQ(error_of([&] { (void)read_merl(path, where_); }),
            "scene.pbrt:7:3: error: measured reflectance '" + path +
                "': expected 34992012 bytes, found 34992011");
  std::filesystem::resize_file(path, 7);
  EXPECT_NE(error_of([&] { (void)read_merl(path, where_); }).find("90 x 90 x 180"),
            std::string::npos);
  const std::string nan =
      merl("nan.binary", [](int h, int, int, int) { return h == 50 ? NAN : 0.; });
  EXPECT_NE(error_of([&] { (void)read_merl(nan, where_); }).find("no number"), std::string::npos);
  EXPECT_NE(error_of([&] { (void)read_merl("/nowhere/x.binary", where_); }).find("7:3: error"),
            std::string::npos);
}

TEST_F(Measured, IrregularOnesAreWeightedMeansOfTheirNeighbours) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  struct Place {
    glm::dvec3 at;
    double value;
  };
  const auto place = [](double ti, double pi, double to, double po) {
    double turn = std::fabs(std::fmod(pi - po, 2 * M_PI));
    if (turn > M_PI) turn = 2 * M_PI - turn;
    return glm::dvec3(std::sin(ti) * std::sin(to), turn / M_PI, std::cos(ti) * std::cos(to));
  };
  std::vector<Place> places;
  std::string text = "# two wavelengths of a flat spectrum\n2\n400 700\n";
  for (int i = 0; i < 300; ++i) {
    const double ti = 1.5 * uniform(random), to = 1.5 * uniform(random);
    const double pi = 6.2 * uniform(random), po = 6.2 * uniform(random), v = uniform(random);
    places.push_back({place(ti, pi, to, po), v});
    std::ostringstream line;
    line.precision(12);
    line << ti << ' ' << pi << ' ' << to << ' ' << po << ' ' << v << ' ' << v << '\n';
    text += line.str();
  }
  const auto table = read_irregular_brdf(write("random.brdf", text), Dialect::v2, where_);
  int near = 0;
  for (int i = 0; i < 300; ++i) {
    const double ti = 1.5 * uniform(random), to = 1.5 * uniform(random);
    const double pi = 6.2 * uniform(random), po = 6.2 * uniform(random);
    const glm::dvec3 at = place(ti, pi, to, po);
    double sum = 0, weights = 0;
    for (double radius2 = 0.001;; radius2 *= 2) {
      int count = 0;
      sum = weights = 0;
      for (const Place& p : places) {
        const double d2 = glm::dot(p.at - at, p.at - at);
        if (std::fabs(d2 - radius2) < 1e-6) ++near;  // may be found or not
        if (d2 >= radius2) continue;
        sum += std::exp(-100 * d2) * p.value;
        weights += std::exp(-100 * d2);
        ++count;
      }
      if (count > 2 || radius2 > 1.5) break;
    }
    const Vec3 wi = polar(ti, pi), wo = polar(to, po);
    // a flat spectrum of 1 is nearly white in RGB: green is within 1 %
    const Rgb white = table->value(wo, wi) / static_cast<float>(sum / weights);
    EXPECT_NEAR(white.y, 0.949f, 0.01f);
    EXPECT_EQ(table->value(wo, wi), table->value(wi, wo));
  }
  EXPECT_LT(near, 10);
}

TEST_F(Measured, BrokenFilesSayWhere) {
  const auto of = [&](const std::string& text) {
    const std::string path = write("broken.brdf", text);
    const std::string what =
        error_of([&] { (void)read_irregular_brdf(path, Dialect::v2, where_); });
    return what.starts_with(path) ? what.substr(path.size()) : what;
  };
  EXPECT_EQ(of("2 400 700 0 0 0"), ":1:16: error: expected an angle, found the end of the file");
  EXPECT_EQ(of("2\n400 700\n0 0 0 0 1 word"), ":3:11: error: expected a value, found 'word'");
  EXPECT_NE(of("0").find("number of wavelengths"), std::string::npos);
  EXPECT_NE(of("1.5").find("number of wavelengths"), std::string::npos);
  EXPECT_NE(of("1 500").find("expected measurements"), std::string::npos);
  EXPECT_NE(of("1 500 0 0 0 0 1e40").find("too large"), std::string::npos);
  EXPECT_NE(error_of([&] {
              (void)read_irregular_brdf("/nowhere/x.brdf", Dialect::v2, where_);
            }).find("scene.pbrt:7:3: error"),
            std::string::npos);
  const auto build = [&](std::initializer_list<Param> params) {
    SceneDescription scene;
    scene.materials = {material("measured", params)};
    scene.materials[0].location = where_;
    Warnings warnings;
    return error_of([&] { (void)Shading::build(scene, {}, warnings); });
  };
  EXPECT_NE(build({}).find("filename"), std::string::npos);
  EXPECT_NE(build({string_param("filename", "/nowhere/x.merl")}).find("/nowhere/x.merl"),
            std::string::npos);
}

TEST_F(Measured, AFileIsReadOnceAndCounts) {
  const std::string path =
      write("one.brdf", "1 550  0.5 0 0.5 3.14 0.3  0.5 0 0.4 3 0.3  1 0 1 3 0.3");
  SceneDescription scene;
  for (const float bump : {0.f, 1.f})
    scene.materials.push_back(
        material("measured", {string_param("filename", path), real_param("bumpmap", bump)}));
  Warnings warnings;
  const auto shading = Shading::build(scene, {}, warnings);
  EXPECT_TRUE(warnings.list().empty());
  SurfacePoint p;
  p.ng = p.ns = {0, 0, 1};
  const Vec3 wo = polar(0.5, 1);
  const Bsdf a = shading->bsdf(0, p, wo, {}), b = shading->bsdf(1, p, wo, {});
  ASSERT_EQ(a.lobe_count(), 1);
  EXPECT_EQ(a.lobe(0).table, b.lobe(0).table);
  EXPECT_EQ(shading->bytes(), a.lobe(0).table->bytes());
  EXPECT_GT(a.eval(wo, polar(0.7, 4)).y, 0.1f);
  EXPECT_EQ(shading->kind(0), 0u);  // not eight at once
}

TEST(MeasuredSampling, GlossIsFoundByItsHalfVectors) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0.f, 1.f);
  const MeasuredReflectance shiny = formula(0.1f, 0.5f, 500.f);
  for (const double theta : {0.2, 0.8, 1.3}) {
    const Vec3 wo = polar(theta, 0.5);
    // second moments of the estimate, by the table and by the cosine alone
    double table = 0.0, cosine = 0.0, mean = 0.0;
    constexpr int kSamples = 20000;
    for (int i = 0; i < kSamples; ++i) {
      const Vec2 u(uniform(random), uniform(random));
      Vec3 wi;
      if (shiny.sample(wo, uniform(random), u, wi)) {
        const double w = shiny.value(wo, wi).x * wi.z / shiny.pdf(wo, wi);
        table += w * w;
        mean += w;
      }
      const Vec3 c = sample_cosine_hemisphere(u);
      const double w = static_cast<double>(shiny.value(wo, c).x * kPi);
      cosine += w * w;
    }
    EXPECT_LT(table, 0.2 * cosine) << theta;
    EXPECT_NEAR(shiny.albedo(wo.z), mean / kSamples, 0.1 * mean / kSamples) << theta;
  }
}

}  // namespace
}  // namespace cloudrenderer
