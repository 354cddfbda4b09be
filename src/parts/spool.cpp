#include "parts/spool.h"

#include <vector>

#include "parts/part_builder.h"
#include "parts/part_format.h"

namespace cloudrenderer {
namespace {

// Vertices of a moved mesh that are in memory at a time.
constexpr std::size_t kBlock = 4096;

template <class T, class Move>
void append_moved(SpoolArray<T>& to, std::span<const T> from, const Move& move) {
  std::vector<T> block;
  for (std::size_t i = 0; i < from.size(); i += kBlock) {
    block.assign(from.begin() + static_cast<std::ptrdiff_t>(i),
                 from.begin() + static_cast<std::ptrdiff_t>(std::min(from.size(), i + kBlock)));
    for (T& v : block) v = move(v);
    to.append(block);
  }
}

float triangle_bytes(std::size_t vertices, std::size_t triangles, bool normals, bool uvs) {
  const auto vertex =
      static_cast<double>(sizeof(Vec3) + (normals ? sizeof(Vec3) : 0) + (uvs ? sizeof(Vec2) : 0));
  const double shared = static_cast<double>(vertices) / static_cast<double>(triangles);
  return static_cast<float>(
      static_cast<double>(loaded_bytes::kBvhTriangle + sizeof(Triangle) + sizeof(std::uint32_t)) +
      std::min(3.0, shared) * (vertex + 0.5 * static_cast<double>(loaded_bytes::kBvhTwoVertices)));
}

bool fits_tracing(const Bounds3& box) {
  const auto bounded = [](const Vec3& v) { return max_component(glm::abs(v)) <= part_format::kLargest; };
  return !box.empty() && bounded(box.min) && bounded(box.max);
}

}  // namespace

bool triangle_box(std::span<const Vec3> positions, const Triangle& t, Bounds3& box) {
  box = {};
  bool ok = true;
  for (int i = 0; i < 3; ++i) {
    const Vec3& p = positions[t[i]];
    for (int a = 0; a < 3; ++a) ok &= std::fabs(p[a]) <= part_format::kLargest;
    box.extend(p);
  }
  return ok;
}

Bounds3 grown(const Bounds3& box) {
  if (box.empty()) return box;
  const Vec3 e = 0x1p-20f * glm::max(glm::abs(box.min), glm::abs(box.max));
  return {box.min - e, box.max + e};
}

Spool::Spool(const std::string& folder)
    : rows_(folder),
      positions_(folder),
      normals_(folder),
      uvs_(folder),
      triangles_(folder),
      quadrics_(folder),
      curve_points_(folder),
      curve_normals_(folder),
      curves_(folder) {}

std::uint32_t Spool::add_mesh(ShapeRow& row, std::span<const Vec3> positions,
                              std::span<const Vec3> normals, std::span<const Vec2> uvs,
                              std::span<const Triangle> triangles, std::uint64_t& dropped) {
  row.box = {};
  std::uint64_t kept = 0;
  for (const Triangle& t : triangles) {
    Bounds3 box;
    if (!triangle_box(positions, t, box)) continue;
    row.box.extend(box);
    ++kept;
  }
  dropped += triangles.size() - kept;
  if (kept == 0) return kNone;
  row.first_vertex = positions_.size();
  row.vertex_count = positions.size();
  row.first_normal = normals.empty() ? ShapeRow::kNoArray : normals_.size();
  row.first_uv = uvs.empty() ? ShapeRow::kNoArray : uvs_.size();
  row.first_triangle = triangles_.size();
  row.triangle_count = triangles.size();
  row.item_bytes =
      triangle_bytes(positions.size(), triangles.size(), !normals.empty(), !uvs.empty());
  positions_.append(positions);
  normals_.append(normals);
  uvs_.append(uvs);
  triangles_.append(triangles);
  rows_.push_back(row);
  return static_cast<std::uint32_t>(rows_.size() - 1);
}

std::uint32_t Spool::add_quadric(ShapeRow& row, const Quadric& quadric) {
  row.box = grown(world_bounds(quadric));
  if (!fits_tracing(row.box)) return kNone;
  row.quadric = static_cast<std::uint32_t>(quadrics_.size());
  row.item_bytes = static_cast<float>(loaded_bytes::kQuadric);
  quadrics_.push_back(quadric);
  rows_.push_back(row);
  return static_cast<std::uint32_t>(rows_.size() - 1);
}

std::uint32_t Spool::add_moved(const View& view, const ShapeRow& source, const Transform& to,
                               ShapeRow& row) {
  const std::uint32_t shape = row.shape, prototype = row.prototype;
  row = source;
  row.shape = shape;
  row.prototype = prototype;
  // The moved normal must be the normal of the moved shape: a mirroring turns the cross product of
  // the edges.
  row.flip = source.flip ^ (to.swaps_handedness() ? 1u : 0u);
  if (source.curve != kNone) {
    // Points, normals and widths stay as they are: their place in the world is another.
    SpooledCurve curve = view.curves[source.curve];
    curve.object_to_world = to * curve.object_to_world;
    row.curve = static_cast<std::uint32_t>(curves_.size());
    row.box = grown(source.box.transformed(to));
    if (!fits_tracing(row.box)) return kNone;
    curves_.push_back(curve);
    rows_.push_back(row);
    return static_cast<std::uint32_t>(rows_.size() - 1);
  }
  if (source.quadric != kNone) {
    Quadric q = view.quadrics[source.quadric];
    q.object_to_world = to * q.object_to_world;
    return add_quadric(row, q);
  }
  const auto part = [](auto span, std::uint64_t first, std::uint64_t count) {
    return span.subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(count));
  };
  row.first_vertex = positions_.size();
  append_moved(positions_, part(view.positions, source.first_vertex, source.vertex_count),
               [&](const Vec3& p) { return to.point(p); });
  if (source.first_normal != ShapeRow::kNoArray) {
    row.first_normal = normals_.size();
    append_moved(normals_, part(view.normals, source.first_normal, source.vertex_count),
                 [&](const Vec3& n) { return to.normal(n); });
  }
  // Indices and uvs do not change and are shared.
  row.box = {};
  const auto positions = part(view.positions, source.first_vertex, source.vertex_count);
  for (const Triangle& t : part(view.triangles, source.first_triangle, source.triangle_count))
    for (int i = 0; i < 3; ++i) {
      const Vec3 p = to.point(positions[t[i]]);
      if (is_finite(p)) row.box.extend(p);
    }
  if (row.box.empty()) return kNone;
  rows_.push_back(row);
  return static_cast<std::uint32_t>(rows_.size() - 1);
}

