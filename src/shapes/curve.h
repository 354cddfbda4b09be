#pragma once
// Curves as pbrt-v3 and v4 have them: a cubic with a width, that turns its flat side to the ray ("flat"), does so and is
// shaded as if it were round ("cylinder"), or keeps the side that its normals say ("ribbon").
#include <array>
#include <cstdint>

#include "base/bulk_array.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

template <class F>
struct SurfacePointOf;
using SurfacePoint = SurfacePointOf<float>;

enum class CurveKind : std::uint32_t { flat, cylinder, ribbon };

// One Shape "curve": cubic Bezier pieces that follow each other.
struct CurveChain {
  CurveKind kind = CurveKind::flat;
  float width[2] = {1, 1};  // at the chain's ends, linear in between
  BulkArray<Vec3> points;   // 3 a piece and a last one
  BulkArray<Vec3> normals;  // ribbons: unit, one a piece and a last one
  // Each piece is cut into 2^this segments, which have boxes of their own: thin curves fill little of their box.
  std::uint32_t log2_segments = 0;
  // Identity where points and widths could be put into world space, which only similarities can that do not mirror.
  Transform object_to_world;

  std::size_t pieces() const { return points.empty() ? 0 : (points.size() - 1) / 3; }
};

// One piece, put together from where it is stored. All of it in the curve's object space.
struct CurvePiece {
  CurveKind kind = CurveKind::flat;
  std::array<Vec3, 4> p{};
  std::array<float, 2> width{};
  std::array<Vec3, 2> n{};  // ribbons
};

// A ray as the curve's object space sees it, in double precision: curves are thin, and rays start far away.
struct CurveRay {
  glm::dvec3 origin, direction;
};

// v runs across the curve, 0 to 1. t is the ray's distance to the middle of the curve, as in pbrt: its flat side has
// no depth.
struct CurveHit {
  float t = kInfinity, u = 0, v = 0;
};

// The nearest hit with t_min < t <= t_max on the part of the piece between u0 and u1. A pure function of its arguments;
// neighbouring parts leave no gap.
bool intersect(const CurvePiece& c, double u0, double u1, const CurveRay& ray, float t_min, float t_max, CurveHit& hit);

// True if a ray in float surely misses segment `number` of 2^log2_segments (at most 8) of the cubic of four `points`: a
// test before intersect(), which most boxes of thin curves that a ray meets do not pass.
bool surely_misses(const Vec3* points, float largest_width, std::uint32_t log2_segments, std::uint32_t number,
                   const Vec3& origin, const Vec3& direction, float t_min, float t_max);

// The point of a hit, in object space. Its error is pbrt-v3's: rays start twice the width away from the curve.
SurfacePoint surface_point(const CurvePiece& c, bool flip, const glm::dvec3& direction, float u, float v);

// Of the part between u0 and u1, in object space.
Bounds3 object_bounds(const CurvePiece& c, double u0, double u1);
// That part as a piece of its own.
CurvePiece part_of(const CurvePiece& c, double u0, double u1);

}  // namespace cloudrenderer
