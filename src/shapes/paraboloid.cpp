// Shape "paraboloid": z = zmax (r / radius)^2 with radius (1), zmin (0), zmax (1), phimax (360).
#include <spdlog/fmt/fmt.h>

#include "shapes/quadric.h"
#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

double curvature(const Quadric& q) { return q.z_max / square(q.radius); }

RayEquation equation(const Quadric& q, const DVec3& o, const DVec3& d) {
  const double k = curvature(q);
  return {k * (d.x * d.x + d.y * d.y), k * (o.x * d.x + o.y * d.y) - 0.5 * d.z,
          k * (o.x * o.x + o.y * o.y) - o.z};
}

DVec3 project(const Quadric& q, const DVec3& p) {
  return {p.x, p.y, curvature(q) * (p.x * p.x + p.y * p.y)};
}

bool inside(const Quadric& q, const DVec3& p) { return p.z >= q.z_min && p.z <= q.z_max; }

Meridian meridian(const Quadric& q, const DVec3& p, double r) {
  const double c = curvature(q), range = static_cast<double>(q.z_max) - q.z_min;
  Meridian k;
  k.v = (p.z - q.z_min) / range;
  k.normal_r = 2 * c * radius_of(p);
  k.normal_z = -1;
  k.z1 = range;
  k.r1 = range / (2 * c * r);
  k.r2 = -square(range) / (4 * c * c * r * r * r);
  return k;
}

// phi_max / (12 c^2) (a^(3/2) - b^(3/2)) with a, b = 1 + 4 c z, written without the difference.
double area(const Quadric& q) {
  const double c = curvature(q), z_min = std::max(q.z_min, 0.f), z_max = q.z_max;
  const double a = 1 + 4 * c * z_max, b = 1 + 4 * c * z_min;
  return q.phi_max * (z_max - z_min) / (3 * c) * (a * a + a * b + b * b) /
         (a * std::sqrt(a) + b * std::sqrt(b));
}

}  // namespace

const QuadricOps kParaboloidOps{
    equation, project, inside, meridian, area, [](const Quadric& q) -> double { return q.radius; },
    nullptr};

ShapeGeometry make_paraboloid(const ShapeDesc& shape, Dialect dialect, Warnings&) {
  Quadric q = begin_quadric(shape, QuadricKind::paraboloid, dialect);
  q.radius = positive_parameter(shape, "radius", 1.f);
  read_z_range(shape, 0.f, 1.f, q);
  if (!(q.z_max > 0.f))
    throw EmptyShape(location_of(shape, "zmax"), fmt::format("zmax must be > 0, got {}", q.z_max));
  return q;
}

}  // namespace cloudrenderer
