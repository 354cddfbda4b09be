#pragma once
// Vectors, colours, transforms and boxes. All of it is plain IEEE float arithmetic without contraction, so that
// every host gets the same bits.
#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <glm/gtc/matrix_access.hpp>
#include <limits>

namespace cloudrenderer {

using Vec2 = glm::vec2;
using Vec3 = glm::vec3;
using Mat4 = glm::mat4;
using Rgb = glm::vec3;  // linear, pbrt's RGB primaries

inline constexpr float kPi = 3.14159265358979323846f;
inline constexpr float kInvPi = 0.31830988618379067154f;
inline constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Rec. 709 luminance.
inline float luminance(const Rgb& c) { return 0.212671f * c.x + 0.715160f * c.y + 0.072169f * c.z; }
inline float max_component(const Rgb& c) { return std::max(c.x, std::max(c.y, c.z)); }
inline bool is_black(const Rgb& c) { return c.x == 0.f && c.y == 0.f && c.z == 0.f; }
inline bool is_finite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

// A matrix with its inverse. Immutable.
class Transform {
 public:
  Transform() : m_(1.f), inv_(1.f) {}
  Transform(const Mat4& m, const Mat4& inverse) : m_(m), inv_(inverse) {}
  // The inverse is computed in double. A singular matrix gives non-finite entries: see is_invertible().
  explicit Transform(const Mat4& m) : m_(m), inv_(glm::inverse(glm::dmat4(m))) {}

  const Mat4& matrix() const { return m_; }
  const Mat4& inverse_matrix() const { return inv_; }
  Transform inverse() const { return {inv_, m_}; }
  bool is_identity() const { return m_ == Mat4(1.f); }
  bool is_invertible() const {
    for (int c = 0; c < 4; ++c)
      for (int r = 0; r < 4; ++r)
        if (!std::isfinite(inv_[c][r])) return false;
    return true;
  }

  Vec3 point(const Vec3& p) const {
    const glm::vec4 q = m_ * glm::vec4(p, 1.f);
    return q.w == 1.f ? Vec3(q) : Vec3(q) / q.w;
  }
  Vec3 vector(const Vec3& v) const { return Vec3(m_ * glm::vec4(v, 0.f)); }
  // Transforms by the inverse transpose; the result is not normalised.
  Vec3 normal(const Vec3& n) const { return glm::transpose(glm::mat3(inv_)) * n; }
  bool swaps_handedness() const { return glm::determinant(glm::mat3(m_)) < 0.f; }

  friend Transform operator*(const Transform& a, const Transform& b) {
    return {a.m_ * b.m_, b.inv_ * a.inv_};
  }
  friend bool operator==(const Transform& a, const Transform& b) { return a.m_ == b.m_; }

 private:
  Mat4 m_, inv_;
};

// An axis-aligned box; the default one is empty.
struct Bounds3 {
  Vec3 min{kInfinity}, max{-kInfinity};

  bool empty() const { return !(min.x <= max.x && min.y <= max.y && min.z <= max.z); }
  void extend(const Vec3& p) {
    min = glm::min(min, p);
    max = glm::max(max, p);
  }
  void extend(const Bounds3& b) {
    min = glm::min(min, b.min);
    max = glm::max(max, b.max);
  }
  Vec3 center() const { return 0.5f * min + 0.5f * max; }
  Vec3 diagonal() const { return max - min; }
  float surface_area() const {
    if (empty()) return 0.f;
    const Vec3 d = diagonal();
    return 2.f * (d.x * d.y + d.y * d.z + d.z * d.x);
  }
  // The box of the eight transformed corners.
  Bounds3 transformed(const Transform& t) const {
    Bounds3 out;
    if (empty()) return out;
    for (int i = 0; i < 8; ++i)
      out.extend(t.point({i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z}));
    return out;
  }
};

// Two unit vectors orthogonal to the unit vector n (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
// T: float, or lanes of them.
template <class T>
void orthonormal_basis(const glm::vec<3, T>& n, glm::vec<3, T>& s, glm::vec<3, T>& t) {
  using std::copysign;
  const T sign = copysign(T(1.f), n.z);
  const T a = -1.f / (sign + n.z);
  const T b = n.x * n.y * a;
  s = {1.f + sign * n.x * n.x * a, sign * b, -sign * n.x};
  t = {b, sign + n.y * n.y * a, -n.y};
}

// An orthonormal frame with z = n.
template <class T>
struct FrameOf {
  using Vector = glm::vec<3, T>;
  Vector s{1, 0, 0}, t{0, 1, 0}, n{0, 0, 1};

  FrameOf() = default;
  explicit FrameOf(const Vector& normal) : n(normal) { orthonormal_basis(n, s, t); }
  FrameOf(const Vector& s_, const Vector& t_, const Vector& n_) : s(s_), t(t_), n(n_) {}
  Vector to_local(const Vector& v) const { return {glm::dot(v, s), glm::dot(v, t), glm::dot(v, n)}; }
  Vector to_world(const Vector& v) const { return s * v.x + t * v.y + n * v.z; }
};
using Frame = FrameOf<float>;

}  // namespace cloudrenderer
