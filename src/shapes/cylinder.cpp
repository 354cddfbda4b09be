// Shape "cylinder": radius (1), zmin (-1), zmax (1), phimax (360).
#include "base/portable_math.h"
#include "shapes/quadric.h"
#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

RayEquation equation(const Quadric& q, const DVec3& o, const DVec3& d) {
  const double radius = q.radius, r = radius_of(o);
  return {d.x * d.x + d.y * d.y, o.x * d.x + o.y * d.y, (r - radius) * (r + radius)};
}

DVec3 project(const Quadric& q, const DVec3& p) { return with_radius(p, q.radius); }

bool inside(const Quadric& q, const DVec3& p) { return p.z >= q.z_min && p.z <= q.z_max; }

Meridian meridian(const Quadric& q, const DVec3& p, double) {
  const double z_min = q.z_min;
  Meridian k;
  k.z1 = q.z_max - z_min;
  k.v = (p.z - z_min) / k.z1;
  k.normal_r = 1;
  return k;
}

double area(const Quadric& q) {
  return static_cast<double>(q.phi_max) * q.radius * (static_cast<double>(q.z_max) - q.z_min);
}

void sample(const Quadric& q, const Vec2& u, DVec3& p, DVec3& n) {
  float s, c;
  portable::sincos(u.y * q.phi_max, s, c);
  // The side that pbrt samples is the outer one, whatever side of a mirrored cylinder it sees; sample_area() turns it.
  n = DVec3(c, s, 0);
  if (q.inside_out) n = -n;
  const double z = q.z_min + static_cast<double>(u.x) * (static_cast<double>(q.z_max) - q.z_min);
  p = project(q, DVec3(c, s, z));
}

}  // namespace

const QuadricOps kCylinderOps{
    equation, project, inside, meridian, area, [](const Quadric& q) -> double { return q.radius; },
    sample};

ShapeGeometry make_cylinder(const ShapeDesc& shape, Dialect dialect, Warnings&) {
  Quadric q = begin_quadric(shape, QuadricKind::cylinder, dialect);
  q.radius = positive_parameter(shape, "radius", 1.f);
  read_z_range(shape, -1.f, 1.f, q);
  return q;
}

}  // namespace cloudrenderer
