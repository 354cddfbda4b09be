#include <gtest/gtest.h>

#include <array>
#include <random>
#include <vector>

#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

// Distance in units in the last place of the float nearest to the exact value.
double ulps(float got, double exact) {
  const float near = static_cast<float>(exact);
  const double ulp = static_cast<double>(std::nextafter(std::fabs(near), kInfinity) - std::fabs(near));
  return std::fabs(static_cast<double>(got) - exact) / std::max(ulp, 1e-45);
}

template <class F, class G>
double worst(F ours, G exact, double lo, double hi) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> dist(lo, hi);
  double w = 0;
  for (int i = 0; i < 200000; ++i) {
    const auto x = static_cast<float>(dist(rng));
    w = std::max(w, ulps(ours(x), exact(static_cast<double>(x))));
  }
  return w;
}

TEST(PortableMath, ElementaryFunctionsAreWithinOneUlpAndAHalf) {
  using D = double;
  EXPECT_LT(worst([](float x) { return portable::exp(x); }, [](D x) { return std::exp(x); }, -80, 80), 1.5);
  EXPECT_LT(worst([](float x) { return portable::log(x); }, [](D x) { return std::log(x); }, 1e-6, 1e6), 1.5);
  EXPECT_LT(worst([](float x) { return portable::atan2(x, 0.7f); }, [](D x) { return std::atan2(x, D{0.7f}); }, -9, 9), 1.5);
  EXPECT_LT(worst([](float x) { return portable::acos(x); }, [](D x) { return std::acos(x); }, -1, 1), 1.5);
  EXPECT_LT(worst([](float x) { return portable::asin(x); }, [](D x) { return std::asin(x); }, -1, 1), 1.5);
  EXPECT_LT(worst([](float x) { return portable::pow(x, 7.3f); }, [](D x) { return std::pow(x, D{7.3f}); }, 0.001, 100), 1.5);
}

TEST(PortableMath, SineAndCosineHaveSmallAbsoluteError) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<float> dist(-1e4f, 1e4f);
  for (int i = 0; i < 200000; ++i) {
    const float x = dist(rng);
    float s, c;
    portable::sincos(x, s, c);
    ASSERT_NEAR(static_cast<double>(s), std::sin(static_cast<double>(x)), 7e-8) << x;
    ASSERT_NEAR(static_cast<double>(c), std::cos(static_cast<double>(x)), 7e-8) << x;
  }
}

TEST(PortableMath, EdgesAreDefined) {
  EXPECT_EQ(portable::exp(-200.f), 0.f);
  EXPECT_EQ(portable::exp(200.f), kInfinity);
  EXPECT_EQ(portable::log(0.f), -kInfinity);
  EXPECT_EQ(portable::pow(0.f, 2.f), 0.f);
  EXPECT_EQ(portable::pow(0.f, 0.f), 1.f);
  EXPECT_EQ(portable::sin(kInfinity), 0.f);
  EXPECT_FLOAT_EQ(portable::atan2(0.f, -1.f), kPi);
  EXPECT_FLOAT_EQ(portable::acos(2.f), 0.f);
}

// The places lie at the end of arrays of just that size, so that a sanitizer sees what is read behind them.
template <std::size_t N>
void expect_gathered() {
  std::array<std::vector<float>, kLanes> rows;
  std::array<const float*, kLanes> places;
  for (std::size_t i = 0; i < kLanes; ++i) {
    for (std::size_t n = 0; n < N; ++n) rows[i].push_back(static_cast<float>(100 * i + n));
    places[i] = rows[i].data();
  }
  const auto columns = lanes::gather<N>(places);
  for (std::size_t n = 0; n < N; ++n)
    for (std::size_t i = 0; i < kLanes; ++i) EXPECT_EQ(lanes::get(columns[n], i), rows[i][n]) << N << " numbers";
}
TEST(Lanes, GatherTakesEachNumberToItsLane) {
  expect_gathered<2>();
  expect_gathered<3>();
  expect_gathered<4>();
  expect_gathered<8>();
}

TEST(Transform, NormalsStayPerpendicularUnderNonUniformScale) {
  const Transform t(Mat4(2, 0, 0, 0, 0, 5, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1));
  const Vec3 tangent = t.vector({1, -1, 0}), normal = t.normal({1, 1, 0});
  EXPECT_NEAR(glm::dot(tangent, normal), 0.f, 1e-6f);
  EXPECT_TRUE(t.is_invertible());
  EXPECT_FALSE(Transform(Mat4(0.f)).is_invertible());
}

}  // namespace
}  // namespace cloudrenderer
