#include "shapes/nurbs_surface.h"

#include <array>

namespace cloudrenderer {

namespace {

// The basis functions that are not 0 in `span`, and their derivatives, by the recurrence of Cox and de Boor (Piegl and
// Tiller, "The NURBS Book", 2nd ed., section 2.2).
struct Basis {
  std::array<double, kMaxNurbsOrder> value{}, slope{};

  Basis(const KnotVector& k, std::size_t span, double t) {
    const std::size_t degree = k.order - 1;
    const auto left = [&](std::size_t j) { return t - k.knots[span + 1 - j]; };
    const auto right = [&](std::size_t j) { return k.knots[span + j] - t; };
    value[0] = 1;
    for (std::size_t j = 1; j <= degree; ++j) {
      if (j == degree) derive(k, span);
      double saved = 0;
      for (std::size_t r = 0; r < j; ++r) {
        const double part = value[r] / (right(r + 1) + left(j - r));
        value[r] = saved + right(r + 1) * part;
        saved = left(j - r) * part;
      }
      value[j] = saved;
    }
  }

 private:
  // From the values of one degree less.
  void derive(const KnotVector& k, std::size_t span) {
    const std::size_t degree = k.order - 1;
    for (std::size_t r = 0; r <= degree; ++r) {
      const auto term = [&](std::size_t i) {  // of basis function i of one degree less
        const std::size_t first = span - degree + 1 + i;
        return value[i] / (k.knots[first + degree] - k.knots[first]);
      };
      slope[r] = static_cast<double>(degree) * ((r > 0 ? term(r - 1) : 0) - (r < degree ? term(r) : 0));
    }
  }
};

}  // namespace

std::vector<std::size_t> KnotVector::spans() const {
  std::vector<std::size_t> out;
  for (std::size_t i = order - 1; i < points; ++i)
    if (knots[i] < knots[i + 1]) out.push_back(i);
  return out;
}

std::size_t KnotVector::multiplicity_after(std::size_t span) const {
  std::size_t count = 0;
  for (std::size_t i = span + 1; i < knots.size() && knots[i] == knots[span + 1]; ++i) ++count;
  return count;
}

NurbsPoint NurbsSurface::at(std::size_t u_span, double u_at, std::size_t v_span, double v_at) const {
  const Basis bu(u, u_span, u_at), bv(v, v_span, v_at);
  glm::dvec4 sum(0), du(0), dv(0);
  for (std::size_t j = 0; j < v.order; ++j) {
    const std::size_t row = (v_span - (v.order - 1) + j) * u.points + u_span - (u.order - 1);
    glm::dvec4 value(0), slope(0);
    for (std::size_t i = 0; i < u.order; ++i) {
      value += bu.value[i] * points[row + i];
      slope += bu.slope[i] * points[row + i];
    }
    sum += bv.value[j] * value;
    du += bv.value[j] * slope;
    dv += bv.slope[j] * value;
  }
  NurbsPoint out;
  out.p = glm::dvec3(sum) / sum.w;
  out.dpdu = (glm::dvec3(du) - out.p * du.w) / sum.w;
  out.dpdv = (glm::dvec3(dv) - out.p * dv.w) / sum.w;
  return out;
}

}  // namespace cloudrenderer
