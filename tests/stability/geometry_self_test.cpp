// Rays that leave a surface: none may find the surface that it leaves (acne), none may come out on its other side (a leak).
#include <algorithm>
#include <cctype>
#include <optional>

#include "geometry_meshes.h"
#include "geometry_reference.h"
#include "record.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

struct ShapeCase {
  const char* name;
  std::string text;  // within [-1, 1]^3
  bool closed;
  std::optional<Vec3> within{};  // of meshes that are convex: a point on the inner side of all triangles
  float curve = 0;               // a straight one's width: nothing is met outside of it
  double acne = 0;               // share of rays that may find what they leave
};

// A dome, convex along its diagonals, too.
std::string heightfield() {
  constexpr int n = 7;
  std::string z;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      const double x = i / (n - 1.) - .5, y = j / (n - 1.) - .5;
      z += fmt::format("{:.9g} ", .4 - .5 * (x * x + y * y) + .25 * x * y);
    }
  return fmt::format("Shape \"heightfield\" \"integer nu\" [{0}] \"integer nv\" [{0}] \"float Pz\" [{1}]", n, z);
}

const glm::dvec3 kCurveEnds[2] = {{-.6, -.3, .2}, {.6, .3, -.1}};

std::string curve(const char* type, double width) {
  return fmt::format("Shape \"curve\" \"string type\" \"{}\" \"point P\" [-.6 -.3 .2  -.2 -.1 .1  .2 .1 0  .6 .3 -.1] \"float width\" [{}]{}", type, width,
                     std::string_view(type) == "ribbon" ? " \"normal N\" [0 .3 .6  .1 .2 .8]" : "");
}

std::vector<ShapeCase> shapes() {
  return {
      {"sphere", "Shape \"sphere\" \"float radius\" [1]", true},
      {"cylinder", "Shape \"cylinder\" \"float radius\" [.7] \"float zmin\" [-.7] \"float zmax\" [.7]", false},
      {"disk", "Shape \"disk\" \"float radius\" [1] \"float height\" [.3]", false},
      {"cone", "Shape \"cone\" \"float radius\" [.7] \"float height\" [.7]", false},
      {"paraboloid", "Shape \"paraboloid\" \"float radius\" [.7] \"float zmax\" [.7]", false},
      {"hyperboloid", "Shape \"hyperboloid\" \"point p1\" [.3 -.5 -.5] \"point p2\" [.3 .5 .5]", false},
      {"triangle", "Shape \"trianglemesh\" \"point P\" [-.5 -.7 .3  .9 0 -.2  -.1 .8 .1] \"integer indices\" [0 1 2]", false},
      // Of rays that leave a polyhedron at an edge, at cosines of about 2e-6, a few in ten million hit the neighbour there. Not
      // understood: the start lies above both.
      {"icosphere", icosphere(2, 1, Vec3(0.f)).text(), true, Vec3(0.f), 0, 2e-6},
      {"heightfield", heightfield(), false, Vec3(.5f, .5f, -9.f)},
      {"flat curve", curve("flat", .1), false, {}, .1f},
      // Two in ten million; not understood either.
      {"curve shaded as a cylinder", curve("cylinder", .1), false, {}, .1f, 1e-6},
      // A ribbon is as wide as its ray sees it, and rays start two such widths away, as in pbrt: stretched, that start is not
      // straight above where it was hit.
      {"ribbon", curve("ribbon", .1), false, {}, .1f, 1e-4},
      {"flat curve 1e-4 wide", curve("flat", 1e-4), false, {}, 1e-4f},
  };
}

struct Placement {
  const char* name;
  Mat4 matrix;  // of [-1, 1]^3
  bool acute = false;  // flat: its edges are acute
  bool limit = false;  // thinner than the rounding of its points

  std::string text() const {
    std::string numbers;
    for (int i = 0; i < 16; ++i) numbers += fmt::format("{:.9g} ", matrix[i / 4][i % 4]);
    return "Transform [" + numbers + "]\n";
  }
};

// Axes of a turn, scaled, then moved: all in double, rounded once.
Mat4 placed(const glm::dvec3& scale, const glm::dvec3& center) {
  const glm::dvec3 a = glm::normalize(glm::dvec3(.3, -.8, .5)), b = glm::normalize(glm::cross(a, glm::dvec3(.1, .4, .9)));
  const glm::dmat3 turn(a, b, glm::cross(a, b)), m = turn * glm::dmat3(scale.x, 0, 0, 0, scale.y, 0, 0, 0, scale.z) * glm::transpose(turn);
  Mat4 out{glm::mat3(m)};
  out[3] = glm::vec4(Vec3(center), 1.f);
  return out;
}

