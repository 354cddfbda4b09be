#include "film/lens_system.h"

#include <algorithm>
#include <cmath>

#include "scene/lexer.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kPupils = 64;        // as many as pbrt-v3 has: the weights follow from them
constexpr double kPupilMargin = 2. / 1024;  // of the searched square's diagonal, added on all sides: likewise
constexpr int kCells = 32, kMostCells = 2048;  // of the search, along each axis
constexpr int kHalvings = 12;                  // that make its border precise

constexpr LensSystem::Pupil kNothing{glm::dvec2(1e30), glm::dvec2(-1e30)};

// Where the ray meets the sphere around (0, 0, center), and the normal against the ray.
bool meet_sphere(double radius, double center, const LensSystem::Ray& ray, double& t, glm::dvec3& n) {
  const glm::dvec3 o = ray.origin - glm::dvec3(0, 0, center);
  const double a = glm::dot(ray.direction, ray.direction), half_b = glm::dot(ray.direction, o);
  const double discriminant = half_b * half_b - a * (glm::dot(o, o) - radius * radius);
  if (!(discriminant >= 0)) return false;
  const double root = std::sqrt(discriminant);
  const double q = half_b < 0 ? -half_b + root : -half_b - root;
  double near = q / a, far = q != 0 ? (glm::dot(o, o) - radius * radius) / q : near;
  if (near > far) std::swap(near, far);
  // Which of the two is the element's side of the sphere.
  t = (ray.direction.z < 0) != (radius < 0) ? near : far;
  if (!(t >= 0)) return false;
  n = glm::normalize(o + t * ray.direction);
  if (glm::dot(n, ray.direction) > 0) n = -n;
  return true;
}

bool refract(const glm::dvec3& direction, const glm::dvec3& n, double eta, glm::dvec3& out) {
  const glm::dvec3 d = glm::normalize(direction);
  const double cosine = -glm::dot(n, d), sine2 = eta * eta * std::max(0., 1 - cosine * cosine);
  if (sine2 >= 1) return false;
  out = eta * d + (eta * cosine - std::sqrt(1 - sine2)) * n;
  return true;
}

double index_of(double eta) { return eta != 0 ? eta : 1; }

// Takes the ray through one element at z; the share that passes, 0 if it is stopped. `aperture`: of a stop, or null.
double pass(const LensSystem::Element& e, double z, double eta_from, double eta_to, const ApertureImage* aperture, LensSystem::Ray& ray) {
  const bool stop = e.curvature == 0;
  double t;
  glm::dvec3 n(0);
  if (stop) {
    t = (z - ray.origin.z) / ray.direction.z;
    if (!(t >= 0)) return 0;
  } else if (!meet_sphere(e.curvature, z - e.curvature, ray, t, n)) {
    return 0;
  }
  ray.origin += t * ray.direction;
  if (stop && aperture) return aperture->at(glm::dvec2(ray.origin) / e.aperture_radius);
  if (ray.origin.x * ray.origin.x + ray.origin.y * ray.origin.y > e.aperture_radius * e.aperture_radius) return 0;
  return stop || refract(ray.direction, n, eta_from / eta_to, ray.direction);
}

// Focal point and principal plane from a ray parallel to the axis and what the lens makes of it.
struct Cardinal {
  double principal, focus;
  Cardinal(const LensSystem::Ray& in, const LensSystem::Ray& out) {
    const auto z_at = [&](double x) { return out.origin.z + (x - out.origin.x) / out.direction.x * out.direction.z; };
    principal = z_at(in.origin.x);
    focus = z_at(0);
  }
};

}  // namespace

