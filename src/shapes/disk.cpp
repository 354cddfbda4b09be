// Shape "disk": height (0), radius (1), innerradius (0), phimax (360).
#include <spdlog/fmt/fmt.h>

#include "base/portable_math.h"
#include "shapes/quadric.h"
#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

RayEquation equation(const Quadric& q, const DVec3& o, const DVec3& d) {
  return {0, 0.5 * d.z, o.z - q.height};
}

DVec3 project(const Quadric& q, const DVec3& p) { return {p.x, p.y, q.height}; }

bool inside(const Quadric& q, const DVec3& p) {
  const double r2 = p.x * p.x + p.y * p.y;
  return r2 <= square(q.radius) && r2 >= square(q.inner_radius);
}

Meridian meridian(const Quadric& q, const DVec3& p, double) {
  const double width = static_cast<double>(q.radius) - q.inner_radius;
  Meridian k;
  k.v = 1 - (radius_of(p) - q.inner_radius) / width;
  k.normal_z = 1;
  k.r1 = -width;
  return k;
}

double area(const Quadric& q) {
  return 0.5 * q.phi_max * (square(q.radius) - square(q.inner_radius));
}

void sample(const Quadric& q, const Vec2& u, DVec3& p, DVec3& n) {
  const double r2 = square(q.inner_radius);
  const double r = std::sqrt(r2 + static_cast<double>(u.x) * (square(q.radius) - r2));
  float s, c;
  portable::sincos(u.y * q.phi_max, s, c);
  p = DVec3(r * static_cast<double>(c), r * static_cast<double>(s), q.height);
  // The side that pbrt samples is +z whatever side it sees (see make_disk); sample_area() turns it.
  n = DVec3(0, 0, q.inside_out ? -1 : 1);
}

}  // namespace

const QuadricOps kDiskOps{equation, project, inside,
                          meridian, area,    [](const Quadric& q) -> double { return q.radius; },
                          sample};

ShapeGeometry make_disk(const ShapeDesc& shape, Dialect dialect, Warnings&) {
  Quadric q = begin_quadric(shape, QuadricKind::disk, dialect);
  q.radius = positive_parameter(shape, "radius", 1.f);
  q.inner_radius = finite_parameter(shape, "innerradius", 0.f);
  if (q.inner_radius < 0.f || q.inner_radius >= q.radius)
    throw EmptyShape(location_of(shape, "innerradius"),
                     fmt::format("innerradius must be >= 0 and less than radius ({}), got {}",
                                 q.radius, q.inner_radius));
  // pbrt-v2 sees a disk's -z side as the front, though it samples lights on +z: the references of
  // teapot-path and miscquads-direct show it.
  if (dialect == Dialect::v2) q.inside_out = 1;
  q.height = q.z_min = q.z_max = finite_parameter(shape, "height", 0.f);
  return q;
}

}  // namespace cloudrenderer
