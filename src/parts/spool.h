#pragma once
#include <cstdint>
#include <span>
#include <string>

#include "cloudrenderer/math.h"
#include "parts/mapped_file.h"
#include "parts/part.h"
#include "shapes/geometry.h"

namespace cloudrenderer {

// One shape of the scene with its place in the spooled arrays.
struct ShapeRow {
  static constexpr std::uint64_t kNoArray = ~std::uint64_t{0};

  std::uint32_t shape = 0;          // global id, or local to the prototype
  std::uint32_t prototype = kNone;  // none: stands in the world
  std::uint32_t material = kNone, light = kNone;
  std::uint32_t alpha_texture = kNone, shadow_alpha_texture = kNone;
  std::uint32_t flip = 0;
  std::uint32_t quadric = kNone;  // row of the quadrics; none: a mesh or a curve
  std::uint64_t first_vertex = 0, vertex_count = 0;
  std::uint64_t first_normal = kNoArray, first_uv = kNoArray;
  std::uint64_t first_triangle = 0, triangle_count = 0;
  Bounds3 box;
  float item_bytes = 0;  // predicted loaded bytes of one triangle, or of the quadric
  // Row of the curves: then vertices and normals are points and normals of curves, and triangles its segments.
  std::uint32_t curve = kNone;

  std::uint64_t item_count() const { return quadric == kNone ? triangle_count : 1; }
  float bytes() const { return item_bytes * static_cast<float>(item_count()); }
};

// A curve apart from its points, as CurveChain has it.
struct SpooledCurve {
  Transform object_to_world;
  CurveKind kind = CurveKind::flat;
  std::uint32_t log2_segments = 0;
  float width[2] = {1, 1};
};

// The geometry of a whole scene in temporary files.
class Spool {
 public:
  // Valid until the next map().
  struct View {
    std::span<const ShapeRow> rows;
    std::span<const Vec3> positions, normals;
    std::span<const Vec2> uvs;
    std::span<const Triangle> triangles;
    std::span<const Quadric> quadrics;
    std::span<const Vec3> curve_points, curve_normals;
    std::span<const SpooledCurve> curves;

    // A piece of a curve.
    CurvePiece piece(const ShapeRow& row, std::uint64_t number) const;
    // Box of an item of a curve; false when it is not fit for tracing.
    bool curve_box(const ShapeRow& row, std::uint32_t segment, Bounds3& box) const;
  };

  explicit Spool(const std::string& folder);
  // Both take the ids from `row`, fill in the rest and return the number of the new row, or none
  // when there is nothing in it. `dropped` counts triangles that are not finite: they are in no
  // part.
  std::uint32_t add_mesh(ShapeRow& row, std::span<const Vec3> positions,
                         std::span<const Vec3> normals, std::span<const Vec2> uvs,
                         std::span<const Triangle> triangles, std::uint64_t& dropped);
  std::uint32_t add_quadric(ShapeRow& row, const Quadric& quadric);
  std::uint32_t add_curve(ShapeRow& row, const CurveChain& curve, std::uint64_t& dropped);
  // A copy of a shape of `view`, moved; only shape and prototype of `row` count, the rest is filled
  // in.
  std::uint32_t add_moved(const View& view, const ShapeRow& source, const Transform& to,
                          ShapeRow& row);
  View map();

 private:
  SpoolArray<ShapeRow> rows_;
  SpoolArray<Vec3> positions_, normals_;
  SpoolArray<Vec2> uvs_;
  SpoolArray<Triangle> triangles_;
  SpoolArray<Quadric> quadrics_;
  SpoolArray<Vec3> curve_points_, curve_normals_;
  SpoolArray<SpooledCurve> curves_;
};

// Box of a triangle; false when it is not fit for tracing.
bool triangle_box(std::span<const Vec3> positions, const Triangle& t, Bounds3& box);
// A box grown by a few roundings of its coordinates, for shapes whose hits are computed in another
// space.
Bounds3 grown(const Bounds3& box);

}  // namespace cloudrenderer