std::vector<LensSystem::Element> LensSystem::read(const std::string& path, double aperture_diameter_mm,
                                                  const FileLocation& where, Warnings& warnings) {
  auto text = SourceText::open(path);
  if (!text) throw SceneError(where, text.error());
  Lexer lexer(*text);
  std::vector<Element> out;
  for (Token t = lexer.next(); t.kind != Token::Kind::end;) {
    const FileLocation row = lexer.location(t);
    double numbers[4];
    for (double& x : numbers) {
      if (t.kind == Token::Kind::end)
        throw SceneError(row, "an element of a lens has four numbers: curvature radius, thickness, index, aperture");
      x = lexer.to_double(t);
      if (!(std::fabs(x) <= 1e6)) throw SceneError(lexer.location(t), "the number is too large");
      t = lexer.next();
    }
    Element e{numbers[0] * 1e-3, numbers[1] * 1e-3, numbers[2], numbers[3] * 0.5e-3};
    if (e.curvature == 0) {
      if (aperture_diameter_mm > numbers[3])
        warnings.add(where, "the aperture of " + std::to_string(aperture_diameter_mm) +
                                " mm is wider than the lens lets it be: " + std::to_string(numbers[3]) + " mm are used");
      else
        e.aperture_radius = aperture_diameter_mm * 0.5e-3;
    }
    if (e.eta != 0 && !(e.eta >= 0.1 && e.eta <= 10)) throw SceneError(row, "an index of refraction must be 0 (air) or 0.1 to 10");
    if (!(e.aperture_radius > 0)) throw SceneError(row, "an element's aperture must be above 0");
    out.push_back(e);
  }
  if (out.empty()) throw SceneError(where, "the lens file '" + path + "' has no elements");
  if (out.size() > 1000) throw SceneError(where, "the lens file '" + path + "' has more than 1000 elements");
  return out;
}

LensSystem::LensSystem(std::vector<Element> elements, double focus_distance, double film_diagonal,
                       const FileLocation& where, std::optional<ApertureImage> aperture)
    : elements_(std::move(elements)), aperture_(std::move(aperture)), half_diagonal_(film_diagonal / 2) {
  elements_.back().thickness = focused(focus_distance, film_diagonal, where);
  find_pupils();
}

double LensSystem::trace_from_film(const Ray& in, Ray& out) const {
  out = in;
  double z = 0, share = 1;
  for (std::size_t i = elements_.size(); share > 0 && i-- > 0;) {
    z += elements_[i].thickness;
    share *= pass(elements_[i], z, index_of(elements_[i].eta), i > 0 ? index_of(elements_[i - 1].eta) : 1, aperture_ ? &*aperture_ : nullptr, out);
  }
  return share;
}

bool LensSystem::trace_from_scene(const Ray& in, Ray& out) const {
  out = in;
  double z = 0;
  for (const Element& e : elements_) z += e.thickness;
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    if (pass(elements_[i], z, i > 0 ? index_of(elements_[i - 1].eta) : 1, index_of(elements_[i].eta), nullptr, out) == 0) return false;
    z -= elements_[i].thickness;
  }
  return true;
}

double LensSystem::focused(double distance, double film_diagonal, const FileLocation& where) {
  double front = 0;
  for (const Element& e : elements_) front += e.thickness;
  // Near the axis, but not on it.
  const double x = 1e-3 * film_diagonal;
  const Ray from_scene{{x, 0, front + 1}, {0, 0, -1}}, from_film{{x, 0, rear_z() - 1}, {0, 0, 1}};
  Ray to_film, to_scene;
  if (!trace_from_scene(from_scene, to_film) || trace_from_film(from_film, to_scene) == 0)
    throw SceneError(where, "the lens lets no ray through near its axis: is its aperture too small?");
  const Cardinal film(from_scene, to_film), scene(from_film, to_scene);
  focal_length_ = film.principal - film.focus;
  // Equation 6.3 of the book, for axes that point into the scene.
  const double to_point = distance - scene.principal;
  const double c = (to_point + film.principal) * (to_point + film.principal - 4 * focal_length_);
  if (!(c > 0) || !std::isfinite(focal_length_))
    throw SceneError(where, "the lens cannot focus at a distance of " + std::to_string(distance) +
                                " m; its focal length is " + std::to_string(1000 * focal_length_) + " mm");
  return rear_z() + 0.5 * (to_point - film.principal - std::sqrt(c));
}

