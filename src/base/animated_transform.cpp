#include "base/animated_transform.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

using DMat3 = glm::dmat3;
using DVec3 = glm::dvec3;
using Quaternion = glm::dvec4;

double norm(const DMat3& m) {
  return std::sqrt(glm::dot(m[0], m[0]) + glm::dot(m[1], m[1]) + glm::dot(m[2], m[2]));
}

DVec3 column(const Mat4& m, int c) { return DVec3(glm::dvec4(m[c])); }

// The orthogonal factor of m = (orthogonal) (symmetric positive), by Newton's iteration (Higham 1986).
DMat3 orthogonal_factor(const DMat3& m) {
  DMat3 q = m;
  for (int i = 0; i < 100; ++i) {
    const DMat3 next = 0.5 * (q + glm::transpose(glm::inverse(q)));
    const bool done = norm(next - q) <= 1e-15 * norm(next);
    q = next;
    if (done) break;
  }
  return q;
}

// Shepperd 1978: the largest component is computed first, so that nothing is divided by a small number.
Quaternion quaternion_of(const DMat3& r) {
  const auto at = [&](int row, int col) { return r[col][row]; };
  const double trace = at(0, 0) + at(1, 1) + at(2, 2);
  Quaternion q;
  if (trace >= std::max(at(0, 0), std::max(at(1, 1), at(2, 2)))) {
    q = {at(2, 1) - at(1, 2), at(0, 2) - at(2, 0), at(1, 0) - at(0, 1), 1 + trace};
  } else {
    const int i = at(0, 0) >= at(1, 1) && at(0, 0) >= at(2, 2) ? 0 : at(1, 1) >= at(2, 2) ? 1 : 2;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    q[i] = 1 + at(i, i) - at(j, j) - at(k, k);
    q[j] = at(i, j) + at(j, i);
    q[k] = at(i, k) + at(k, i);
    q[3] = at(k, j) - at(j, k);
  }
  return q / std::sqrt(glm::dot(q, q));
}

DMat3 rotation_of(const Quaternion& q) {
  const double x = q.x, y = q.y, z = q.z, w = q.w;
  return {1 - 2 * (y * y + z * z), 2 * (x * y + z * w),     2 * (x * z - y * w),
          2 * (x * y - z * w),     1 - 2 * (x * x + z * z), 2 * (y * z + x * w),
          2 * (x * z + y * w),     2 * (y * z - x * w),     1 - 2 * (x * x + y * y)};
}

Mat4 rounded(const Affine& a) {
  Mat4 out(1.f);
  for (int c = 0; c < 3; ++c) out[c] = glm::vec4(Vec3(a.m[c]), 0.f);
  out[3] = glm::vec4(Vec3(a.t), 1.f);
  return out;
}

}  // namespace

Affine::Affine(const Mat4& matrix) : m(column(matrix, 0), column(matrix, 1), column(matrix, 2)), t(column(matrix, 3)) {}

Affine Affine::inverse() const {
  const DVec3 a = glm::cross(m[1], m[2]), b = glm::cross(m[2], m[0]), c = glm::cross(m[0], m[1]);
  const double scale = 1 / glm::dot(m[0], a);
  const DMat3 inv = glm::transpose(DMat3(a * scale, b * scale, c * scale));
  return {inv, -(inv * t)};
}

bool AnimatedTransform::can_move(const Mat4& start, const Mat4& end) {
  return (glm::determinant(Affine(start).m) < 0) == (glm::determinant(Affine(end).m) < 0);
}

AnimatedTransform::Parts AnimatedTransform::take_apart(const Affine& a) {
  DMat3 r = orthogonal_factor(a.m);
  if (glm::determinant(r) < 0) r = -r;  // mirrored: the scale takes the sign
  return {a.t, quaternion_of(r), glm::transpose(r) * a.m};
}

AnimatedTransform::AnimatedTransform(const Mat4& start, const Mat4& end, TimeSpan times, Interpolates interpolates)
    : times_(times),
      inverse_(interpolates == Interpolates::inverse),
      start_(start),
      end_(end),
      start_inverse_(start_.inverse()),
      end_inverse_(end_.inverse()) {
  const Parts a = take_apart(inverse_ ? start_inverse_ : start_), b = take_apart(inverse_ ? end_inverse_ : end_);
  translation_ = a.translation;
  translation_step_ = b.translation - a.translation;
  scale_ = a.scale;
  scale_step_ = b.scale - a.scale;
  rotation_ = a.rotation;
  double cosine = glm::dot(a.rotation, b.rotation);
  const Quaternion to = cosine < 0 ? -b.rotation : b.rotation;  // the short way
  cosine = std::fabs(cosine);
  const Quaternion across = to - a.rotation * cosine;
  const double sine = std::sqrt(glm::dot(across, across));
  turns_ = sine > 1e-12;
  rotation_across_ = turns_ ? across / sine : Quaternion(0.0);
  angle_ = turns_ ? portable::detail::atan2_double(sine, cosine) : 0;
  scale_norm_ = norm(scale_step_);
  stretches_ = scale_norm_ > 1e-12 * norm(scale_);
  // The least eigenvalue of the scale, on its way between two that are positive, is not below both ends'.
  unscale_norm_ = std::max(norm(glm::inverse(a.scale)), norm(glm::inverse(b.scale)));
}

