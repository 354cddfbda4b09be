// Measured reflectances of the RGL's format, fitted to formulas: the warp, the value, symmetries.
#include <gtest/gtest.h>

#include <random>

#include "scene/spectrum.h"
#include "shading_rgl_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

struct Uniform {
  std::mt19937 engine{11};
  float operator()() { return static_cast<float>(engine() >> 8) * 0x1p-24f; }
};

Vec3 direction(float z, float phi) {
  const float r = std::sqrt(1.f - z * z);
  return {r * std::cos(phi), r * std::sin(phi), z};
}

TEST(Warp2D, FollowsASlopeInEachDirection) {
  // p(x, y) = (1 + 2 y) / 2 and (1 + 2 x) / 2 by a single cell
  const Warp2D up(2, 2, {1, 1, 3, 3}), right(2, 2, {1, 3, 1, 3});
  for (const float u : {0.f, 0.1f, 0.5f, 0.9f}) {
    const float root = 0.5f * (std::sqrt(1.f + 8.f * u) - 1.f);  // of (x + x^2) / 2 = u
    float pdf;
    const Vec2 a = up.sample({0.3f, u}, {}, pdf);
    EXPECT_NEAR(a.x, 0.3f, 1e-6f);
    EXPECT_NEAR(a.y, root, 1e-6f);
    EXPECT_NEAR(pdf, 0.5f + root, 1e-6f);
    const Vec2 b = right.sample({u, 0.3f}, {}, pdf);
    EXPECT_NEAR(b.x, root, 1e-6f);
    EXPECT_NEAR(b.y, 0.3f, 1e-6f);
  }
}

TEST(Warp2D, ChoosesTheRowFirst) {
  // p = x y, not even: rows by y^2, then within a row by x^2
  const Warp2D corner(2, 2, {0, 0, 0, 1});
  float pdf;
  const Vec2 p = corner.sample({0.49f, 0.25f}, {}, pdf);
  EXPECT_NEAR(p.y, 0.5f, 1e-6f);
  EXPECT_NEAR(p.x, 0.7f, 1e-6f);
  // p = (1 - x) (1 - y) + x y: the row at y has the slope 2 y - 1, and all rows the same sum
  const Warp2D saddle(2, 2, {1, 0, 0, 1});
  const Vec2 q = saddle.sample({0.25f, 0.9f}, {}, pdf);
  EXPECT_NEAR(q.y, 0.9f, 1e-6f);
  EXPECT_NEAR(q.x, (-0.2f + std::sqrt(0.04f + 4 * 0.8f * 0.25f)) / 1.6f, 1e-6f);  // x (0.2 + 0.8 x) = u
}

TEST(Warp2D, InverseAndDensityAgreeWithSamplesBetweenSlices) {
  constexpr std::size_t kColumns = 7, kRows = 5;
  Uniform u;
  std::vector<float> values(4 * kColumns * kRows);
  for (float& v : values) v = u() < 0.2f ? 0.f : u();
  const Warp2D warp(kColumns, kRows, values);
  const SliceNodes nodes({0.f, 2.f}, {1.f, 2.f});
  ASSERT_EQ(nodes.slices(), 4u);
  for (int i = 0; i < 2000; ++i) {
    const SliceMix mix = nodes.at(3.f * u() - 0.5f, 0.5f + 2.f * u());
    const Vec2 from(u(), u());
    float forward, back;
    const Vec2 p = warp.sample(from, mix, forward), again = warp.invert(p, mix, back);
    if (forward < 0.05f) continue;  // where there is nearly nothing, places are close
    EXPECT_NEAR(again.x, from.x, 2e-5f);
    EXPECT_NEAR(again.y, from.y, 2e-5f);
    EXPECT_NEAR(back, forward, 1e-4f * forward);
    EXPECT_NEAR(warp.pdf(p, mix), forward, 1e-4f * forward);
  }
  double sum = 0;
  constexpr int kSteps = 420;  // a multiple of the cells
  const SliceMix mix = nodes.at(0.7f, 1.2f);
  for (int i = 0; i < kSteps * kSteps; ++i)
    sum += static_cast<double>(warp.pdf(
        {(static_cast<float>(i % kSteps) + 0.5f) / kSteps, (static_cast<float>(i / kSteps) + 0.5f) / kSteps}, mix));
  EXPECT_NEAR(sum / (kSteps * kSteps), 1, 1e-4);
}

TEST(Warp2D, MixesSlicesByTheirShares) {
  const SliceNodes nodes({0.f, 1.f, 4.f}, {0.f, 2.f});
  const SliceMix mix = nodes.at(2.5f, 0.5f);
  ASSERT_EQ(mix.count, 4u);
  EXPECT_EQ(mix.slice, (std::array<std::size_t, 4>{2, 3, 4, 5}));
  EXPECT_EQ(mix.share, (std::array<float, 4>{0.375f, 0.125f, 0.375f, 0.125f}));
  EXPECT_EQ(nodes.at(-1.f, 9.f).slice[0], 1u);
  EXPECT_EQ(nodes.at(-1.f, 9.f).count, 1u);
  EXPECT_EQ(nodes.at(4.f, 2.f).slice[0], 5u);
}

