// Emissive triangles, parallelograms and disks, sampled uniformly by area; rectangles that fill much of the view by solid angle.
#include <algorithm>
#include <cstddef>

#include "base/portable_math.h"
#include "base/sampling.h"
#include "shading/light_record.h"

namespace cloudrenderer {
namespace {

// A rectangle as it is seen from a point (Urena, Fajardo and King 2013, "An Area-Preserving Parametrization for Spherical
// Rectangles"): coordinates along its edges from the foot of the point's perpendicular, whose length is 1.
template <class F>
struct RectangleView {
  F length0, length1, x0, y0, x1, y1;
  F solid_angle = 0, begin = 0;  // the angle that sampling starts at
  MaskOf<F> wide;                // as large and as far from its plane as single precision wants it; else it is not to be used

  RectangleView(const FlatOf<F>& e, const Vec3Of<F>& p) {
    using lanes::sqrt, lanes::max, lanes::abs;
    const Vec3Of<F> d = e.position - p;
    const F edge0 = sqrt(glm::dot(e.edge0, e.edge0)), edge1 = sqrt(glm::dot(e.edge1, e.edge1)), scale = 1.f / abs(glm::dot(d, e.axis));
    length0 = edge0 * scale;
    length1 = edge1 * scale;
    x0 = glm::dot(d, e.edge0) / edge0 * scale;
    y0 = glm::dot(d, e.edge1) / edge1 * scale;
    x1 = x0 + length0;
    y1 = y0 + length1;
    const F xx0 = x0 * x0, yy0 = y0 * y0, xx1 = x1 * x1, yy1 = y1 * y1;
    const F x = x0 + 0.5f * length0, y = y0 + 0.5f * length1, far2 = x * x + y * y + 1.f;
    wide = e.by_solid_angle && length0 * length1 > kLeast * (far2 * sqrt(far2)) && max(max(xx0, xx1), max(yy0, yy1)) < kFarthest * kFarthest;
    if (!lanes::any(wide)) return;
    // The angles between the planes through the point and the edges. Not by arc cosines: of what is near 1 they would be of little use.
    // Two add up as the angles of complex numbers do.
    const auto angle_of_both = [](F s0, F c0, F s1, F c1) {
      const F angle = portable::atan2_near<F>(s0 * c1 + c0 * s1, c0 * c1 - s0 * s1);
      return lanes::select(angle < 0.f, angle + 2 * kPi, angle);
    };
    begin = 2 * kPi - angle_of_both(sqrt(xx0 + yy1 + 1.f), y1 * x0, sqrt(xx0 + yy0 + 1.f), -x0 * y0);
    solid_angle = angle_of_both(sqrt(xx1 + yy0 + 1.f), y0 * x1, sqrt(xx1 + yy1 + 1.f), -x1 * y1) - begin;
  }

  // Fractions of both edges.
  Vec2Of<F> sample(const Vec2Of<F>& u) const {
    using lanes::sqrt, lanes::max, lanes::min, lanes::select;
    F s, c;
    portable::sincos_turn<F>(min((begin + u.x * solid_angle) * (0.5f / kPi), 1.f), s, c);
    const F b0 = -y0 / sqrt(1.f + y0 * y0), b1 = y1 / sqrt(1.f + y1 * y1);
    const F f = (c * b0 - b1) / s;
    const F away = 1.f / sqrt(max(f * f + b0 * b0 - 1.f, 1e-12f)), x = select(f < 0.f, -away, away) - x0;
    const F along0 = select(x > 0.f, min(x, length0), F(0.f));  // NaN becomes 0
    const F xx = x0 + along0, d2 = xx * xx + 1.f;
    const F h0 = y0 / sqrt(d2 + y0 * y0), h1 = y1 / sqrt(d2 + y1 * y1), h = h0 + u.y * (h1 - h0);
    const F y = h * sqrt(d2 / max(1.f - h * h, 1e-12f)) - y0;
    const F along1 = select(y > 0.f, min(y, length1), F(0.f));
    return {along0 / length0, along1 / length1};
  }

