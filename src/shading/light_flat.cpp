// Emissive triangles, parallelograms and disks, sampled uniformly by area.
#include <algorithm>

#include "base/sampling.h"
#include "shading/light_record.h"

namespace cloudrenderer {

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

  EmitterBounds& b = out.bounds;
  b.shape = two_sided ? EmitterShape::planar_two_sided : EmitterShape::planar;
  b.axis = normal;
  b.strength = average(radiance) * area;
  b.center = corner + (edge0 + edge1) * (triangle ? 1.f / 3.f : 0.5f);
  for (const Vec3& v : {corner, corner + edge0, corner + edge1, corner + edge0 + edge1}) {
    if (triangle && v == corner + edge0 + edge1) continue;
    b.radius = std::max(b.radius, glm::length(v - b.center));
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
MaskOf<F> sample_flat(const Emitter& e, const Vec3Of<F>& p, const Vec2Of<F>& u, LightSampleOf<F>& out) {
  using V = Vec3Of<F>;
  const Vec2Of<F> b = e.kind == EmitterKind::triangle ? sample_triangle<F>(u) : e.kind == EmitterKind::disk ? sample_disk<F>(u) : u;
  const V w = V(e.position) + V(e.edge0) * b.x + V(e.edge1) * b.y - p;
  const F d2 = glm::dot(w, w);
  out.distance = lanes::sqrt(d2);
  out.wi = w * (1.f / out.distance);
  const F cosine = -glm::dot(V(e.axis), out.wi);
  out.pdf = solid_angle_pdf<F>(e.area_pdf, d2, lanes::abs(cosine));
  out.radiance = V(e.radiance);
  out.delta = MaskOf<F>(false);
  return (cosine > 0.f || MaskOf<F>(e.two_sided)) && out.pdf > 0.f && out.pdf < kInfinity;
}
template bool sample_flat<float>(const Emitter&, const Vec3&, const Vec2&, LightSample&);
template Mask8 sample_flat<Float8>(const Emitter&, const Vec3x8&, const Vec2x8&, LightSample8&);

}  // namespace cloudrenderer
