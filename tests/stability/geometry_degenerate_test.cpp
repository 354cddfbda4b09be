// Needles, triangles without area, surfaces that coincide or nearly do, dielectrics that touch.
#include "../integrator_support.h"
#include "geometry_meshes.h"
#include "geometry_reference.h"
#include "record.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

constexpr std::uint64_t kSeed = 31;
const std::string kMirror = "Material \"mirror\" \"color Kr\" [1 1 1]\n";

// Bounces of rays at their hits.
std::vector<PathSegment> bounces(const World& world, const std::vector<ProbeRay>& probes, std::vector<Hit>& hits, RayCounts& counts) {
  SegmentBatch batch = world.trace(probes), hit;
  hits = batch.hits;
  for (std::size_t i = 0; i < batch.size(); ++i) {
    if (hits[i].part == kNone) continue;
    hit.segments.push_back(batch.segments[i]);
    hit.hits.push_back(hits[i]);
    hit.next.emplace_back();
  }
  ShadeOutput out;
  world.tracer().shade(hit, out);
  counts += out.counts;
  return out.continuing;
}

// A needle of length 1: with one short edge, or ("cap") with three long ones. It lies askew.
TestMesh needle(double width, bool cap) {
  const glm::dvec3 a = glm::normalize(glm::dvec3(.3, -.8, .5)), b = glm::normalize(glm::cross(a, glm::dvec3(.1, .4, .9))), at(.3, .2, -.4);
  TestMesh mesh;
  mesh.points = {Vec3(at), Vec3(at + a), Vec3(at + (cap ? 0.4 : 1.0) * a + width * b)};
  mesh.triangles = {{0, 1, 2}};
  return mesh;
}

void leave_needles(bool cap) {
  Random random(kSeed);
  for (const double width : {0.1, 1e-2, 1e-3, 1e-4, 1e-5}) {
    const TestMesh mesh = needle(width, cap);
    const World world(kMirror + mesh.text());
    const std::array<Real3, 3> v = {Real3(mesh.points[0]), Real3(mesh.points[1]), Real3(mesh.points[2])};
    const Real3 n = glm::normalize(glm::cross(v[1] - v[0], v[2] - v[0]));
    std::uint64_t tries = 0, own = 0, found = 0;
    double off = 0;
    RayCounts counts;
    for (std::uint64_t round = 0; round < rays(4, 1000); ++round) {
      std::vector<ProbeRay> probes, leaving;
      for (int i = 0; i < 1000; ++i) {
        const double p = random.uniform(), q = random.uniform();
        const Real u = p + q > 1 ? 1 - p : p, w = p + q > 1 ? 1 - q : q;
        const Real3 to = v[0] + u * (v[1] - v[0]) + w * (v[2] - v[0]);
        Real3 way(random.direction());
        if (std::abs(glm::dot(way, n)) < 0.05L) continue;
        const Vec3 from(to + static_cast<Real>(random.log_uniform(.1, 10)) * way);
        probes.push_back({from, Vec3(glm::normalize(to - Real3(from)))});
      }
      std::vector<Hit> hits;
      for (const PathSegment& s : bounces(world, probes, hits, counts)) {
        ++found;
        // The start must be on the ray's side of the plane, and near.
        const Real side = glm::dot(n, Real3(s.direction)) > 0 ? 1 : -1, height = side * glm::dot(n, Real3(s.origin) - v[0]);
        off = std::max(off, static_cast<double>(std::abs(height)));
        for (int i = 0; i < 2; ++i) {
          const Real cosine = static_cast<Real>(random.log_uniform(1e-3, 1));
          const Real3 across = glm::normalize(glm::cross(n, Real3(random.direction())));
          leaving.push_back({s.origin, Vec3(glm::normalize(side * cosine * n + std::sqrt(1 - cosine * cosine) * across))});
        }
      }
      const SegmentBatch again = world.trace(leaving);
      for (const Hit& h : again.hits) {
        ++tries;
        own += h.part != kNone;
      }
    }
    const std::string name = fmt::format("{} of length 1, {:g} wide", cap ? "triangle with three long edges" : "needle", width);
    // Beyond an aspect of 1e4 the plane's error is more than the quarter of the width that starts may be off.
    if (cap && width < 1e-4)
      record_limit(name, "share of rays that hit what they leave, at cosines from 1e-3 on", 0.2, static_cast<double>(own) / static_cast<double>(tries), tries);
    else
      record(name, "rays that hit what they leave, at cosines from 1e-3 on", 0, static_cast<double>(own), tries);
    record(name, "distance of starts from the plane / (a half of the width + 1e-6)", 1, off / (0.5 * width + 1e-6), found);
    EXPECT_EQ(counts.invalid, 0u);
  }
}
TEST(Degenerate, NeedlesDoNotShadeThemselves) { leave_needles(false); }
TEST(Degenerate, CapsDoNotShadeThemselves) { leave_needles(true); }