 private:
  static constexpr float kLeast = 0.05f;   // of the solid angle, about: smaller ones would be sums that cancel
  static constexpr float kFarthest = 50;   // coordinate
};

}  // namespace

std::optional<EmitterAndBounds> make_flat(EmitterKind kind, const Vec3& corner, const Vec3& edge0,
                                          const Vec3& edge1, const Vec3& normal,
                                          const Rgb& radiance, bool two_sided) {
  const bool triangle = kind == EmitterKind::triangle;
  const float area = glm::length(glm::cross(edge0, edge1)) * (triangle ? 0.5f : 1.f);
  if (!(area > 0.f && area < kInfinity && 1.f / area < kInfinity)) return std::nullopt;
  EmitterAndBounds out;
  Emitter& e = out.emitter;
  e.kind = kind;
  e.two_sided = two_sided;
  e.radiance = radiance;
  e.position = corner;
  e.edge0 = edge0;
  e.edge1 = edge1;
  e.axis = normal;
  e.area_pdf = 1.f / area;
  e.by_solid_angle = kind == EmitterKind::parallelogram &&
                     std::fabs(glm::dot(edge0, edge1)) <= 1e-5f * glm::length(edge0) * glm::length(edge1);

  EmitterBounds& b = out.bounds;
  b.shape = two_sided ? EmitterShape::planar_two_sided : EmitterShape::planar;
  b.axis = normal;
  b.strength = average(radiance) * area;
  b.center = corner + (edge0 + edge1) * (triangle ? 1.f / 3.f : 0.5f);
  for (const Vec3& v : {corner, corner + edge0, corner + edge1, corner + edge0 + edge1}) {
    if (triangle && v == corner + edge0 + edge1) continue;
    b.radius = std::max(b.radius, glm::length(v - b.center));
  }
  // Midpoints of what the edges' midpoints cut it into; of a triangle those of its edges.
  if (kind != EmitterKind::disk) {
    const auto at = [&](float s, float t) { out.points.at[out.points.count++] = corner + s * edge0 + t * edge1; };
    if (triangle) {
      at(0.5f, 0);
      at(0, 0.5f);
      at(0.5f, 0.5f);
    } else {
      for (const float s : {0.25f, 0.75f})
        for (const float t : {0.25f, 0.75f}) at(s, t);
    }
  }
  return out;
}

bool parallelogram(const std::array<Vec3, 3>& a, const std::array<Vec3, 3>& b, Vec3& corner, Vec3& edge0, Vec3& edge1) {
  const auto lone = [](const std::array<Vec3, 3>& x, const std::array<Vec3, 3>& y) {
    int found = -1;
    for (int i = 0; i < 3; ++i) {
      if (std::find(y.begin(), y.end(), x[static_cast<std::size_t>(i)]) != y.end()) continue;
      if (found >= 0) return -1;
      found = i;
    }
    return found;
  };
  const int i = lone(a, b), j = lone(b, a);
  if (i < 0 || j < 0) return false;
  corner = a[static_cast<std::size_t>(i)];
  edge0 = a[static_cast<std::size_t>((i + 1) % 3)] - corner;
  edge1 = a[static_cast<std::size_t>((i + 2) % 3)] - corner;
  const Vec3 gap = corner + edge0 + edge1 - b[static_cast<std::size_t>(j)];
  return glm::length(gap) <= 1e-5f * std::min(glm::length(edge0), glm::length(edge1));
}

template <class F>
FlatOf<F> flat_of(const Emitter& e) {
  using V = Vec3Of<F>;
  using M = MaskOf<F>;
  return {V(e.radiance), V(e.position), V(e.edge0), V(e.edge1), V(e.axis), e.area_pdf, M(e.two_sided), M(e.kind == EmitterKind::triangle),
          M(e.kind == EmitterKind::disk), M(e.by_solid_angle)};
}

FlatOf<Float8> flats_of(const std::array<const Emitter*, kLanes>& emitters) {
  static_assert(offsetof(Emitter, area_pdf) == offsetof(Emitter, radiance) + 15 * sizeof(float), "what is gathered lies side by side");
  std::array<const float*, kLanes> first, second;
  std::uint32_t two_sided = 0, triangle = 0, disk = 0, wide = 0;
  for (std::size_t i = 0; i < kLanes; ++i) {
    const Emitter& e = *emitters[i];
    first[i] = &e.radiance.x;
    second[i] = &e.edge0.z;
    const auto bit = [i](bool is) { return static_cast<std::uint32_t>(is) << i; };
    two_sided |= bit(e.two_sided);
    triangle |= bit(e.kind == EmitterKind::triangle);
    disk |= bit(e.kind == EmitterKind::disk);
    wide |= bit(e.by_solid_angle);
  }
  const auto a = lanes::gather<8>(first), b = lanes::gather<8>(second);
  const auto mask = [](std::uint32_t bits) { return lanes::from_mask_bits(bits); };
  return {{a[0], a[1], a[2]}, {a[3], a[4], a[5]}, {a[6], a[7], b[0]}, {b[1], b[2], b[3]}, {b[4], b[5], b[6]}, b[7],
          mask(two_sided),    mask(triangle),     mask(disk),         mask(wide)};
}

template <class F>
MaskOf<F> sample_flat(const FlatOf<F>& e, const Vec3Of<F>& p, const Vec2Of<F>& u, LightSampleOf<F>& out) {
  using lanes::select, lanes::any;
  Vec2Of<F> b = u;
  const auto take = [&](MaskOf<F> m, const Vec2Of<F>& other) { b = {select(m, other.x, b.x), select(m, other.y, b.y)}; };
  if (any(e.triangle)) take(e.triangle, sample_triangle<F>(u));
  if (any(e.disk)) take(e.disk, sample_disk<F>(u));
  MaskOf<F> wide(false);
  F wide_pdf = 0.f;
  if (any(e.by_solid_angle)) {
    const RectangleView<F> view(e, p);
    wide = view.wide;
    if (any(wide)) {
      take(wide, view.sample(u));
      wide_pdf = 1.f / view.solid_angle;
    }
  }
  const Vec3Of<F> w = e.position + e.edge0 * b.x + e.edge1 * b.y - p;
  const F d2 = glm::dot(w, w);
  out.distance = lanes::sqrt(d2);
  out.wi = w * (1.f / out.distance);
  const F cosine = -glm::dot(e.axis, out.wi);
  out.pdf = select(wide, wide_pdf, solid_angle_pdf<F>(e.area_pdf, d2, lanes::abs(cosine)));
  out.radiance = e.radiance;
  out.delta = MaskOf<F>(false);
  return (cosine > 0.f || e.two_sided) && out.pdf > 0.f && out.pdf < kInfinity;
}

float flat_pdf(const Emitter& e, const Vec3& p, const Vec3& direction, float t) {
  if (e.by_solid_angle)
    if (const RectangleView<float> view(flat_of<float>(e), p); view.wide) return 1.f / view.solid_angle;
  return solid_angle_pdf(e.area_pdf, t * t, std::fabs(glm::dot(e.axis, direction)));
}

template FlatOf<float> flat_of<float>(const Emitter&);
template FlatOf<Float8> flat_of<Float8>(const Emitter&);
template bool sample_flat<float>(const FlatOf<float>&, const Vec3&, const Vec2&, LightSample&);
template Mask8 sample_flat<Float8>(const FlatOf<Float8>&, const Vec3x8&, const Vec2x8&, LightSample8&);

}  // namespace cloudrenderer
