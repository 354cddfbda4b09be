// Shape "nurbs": nu, uorder, uknots, u0, u1, the same for v, P or Pw. pbrt cuts every surface into 29 x 29 squares; here
// each span between knots is cut as fine as its curvature asks for, with the surface's own normals at the vertices.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "shapes/mesh_builder.h"
#include "shapes/nurbs_surface.h"

namespace cloudrenderer {

namespace {

// How far triangles may be from the surface, in diagonals of its box; a whole sphere gets 40 squares around.
constexpr double kTolerance = 1.0 / 2000;
constexpr std::size_t kProbes = 8;         // places in each span where curvature is looked at
constexpr std::size_t kMostCuts = 64;      // of one span
constexpr double kMostVertices = 4 << 20;  // of a surface: coarser beyond

// One line of vertices: a parameter, and the span from which it is seen.
struct GridLine {
  std::size_t span = 0;
  double t = 0;
  bool joined = false;  // a strip of triangles lies between the line before and this one
};

struct Direction {
  std::string count, order, knots, first, last;  // parameter names
  explicit Direction(const std::string& letter)
      : count("n" + letter), order(letter + "order"), knots(letter + "knots"), first(letter + "0"), last(letter + "1") {}
};

// What of a span is used.
struct Interval {
  std::size_t span;
  double from, to;
};

KnotVector read_knots(const ShapeDesc& shape, const Direction& names, std::vector<Interval>& used) {
  const ParamSet& params = shape.params;
  const int count = params.integer(names.count, -1), order = params.integer(names.order, -1);
  if (order < 2 || order > static_cast<int>(kMaxNurbsOrder))
    throw SceneError(location_of(shape, names.order),
                     fmt::format("a nurbs needs {} between 2 and {}, got {}", names.order, kMaxNurbsOrder, order));
  if (count < order)
    throw SceneError(location_of(shape, names.count),
                     fmt::format("a nurbs needs {} >= {} ({}), got {}", names.count, names.order, order, count));
  KnotVector k;
  k.order = static_cast<std::size_t>(order);
  k.points = static_cast<std::size_t>(count);
  const FileLocation& at_knots = location_of(shape, names.knots);
  for (const float x : params.reals(names.knots)) k.knots.push_back(x);
  if (k.knots.size() != k.points + k.order)
    throw SceneError(at_knots, fmt::format("a nurbs needs {} + {} = {} {}, got {}", names.count, names.order,
                                           k.points + k.order, names.knots, k.knots.size()));
  for (std::size_t i = 0; i < k.knots.size(); ++i)
    if (!std::isfinite(k.knots[i]) || (i > 0 && k.knots[i] < k.knots[i - 1]))
      throw SceneError(at_knots, fmt::format("{} must be finite numbers that do not fall, number {} is {}", names.knots,
                                             i, k.knots[i]));
  const double low = k.knots[k.order - 1], high = k.knots[k.points];
  const double from = params.real(names.first, static_cast<float>(low));
  const double to = params.real(names.last, static_cast<float>(high));
  if (!(from < to && from >= low && to <= high))
    throw SceneError(location_of(shape, params.has(names.first) ? names.first : names.last),
                     fmt::format("{} and {} must be a range within the knots' {} to {}, got {} and {}", names.first,
                                 names.last, low, high, from, to));
  for (const std::size_t span : k.spans()) {
    const double a = std::max(from, k.knots[span]), b = std::min(to, k.knots[span + 1]);
    if (a < b) used.push_back({span, a, b});
  }
  return k;
}

std::vector<glm::dvec4> read_points(const ShapeDesc& shape, std::size_t count) {
  const bool weighted = !shape.params.has("P");
  const char* name = weighted ? "Pw" : "P";
  const std::size_t parts = weighted ? 4 : 3;
  const BulkArray<float> numbers = shape.params.reals(name);
  if (numbers.empty()) throw SceneError(shape.location, "a nurbs needs \"P\" or \"Pw\"");
  if (numbers.size() != parts * count)
    throw SceneError(location_of(shape, name),
                     fmt::format("a nurbs of nu x nv = {} points needs {} numbers in {}, got {}", count, parts * count,
                                 name, numbers.size()));
  std::vector<glm::dvec4> points;
  points.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    glm::dvec4 p(0, 0, 0, 1);
    for (std::size_t c = 0; c < parts; ++c) {
      p[static_cast<int>(c)] = numbers[parts * i + c];
      if (!std::isfinite(numbers[parts * i + c]))
        throw SceneError(location_of(shape, name), fmt::format("point {} of the nurbs is not finite", i));
    }
    if (!(p.w > 0))  // the surface might go through infinity
      throw SceneError(location_of(shape, name), fmt::format("the weight of point {} must be > 0, got {}", i, p.w));
    points.push_back(p);
  }
  return points;
}

double largest(const glm::dvec3& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

// Cuts of a span that is looked at in kProbes steps, whose second differences are at most `bend` and whose mixed
// differences are at most `twist`. A chord is at most (second derivative) / 8 of its squared length from its curve, the
// middle of a square's diagonal (mixed derivative) / 4 from the surface.
std::size_t cuts(double bend, double twist, double tolerance) {
  const double probes = kProbes;
  const double need = probes * std::sqrt(std::max(bend / 8, twist / 4) / tolerance);
  return static_cast<std::size_t>(std::clamp(std::ceil(need), 1.0, static_cast<double>(kMostCuts)));
}

std::vector<GridLine> grid_lines(const KnotVector& k, const std::vector<Interval>& used, const std::vector<std::size_t>& counts) {
  std::vector<GridLine> lines;
  for (std::size_t s = 0; s < used.size(); ++s) {
    const Interval& i = used[s];
    // Where the surface may have an edge, two lines with normals of their own stand at one place.
    const bool edge = s > 0 && k.multiplicity_after(used[s - 1].span) + 1 >= k.order;
    if (s == 0 || edge) lines.push_back({i.span, i.from, false});
    for (std::size_t c = 1; c <= counts[s]; ++c) {
      const double w = static_cast<double>(c) / static_cast<double>(counts[s]);
      lines.push_back({i.span, c == counts[s] ? i.to : i.from + w * (i.to - i.from), true});
    }
  }
  return lines;
}

// Surfaces may be drawn together to a point or a line, where one derivative is 0: the normal is that beside it.
glm::dvec3 normal_at(const NurbsSurface& surface, const GridLine& u, const GridLine& v) {
  const auto inner = [](const KnotVector& k, const GridLine& line, double step) {
    const double a = k.knots[line.span], b = k.knots[line.span + 1];
    return std::clamp(line.t, a + step * (b - a), b - step * (b - a));
  };
  for (const double step : {0.0, 1e-5, 1e-3}) {
    const NurbsPoint p = surface.at(u.span, inner(surface.u, u, step), v.span, inner(surface.v, v, step));
    const double a = largest(p.dpdu), b = largest(p.dpdv);
    if (!(a > 0 && b > 0)) continue;
    const glm::dvec3 n = glm::cross(p.dpdu / a, p.dpdv / b);
    if (glm::dot(n, n) > 1e-14) return glm::normalize(n);
  }
  return glm::dvec3(0);  // pbrt's word for "none": the triangle's own is taken
}

// Cuts of every interval in both directions.
struct Dicing {
  std::vector<std::size_t> u, v;
  double vertices() const {
    double nu = 1, nv = 1;
    for (const std::size_t n : u) nu += static_cast<double>(n);
    for (const std::size_t n : v) nv += static_cast<double>(n);
    return nu * nv;
  }
};

Dicing choose_dicing(const NurbsSurface& surface, const std::vector<Interval>& us, const std::vector<Interval>& vs) {
  std::vector<double> bend_u(us.size(), 0), bend_v(vs.size(), 0), twist_u(us.size(), 0), twist_v(vs.size(), 0);
  glm::dvec3 low(1e300), high(-1e300);
  constexpr std::size_t kSide = kProbes + 1;
  std::array<glm::dvec3, kSide * kSide> p;
  for (std::size_t a = 0; a < us.size(); ++a)
    for (std::size_t b = 0; b < vs.size(); ++b) {
      for (std::size_t j = 0; j < kSide; ++j)
        for (std::size_t i = 0; i < kSide; ++i) {
          const auto between = [](const Interval& s, std::size_t n) {
            return s.from + static_cast<double>(n) / static_cast<double>(kProbes) * (s.to - s.from);
          };
          glm::dvec3& q = p[j * kSide + i];
          q = surface.at(us[a].span, between(us[a], i), vs[b].span, between(vs[b], j)).p;
          low = glm::min(low, q);
          high = glm::max(high, q);
        }
      for (std::size_t j = 0; j < kSide; ++j)
        for (std::size_t i = 0; i < kSide; ++i) {
          const glm::dvec3& q = p[j * kSide + i];
          if (i > 0 && i < kProbes) bend_u[a] = std::max(bend_u[a], glm::length((&q)[-1] - 2.0 * q + (&q)[1]));
          if (j > 0 && j < kProbes)
            bend_v[b] = std::max(bend_v[b], glm::length(p[(j - 1) * kSide + i] - 2.0 * q + p[(j + 1) * kSide + i]));
          if (i == 0 || j == 0) continue;
          const double twist = glm::length(q - (&q)[-1] - p[(j - 1) * kSide + i] + p[(j - 1) * kSide + i - 1]);
          twist_u[a] = std::max(twist_u[a], twist);
          twist_v[b] = std::max(twist_v[b], twist);
        }
    }
  const double size = glm::length(high - low);
  Dicing dicing;
  for (double tolerance = kTolerance * size;; tolerance *= 2) {
    dicing = {};
    for (std::size_t a = 0; a < us.size(); ++a) dicing.u.push_back(size > 0 ? cuts(bend_u[a], twist_u[a], tolerance) : 1);
    for (std::size_t b = 0; b < vs.size(); ++b) dicing.v.push_back(size > 0 ? cuts(bend_v[b], twist_v[b], tolerance) : 1);
    const bool coarsest = std::ranges::all_of(dicing.u, [](std::size_t n) { return n == 1; }) &&
                          std::ranges::all_of(dicing.v, [](std::size_t n) { return n == 1; });
    if (coarsest || dicing.vertices() <= kMostVertices) return dicing;
  }
}

}  // namespace

ShapeGeometry make_nurbs(const ShapeDesc& shape, Dialect dialect, Warnings& warnings) {
  NurbsSurface surface;
  std::vector<Interval> us, vs;
  surface.u = read_knots(shape, Direction("u"), us);
  surface.v = read_knots(shape, Direction("v"), vs);
  surface.points = read_points(shape, surface.u.points * surface.v.points);

  const Dicing dicing = choose_dicing(surface, us, vs);
  const std::vector<GridLine> columns = grid_lines(surface.u, us, dicing.u), rows = grid_lines(surface.v, vs, dicing.v);
  if (columns.size() * rows.size() >= 0x7fffffff) throw SceneError(shape.location, "a nurbs with too many spans");
  BulkWriter<Vec3> positions, normals;
  BulkWriter<Vec2> uvs;
  BulkWriter<Triangle> triangles;
  const auto width = static_cast<std::uint32_t>(columns.size());
  for (std::uint32_t y = 0; y < rows.size(); ++y)
    for (std::uint32_t x = 0; x < width; ++x) {
      // Where lines of two spans stand at one place, the vertices must be one to the bit, or rays find the gap.
      const GridLine &u = columns[x], &v = rows[y];
      const GridLine& pu = !u.joined && x > 0 ? columns[x - 1] : u;
      const GridLine& pv = !v.joined && y > 0 ? rows[y - 1] : v;
      positions.push_back(Vec3(surface.at(pu.span, pu.t, pv.span, pv.t).p));
      normals.push_back(Vec3(normal_at(surface, u, v)));
      uvs.push_back(Vec2(static_cast<float>(u.t), static_cast<float>(v.t)));
      if (!u.joined || !v.joined) continue;
      const std::uint32_t d = y * width + x, c = d - 1, b = d - width, a = b - 1;
      triangles.push_back({a, b, d});
      triangles.push_back({a, d, c});
    }
  TriangleMesh mesh{positions.finish(), normals.finish(), uvs.finish(), triangles.finish()};
  const char* points = shape.params.has("P") ? "P" : "Pw";
  return finish_mesh(std::move(mesh), {shape, points, points, "uknots", points}, dialect, warnings);
}

}  // namespace cloudrenderer
