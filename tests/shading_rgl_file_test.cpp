// The RGL's files: what is broken, and who holds the tables.
#include <gtest/gtest.h>

#include <random>

#include "base/log.h"
#include "shading/material.h"
#include "shading_rgl_support.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

const RglFormula kSmall{.thetas = 3, .fine = 4, .coarse = 3, .wavelengths = {400, 700}};

std::string read_error(const std::string& bytes) {
  const RglFile file(bytes);
  try {
    RglTable::read(file.path(), {std::make_shared<const std::string>("scene.pbrt"), 7, 3});
  } catch (const SceneError& e) {
    return e.what();
  }
  return "";
}

// Where the description of a field begins, behind its name.
std::size_t behind(const std::string& bytes, const std::string& name) {
  const std::string key = std::string(1, static_cast<char>(name.size())) + '\0' + name;
  return bytes.find(key) + key.size();
}

TEST(RglFile, BrokenFilesSayWhy) {
  const std::string good = kSmall.bytes();
  ASSERT_EQ(read_error(good), "");
  const auto expect = [](const std::string& bytes, const std::string& part) {
    const std::string said = read_error(bytes);
    EXPECT_NE(said.find(part), std::string::npos) << part << ": " << said;
    EXPECT_EQ(said.rfind("scene.pbrt:7:3: error: measured reflectance '", 0), 0u) << said;
  };
  const auto with = [&](std::size_t at, auto value) {
    std::string s = good;
    std::memcpy(s.data() + at, &value, sizeof value);
    return s;
  };
  const auto renamed = [&](const std::string& name) {
    std::string s = good;
    s[behind(s, name) - 1] = '_';
    return s;
  };
  const auto data_of = [&](const std::string& name) {
    std::uint64_t offset;
    std::memcpy(&offset, good.data() + behind(good, name) + 3, sizeof offset);
    return static_cast<std::size_t>(offset);
  };
  const auto nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  expect("", "begins with tensor_file");
  expect("x" + good, "begins with tensor_file");
  expect(with(12, '\2'), "expected version 1.0, found 2.0");
  expect(with(14, 0xffffffffu), "more than 256 fields");
  expect(good.substr(0, 40), "is cut off");
  expect(good.substr(0, good.size() - 1), "outside of the file");
  for (const char* name : {"phi_i", "theta_i", "sigma", "ndf", "vndf", "luminance", "jacobian", "wavelengths"})
    expect(renamed(name), std::string("has no field ") + name);
  expect(renamed("spectra"), "has no field rgb");
  const std::size_t ndf = behind(good, "ndf"), vndf = behind(good, "vndf");
  expect(with(ndf, std::uint16_t{1000}), "more than 8 dimensions");
  expect(with(ndf + 2, std::uint8_t{0}), "unknown type");
  expect(with(ndf + 2, std::uint8_t{12}), "unknown type");
  expect(with(ndf + 2, std::uint8_t{5}), "ndf has another type");
  expect(with(ndf + 3, std::uint64_t{1} << 60), "outside of the file");
  expect(with(ndf + 11, std::uint64_t{1} << 33), "outside of the file");
  expect(with(ndf + 11, ~std::uint64_t{0}), "outside of the file");
  expect(with(ndf + 11, std::uint64_t{0}), "ndf has another shape");
  expect(with(ndf + 11, std::uint64_t{1}), "ndf needs two rows");
  expect(with(vndf + 11 + 8, std::uint64_t{2}), "vndf has another shape");
  expect(with(behind(good, "spectra") + 11 + 16, std::uint64_t{1}), "spectra has another shape");
  expect(with(data_of("theta_i") + 4, 0.f), "theta_i that rise");
  expect(with(data_of("theta_i") + 8, 2.f), "theta_i that rise");
  expect(with(data_of("phi_i"), 100.f), "phi_i that rise");
  expect(with(data_of("wavelengths"), 800.f), "wavelengths that rise");
  expect(with(data_of("wavelengths"), nan), "wavelengths is no number");
  for (const char* name : {"ndf", "sigma", "vndf", "luminance", "spectra"}) {
    expect(with(data_of(name) + 8, nan), "a value of " + std::string(name) + " is no number");
    expect(with(data_of(name) + 8, -infinity), "a value of " + std::string(name) + " is no number");
  }
  RglFormula third{.thetas = 2, .phis = 4, .folds = 3, .fine = 4, .coarse = 3};
  expect(third.bytes(), "a half or a quarter");
}