TEST(Warp2D, OfNothingIsEven) {
  const Warp2D none(2, 3, {0, 0, 0, -1, 0, 0});
  float pdf;
  const Vec2 p = none.sample({0.2f, 0.7f}, {}, pdf);
  EXPECT_NEAR(p.x, 0.2f, 1e-6f);
  EXPECT_NEAR(p.y, 0.7f, 1e-6f);
  EXPECT_NEAR(pdf, 1.f, 1e-6f);
}

struct Errors {  // relative, of half, nine in ten and 99 of 100 of the directions
  double half, most, nearly_all;
};

// Pairs near the mirror's direction and anywhere, of viewers at angles that the file has or at any between them.
Errors errors(const RglFormula& formula, const RglTable& table, bool at_nodes) {
  std::vector<Rgb> basis;
  for (std::size_t k = 0; k < formula.wavelengths.size(); ++k) {
    SampledSpectrum one{{formula.wavelengths.begin(), formula.wavelengths.end()},
                        std::vector<double>(formula.wavelengths.size())};
    one.values[k] = 1;
    basis.push_back(reflectance_to_rgb(one));
  }
  Uniform u;
  std::vector<double> all;
  while (all.size() < 4000) {
    Vec3 wo = direction(0.2f + 0.8f * u(), 2 * kPi * u());
    if (at_nodes) {
      const int i = static_cast<int>(u() * static_cast<float>(formula.thetas)),
                j = static_cast<int>(u() * static_cast<float>(formula.phis));
      wo = Vec3(RglFormula::polar(formula.theta(i), formula.phi(j)));
    }
    Vec3 wi = direction(u(), 2 * kPi * u());
    if (u() < 0.5f) {
      const Vec3 m = glm::normalize(Vec3(0.3f * (u() - 0.5f), 0.3f * (u() - 0.5f), 1.f));
      wi = 2.f * glm::dot(wo, m) * m - wo;
    }
    if (wo.z < 0.2f || wi.z < 0.2f) continue;  // S ends at the horizon, within one of its few cells
    const auto exact = [&](double r) { return formula.value(glm::dvec3(wo), glm::dvec3(wi), r); };
    glm::dvec3 expected(0);
    if (formula.rgb)
      expected = {exact(0.9), exact(0.6), exact(0.3)};
    else
      for (std::size_t k = 0; k < basis.size(); ++k)
        expected += exact(RglFormula::reflectance(static_cast<double>(formula.wavelengths[k]))) * glm::dvec3(basis[k]);
    const Rgb found = table.value(wo, wi);
    double worst = 0;
    for (int c = 0; c < 3; ++c)
      worst = std::max(worst, std::fabs(static_cast<double>(found[c]) - expected[c]) / expected[c]);
    all.push_back(worst);
  }
  std::sort(all.begin(), all.end());
  return {all[2000], all[3600], all[3960]};
}

TEST(Rgl, HasTheValuesOfTheFormulaThatItWasFittedTo) {
  struct Fit {
    const char* name;
    RglFormula formula;
    Errors at_nodes, between;
  };
  const Fit fits[]{
      {"metal", {.thetas = 16, .fine = 128, .coarse = 32}, {3e-4, 0.01, 0.1}, {3e-3, 0.03, 0.1}},
      {"metal in rgb", {.thetas = 16, .fine = 128, .coarse = 32, .rgb = true}, {3e-4, 0.01, 0.1}, {3e-3, 0.03, 0.1}},
      {"lacquer",
       {.alpha_x = 0.2, .alpha_y = 0.2, .diffuse = 0.4, .thetas = 16, .fine = 128, .coarse = 32},
       {5e-4, 0.05, 0.4},
       {6e-3, 0.07, 0.4}},
      {"without normals",
       {.alpha_x = 0.4, .alpha_y = 0.4, .thetas = 16, .phis = 2, .fine = 128, .coarse = 32, .jacobian = false},
       {6e-4, 0.005, 0.03},
       {0.01, 0.05, 0.1}},
      {"brushed metal",
       {.alpha_x = 0.2, .alpha_y = 0.5, .thetas = 16, .phis = 33, .fine = 96, .coarse = 32},
       {8e-4, 0.03, 0.2},
       {6e-3, 0.06, 0.35}},
      {"half a circle",
       {.alpha_x = 0.2, .alpha_y = 0.5, .thetas = 16, .phis = 17, .folds = 2, .fine = 96, .coarse = 32},
       {8e-4, 0.03, 0.2},
       {6e-3, 0.06, 0.35}},
      {"a quarter",
       {.alpha_x = 0.2, .alpha_y = 0.5, .thetas = 16, .phis = 9, .folds = 4, .fine = 96, .coarse = 32},
       {8e-4, 0.03, 0.2},
       {6e-3, 0.06, 0.35}},
  };
  for (const Fit& fit : fits) {
    const auto table = rgl_table(fit.formula);
    for (const bool at_nodes : {true, false}) {
      const Errors e = errors(fit.formula, *table, at_nodes), &most = at_nodes ? fit.at_nodes : fit.between;
      EXPECT_LT(e.half, most.half) << fit.name << (at_nodes ? " at the angles of the file" : "");
      EXPECT_LT(e.most, most.most) << fit.name << (at_nodes ? " at the angles of the file" : "");
      EXPECT_LT(e.nearly_all, most.nearly_all) << fit.name << (at_nodes ? " at the angles of the file" : "");
    }
  }
}

