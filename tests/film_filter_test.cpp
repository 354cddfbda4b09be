#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "film/camera.h"
#include "film_support.h"

namespace cloudrenderer {
namespace {

using test::entity;
using test::reals;

struct Axis {
  const char* type;
  float width;
  std::function<double(double)> f;  // along one axis; the filter is the product
};

double sinc(double x) {
  return x == 0 ? 1 : std::sin(3.14159265358979 * x) / (3.14159265358979 * x);
}

const std::vector<Axis>& axes() {
  static const std::vector<Axis> all = {
      {"box", 0.5f, [](double) { return 1.0; }},
      {"triangle", 2, [](double x) { return 2 - std::fabs(x); }},
      {"gaussian", 2, [](double x) { return std::exp(-2 * x * x) - std::exp(-8.0); }},
      {"mitchell", 2,
       [](double x) {  // B = C = 1/3
         x = std::fabs(x);
         return x < 1 ? (7 * x * x * x - 12 * x * x + 16. / 3) / 6
                      : (-7. / 3 * x * x * x + 12 * x * x - 20 * x + 32. / 3) / 6;
       }},
      {"sinc", 4, [](double x) { return sinc(0.75 * x) * sinc(x / 4); }}};
  return all;
}

// With which the sample counts if all count alike: +-1 over the mean of the signs.
double signed_weight(const Filter& filter, const Vec2& u) {
  const FilterLobes l = filter.lobes();
  return (l.above + l.below) * (filter.negative(u) ? -1 : 1);
}

// A regular grid of the unit square: what a filter integrates to, to the accuracy of its tables.
template <class F>
double mean(const Filter& filter, int n, F&& f) {
  double sum = 0;
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const Vec2 u((static_cast<float>(x) + 0.5f) / static_cast<float>(n), (static_cast<float>(y) + 0.5f) / static_cast<float>(n));
      sum += signed_weight(filter, u) * f(filter.sample(u));
    }
  return sum / (static_cast<double>(n) * n);
}

double integral(const std::function<double(double)>& f, double w) {
  constexpr int kSteps = 20000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) sum += f(w * (2 * (i + 0.5) / kSteps - 1));
  return sum * 2 * w / kSteps;
}

TEST(Filter, SamplesIntegrateAsTheFilterDoes) {
  for (const Axis& axis : axes()) {
    SCOPED_TRACE(axis.type);
    Warnings warnings;
    const auto filter = Filter::build(entity(axis.type, {}), warnings);
    EXPECT_TRUE(warnings.list().empty());
    const double w = static_cast<double>(axis.width), norm = integral(axis.f, w);
    EXPECT_NEAR(mean(*filter, 400, [](const Vec2&) { return 1.0; }), 1, 0.02);
    const auto g = [](double x) { return std::cos(1.3 * x) + 0.3 * x; };
    const double one = integral([&](double x) { return axis.f(x) * g(x); }, w) / norm;
    const double both = mean(*filter, 400, [&](const Vec2& p) {
      return g(static_cast<double>(p.x)) * g(static_cast<double>(p.y) + 0.0);
    });
    EXPECT_NEAR(both, one * one, 0.01);
  }
}

TEST(Filter, StaysInsideItsWidth) {
  for (const Axis& axis : axes()) {
    Warnings warnings;
    const auto filter =
        Filter::build(entity(axis.type, {reals("xwidth", {1.5f}), reals("ywidth", {3})}), warnings);
    Vec2 low(0), high(0);
    for (int i = 0; i <= 100; ++i) {
      const float u = std::min(static_cast<float>(i) / 100.f, 0.99999994f);
      const Vec2 p = filter->sample({u, u});
      low = glm::min(low, p);
      high = glm::max(high, p);
    }
    EXPECT_GE(low.x, -1.5f) << axis.type;
    EXPECT_LE(high.x, 1.5f) << axis.type;
    EXPECT_GE(low.y, -3.f) << axis.type;
    EXPECT_LE(high.y, 3.f) << axis.type;
    EXPECT_GT(high.y, 2.f) << axis.type;
  }
}

TEST(Filter, KnowsItsNegativeLobes) {
  constexpr int kSide = 997;
  for (const Axis& axis : axes()) {
    SCOPED_TRACE(axis.type);
    Warnings warnings;
    const auto filter = Filter::build(entity(axis.type, {}), warnings);
    const FilterLobes lobes = filter->lobes();
    EXPECT_NEAR(lobes.above - lobes.below, 1, 1e-12);
    const bool some = axis.type == std::string("mitchell") || axis.type == std::string("sinc");
    EXPECT_EQ(lobes.sums_per_pixel(), some ? 2u : 1u);
    int below = 0;
    for (int i = 0; i < kSide * kSide; ++i) {
      const Vec2 u((static_cast<float>(i % kSide) + 0.5f) / kSide, (static_cast<float>(i / kSide) + 0.5f) / kSide);
      const Vec2 p = filter->sample(u);
      const double f = axis.f(static_cast<double>(p.x)) * axis.f(static_cast<double>(p.y));
      if (std::fabs(f) > 1e-3) {
        EXPECT_EQ(filter->negative(u), f < 0) << p.x << ' ' << p.y;
      }
      below += filter->negative(u);
    }
    EXPECT_NEAR(below / static_cast<double>(kSide * kSide), lobes.below / (lobes.above + lobes.below), 2e-3);
  }
}

TEST(Filter, WarnsAboutUnknownKinds) {
  Warnings warnings;
  EXPECT_TRUE(Filter::build(entity("catmull", {}), warnings));
  EXPECT_EQ(warnings.list().size(), 1u);
  EXPECT_THROW(Filter::build(entity("box", {reals("xwidth", {0})}), warnings), SceneError);
  // b and c far from what Mitchell and Netravali mean: nearly as much below zero as above.
  EXPECT_THROW(Filter::build(entity("mitchell", {reals("B", {1e6f}), reals("C", {-1e6f})}), warnings), SceneError);
}

}  // namespace
}  // namespace cloudrenderer
