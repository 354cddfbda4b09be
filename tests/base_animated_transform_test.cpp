#include "base/animated_transform.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace cloudrenderer {
namespace {

using DMat3 = glm::dmat3;
using DVec3 = glm::dvec3;
using Way = AnimatedTransform::Interpolates;

// Rodrigues' formula.
DMat3 turn(const DVec3& axis, double angle) {
  const DVec3 a = axis / std::sqrt(glm::dot(axis, axis));
  const DMat3 cross{0, a.z, -a.y, -a.z, 0, a.x, a.y, -a.x, 0};
  return DMat3(1.0) * std::cos(angle) + glm::outerProduct(a, a) * (1 - std::cos(angle)) + cross * std::sin(angle);
}

struct Random {
  std::mt19937 rng;
  explicit Random(unsigned seed) : rng(seed) {}
  double number(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(rng); }
  DVec3 vector(double size) { return {number(-size, size), number(-size, size), number(-size, size)}; }
  DMat3 rotation(double most) { return turn(vector(1) + DVec3(1e-3), number(-most, most)); }
  // Symmetric, with all eigenvalues of one sign.
  DMat3 scale(double sign) {
    const DMat3 q = rotation(3);
    const DVec3 s(number(0.4, 2.5), number(0.4, 2.5), number(0.4, 2.5));
    return q * DMat3(sign * s.x, 0, 0, 0, sign * s.y, 0, 0, 0, sign * s.z) * glm::transpose(q);
  }
};

Mat4 matrix(const DMat3& m, const DVec3& t) {
  Mat4 out(1.f);
  for (int c = 0; c < 3; ++c) out[c] = glm::vec4(Vec3(m[c]), 0.f);
  out[3] = glm::vec4(Vec3(t), 1.f);
  return out;
}

// What is known of a movement, independent of how it is taken apart.
struct Known {
  DVec3 t0, t1, axis;
  DMat3 r0, s0, s1;
  double angle;
  DMat3 rotation(double f) const { return turn(axis, f * angle) * r0; }
  DMat3 linear(double f) const { return rotation(f) * (s0 * (1 - f) + s1 * f); }
  DVec3 offset(double f) const { return t0 * (1 - f) + t1 * f; }
};

Known some_movement(Random& r) {
  const double sign = r.number(0, 1) < 0.3 ? -1 : 1;
  return {r.vector(5), r.vector(5), r.vector(1) + DVec3(1e-3), r.rotation(3), r.scale(sign), r.scale(sign), r.number(-3.1, 3.1)};
}

double difference(const Affine& a, const DMat3& m, const DVec3& t) {
  double most = 0;
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < 3; ++i) most = std::max(most, std::fabs(a.m[c][i] - m[c][i]));
  for (int i = 0; i < 3; ++i) most = std::max(most, std::fabs(a.t[i] - t[i]));
  return most;
}

TEST(AnimatedTransform, GoesStraightAndTurnsAtAConstantSpeed) {
  constexpr unsigned kSeed = 41;
  Random r(kSeed);
  for (int i = 0; i < 300; ++i) {
    SCOPED_TRACE(testing::Message() << "movement " << i << " of seed " << kSeed);
    const Known k = some_movement(r);
    const Mat4 start = matrix(k.linear(0), k.offset(0)), end = matrix(k.linear(1), k.offset(1));
    ASSERT_TRUE(AnimatedTransform::can_move(start, end));
    const AnimatedTransform forward(start, end, {2, 6}, Way::forward);
    const AnimatedTransform backward(Transform(start).inverse_matrix(), Transform(end).inverse_matrix(), {2, 6}, Way::inverse);
    for (const double f : {0.0, 0.1, 0.5, 0.77, 1.0}) {
      const auto time = static_cast<float>(2 + 4 * f);
      // The ends are given in float.
      EXPECT_LT(difference(forward.at(time), k.linear(f), k.offset(f)), 2e-5);
      EXPECT_LT(difference(backward.at(time).inverse(), k.linear(f), k.offset(f)), 2e-4);
      const Transform both = placed(Affine(), {&forward, 1}, time);
      EXPECT_EQ(both.inverse_matrix(), entering(Affine(), {&forward, 1}, time));
      EXPECT_LT(difference(Affine(both.matrix()) * Affine(both.inverse_matrix()), DMat3(1.0), DVec3(0.0)), 1e-5);
    }
  }
}