TEST(RglFile, ThatIsCutOffAnywhereIsRefused) {
  const std::string good = kSmall.bytes();
  for (std::size_t length = 0; length < good.size(); length += 7)
    EXPECT_NE(read_error(good.substr(0, length)), "") << length;
}

// Whatever is in the numbers: a table that can be used, or an error.
TEST(RglFile, AnyMutationIsReadOrRefused) {
  const std::string good = kSmall.bytes();
  const std::size_t head = good.find("a formula");
  std::mt19937 random(3);
  int read = 0;
  for (int round = 0; round < 2000; ++round) {
    std::string bytes = good;
    const auto edits = random() % 4 + 1;
    for (unsigned i = 0; i < edits; ++i) {
      const std::size_t at = random() % (random() % 2 == 0 ? head : bytes.size());
      bytes[at] =
          static_cast<char>(random() % 3 == 0 ? random() : static_cast<unsigned char>(bytes[at]) ^ 1u << random() % 8);
    }
    const RglFile file(bytes);
    std::unique_ptr<RglTable> table;
    try {
      table = RglTable::read(file.path(), {});
    } catch (const SceneError&) {
      continue;
    }
    ++read;
    EXPECT_LT(table->bytes(), 20 * bytes.size());
    for (const Vec3& wo : {Vec3(0, 0, 1), Vec3(0.48f, 0.64f, 0.6f), Vec3(-0.6f, 0, -0.8f), Vec3(1, 0, 0)})
      for (const float u : {0.f, 0.3f, 0x1.fffffep-1f}) {
        Vec3 wi;
        if (!table->sample(wo, u, {u, 1.f - u}, wi)) continue;
        const Rgb f = table->value(wo, wi);
        ASSERT_TRUE(is_finite(wi) && is_finite(f) && f.x >= 0 && f.y >= 0 && f.z >= 0) << round;
        const float density = table->pdf(wo, wi);
        ASSERT_TRUE(std::isfinite(density) && density >= 0) << round;
      }
  }
  EXPECT_GT(read, 200);
  EXPECT_LT(read, 1800);
}

TEST(RglFile, IsReadOnceAndCounted) {
  const RglFile file(kSmall.bytes());
  SceneDescription scene;
  scene.dialect = Dialect::v3;
  scene.materials = {material("measured", {string_param("bsdffile", file.path())}),
                     material("measured", {string_param("bsdffile", file.path())})};
  Warnings warnings;
  const auto shading = Shading::build(scene, {}, warnings);
  EXPECT_TRUE(warnings.list().empty());
  EXPECT_EQ(shading->bytes(), rgl_table(kSmall)->bytes());
  SurfacePoint p;
  p.ng = p.ns = {0, 0, 1};
  EXPECT_TRUE(shading->bsdf(1, p, {0, 0, 1}, {}).has_smooth());
  scene.materials = {material("measured", {string_param("bsdffile", "/no/such.bsdf")})};
  EXPECT_THROW(Shading::build(scene, {}, warnings), SceneError);
}

TEST(RglFile, AnisotropyFollowsTheTangent) {
  const RglFile file(
      RglFormula{.alpha_x = 0.1, .alpha_y = 0.5, .thetas = 4, .phis = 9, .folds = 2, .fine = 32, .coarse = 12}.bytes());
  SceneDescription scene;
  scene.dialect = Dialect::v3;
  scene.materials = {material("measured", {string_param("bsdffile", file.path())})};
  Warnings warnings;
  const auto shading = Shading::build(scene, {}, warnings);
  const Vec3 wo = glm::normalize(Vec3(0.3f, 0.f, 1.f)), along = glm::normalize(Vec3(-0.3f, 0.7f, 1.f));
  const auto seen = [&](const Vec3& tangent) {
    SurfacePoint p;
    p.ng = p.ns = {0, 0, 1};
    p.shading_dpdu = tangent;
    return shading->bsdf(0, p, wo, {}).eval(wo, along).y;
  };
  EXPECT_GT(seen({1, 0, 0}), 3 * seen({0, 1, 0}));
  EXPECT_NEAR(seen({2, 0, 0}), seen({1, 0, 0}), 1e-6f);
}

}  // namespace
}  // namespace cloudrenderer