std::vector<Placement> placements() {
  const glm::dvec3 away(-.7, .6, .4);
  const auto at = [&](const char* name, double size, double offset) { return Placement{name, placed(glm::dvec3(size), size * offset * away)}; };
  return {at("size 1 at the origin", 1, 0),
          at("size 1e-6", 1e-6, 1),
          at("size 1e9", 1e9, 1),
          at("1e3 sizes away", 1, 1e3),
          at("1e5 sizes away", 1, 1e5),
          {"stretched .5 : 1 : 2, mirrored", placed({.5, -1, 2}, {3, 2, 1})},
          {"stretched .1 : 1 : 10, mirrored", placed({.1, -1, 10}, {3, 2, 1}), true},
          {"stretched .001 : 1 : 1000, mirrored", placed({1e-3, -1, 1e3}, {3, 2, 1}), true, true}};
}

// Where rays leave a surface, as the renderer chose it.
struct Start {
  Vec3 origin;
  Real3 normal;  // of the surface by its equation, unit, on the side of the ray
  std::uint32_t shape, primitive;
};

struct Tally {
  std::uint64_t rays = 0, acne = 0, leaks = 0;
};

class Leaving {
 public:
  Leaving(const ShapeCase& shape, const Placement& place, bool instance)
      : shape_(shape), place_(place), world_(scene(shape, place, instance)) {
    const auto set = world_.set();
    for (std::uint32_t p = 0; p < world_.parts(); ++p) {
      const Part& part = set->part(p);
      if (!part.quadrics.empty()) take(part.quadrics[0].quadric, {});
      if (part.instances.empty()) continue;
      const Part& prototype = set->prototype(p, 0);
      if (!prototype.quadrics.empty()) take(prototype.quadrics[0].quadric, RealAffine(part.instances[0].to_world.matrix()));
    }
  }

  bool curved() const { return quadric_.has_value(); }

  Tally run(std::uint64_t count, std::uint64_t seed) {
    const float reach = std::cbrt(std::abs(glm::determinant(glm::mat3(place_.matrix))));
    Random random(seed);
    Tally tally;
    while (tally.rays < count) {
      std::vector<ProbeRay> rays;
      for (int i = 0; i < 512; ++i) {
        // From everywhere about, and from within.
        const double far = i % 4 == 0 ? 0.4 : 1.8 * random.log_uniform(1, 100);
        const glm::dvec3 near = shape_.curve > 0 ? glm::mix(kCurveEnds[0], kCurveEnds[1], random.uniform()) : glm::dvec3(0);
        const double about = shape_.curve > 0 ? shape_.curve : 1.8;
        const Vec3 from = in_world(far * random.direction()), to = in_world(near + about * random.uniform() * random.direction());
        if (from != to) rays.push_back({from, Vec3(glm::normalize(glm::dvec3(to) - glm::dvec3(from)))});
      }
      std::vector<ProbeRay> grazing, leaving;
      std::vector<Start> of;
      mirror(rays, of, leaving);
      for (std::size_t i = 0; i < of.size(); ++i) {
        const Vec3 w = way(random, of[i].normal);
        leaving[i].direction = w;
        // Backwards along it: a ray that comes in at that angle.
        grazing.push_back({of[i].origin + w * reach, -w});
      }
      mirror(grazing, of, leaving);
      judge(leaving, of, tally);
      if (leaving.empty()) {
        ADD_FAILURE() << "no ray hits the " << shape_.name << ", " << place_.name << ", seed " << seed;
        break;
      }
    }
    return tally;
  }