// Triangles without area are no surface, and harm none: a picture with them has the same bits as without.
TEST(Degenerate, TrianglesWithoutAreaAreNotThere) {
  TestMesh mesh = icosphere(2, 1, Vec3(0.f));
  const auto vertices = static_cast<std::uint32_t>(mesh.points.size());
  const std::size_t real = mesh.triangles.size();
  TestMesh more = mesh;
  Random random(kSeed);
  for (std::uint32_t i = 0; i < 500; ++i) {
    const std::uint32_t a = random.below(vertices), b = random.below(vertices);
    more.points.push_back(0.5f * (more.points[a] + more.points[b]));
    more.triangles.push_back({a, b, i % 3 == 0 ? a : i % 3 == 1 ? b : static_cast<std::uint32_t>(more.points.size() - 1)});
    more.triangles.push_back({a, a, a});
  }
  const World plain(kMirror + mesh.text()), littered(kMirror + more.text());
  std::uint64_t tries = 0, differ = 0, slivers = 0;
  RayCounts counts;
  for (std::uint64_t round = 0; round < rays(10, 1000); ++round) {
    std::vector<ProbeRay> probes;
    for (int i = 0; i < 1000; ++i) {
      const Vec3 from = Vec3(random.uniform(.0, 3.) * random.direction());
      // At the lines that some of them are, too.
      const Vec3 to = i % 2 ? more.points[vertices + random.below(500)] : Vec3(random.direction());
      if (from != to) probes.push_back({from, glm::normalize(to - from)});
    }
    std::vector<Hit> a, b;
    bounces(plain, probes, a, counts);
    bounces(littered, probes, b, counts);
    for (std::size_t i = 0; i < probes.size(); ++i) {
      ++tries;
      if (b[i].part != kNone && b[i].primitive >= real) {
        ++slivers;  // a line whose middle is rounded off it is a needle, and may be hit
        EXPECT_EQ((b[i].primitive - real) % 6, 4u);
      } else {
        differ += a[i].t != b[i].t || a[i].primitive != b[i].primitive;
      }
    }
  }
  EXPECT_EQ(counts.invalid, 0u);
  record("triangles without area among others", "hits that are others for them", 0, static_cast<double>(differ), tries);
  record_limit("triangles without area among others", "share of hits on what is a line but for rounding", 0.05, static_cast<double>(slivers) / static_cast<double>(tries), tries);
}

// Planes 1e-6 apart, each a mesh of two triangles 1e3 wide. `tilt` lets rounding move their corners by more than that:
// then what counts is the first plane of those that floats can tell.
std::string stack(int planes, double gap, bool in_order) {
  std::string text;
  for (int i = 0; i < planes; ++i) {
    const int k = in_order ? i : planes - 1 - i;
    const auto z = static_cast<float>(k * gap);
    text += fmt::format("Shape \"trianglemesh\" \"point P\" [-500 -500 {0:.9g}  500 -500 {0:.9g}  500 500 {0:.9g}  -500 500 {0:.9g}] \"integer indices\" [0 1 2 2 3 0]\n", z);
  }
  return text;
}

