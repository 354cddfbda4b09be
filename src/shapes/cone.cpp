// Shape "cone": radius (1) at z = 0, height (1) of the apex, phimax (360).
#include "shapes/quadric.h"
#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

RayEquation equation(const Quadric& q, const DVec3& o, const DVec3& d) {
  const double slope = static_cast<double>(q.radius) / q.height;
  const double cone_r = slope * (o.z - q.height), cone_d = slope * d.z, r = radius_of(o);
  return {d.x * d.x + d.y * d.y - cone_d * cone_d, o.x * d.x + o.y * d.y - cone_r * cone_d,
          (r - cone_r) * (r + cone_r)};
}

DVec3 project(const Quadric& q, const DVec3& p) {
  return with_radius(p, q.radius * std::abs(1 - p.z / q.height));
}

bool inside(const Quadric& q, const DVec3& p) { return p.z >= 0 && p.z <= q.height; }

Meridian meridian(const Quadric& q, const DVec3& p, double) {
  Meridian k;
  k.v = p.z / q.height;
  k.normal_r = q.height;
  k.normal_z = q.radius;
  k.r1 = -q.radius;
  k.z1 = q.height;
  return k;
}

double area(const Quadric& q) {
  return 0.5 * q.phi_max * q.radius * std::sqrt(square(q.height) + square(q.radius));
}

}  // namespace

const QuadricOps kConeOps{equation, project, inside,
                          meridian, area,    [](const Quadric& q) -> double { return q.radius; },
                          nullptr};

ShapeGeometry make_cone(const ShapeDesc& shape, Dialect dialect, Warnings&) {
  Quadric q = begin_quadric(shape, QuadricKind::cone, dialect);
  q.radius = positive_parameter(shape, "radius", 1.f);
  q.height = positive_parameter(shape, "height", 1.f);
  q.z_min = 0.f;
  q.z_max = q.height;
  return q;
}

}  // namespace cloudrenderer