 private:
  Vec3 in_world(const glm::dvec3& p) const { return Vec3(glm::dmat4(place_.matrix) * glm::dvec4(p, 1)); }
  static std::string scene(const ShapeCase& shape, const Placement& place, bool instance) {
    const std::string mirror = "Material \"mirror\" \"color Kr\" [1 1 1]\n";
    if (!instance) return mirror + "Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]\n" + place.text() + "\n" + shape.text;
    return mirror + "Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]\nObjectBegin \"thing\"\n" + shape.text + "\nObjectEnd\n" + place.text() + "\nObjectInstance \"thing\"";
  }
  void take(const Quadric& q, const RealAffine& to_world) {
    quadric_ = q;
    to_world_ = to_world * RealAffine(q.object_to_world.matrix());
  }
  // The surface's normal at a hit, not turned to any side.
  Real3 normal(const Hit& h, const Vec3& at) const {
    if (quadric_) {
      // At the foot of the start on the surface: where it is far from it for its curvature, normals differ.
      const Real33 to_object = glm::inverse(to_world_.linear);
      Real3 p(at), n(0);
      for (int i = 0; i < 6; ++i) {
        const AlongRay f = along(*quadric_, to_object * (p - to_world_.translation), Real3(0));
        n = glm::transpose(to_object) * f.gradient;
        p -= n * (f.value / glm::dot(n, n));
      }
      return glm::normalize(n);
    }
    const auto set = world_.set();
    const bool instance = h.instance != kNone;
    const Part& part = instance ? set->prototype(h.part, h.instance) : set->part(h.part);
    const RealAffine to_world(instance ? set->part(h.part).instances[h.instance].to_world.matrix() : Mat4(1.f));
    const Triangle t = part.triangles[h.index];
    const Real3 a = to_world.point(Real3(part.positions[t.x])), b = to_world.point(Real3(part.positions[t.y])), c = to_world.point(Real3(part.positions[t.z]));
    return glm::normalize(glm::cross(b - a, c - a));
  }

  // By how much the surface turns within the rounding of its points. The tip of a cone 1e5 sizes away is smaller than that:
  // there is no side to be on.
  Real turn_within_rounding(const Hit& h, const Vec3& at, const Real3& n) const {
    if (!quadric_) return 0;
    const Real3 across = glm::normalize(glm::cross(n, std::abs(n.x) < 0.5L ? Real3(1, 0, 0) : Real3(0, 1, 0)));
    // Starts are off an instance by the rounding of the way into its space too.
    const float rounding = (h.instance == kNone ? 0x1p-20f : 0x1p-18f) * max_component(glm::abs(at));
    Real most = 0;
    for (const Real3& way : {across, glm::cross(n, across)}) most = std::max(most, glm::length(normal(h, at + rounding * Vec3(way)) - n));
    return most;
  }

  // Fires rays, and lets the mirror that everything is made of send them on.
  void mirror(const std::vector<ProbeRay>& rays, std::vector<Start>& starts, std::vector<ProbeRay>& bounces) const {
    SegmentBatch batch = world_.trace(rays), hit;
    for (std::size_t i = 0; i < batch.size(); ++i) {
      if (batch.hits[i].part == kNone) continue;
      hit.segments.push_back(batch.segments[i]);
      hit.hits.push_back(batch.hits[i]);
      hit.next.emplace_back();
    }
    ShadeOutput out;
    world_.tracer().shade(hit, out);
    EXPECT_EQ(out.counts.invalid, 0u);
    for (const PathSegment& s : out.continuing) {
      const Hit& h = batch.hits[s.pixel];
      // A curve's normal depends on the ray; the mirror tells it.
      const Real3 n = shape_.curve > 0 ? glm::normalize(Real3(s.direction) - Real3(batch.segments[s.pixel].direction)) : normal(h, s.origin);
      const Real cosine = glm::dot(n, Real3(s.direction));
      const Real turn = place_.limit || shape_.curve > 0 ? 0 : turn_within_rounding(h, s.origin, n);
      // Which side a ray is on that comes in along the surface is a matter of rounding.
      if (turn > 0.5L || std::abs(cosine) < 1e-6L + 2 * turn) continue;
      starts.push_back({s.origin, cosine < 0 ? -n : n, h.shape, h.primitive});
      bounces.push_back({s.origin, s.direction});
    }
  }

  static Vec3 way(Random& random, const Real3& n) {
    const double cosine = random.log_uniform(2e-6, 1);
    const Real3 across = glm::normalize(glm::cross(n, Real3(random.direction())));
    return Vec3(glm::normalize(static_cast<Real>(cosine) * n + static_cast<Real>(std::sqrt(1 - cosine * cosine)) * across));
  }

