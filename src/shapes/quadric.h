#pragma once
// What the six kinds of quadric have in common, and the table of what they have not. Everything is
// computed in double precision in object space: a ray may start millions of radii away, and float
// has nothing left there.
#include <glm/glm.hpp>

#include "shapes/geometry.h"

namespace cloudrenderer {

using DVec3 = glm::dvec3;

// The implicit equation along a ray: a t^2 + 2 b t + c = 0.
struct RayEquation {
  double a, b, c;
};

// The meridian through a point of the surface: position and derivatives in v, in the directions
// r (away from the axis), phi (around it) and z.
struct Meridian {
  double v = 0;
  double normal_r = 0, normal_z = 0;  // along dpdu x dpdv, not normalised
  double r1 = 0, phi1 = 0, z1 = 0;    // dpdv
  double r2 = 0, z2 = 0;              // second derivative
};

struct QuadricOps {
  RayEquation (*equation)(const Quadric&, const DVec3& origin, const DVec3& direction);
  DVec3 (*project)(const Quadric&,
                   const DVec3& p);  // a point almost on the unclipped surface -> on it
  bool (*inside)(const Quadric&, const DVec3& p);  // within the clipping in z or radius
  // `r` is the distance from the axis to use in divisions: never 0, see kAxisClearance.
  Meridian (*meridian)(const Quadric&, const DVec3& p, double r);
  double (*area)(const Quadric&);  // object space
  double (*max_radius)(const Quadric&);
  // Uniform by area: the point and its normal (not unit, on the side of dpdu x dpdv); null for most
  // kinds.
  void (*sample)(const Quadric&, const Vec2& u, DVec3& p, DVec3& n);
};

extern const QuadricOps kSphereOps, kCylinderOps, kDiskOps, kConeOps, kParaboloidOps,
    kHyperboloidOps;
const QuadricOps& quadric_ops(QuadricKind kind);

// Derivatives at the axis are those at this fraction of the shape's radius from it (pbrt uses the
// same for poles): frames and texture derivatives stay finite.
inline constexpr double kAxisClearance = 1e-5;

inline double radius_of(const DVec3& p) { return std::sqrt(p.x * p.x + p.y * p.y); }
inline DVec3 with_radius(const DVec3& p, double radius) {
  const double r = radius_of(p);
  return r > 0 ? DVec3(p.x * (radius / r), p.y * (radius / r), p.z) : DVec3(radius, 0, p.z);
}
inline double square(double x) { return x * x; }

}  // namespace cloudrenderer