TEST(Degenerate, PlanesAMillionthApartAreTold) {
  constexpr int kPlanes = 16;
  constexpr double kGap = 1e-6;
  Random random(kSeed);
  // On one host, and each plane in parts of its own order.
  for (const bool in_order : {true, false}) {
    const World world(kMirror + stack(kPlanes, kGap, in_order));
    std::uint64_t tries = 0, wrong = 0, between = 0, escapes = 0;
    RayCounts counts;
    for (std::uint64_t round = 0; round < rays(10, 1000); ++round) {
      std::vector<ProbeRay> probes;
      std::vector<int> expected;
      for (int i = 0; i < 1000; ++i) {
        const double c = random.log_uniform(1e-2, 1), phi = random.uniform(0, 2 * M_PI);
        const bool from_above = random.below(2);
        const glm::dvec3 way(std::sqrt(1 - c * c) * std::cos(phi), std::sqrt(1 - c * c) * std::sin(phi), from_above ? -c : c);
        const int k = i % 2 ? (from_above ? kPlanes - 1 : 0) : static_cast<int>(random.below(kPlanes - 1));
        const glm::dvec3 at(random.uniform(-300, 300), random.uniform(-300, 300), k * kGap);
        if (i % 2) {  // from outside on the first plane
          probes.push_back({Vec3(at - random.log_uniform(1e-3, 1) * way), Vec3(way)});
          expected.push_back(k);
        } else {  // from the middle between two planes
          probes.push_back({Vec3(at.x, at.y, static_cast<float>((k + 0.5) * kGap)), Vec3(way)});
          expected.push_back(from_above ? k : k + 1);
        }
      }
      std::vector<Hit> hits;
      const std::vector<PathSegment> next = bounces(world, probes, hits, counts);
      std::vector<ProbeRay> up;
      std::vector<int> neighbour;
      for (std::size_t i = 0; i < probes.size(); ++i) {
        ++tries;
        const int shape = in_order ? expected[i] : kPlanes - 1 - expected[i];
        wrong += hits[i].part == kNone || static_cast<int>(hits[i].shape) != shape;
      }
      for (const PathSegment& s : next) {
        const int k = in_order ? static_cast<int>(hits[s.pixel].shape) : kPlanes - 1 - static_cast<int>(hits[s.pixel].shape);
        up.push_back({s.origin, s.direction});
        neighbour.push_back(s.direction.z > 0 ? k + 1 : k - 1);
      }
      const SegmentBatch second = world.trace(up);
      for (std::size_t i = 0; i < up.size(); ++i) {
        ++between;
        const bool out = neighbour[i] < 0 || neighbour[i] >= kPlanes;
        const Hit& h = second.hits[i];
        const int k = h.part == kNone ? -1 : in_order ? static_cast<int>(h.shape) : kPlanes - 1 - static_cast<int>(h.shape);
        escapes += out ? h.part != kNone : k != neighbour[i];
      }
    }
    EXPECT_EQ(counts.invalid, 0u);
    const std::string name = fmt::format("16 planes 1e-6 apart and 1e3 wide{}", in_order ? "" : ", in reverse order");
    record(name, "rays that find another than the first plane", 0, static_cast<double>(wrong), tries);
    record(name, "mirrored rays that do not find the neighbour", 0, static_cast<double>(escapes), between);
  }
}