  void judge(const std::vector<ProbeRay>& rays, const std::vector<Start>& of, Tally& tally) const {
    const SegmentBatch found = world_.trace(rays);
    std::vector<OcclusionRay> shadows;
    for (const ProbeRay& r : rays) shadows.push_back({r.origin, r.direction, 1e18f});
    std::vector<std::uint8_t> blocked(rays.size());
    world_.tracer().occluded(shadows, {}, blocked);
    const auto set = world_.set();
    for (std::size_t i = 0; i < rays.size(); ++i) {
      ++tally.rays;
      const Hit& h = found.hits[i];
      const bool hit = h.part != kNone;
      bool inside = false, own = false;
      if (quadric_) {
        const Real3 o = to_world_.inverse_point(Real3(rays[i].origin)), w = to_world_.inverse_vector(Real3(rays[i].direction));
        const AlongRay f = along(*quadric_, o, w);
        // The side that the ray was meant to start on; the gradient is taken to the world as normals are.
        const bool outside = glm::dot(normal(h, rays[i].origin), of[i].normal) > 0;
        const bool bulges = outside && quadric_->kind != QuadricKind::hyperboloid;
        inside = shape_.closed && !outside;
        own = bulges || quadric_->kind == QuadricKind::disk ? hit || blocked[i] : outside != (f.value > 0);
      } else {
        // Meshes are flat or convex: outside nothing is met, and the triangle itself never again.
        const bool inner = shape_.within && glm::dot(of[i].normal, Real3(in_world(*shape_.within)) - Real3(rays[i].origin)) > 0;
        inside = shape_.closed && inner;
        own = inner ? hit && h.shape == of[i].shape && h.primitive == of[i].primitive : hit || blocked[i];
      }
      if (own) ++tally.acne;
      if (inside && (!hit || !blocked[i])) ++tally.leaks;
    }
  }

  const ShapeCase& shape_;
  const Placement& place_;
  World world_;
  std::optional<Quadric> quadric_;
  RealAffine to_world_;
};

class Leave : public testing::TestWithParam<std::tuple<std::size_t, bool>> {};

TEST_P(Leave, NoRayFindsTheSurfaceThatItLeaves) {
  const auto [number, instance] = GetParam();
  const ShapeCase shape = shapes()[number];
  std::uint64_t seed = 100 * number;
  Tally usual, thin;  // over the places
  double leaks_in_acute = 0;
  for (const Placement& place : placements()) {
    Leaving leaving(shape, place, instance);
    const Tally tally = leaving.run(rays(500, 1'500'000), ++seed);
    Tally& sum = place.limit ? thin : usual;
    sum.rays += tally.rays;
    sum.acne += tally.acne;
    // In the acute edges of a squeezed polyhedron what is off one face may be beyond the other.
    const bool acute = place.acute && !place.limit && !leaving.curved();
    if (acute)
      leaks_in_acute = static_cast<double>(tally.leaks) / static_cast<double>(tally.rays);
    else
      sum.leaks += tally.leaks;
    if (!place.limit && shape.acne == 0 && (tally.acne || (tally.leaks && !acute)))
      std::printf("%s, %s, seed %llu: %llu hit what they leave, %llu leak\n", shape.name, place.name, static_cast<unsigned long long>(seed),
                  static_cast<unsigned long long>(tally.acne), static_cast<unsigned long long>(tally.leaks));
  }
  const std::string name = std::string(shape.name) + (instance ? " in an instance" : "");
  const std::string usual_name = name + " (size 1e-6 to 1e9, up to 1e5 sizes off, stretched up to .1 : 1 : 10), left at cosines from 2e-6 on";
  if (shape.acne > 0)
    record_limit(usual_name, "share of rays that hit what they leave", shape.acne, static_cast<double>(usual.acne) / static_cast<double>(usual.rays), usual.rays);
  else
    record(usual_name, "rays that hit what they leave", 0, static_cast<double>(usual.acne), usual.rays);
  if (shape.closed) record(usual_name, "rays that leak", 0, static_cast<double>(usual.leaks), usual.rays);
  const std::string thin_name = name + " stretched .001 : 1 : 1000, thinner than its points are rounded";
  const auto share = [&](std::uint64_t n) { return static_cast<double>(n) / static_cast<double>(thin.rays); };
  record_limit(thin_name, "share of rays that hit what they leave", 0.05, share(thin.acne), thin.rays);
  if (shape.closed) record_limit(thin_name, "share of rays that leak", 0.06, share(thin.leaks), thin.rays);
  if (leaks_in_acute > 0 || std::string_view(shape.name) == "icosphere")
    record_limit(name + " stretched .1 : 1 : 10, from its acute edges", "share of rays that leak", 1e-3, leaks_in_acute, usual.rays / 7);
}
INSTANTIATE_TEST_SUITE_P(Shapes, Leave, testing::Combine(testing::Range<std::size_t>(0, shapes().size()), testing::Bool()),
                         [](const auto& p) {
                           std::string name = shapes()[std::get<0>(p.param)].name;
                           std::ranges::replace_if(name, [](unsigned char c) { return !std::isalnum(c); }, '_');
                           return name + (std::get<1>(p.param) ? "_instance" : "");
                         });

}  // namespace
}  // namespace cloudrenderer::stability
