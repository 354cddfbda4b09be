#pragma once
#include <cstdint>
#include <variant>
#include <vector>

#include "base/bulk_array.h"
#include "base/lanes.h"
#include "base/log.h"
#include "cloudrenderer/math.h"
#include "scene/description.h"
#include "shapes/curve.h"

namespace cloudrenderer {

using Triangle = glm::u32vec3;  // three vertex indices

// Triangles in world space (or in the space of the prototype).
struct TriangleMesh {
  BulkArray<Vec3> positions;
  BulkArray<Vec3> normals;  // empty, or one a vertex; not normalised as given
  BulkArray<Vec2> uvs;  // empty, or one a vertex; when empty every triangle has (0,0) (1,0) (1,1)
  BulkArray<Triangle> triangles;  // every index < positions.size()
};

enum class QuadricKind : std::uint32_t { sphere, cylinder, disk, cone, paraboloid, hyperboloid };

// An exact analytic shape in object space, with pbrt's parametrisation. Plain data: it is stored in
// parts as it is.
struct Quadric {
  QuadricKind kind = QuadricKind::sphere;
  float radius = 1, inner_radius = 0, height = 0;
  float z_min = -1, z_max = 1;  // of every kind: where the shape lies along its axis
  float phi_max = 2 * kPi;      // radians
  Vec3 p1{}, p2{};              // hyperboloid
  // pbrt-v3 under a mirrored transform: it flips the normal in object space, where nothing is
  // mirrored, so that its normal points the other way than pbrt-v2's. Set by make_geometry.
  std::uint32_t inside_out = 0;
  Transform object_to_world;  // affine and invertible; only its matrix counts, the inverse is made
                              // in double
};

using ShapeGeometry = std::variant<TriangleMesh, Quadric, CurveChain>;

// Builds the geometry of a shape. Throws SceneError for parameters that make no shape; degenerate
// triangles are kept (Embree never reports them), and an unknown or unsupported kind is a warning
// and gives an empty mesh. Files (PLY) are named by absolute path in the parameters. Normals of a
// mesh come out with pbrt's sign: pbrt-v2 turns them for ReverseOrientation xor a mirrored
// transform, pbrt-v3 for ReverseOrientation alone.
ShapeGeometry make_geometry(const ShapeDesc& shape, Dialect dialect, Warnings& warnings);

Bounds3 world_bounds(const Quadric& q);
float surface_area(
    const Quadric& q);  // of the whole shape in world space; exact for similarity transforms

// A point of the quadric, uniform by area in object space, with its oriented normal and its density
// by world area, which is exact for every affine transform (and constant for similarities).
// Spheres, cylinders and disks, whole or clipped; false for other kinds. `flip` as for
// surface_point.
bool sample_area(const Quadric& q, bool flip, const Vec2& u, Vec3& p, Vec3& n, float& pdf_area);
// The density that sample_area has at a point with the world normal n (either side); 0 for other
// kinds.
float area_pdf(const Quadric& q, const Vec3& n);

// What a ray finds on a quadric. t is in units of the world ray's direction.
struct QuadricHit {
  float t = kInfinity;
};
// The nearest hit with t_min < t <= t_max, computed without cancellation; a pure function of its
// arguments. The ray is in world space (or prototype space).
bool intersect(const Quadric& q, const Vec3& origin, const Vec3& direction, float t_min,
               float t_max, QuadricHit& hit);

// A point of a surface, made from a hit: all that shading needs to know of geometry. F: one point, or eight in lanes.
template <class F>
struct SurfacePointOf {
  Vec3Of<F> p{};        // world
  Vec3Of<F> p_error{};  // absolute bound of the error of p, each axis, so that new rays can start
                   // outside of it
  Vec3Of<F> ng{};  // unit geometric normal, on the side that pbrt calls outside (orientation, handedness
              // applied)
  Vec3Of<F> ns{};  // unit shading normal, in the hemisphere that pbrt gives it
  Vec2Of<F> uv{};
  Vec3Of<F> dpdu{}, dpdv{};  // of the surface
  Vec3Of<F> dndu{}, dndv{};  // of the unit shading normal ns, its sign included
  // The tangents of the shading frame, orthogonal to ns, not normalised. Where a mesh has normals
  // they are what pbrt-v2 and v3 make: unit vectors *against* dpdu and dpdv. Bump maps look as in
  // pbrt only with these.
  Vec3Of<F> shading_dpdu{}, shading_dpdv{};
};
using SurfacePoint = SurfacePointOf<float>;

// The point of a hit that intersect() found for this ray: p lies on the surface up to the rounding
// of p itself. `flip` is reverse_orientation xor object_to_world.swaps_handedness().
SurfacePoint surface_point(const Quadric& q, bool flip, const Vec3& origin, const Vec3& direction,
                           float t);

}  // namespace cloudrenderer