double AnimatedTransform::fraction(float time) const {
  if (!(time > times_.start)) return 0;
  if (!(time < times_.end)) return 1;
  return (static_cast<double>(time) - static_cast<double>(times_.start)) /
         (static_cast<double>(times_.end) - static_cast<double>(times_.start));
}

Affine AnimatedTransform::between(double f) const {
  if (f <= 0) return inverse_ ? start_inverse_ : start_;
  if (f >= 1) return inverse_ ? end_inverse_ : end_;
  const Quaternion q =
      turns_ ? rotation_ * portable::cos(f * angle_) + rotation_across_ * portable::sin(f * angle_) : rotation_;
  return {rotation_of(q) * (scale_ + scale_step_ * f), translation_ + translation_step_ * f};
}

// At the ends exactly what was given.
Affine AnimatedTransform::at(float time, const Affine& between) const {
  if (!inverse_) return between;
  return !(time > times_.start) ? start_ : !(time < times_.end) ? end_ : between.inverse();
}
Affine AnimatedTransform::inverse_at(float time, const Affine& between) const {
  if (inverse_) return between;
  return !(time > times_.start) ? start_inverse_ : !(time < times_.end) ? end_inverse_ : between.inverse();
}

int AnimatedTransform::steps() const {
  if (!turns_ && !stretches_) return 1;
  return std::min(128, static_cast<int>(std::ceil(64 * angle_)) + (stretches_ ? 16 : 1));
}

// No point of the way of p has a larger second derivative by the fraction of time. Forward p goes to T + R S p, where T
// and S are linear and R turns at a constant speed; backward it goes to S^-1 R^-1 (p - T).
double AnimatedTransform::acceleration(const DVec3& p) const {
  const auto length = [](const DVec3& v) { return std::sqrt(glm::dot(v, v)); };
  const double w = 2 * angle_;
  if (!inverse_)
    return w * w * std::max(length(scale_ * p), length((scale_ + scale_step_) * p)) + 2 * w * length(scale_step_ * p);
  const double y = std::max(length(p - translation_), length(p - translation_ - translation_step_));
  const double step = length(translation_step_), u = unscale_norm_, s = u * scale_norm_;
  return u * (w * w * y + 2 * w * step + 2 * s * (w * y + step) + 2 * s * s * y);
}

Bounds3 AnimatedTransform::bounds(const Bounds3& box, float from, float to) const {
  if (box.empty()) return box;
  const double a = fraction(from), b = fraction(to);
  const Affine first = at(from), last = at(to);
  Bounds3 out;
  double most = 0;
  // What holds for the corners holds for what is between them.
  for (int i = 0; i < 8; ++i) {
    const DVec3 p(Vec3{i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z});
    out.extend(Vec3(first.point(p)));
    out.extend(Vec3(last.point(p)));
    most = std::max(most, acceleration(p));
  }
  if (turns_ || stretches_) {  // a curve leaves its chord by at most this
    const auto off = static_cast<float>((b - a) * (b - a) / 8 * most);
    out.min -= off;
    out.max += off;
  }
  return out;
}

Transform placed(const Affine& fixed, std::span<const AnimatedTransform> moves, float time) {
  Affine all = fixed, inverse = fixed.inverse();
  for (const AnimatedTransform& m : moves) {
    const Affine between = m.between(time);
    all = all * m.at(time, between);
    inverse = m.inverse_at(time, between) * inverse;
  }
  return {rounded(all), rounded(inverse)};
}

Mat4 entering(const Affine& fixed_inverse, std::span<const AnimatedTransform> moves, float time) {
  Affine inverse = fixed_inverse;
  for (const AnimatedTransform& m : moves) inverse = m.inverse_at(time) * inverse;
  return rounded(inverse);
}

Bounds3 moved_bounds(const Affine& fixed, std::span<const AnimatedTransform> moves, const Bounds3& box) {
  TimeSpan times{kInfinity, -kInfinity};
  int steps = 1;
  for (const AnimatedTransform& m : moves) {
    times.start = std::min(times.start, m.times().start);
    times.end = std::max(times.end, m.times().end);
    steps = std::min(256, steps + m.steps());
  }
  Bounds3 all;
  for (int i = 0; i < steps; ++i) {
    const auto at = [&](int k) {
      const double f = static_cast<double>(k) / steps;
      return static_cast<float>(static_cast<double>(times.start) * (1 - f) + static_cast<double>(times.end) * f);
    };
    Bounds3 b = box;
    for (auto m = moves.rbegin(); m != moves.rend(); ++m)
      b = m->bounds(b, i == 0 ? -kInfinity : at(i), i + 1 == steps ? kInfinity : at(i + 1));
    all.extend(b);
  }
  if (all.empty()) return all;
  return all.transformed(Transform(rounded(fixed), rounded(fixed.inverse())));
}

}  // namespace cloudrenderer
