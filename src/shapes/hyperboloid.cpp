// Shape "hyperboloid": the segment p1 (0 0 0), p2 (1 1 1) turned around z by phimax (360). It is
// the surface of revolution of the whole line for every segment; pbrt's implicit equation is that
// only for lines nearest to the axis at z = 0.
#include "shapes/quadric.h"
#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

// The point of the segment at a height.
DVec3 segment_at(const Quadric& q, double z, double& v) {
  const DVec3 p1(q.p1), p2(q.p2);
  v = (z - p1.z) / (p2.z - p1.z);
  return p1 + v * (p2 - p1);
}

// r^2 = |a + s z|^2, with a + s z the point of the line at the height z.
RayEquation equation(const Quadric& q, const DVec3& o, const DVec3& d) {
  double v;
  const DVec3 at = segment_at(q, o.z, v);
  const DVec3 p1(q.p1), p2(q.p2);
  const double sx = (p2.x - p1.x) / (p2.z - p1.z), sy = (p2.y - p1.y) / (p2.z - p1.z);
  const double r_line = radius_of(at), r = radius_of(o);
  return {d.x * d.x + d.y * d.y - (sx * sx + sy * sy) * d.z * d.z,
          o.x * d.x + o.y * d.y - (at.x * sx + at.y * sy) * d.z, (r - r_line) * (r + r_line)};
}

DVec3 project(const Quadric& q, const DVec3& p) {
  double v;
  return with_radius(p, radius_of(segment_at(q, p.z, v)));
}

bool inside(const Quadric& q, const DVec3& p) { return p.z >= q.z_min && p.z <= q.z_max; }

Meridian meridian(const Quadric& q, const DVec3& p, double) {
  Meridian k;
  const DVec3 at = segment_at(q, p.z, k.v), step = DVec3(q.p2) - DVec3(q.p1);
  const double r = radius_of(at);
  k.z1 = step.z;
  k.r1 = r > 0 ? (at.x * step.x + at.y * step.y) / r : radius_of(step);
  k.phi1 = r > 0 ? (at.x * step.y - at.y * step.x) / r : 0;
  k.normal_r = k.z1;
  k.normal_z = -k.r1;
  return k;
}

// |dpdu x dpdv| = phi_max sqrt((r dz)^2 + (r r')^2), integrated over v by Simpson's rule.
double area(const Quadric& q) {
  const DVec3 p1(q.p1), step = DVec3(q.p2) - p1;
  constexpr int kSteps = 256;
  double sum = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const DVec3 at = p1 + step * (static_cast<double>(i) / kSteps);
    const double weight = i == 0 || i == kSteps ? 1 : i % 2 ? 4 : 2;
    sum += weight * std::sqrt((at.x * at.x + at.y * at.y) * step.z * step.z +
                              square(at.x * step.x + at.y * step.y));
  }
  return q.phi_max * sum / (3 * kSteps);
}

double max_radius(const Quadric& q) {
  return std::max(radius_of(DVec3(q.p1)), radius_of(DVec3(q.p2)));
}

Vec3 finite_point(const ShapeDesc& shape, const char* name, const Vec3& otherwise) {
  const Vec3 p = shape.params.point3(name, otherwise);
  if (!is_finite(p))
    throw SceneError(location_of(shape, name), std::string(name) + " must be finite");
  return p;
}

}  // namespace

const QuadricOps kHyperboloidOps{equation, project, inside, meridian, area, max_radius, nullptr};

ShapeGeometry make_hyperboloid(const ShapeDesc& shape, Dialect dialect, Warnings&) {
  Quadric q = begin_quadric(shape, QuadricKind::hyperboloid, dialect);
  q.p1 = finite_point(shape, "p1", Vec3(0.f));
  q.p2 = finite_point(shape, "p2", Vec3(1.f));
  if (q.p2.z == 0.f)
    std::swap(q.p1, q.p2);  // as pbrt: it decides where v starts and which side is outside
  if (q.p1.z == q.p2.z)
    throw SceneError(location_of(shape, "p2"),
                     "p1 and p2 of a hyperboloid must differ in z (use a disk)");
  if (max_radius(q) == 0)
    throw SceneError(location_of(shape, "p2"), "p1 and p2 of a hyperboloid are both on the axis");
  q.z_min = std::min(q.p1.z, q.p2.z);
  q.z_max = std::max(q.p1.z, q.p2.z);
  return q;
}

}  // namespace cloudrenderer