bool LensSystem::reaches_scene(double film_x, const glm::dvec2& rear) const {
  Ray ignored;
  const glm::dvec3 start(film_x, 0, 0);
  return trace_from_film({start, glm::dvec3(rear, rear_z()) - start}, ignored) > 0;
}

// Bounds of what reaches the scene from a film point, within `in`, to the precision of the halvings: along each row and
// column of cells the border between the outermost cell that lets light through and the next one.
void LensSystem::search(double film_x, const Pupil& in, int cells, Pupil& found) const {
  const glm::dvec2 step = (in.max - in.min) / static_cast<double>(cells);
  for (const int axis : {0, 1}) {  // along rows, along columns
    const auto at = [&](int d, int i) { return in.min[d] + (i + 0.5) * step[d]; };
    const auto point = [&](double along, double across) {
      return axis == 0 ? glm::dvec2(along, across) : glm::dvec2(across, along);
    };
    for (int row = 0; row < cells; ++row) {
      const double across = at(1 - axis, row);
      const auto open = [&](double along) { return reaches_scene(film_x, point(along, across)); };
      int first = 0, last = cells - 1;
      while (first < cells && !open(at(axis, first))) ++first;
      if (first == cells) continue;
      while (!open(at(axis, last))) --last;
      for (const double direction : {-1., 1.}) {
        double inside = at(axis, direction < 0 ? first : last), outside = inside + direction * step[axis];
        for (int i = 0; i < kHalvings; ++i) {
          const double middle = 0.5 * (inside + outside);
          (open(middle) ? inside : outside) = middle;
        }
        found.min = glm::min(found.min, point(inside, across));
        found.max = glm::max(found.max, point(inside, across));
      }
    }
  }
}

// What a film point sees through, or nothing. `near`: the same of a point close by, to begin with. most_cells: along the side of what is
// searched at most.
LensSystem::Pupil LensSystem::opening(double film_x, const Pupil& near, int most_cells) const {
  const double half = 1.5 * elements_.back().aperture_radius;
  const Pupil all{glm::dvec2(-half), glm::dvec2(half)};
  Pupil found = kNothing;
  if (!near.is_empty()) {
    const glm::dvec2 around = 0.5 * (near.max - near.min) + 1e-3 * half;
    const Pupil in{near.min - around, near.max + around};
    search(film_x, in, kCells, found);
    // What reaches the window's border may reach farther.
    const bool inside = glm::all(glm::greaterThan(found.min, in.min)) && glm::all(glm::lessThan(found.max, in.max));
    if (!found.is_empty() && inside) return found;
    found = kNothing;
  }
  // Narrow stops leave little of what is searched.
  for (int cells = kCells; cells <= most_cells && found.is_empty(); cells *= 4) search(film_x, all, cells, found);
  if (found.is_empty()) return found;
  const glm::dvec2 around = 0.5 * (found.max - found.min) + 2 * half / kMostCells;
  const Pupil in{found.min - around, found.max + around};
  search(film_x, in, kCells, found);
  return found;
}

void LensSystem::find_pupils() {
  const double half = 1.5 * elements_.back().aperture_radius, margin = kPupilMargin * std::sqrt(2.) * 2 * half;
  const auto at = [&](std::size_t i) { return static_cast<double>(i) / kPupils * half_diagonal_; };
  Pupil from = opening(at(0), kNothing, kMostCells);
  for (std::size_t i = 0; i < kPupils; ++i) {
    // Where a film is larger than the lens's image, what lies beyond a point that sees nothing is not searched as thoroughly.
    const Pupil to = opening(at(i + 1), from, from.is_empty() ? kCells : kMostCells);
    const Pupil both{glm::min(from.min, to.min) - margin, glm::max(from.max, to.max) + margin};
    pupils_.push_back(both.is_empty() ? Pupil{glm::dvec2(-half), glm::dvec2(half)} : both);
    from = to;
  }
}

const LensSystem::Pupil& LensSystem::pupil(double distance_from_axis) const {
  const double i = distance_from_axis / half_diagonal_ * kPupils;
  return pupils_[std::min(static_cast<std::size_t>(std::max(i, 0.)), kPupils - 1)];
}

}  // namespace cloudrenderer
