// Shape "hyperboloid": the segment p1 (0 0 0), p2 (1 1 1) turned around z by phimax (360). What pbrt renders is another
// surface, which is that only for lines nearest to the axis at z = 0 (see Profile); its parameters and normals are the
// turned segment's all the same. miscquads-direct shows it.
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

// pbrt's surface of revolution without a term linear in z: r^2 = c0 + c2 z^2 through p2 and p1 + 2 (p2 - p1).
struct Profile {
  double c0, c2;
  explicit Profile(const Quadric& q) {
    const DVec3 p2(q.p2), step = 2.0 * (p2 - DVec3(q.p1));
    DVec3 p = DVec3(q.p1) + step;
    if (p.z * p.z == p2.z * p2.z) p += step;  // the two points say the same
    c2 = (square(radius_of(p)) - square(radius_of(p2))) / ((p.z - p2.z) * (p.z + p2.z));
    c0 = square(radius_of(p2)) - c2 * p2.z * p2.z;
  }
  double radius2(double z) const { return c0 + c2 * z * z; }
  double radius(double z) const { return std::sqrt(std::max(0.0, radius2(z))); }
};

RayEquation equation(const Quadric& q, const DVec3& o, const DVec3& d) {
  const Profile k(q);
  const double r_line = k.radius(o.z), r = radius_of(o);
  return {d.x * d.x + d.y * d.y - k.c2 * d.z * d.z, o.x * d.x + o.y * d.y - k.c2 * o.z * d.z,
          k.radius2(o.z) > 0 ? (r - r_line) * (r + r_line) : r * r - k.radius2(o.z)};
}

DVec3 project(const Quadric& q, const DVec3& p) { return with_radius(p, Profile(q).radius(p.z)); }

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
  const Profile k(q);
  const double middle = q.z_min < 0 && q.z_max > 0 ? k.radius(0) : 0;
  return std::max({k.radius(q.z_min), k.radius(q.z_max), middle});
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
    throw EmptyShape(location_of(shape, "p2"),
                     "p1 and p2 of a hyperboloid must differ in z (use a disk)");
  q.z_min = std::min(q.p1.z, q.p2.z);
  q.z_max = std::max(q.p1.z, q.p2.z);
  if (!(max_radius(q) > 0) || max_radius(q) > static_cast<double>(kInfinity))
    throw EmptyShape(location_of(shape, "p2"), "p1 and p2 make no hyperboloid");
  return q;
}

}  // namespace cloudrenderer