std::uint32_t Spool::add_curve(ShapeRow& row, const CurveChain& curve, std::uint64_t& dropped) {
  const std::uint64_t pieces = curve.pieces(), segments = pieces << curve.log2_segments;
  row.curve = static_cast<std::uint32_t>(curves_.size());
  row.first_vertex = curve_points_.size();
  row.vertex_count = curve.points.size();
  row.first_normal = curve.normals.empty() ? ShapeRow::kNoArray : curve_normals_.size();
  row.first_triangle = 0;
  row.triangle_count = segments;
  // Groups are shared by many curves as a rule.
  const std::uint64_t own = loaded_bytes::kCurvePiece + (curve.normals.empty() ? 0 : sizeof(Vec3));
  row.item_bytes = static_cast<float>(loaded_bytes::kCurveSegment) +
                   static_cast<float>(own) / static_cast<float>(1u << curve.log2_segments);
  const SpooledCurve spooled{curve.object_to_world, curve.kind, curve.log2_segments, {curve.width[0], curve.width[1]}};
  row.box = {};
  View view;  // of this curve alone
  ShapeRow own_row = row;
  own_row.curve = 0;
  own_row.first_vertex = 0;
  if (!curve.normals.empty()) own_row.first_normal = 0;
  view.curve_points = curve.points.view();
  view.curve_normals = curve.normals.view();
  view.curves = {&spooled, 1};
  for (std::uint64_t i = 0; i < segments; ++i) {
    Bounds3 box;
    if (view.curve_box(own_row, static_cast<std::uint32_t>(i), box))
      row.box.extend(box);
    else
      ++dropped;
  }
  if (segments >= kNone || row.box.empty()) return kNone;
  curve_points_.append(curve.points.view());
  curve_normals_.append(curve.normals.view());
  curves_.push_back(spooled);
  rows_.push_back(row);
  return static_cast<std::uint32_t>(rows_.size() - 1);
}

CurvePiece Spool::View::piece(const ShapeRow& row, std::uint64_t number) const {
  const SpooledCurve& curve = curves[row.curve];
  const auto count = static_cast<float>((row.vertex_count - 1) / 3);
  CurvePiece out;
  out.kind = curve.kind;
  std::copy_n(curve_points.begin() + static_cast<std::ptrdiff_t>(row.first_vertex + 3 * number), 4, out.p.begin());
  for (std::size_t i = 0; i < 2; ++i) {
    const float w = static_cast<float>(number + i) / count;
    out.width[i] = (1.f - w) * curve.width[0] + w * curve.width[1];
  }
  if (row.first_normal != ShapeRow::kNoArray)
    std::copy_n(curve_normals.begin() + static_cast<std::ptrdiff_t>(row.first_normal + number), 2, out.n.begin());
  return out;
}

bool Spool::View::curve_box(const ShapeRow& row, std::uint32_t segment, Bounds3& box) const {
  const SpooledCurve& curve = curves[row.curve];
  const std::uint32_t count = 1u << curve.log2_segments, number = segment & (count - 1);
  const double step = 1.0 / count;
  box = object_bounds(piece(row, segment >> curve.log2_segments), number * step, (number + 1) * step);
  if (!curve.object_to_world.is_identity()) box = box.transformed(curve.object_to_world);
  box = grown(box);
  return fits_tracing(box);
}

Spool::View Spool::map() {
  return {rows_.map(),     positions_.map(),    normals_.map(),       uvs_.map(),   triangles_.map(),
          quadrics_.map(), curve_points_.map(), curve_normals_.map(), curves_.map()};
}

}  // namespace cloudrenderer
