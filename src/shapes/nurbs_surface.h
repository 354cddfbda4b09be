#pragma once
// Points of NURBS surfaces, in double precision.
#include <cstddef>
#include <vector>

#include "shapes/geometry.h"

namespace cloudrenderer {

inline constexpr std::size_t kMaxNurbsOrder = 16;  // pbrt's scenes use up to 6

// One direction of a tensor product: knots.size() == points + order.
struct KnotVector {
  std::size_t order = 0, points = 0;
  std::vector<double> knots;

  // Intervals that are not empty, as the index of their first knot; those of pbrt's range of the parameter.
  std::vector<std::size_t> spans() const;
  // How often the knot at the end of `span` is there. With order - 1 times the surface may have an edge.
  std::size_t multiplicity_after(std::size_t span) const;
};

struct NurbsPoint {
  glm::dvec3 p{}, dpdu{}, dpdv{};
};

struct NurbsSurface {
  KnotVector u, v;
  std::vector<glm::dvec4> points;  // homogeneous, u runs first

  // At parameters within (or at the ends of) the spans: on a knot the caller says from which side.
  NurbsPoint at(std::size_t u_span, double u, std::size_t v_span, double v) const;
};

}  // namespace cloudrenderer