TEST(Rgl, FinerTablesAreNearerToTheFormula) {
  const auto at = [](const RglFormula& formula) { return errors(formula, *rgl_table(formula), false); };
  const Errors rough = at({.thetas = 8, .fine = 64, .coarse = 16}),
               fine = at({.thetas = 24, .fine = 192, .coarse = 48});
  EXPECT_LT(fine.half, 0.3 * rough.half);
  EXPECT_LT(fine.most, 0.3 * rough.most);
}

TEST(Rgl, IsotropicTablesDoNotSeeTheAzimuth) {
  const auto table = rgl_table({});
  EXPECT_TRUE(table->isotropic());
  const Rgb f = table->value(direction(0.6f, 0.3f), direction(0.7f, 2.9f));
  for (const float turn : {1.f, 2.5f, 4.f, 6.f}) {
    const Rgb g = table->value(direction(0.6f, 0.3f + turn), direction(0.7f, 2.9f + turn));
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(f[c], g[c], 1e-4f * f[c]);
  }
}

// Where coordinates are 0 of either sign, the part of the circle that is in the file has to be met all the same.
TEST(Rgl, PartsOfTheCircleStandForAllOfItOnTheAxesToo) {
  const Vec3 wi = direction(0.7f, 2.2f);
  for (const int folds : {1, 2, 4}) {
    const RglFormula formula{
        .alpha_x = 0.15, .alpha_y = 0.4, .phis = 16 / folds + 1, .folds = folds, .fine = 96, .rgb = true};
    const auto table = rgl_table(formula);
    EXPECT_FALSE(table->isotropic());
    for (const Vec3& wo :
         {Vec3(0.6f, 0.f, 0.8f), Vec3(0.6f, -0.f, 0.8f), Vec3(-0.6f, 0.f, 0.8f), Vec3(-0.6f, -0.f, 0.8f),
          Vec3(0.f, 0.6f, 0.8f), Vec3(-0.f, 0.6f, 0.8f), Vec3(0.f, -0.6f, 0.8f), Vec3(-0.f, -0.6f, 0.8f)}) {
      const double expected = formula.value(glm::dvec3(wo), glm::dvec3(wi), 0.6);  // green
      EXPECT_NEAR(static_cast<double>(table->value(wo, wi).y), expected, 0.1 * expected)
          << folds << " " << wo.x << " " << wo.y;
    }
  }
}

TEST(Rgl, LooksTheSameFromBelowAndLetsNothingThrough) {
  const auto table = rgl_table({.alpha_x = 0.1, .alpha_y = 0.4, .phis = 9, .folds = 2});
  const Vec3 wo = direction(0.6f, 0.3f), wi = direction(0.7f, 2.9f);
  EXPECT_EQ(table->value(wo, wi), table->value(-wo, -wi));
  EXPECT_EQ(table->pdf(wo, wi), table->pdf(-wo, -wi));
  EXPECT_GT(table->pdf(wo, wi), 0.f);
  EXPECT_EQ(table->value(wo, -wi), Rgb(0.f));
  EXPECT_EQ(table->pdf(wo, -wi), 0.f);
  Vec3 above, below;
  ASSERT_TRUE(table->sample(wo, 0.f, {0.4f, 0.6f}, above) && table->sample(-wo, 0.f, {0.4f, 0.6f}, below));
  EXPECT_EQ(above, -below);
}

TEST(Rgl, SamplesWeighNearlyTheSame) {
  const auto table = rgl_table({.fine = 128, .coarse = 32});
  Uniform u;
  for (const float z : {0.95f, 0.6f, 0.3f}) {
    const Vec3 wo = direction(z, 1.f);
    double sum = 0, squares = 0;
    int count = 0;
    for (int i = 0; i < 4000; ++i) {
      Vec3 wi;
      if (!table->sample(wo, 0.f, {u(), u()}, wi)) continue;
      const auto weight = static_cast<double>(luminance(table->value(wo, wi)) * wi.z / table->pdf(wo, wi));
      sum += weight;
      squares += weight * weight;
      ++count;
    }
    const double mean = sum / count;
    EXPECT_GT(count, 3900);
    EXPECT_LT(std::sqrt(squares / count - mean * mean), 0.15 * mean) << z;
    EXPECT_NEAR(static_cast<double>(table->albedo(z)), mean, 0.05 * mean) << z;
  }
}

}  // namespace
}  // namespace cloudrenderer
