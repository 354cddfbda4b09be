// Emissive spheres (by the cone in which they are seen), disks and cylinders (by area).
#include <cmath>

#include "base/sampling.h"
#include "shading/light_record.h"

namespace cloudrenderer {
namespace {

// The cone of directions in which a sphere is seen from outside. 1 - cos is kept instead of cos, so
// that a sphere of 1e-9 steradian still has a cone, and that of a sphere that is touched is a half
// space.
template <class F>
struct VisibleCone {
  F one_minus_cos;
  VisibleCone(float radius2, F distance2) {
    const F sin2 = radius2 / distance2;
    one_minus_cos = sin2 / (1.f + lanes::sqrt(lanes::max(0.f, 1.f - sin2)));
  }
  F pdf() const {
    return lanes::select(one_minus_cos > 1e-35f, 1.f / (2 * kPi * one_minus_cos), F(0.f));
  }
};

// A direction of the cone around the unit vector `axis`; sin2 is the squared sine of its angle to
// the axis.
template <class F>
Vec3Of<F> sample_cone(const VisibleCone<F>& cone, const Vec3Of<F>& axis, const Vec2Of<F>& u, F& cosine, F& sin2) {
  const F x = u.x * cone.one_minus_cos;
  cosine = 1.f - x;
  sin2 = x * (2.f - x);
  const F r = lanes::sqrt(sin2);
  F s, c;
  portable::sincos_turn<F>(u.y, s, c);
  return FrameOf<F>(axis).to_world({r * c, r * s, cosine});
}

constexpr float kUniformPdf = 1.f / (4 * kPi);

bool is_whole(const Quadric& q) {
  return q.z_min <= -q.radius && q.z_max >= q.radius && q.phi_max >= 2 * kPi * 0.999999f;
}

// Whose light is where it shines: pbrt-v2's disks are not so (SceneLights::weighs_alone).
bool is_whole_disk(const Quadric& q) {
  return q.inner_radius == 0.f && q.phi_max >= 2 * kPi * 0.999999f && !q.inside_out;
}

}  // namespace

std::optional<EmitterAndBounds> make_quadric(const Quadric& q, bool flip, const Rgb& radiance,
                                             bool two_sided, EmissiveQuadric& record) {
  Vec3 p, n;
  float density;
  if (!sample_area(q, flip, Vec2(0.5f), p, n, density) || !(density > 0.f && density < kInfinity))
    return std::nullopt;
  record.quadric = q;
  record.flip = flip;
  record.to_world = glm::mat3(q.object_to_world.matrix());
  record.to_object = glm::mat3(glm::inverse(glm::dmat3(record.to_world)));
  record.offset = q.object_to_world.point(Vec3(0.f));
  record.inverse_volume = 1.f / std::fabs(glm::determinant(record.to_world));
  if (!std::isfinite(record.inverse_volume)) return std::nullopt;

  EmitterAndBounds out;
  Emitter& e = out.emitter;
  e.radiance = radiance;
  e.two_sided = two_sided;
  const Bounds3 box = world_bounds(q);
  EmitterBounds& b = out.bounds;
  b.center = box.center();
  b.radius = 0.5f * glm::length(box.diagonal());
  const float area = surface_area(q);
  if (q.kind == QuadricKind::sphere) {
    b.strength = average(radiance) * area / 4;  // seen from anywhere: pi r^2
    e.kind = EmitterKind::sphere_part;
    e.outward = flip == q.object_to_world.swaps_handedness();
    if (is_whole(q) && is_similarity(record.to_world)) {
      e.kind = EmitterKind::sphere;
      e.position = b.center = record.offset;
      b.radius = q.radius * glm::length(record.to_world[0]);
      e.radius2 = b.radius * b.radius;
    }
  } else {
    e.kind = EmitterKind::quadric;
    b.strength = average(radiance) * area;
    if (q.kind == QuadricKind::disk) {
      b.shape = two_sided ? EmitterShape::planar_two_sided : EmitterShape::planar;
      b.axis = n;
      b.center = record.to_world * Vec3(0, 0, q.height) + record.offset;
      b.radius = q.radius * std::sqrt(glm::dot(record.to_world[0], record.to_world[0]) +
                                      glm::dot(record.to_world[1], record.to_world[1]));
      if (is_whole_disk(q)) {
        e.kind = EmitterKind::disk;
        e.position = b.center;
        e.edge0 = q.radius * record.to_world[0];
        e.edge1 = q.radius * record.to_world[1];
        e.axis = n;
        e.area_pdf = density;
      }
    } else {
      b.strength /= kPi;  // a cylinder shows 2 r h of its 2 pi r h
    }
  }
  return out;
}

template <class F>
MaskOf<F> sample_sphere(const Emitter& e, const Vec3Of<F>& p, const Vec2Of<F>& u, LightSampleOf<F>& out) {
  using lanes::max, lanes::sqrt;
  const Vec3Of<F> w = Vec3Of<F>(e.position) - p;
  const F d2 = glm::dot(w, w);
  const MaskOf<F> outside = d2 > e.radius2;
  out.radiance = Vec3Of<F>(e.radiance);
  out.delta = MaskOf<F>(false);
  if (lanes::any(outside)) {
    const VisibleCone<F> cone(e.radius2, d2);
    const F d = sqrt(d2);
    F cosine, sin2;
    out.wi = sample_cone<F>(cone, w * (1.f / d), u, cosine, sin2);
    // Not beyond the sphere, whatever rounds: beside a huge one the way is a small difference.
    const F half_chord = sqrt(max(0.f, e.radius2 - d2 * sin2) + e.radius2 * 0x1p-21f);
    out.distance = max(0.f, d * (cosine - 0x1p-22f) - half_chord);
    out.pdf = cone.pdf();
  }
  if (lanes::any(!outside)) {
    const Vec3Of<F> wi = sample_uniform_sphere<F>(u);
    const F along = glm::dot(wi, w);
    const F distance = along + sqrt(max(0.f, along * along + (e.radius2 - d2)));
    out.wi = lanes::select(outside, out.wi, wi);
    out.distance = lanes::select(outside, out.distance, distance);
    out.pdf = lanes::select(outside, out.pdf, F(kUniformPdf));
  }
  return (outside == MaskOf<F>(e.outward) || MaskOf<F>(e.two_sided)) && out.pdf > 0.f;
}
template bool sample_sphere<float>(const Emitter&, const Vec3&, const Vec2&, LightSample&);
template Mask8 sample_sphere<Float8>(const Emitter&, const Vec3x8&, const Vec2x8&, LightSample8&);

float sphere_pdf(const Emitter& e, const Vec3& p) {
  const Vec3 w = e.position - p;
  const float d2 = glm::dot(w, w);
  return d2 > e.radius2 ? VisibleCone<float>(e.radius2, d2).pdf() : kUniformPdf;
}

bool sample_sphere_part(const Emitter& e, const EmissiveQuadric& q, const Vec3& p, const Vec2& u,
                        LightSample& out) {
  const Vec3 w = q.to_object * (q.offset - p);  // towards the centre, in object space
  const float d2 = glm::dot(w, w), r2 = q.quadric.radius * q.quadric.radius;
  Vec3 direction;
  float pdf = kUniformPdf;
  if (d2 > r2) {
    const VisibleCone<float> cone(r2, d2);
    float cosine, sin2;
    direction = sample_cone<float>(cone, w / std::sqrt(d2), u, cosine, sin2);
    pdf = cone.pdf();
  } else {
    direction = sample_uniform_sphere<float>(u);
  }
  const Vec3 world = q.to_world * direction;
  const float stretch = glm::length(world);
  out.wi = world / stretch;
  out.pdf = pdf * stretch * stretch * stretch * q.inverse_volume;
  if (!(out.pdf > 0.f && out.pdf < kInfinity) || !is_finite(out.wi)) return false;
  // The first point on the surface as it is. Starting on the surface itself must not find that same
  // point.
  QuadricHit hit;
  const float scale = std::sqrt(d2) * stretch;
  if (!intersect(q.quadric, p, out.wi, 1e-5f * scale, kInfinity, hit)) return false;
  const bool from_outside = glm::dot(hit.t / stretch * direction - w, direction) < 0.f;
  if (!e.two_sided && from_outside != e.outward) return false;
  out.distance = hit.t;
  out.radiance = e.radiance;
  out.delta = false;
  return true;
}

float sphere_part_pdf(const EmissiveQuadric& q, const Vec3& p, const Vec3& direction) {
  const Vec3 w = q.to_object * (q.offset - p);
  const float d2 = glm::dot(w, w), r2 = q.quadric.radius * q.quadric.radius;
  const float stretch = 1.f / glm::length(q.to_object * direction);
  return (d2 > r2 ? VisibleCone<float>(r2, d2).pdf() : kUniformPdf) * stretch * stretch * stretch *
         q.inverse_volume;
}

bool sample_quadric(const Emitter& e, const EmissiveQuadric& q, const Vec3& p, const Vec2& u,
                    LightSample& out) {
  Vec3 point, normal;
  float density;
  if (!sample_area(q.quadric, q.flip, u, point, normal, density)) return false;
  const Vec3 w = point - p;
  const float d2 = glm::dot(w, w);
  out.distance = std::sqrt(d2);
  out.wi = w * (1.f / out.distance);
  const float cosine = -glm::dot(normal, out.wi);
  if (!(cosine > 0.f) && !e.two_sided) return false;
  out.pdf = solid_angle_pdf(density, d2, std::fabs(cosine));
  out.radiance = e.radiance;
  out.delta = false;
  return out.pdf > 0.f && out.pdf < kInfinity;
}

}  // namespace cloudrenderer
