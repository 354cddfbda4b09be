// Shape "curve": P, width, width0, width1, degree, basis, type, N, splitdepth (pbrt-v3 and v4).
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "shapes/quadric_builder.h"

namespace cloudrenderer {

namespace {

// More segments than this take more memory than they save time (each has a box in the BVH).
constexpr int kMostLog2Segments = 3;

Vec3 lerp(const Vec3& a, const Vec3& b, float w) { return (1.f - w) * a + w * b; }

// Control points of quadratic and B-spline curves as those of cubic Bezier pieces: raised in degree, and by blossoms.
class ChainWriter {
 public:
  void quadratic(const Vec3& a, const Vec3& b, const Vec3& c) { cubic(a, lerp(a, b, 2.f / 3), lerp(b, c, 1.f / 3), c); }
  void cubic(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
    if (points_.size() == 0) points_.push_back(a);  // else the end of the piece before
    for (const Vec3& p : {b, c, d}) points_.push_back(p);
  }
  BulkArray<Vec3> finish() { return points_.finish(); }

 private:
  BulkWriter<Vec3> points_;
};

BulkArray<Vec3> as_bezier(const ShapeDesc& shape, std::span<const Vec3> p) {
  const int degree = shape.params.integer("degree", 3);
  if (degree != 2 && degree != 3)
    throw SceneError(location_of(shape, "degree"), fmt::format("degree must be 2 or 3, got {}", degree));
  const std::string basis = shape.params.string("basis", "bezier");
  if (basis != "bezier" && basis != "bspline")
    throw SceneError(location_of(shape, "basis"), "basis must be \"bezier\" or \"bspline\", got \"" + basis + "\"");
  const auto d = static_cast<std::size_t>(degree);
  const FileLocation& where = location_of(shape, "P");
  ChainWriter chain;
  if (basis == "bezier") {
    if (p.size() < d + 1 || (p.size() - 1) % d != 0)
      throw SceneError(where, fmt::format("a bezier curve of degree {} needs {} + n * {} points, got {}", degree, d + 1, d, p.size()));
    for (std::size_t i = 0; i + d < p.size(); i += d)
      d == 2 ? chain.quadratic(p[i], p[i + 1], p[i + 2]) : chain.cubic(p[i], p[i + 1], p[i + 2], p[i + 3]);
  } else {
    if (p.size() < d + 1)
      throw SceneError(where, fmt::format("a bspline curve of degree {} needs at least {} points, got {}", degree, d + 1, p.size()));
    for (std::size_t i = 0; i + d < p.size(); ++i) {
      if (d == 2) {
        chain.quadratic(lerp(p[i], p[i + 1], 0.5f), p[i + 1], lerp(p[i + 1], p[i + 2], 0.5f));
        continue;
      }
      const Vec3 a = lerp(p[i], p[i + 1], 2.f / 3), b = lerp(p[i + 1], p[i + 2], 1.f / 3);
      const Vec3 c = lerp(p[i + 1], p[i + 2], 2.f / 3), e = lerp(p[i + 2], p[i + 3], 1.f / 3);
      chain.cubic(lerp(a, b, 0.5f), b, c, lerp(c, e, 0.5f));
    }
  }
  return chain.finish();
}

float width_parameter(const ShapeDesc& shape, const char* name, float otherwise) {
  const float width = finite_parameter(shape, name, otherwise);
  if (width < 0.f) throw SceneError(location_of(shape, name), fmt::format("{} must be >= 0, got {}", name, width));
  return width;
}

CurveKind kind_of(const ShapeDesc& shape, Warnings& warnings) {
  const std::string type = shape.params.string("type", "flat");
  if (type == "flat") return CurveKind::flat;
  if (type == "ribbon") return CurveKind::ribbon;
  if (type != "cylinder")
    warnings.add(location_of(shape, "type"),
                 "unknown type \"" + type + "\" of a curve (known: flat, cylinder, ribbon); cylinder is used");
  return CurveKind::cylinder;
}

BulkArray<Vec3> read_normals(const ShapeDesc& shape, CurveKind kind, std::size_t pieces, Warnings& warnings) {
  const BulkArray<float> numbers = shape.params.reals("N");
  if (kind != CurveKind::ribbon) {
    if (!numbers.empty()) warnings.add(location_of(shape, "N"), "normals of a curve have an effect on ribbons only");
    return {};
  }
  if (numbers.size() != 3 * (pieces + 1))
    throw SceneError(location_of(shape, "N"), fmt::format("a ribbon of {} pieces needs {} normals N, got {}", pieces,
                                                          pieces + 1, numbers.size() / 3));
  std::vector<Vec3> normals;
  for (std::size_t i = 0; i <= pieces; ++i) {
    const Vec3 n(numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]);
    const float largest = std::max({std::abs(n.x), std::abs(n.y), std::abs(n.z)});
    if (!(largest > 0.f && largest < kInfinity))
      throw SceneError(location_of(shape, "N"), fmt::format("normal {} of the ribbon must be finite and not null", i));
    normals.push_back(glm::normalize(n / largest));
  }
  return BulkArray<Vec3>(std::move(normals));
}

// The factor by which a similarity that does not mirror makes everything larger; 0 for all other transforms.
float similarity_scale(const Mat4& m) {
  const Vec3 x(m[0]), y(m[1]), z(m[2]);
  const float xx = glm::dot(x, x), tolerance = 1e-5f * xx;
  const bool similar = std::abs(glm::dot(y, y) - xx) < tolerance && std::abs(glm::dot(z, z) - xx) < tolerance &&
                       std::abs(glm::dot(x, y)) < tolerance && std::abs(glm::dot(x, z)) < tolerance &&
                       std::abs(glm::dot(y, z)) < tolerance;
  return similar && glm::determinant(glm::mat3(m)) > 0.f ? std::sqrt(xx) : 0.f;
}

template <class Move>
BulkArray<Vec3> moved(const BulkArray<Vec3>& from, Move move) {
  BulkWriter<Vec3> out;
  for (const Vec3& p : from) out.push_back(move(p));
  return out.finish();
}

// Pieces much longer than wide are cut: the box of a slanting hair is nearly empty.
std::uint32_t choose_segments(const ShapeDesc& shape, const CurveChain& chain) {
  const Param* given = shape.params.find("splitdepth");
  const int most = given && given->type == ParamType::real ? static_cast<int>(std::clamp(shape.params.real("splitdepth", 3), 0.f, 100.f))
                                                           : shape.params.integer("splitdepth", 3);
  double length = 0;
  for (std::size_t i = 1; i < chain.points.size(); ++i) length += static_cast<double>(glm::length(chain.points[i] - chain.points[i - 1]));
  length /= static_cast<double>(chain.pieces());
  const double width = std::max(chain.width[0], chain.width[1]);
  int n = 0;
  while (n < std::min(most, kMostLog2Segments) && length > 8 * width * (1 << n)) ++n;
  return static_cast<std::uint32_t>(n);
}

}  // namespace

