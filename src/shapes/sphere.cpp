// Shape "sphere": radius (1), zmin (-radius), zmax (radius), phimax (360).
#include <spdlog/fmt/fmt.h>

#include "base/portable_math.h"
#include "shapes/quadric.h"
#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

RayEquation equation(const Quadric& q, const DVec3& o, const DVec3& d) {
  const double radius = q.radius, distance = glm::length(o);
  return {glm::dot(d, d), glm::dot(o, d), (distance - radius) * (distance + radius)};
}

DVec3 project(const Quadric& q, const DVec3& p) {
  const double distance = glm::length(p), radius = q.radius;
  return distance > 0 ? p * (radius / distance) : DVec3(radius, 0, 0);
}

bool inside(const Quadric& q, const DVec3& p) {
  return (q.z_min <= -q.radius || p.z >= q.z_min) && (q.z_max >= q.radius || p.z <= q.z_max);
}

// The angle from the +z axis.
double polar_angle(double r, double z, double radius) {
  return portable::atan2(static_cast<float>(r / radius), static_cast<float>(z / radius));
}
double polar_angle_of_height(const Quadric& q, double z) {
  const double radius = q.radius;
  return polar_angle(std::sqrt(std::max(0.0, (radius - z) * (radius + z))), z, radius);
}

Meridian meridian(const Quadric& q, const DVec3& p, double r) {
  const double first = polar_angle_of_height(q, q.z_min);
  const double range = polar_angle_of_height(q, q.z_max) - first;
  const double on_axis = radius_of(p);
  Meridian k;
  k.v = (polar_angle(on_axis, p.z, q.radius) - first) / range;
  k.normal_r = on_axis;  // range < 0, so v grows upwards
  k.normal_z = p.z;
  k.r1 = range * p.z;
  k.z1 = -range * r;
  k.r2 = -range * range * r;
  k.z2 = -range * range * p.z;
  return k;
}

double area(const Quadric& q) {
  return static_cast<double>(q.phi_max) * q.radius * (static_cast<double>(q.z_max) - q.z_min);
}

// A slice of a sphere has the area of the slice of its cylinder (Archimedes): heights are uniform.
void sample(const Quadric& q, const Vec2& u, DVec3& p, DVec3& n) {
  const double z = q.z_min + static_cast<double>(u.x) * (static_cast<double>(q.z_max) - q.z_min);
  const double radius = q.radius, r = std::sqrt(std::max(0.0, (radius - z) * (radius + z)));
  float s, c;
  portable::sincos(u.y * q.phi_max, s, c);
  n = p = project(q, DVec3(r * static_cast<double>(c), r * static_cast<double>(s), z));
}

}  // namespace

const QuadricOps kSphereOps{equation, project, inside,
                            meridian, area,    [](const Quadric& q) -> double { return q.radius; },
                            sample};

ShapeGeometry make_sphere(const ShapeDesc& shape, Dialect dialect, Warnings&) {
  Quadric q = begin_quadric(shape, QuadricKind::sphere, dialect);
  q.radius = positive_parameter(shape, "radius", 1.f);
  read_z_range(shape, -q.radius, q.radius, q);
  q.z_min = std::clamp(q.z_min, -q.radius, q.radius);
  q.z_max = std::clamp(q.z_max, -q.radius, q.radius);
  if (!(q.z_min < q.z_max))
    throw EmptyShape(
        location_of(shape, "zmin"),
        fmt::format("nothing of the sphere of radius {} lies between zmin and zmax", q.radius));
  return q;
}

}  // namespace cloudrenderer