// Of surfaces at the same place the first in the file counts, however the scene is cut.
TEST(Degenerate, OfCoincidentSurfacesTheFirstCounts) {
  TestMesh mesh = icosphere(4, 1, Vec3(.1f, .2f, .3f));
  const std::string text = "Material \"matte\"\n" + mesh.text() + mesh.text() + mesh.text();
  const World whole(text), cut(text, 60'000);
  EXPECT_GT(cut.parts(), 6u);
  Random random(kSeed);
  std::uint64_t tries = 0, wrong = 0;
  for (std::uint64_t round = 0; round < rays(10, 1000); ++round) {
    std::vector<ProbeRay> probes;
    for (int i = 0; i < 1000; ++i) {
      const Vec3 from = Vec3(3. * random.direction()), to = Vec3(.8 * random.uniform() * random.direction());
      probes.push_back({from, glm::normalize(to - from)});
    }
    const SegmentBatch a = whole.trace(probes), b = cut.trace(probes);
    for (std::size_t i = 0; i < probes.size(); ++i) {
      if (a.hits[i].part == kNone) continue;
      ++tries;
      wrong += a.hits[i].shape != 0 || b.hits[i].shape != 0 || a.hits[i].t != b.hits[i].t || a.hits[i].primitive != b.hits[i].primitive;
    }
  }
  record("three meshes at the same place, whole and cut", "hits that are not of the first, or others when cut", 0, static_cast<double>(wrong), tries);
}

// A furnace: glass absorbs nothing, so that under an even sky of radiance 1 every path that leaves is worth 1, whatever
// touches what; paths that are still inside at the depth limit are what is missing.
TEST(Degenerate, TouchingDielectricsKeepTheLight) {
  const std::string sphere = "Shape \"sphere\" \"float radius\" ";
  const struct {
    const char* name;
    std::string shapes;
    bool limit = false;  // starts of rays are off the surface by more than the gap
  } cases[] = {
      {"glass spheres of the same place and size", "Material \"glass\" \"float index\" [1.5]\n" + sphere + "[1]\nMaterial \"glass\" \"float index\" [1.3]\n" + sphere + "[1]\n"},
      {"a glass sphere in another that touches it", "Material \"glass\" \"float index\" [1.5]\n" + sphere + "[1]\nAttributeBegin\nTranslate .5 0 0\nMaterial \"glass\" \"float index\" [1.3]\n" + sphere + "[.5]\nAttributeEnd\n"},
      {"glass spheres 1e-5 apart", "Material \"glass\" \"float index\" [1.5]\n" + sphere + "[1]\nMaterial \"glass\" \"float index\" [1.3]\n" + sphere + "[.99999]\n"},
      {"glass spheres 1e-6 apart", "Material \"glass\" \"float index\" [1.5]\n" + sphere + "[1]\nMaterial \"glass\" \"float index\" [1.3]\n" + sphere + "[.999999]\n"},
      {"glass spheres an ulp (1.2e-7) apart", "Material \"glass\" \"float index\" [1.5]\n" + sphere + "[1]\nMaterial \"glass\" \"float index\" [1.3]\n" + sphere + "[.9999999]\n", true},
      {"two glass spheres that touch from outside", "Material \"glass\" \"float index\" [1.5]\nAttributeBegin\nTranslate -.5 0 0\n" + sphere + "[.5]\nTranslate 1 0 0\n" + sphere + "[.5]\nAttributeEnd\n"},
      {"a glass cube on a glass plate", "Material \"glass\" \"float index\" [1.5]\n" + [] {
         TestMesh box;
         for (const float z : {0.f, .5f, .5f, 1.f})
           for (const glm::vec2 p : {glm::vec2(-.6f, -.6f), glm::vec2(.6f, -.6f), glm::vec2(.6f, .6f), glm::vec2(-.6f, .6f)}) box.points.emplace_back(p.x, p.y, z);
         for (const std::uint32_t b : {0u, 8u}) {
           for (const glm::u32vec4 q : {glm::u32vec4{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}}) {
             box.triangles.push_back({b + q.x, b + q.y, b + q.z});
             box.triangles.push_back({b + q.x, b + q.z, b + q.w});
           }
         }
         return box.text();
       }()},
  };
  const std::string head =
      "LookAt 0 -3 .7  0 0 .2  0 0 1\nCamera \"perspective\" \"float fov\" [40]\nFilm \"image\" \"integer xresolution\" [16] \"integer yresolution\" [16] \"string filename\" \"a.exr\"\n"
      "Sampler \"sobol\" \"integer pixelsamples\" [16]\nIntegrator \"path\" \"integer maxdepth\" [200] \"float rrthreshold\" [0]\n";
  for (const auto& c : cases) {
    const World world("LightSource \"infinite\" \"rgb L\" [1 1 1]\n" + c.shapes, std::uint64_t{64} << 20, head);
    RayCounts counts;
    const Sums sums = render(world.tracer(), 16384, counts);
    EXPECT_EQ(counts.invalid, 0u);
    double sum = 0;
    for (const auto& [where, radiance] : sums) {
      for (const std::int64_t channel : radiance) {
        const double value = std::ldexp(static_cast<double>(channel), -world.tracer().job().k);
        EXPECT_GE(value, 0);
        sum += value / 3;
      }
    }
    const double off = std::abs(sum / static_cast<double>(sums.size()) - 1);
    record(c.name, "light that is missing or too much under an even sky", c.limit ? 0.25 : 0.02, off, sums.size(), c.limit ? Kind::limit : Kind::bound);
  }
}

}  // namespace
}  // namespace cloudrenderer::stability