TEST(AnimatedTransform, StandsStillBeforeAndAfter) {
  const Mat4 start = matrix(turn({1, 2, 3}, 0.4), {1, 2, 3}), end = matrix(turn({3, 2, 1}, 2.0) * 2.0, {5, 2, 3});
  for (const Way way : {Way::forward, Way::inverse}) {
    const AnimatedTransform a(start, end, {-1, 3}, way), jump(start, end, {2, 2}, way);
    for (const float t : {-kInfinity, -7.f, -1.f}) EXPECT_EQ(placed(Affine(), {&a, 1}, t).matrix(), start);
    for (const float t : {3.f, 8.f, kInfinity}) EXPECT_EQ(placed(Affine(), {&a, 1}, t).matrix(), end);
    EXPECT_EQ(placed(Affine(), {&jump, 1}, 2.f).matrix(), start);
    EXPECT_EQ(placed(Affine(), {&jump, 1}, 2.001f).matrix(), end);
  }
}

TEST(AnimatedTransform, DoesNotTurnAShapeInsideOut) {
  EXPECT_FALSE(AnimatedTransform::can_move(Mat4(1.f), matrix(DMat3(-1, 0, 0, 0, 1, 0, 0, 0, 1), {})));
  EXPECT_TRUE(AnimatedTransform::can_move(matrix(-DMat3(1.0), {}), matrix(DMat3(1, 0, 0, 0, -2, 0, 0, 0, 1), {})));
}

TEST(AnimatedTransform, BoundsHoldEveryPointAtEveryTime) {
  constexpr unsigned kSeed = 42;
  Random r(kSeed);
  double largest = 0, moved = 0;
  for (int i = 0; i < 100; ++i) {
    SCOPED_TRACE(testing::Message() << "movement " << i << " of seed " << kSeed);
    std::vector<AnimatedTransform> moves;
    for (int n = 0; n < 1 + i % 2; ++n) {
      const Known k = some_movement(r);
      moves.emplace_back(matrix(k.linear(0), k.offset(0)), matrix(k.linear(1), k.offset(1)), TimeSpan{0, 1},
                         r.number(0, 1) < 0.5 ? Way::forward : Way::inverse);
    }
    const Affine fixed = i % 2 ? Affine(matrix(r.rotation(3), r.vector(3))) : Affine();
    Bounds3 box;
    for (int k = 0; k < 2; ++k) box.extend(Vec3(r.vector(2)));
    Bounds3 all = moved_bounds(fixed, moves, box), seen;
    const Affine fixed_inverse = fixed.inverse();
    const Vec3 rounding = 1e-5f * glm::max(glm::abs(all.min), glm::abs(all.max));
    for (int k = 0; k < 10000; ++k) {
      const auto u = [&] { return static_cast<float>(r.number(0, 1)); };
      Vec3 p;
      for (int a = 0; a < 3; ++a) p[a] = k % 2 ? (u() < 0.5f ? box.min[a] : box.max[a]) : box.min[a] + u() * (box.max[a] - box.min[a]);
      const auto time = static_cast<float>(r.number(-0.1, 1.1));
      const Transform to_world = placed(fixed, moves, time);
      ASSERT_EQ(to_world.inverse_matrix(), entering(fixed_inverse, moves, time));
      const Vec3 q = to_world.point(p);
      seen.extend(q);
      for (int a = 0; a < 3; ++a) {
        ASSERT_GE(q[a], all.min[a] - rounding[a]);
        ASSERT_LE(q[a], all.max[a] + rounding[a]);
      }
    }
    if (moves.size() == 1) {
      largest += static_cast<double>(all.surface_area());
      moved += static_cast<double>(seen.surface_area());
    }
  }
  EXPECT_LT(largest, 1.3 * moved);  // and they are not much larger than needed
}

}  // namespace
}  // namespace cloudrenderer