ShapeGeometry make_curve(const ShapeDesc& shape, Dialect, Warnings& warnings) {
  const ParamSet& params = shape.params;
  const Mat4& m = shape.object_to_world.matrix();
  if (m[0].w != 0.f || m[1].w != 0.f || m[2].w != 0.f || m[3].w != 1.f)
    throw SceneError(shape.location, "Shape \"curve\" cannot have a perspective transform");
  const BulkArray<float> numbers = params.reals("P");
  if (numbers.size() % 3)
    throw SceneError(location_of(shape, "P"), fmt::format("{} numbers do not make points", numbers.size()));
  std::vector<Vec3> points;
  for (std::size_t i = 0; i + 2 < numbers.size(); i += 3) {
    points.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
    if (!is_finite(points.back()))
      throw SceneError(location_of(shape, "P"), fmt::format("point {} of the curve is not finite", i / 3));
  }
  CurveChain chain;
  const float width = width_parameter(shape, "width", 1.f);
  chain.width[0] = width_parameter(shape, "width0", width);
  chain.width[1] = width_parameter(shape, "width1", width);
  chain.points = as_bezier(shape, points);
  chain.kind = kind_of(shape, warnings);
  chain.normals = read_normals(shape, chain.kind, chain.pieces(), warnings);
  if (chain.width[0] == 0.f && chain.width[1] == 0.f) {
    warnings.add(shape.location, "a curve without width is left out");
    return TriangleMesh{};
  }
  chain.log2_segments = choose_segments(shape, chain);
  chain.object_to_world = shape.object_to_world;
  if (const float scale = similarity_scale(m); scale > 0.f) {
    chain.object_to_world = Transform();
    if (!shape.object_to_world.is_identity()) {
      chain.points = moved(chain.points, [&](const Vec3& p) { return shape.object_to_world.point(p); });
      chain.normals = moved(chain.normals, [&](const Vec3& n) { return glm::normalize(shape.object_to_world.vector(n)); });
      for (float& w : chain.width) w *= scale;
    }
  }
  return chain;
}

}  // namespace cloudrenderer
