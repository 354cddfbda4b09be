// Closed meshes: no ray from inside comes out, through whatever edge or vertex it goes, on one host or cut into parts.
#include <atomic>
#include <thread>

#include "geometry_meshes.h"
#include "record.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

constexpr std::uint64_t kSeed = 21;

// A ridge of slivers a thousand times as long as wide, with walls and a floor: closed.
TestMesh sliver_box(std::uint32_t n) {
  TestMesh mesh;
  Random random(3);
  const auto row = [&](double y, bool top) {
    for (std::uint32_t x = 0; x <= n; ++x) mesh.points.push_back(Vec3(glm::dvec3(x, y, top ? 20 + random.uniform() : 0)));
  };
  row(0, true), row(1000, true), row(0, false), row(1000, false);
  const auto quad = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    mesh.triangles.push_back({a, b, c});
    mesh.triangles.push_back({a, c, d});
  };
  const std::uint32_t far = n + 1, low = 2 * (n + 1), low_far = 3 * (n + 1);
  for (std::uint32_t x = 0; x < n; ++x) {
    quad(x, x + 1, far + x + 1, far + x);                       // top
    quad(low + x, low + x + 1, low_far + x + 1, low_far + x);   // floor
    quad(x, x + 1, low + x + 1, low + x);                       // walls
    quad(far + x, far + x + 1, low_far + x + 1, low_far + x);
  }
  quad(0, far, low_far, low);
  quad(n, far + n, low_far + n, low + n);
  return mesh;
}

struct Closed {
  std::string name;
  TestMesh mesh;
  glm::dvec3 from, to;        // a box inside
  std::uint64_t part_size;  // of the cut version
  bool rims_only = false;   // every vertex is at an end of the mesh: no ray from the box goes along an axis to it
};

std::vector<Closed> meshes() {
  const Vec3 off(3000.25f, -2000.5f, 1000.125f);
  return {{"icosphere of 20,480 triangles", icosphere(5, 1, Vec3(0.f)), glm::dvec3(-.5), glm::dvec3(.5), 100'000},
          {"icosphere 4e3 radii away", icosphere(5, 1, off), glm::dvec3(off) - .5, glm::dvec3(off) + .5, 100'000},
          {"terrain of slivers, closed", sliver_box(500), {1, 1, 1}, {499, 999, 19}, 30'000, true}};
}

// What rays aim at.
enum class Aim { vertices, edges, faces };
const char* name_of(Aim aim) { return aim == Aim::vertices ? "vertices" : aim == Aim::edges ? "edges" : "faces"; }

Vec3 target(Random& random, const TestMesh& mesh, Aim aim) {
  const Triangle t = mesh.triangles[random.below(static_cast<std::uint32_t>(mesh.triangles.size()))];
  const glm::dvec3 a(mesh.points[t.x]), b(mesh.points[t.y]), c(mesh.points[t.z]);
  double u = random.uniform();
  const double v = random.uniform();
  if (aim == Aim::vertices) return mesh.points[t.x];
  // Not so near to an end that the point is rounded to it.
  if (aim == Aim::edges) u = 0.05 + 0.9 * u;
  if (aim == Aim::edges) return random.below(2) ? Vec3(a + u * (b - a)) : 0.5f * mesh.points[t.x] + 0.5f * mesh.points[t.y];
  return Vec3(a + (u + v > 1 ? 1 - u : u) * (b - a) + (u + v > 1 ? 1 - v : v) * (c - a));
}

struct Escapes {
  std::uint64_t rays = 0, nearest = 0, shadow = 0, differ = 0;
};

// One pass with `count` rays from `make`; both worlds see the same rays.
template <class Make>
Escapes escapes(const World& whole, const World& cut, std::uint64_t count, const Make& make) {
  std::atomic<std::uint64_t> nearest{0}, shadow{0}, differ{0}, next{0};
  constexpr std::uint64_t kBatch = 4096;
  const std::uint64_t batches = (count + kBatch - 1) / kBatch;
  const auto work = [&] {
    prepare_compute_thread();
    for (std::uint64_t b; (b = next++) < batches;) {
      Random random(mix64(kSeed + b));
      std::vector<ProbeRay> probes;
      std::vector<OcclusionRay> rays;
      for (std::uint64_t i = 0; i < kBatch; ++i) {
        probes.push_back(make(random));
        rays.push_back({probes.back().origin, probes.back().direction, 1e18f});
      }
      const SegmentBatch one = whole.trace(probes), many = cut.trace(probes);
      std::vector<std::uint8_t> blocked(kBatch), blocked_too(kBatch);
      whole.tracer().occluded(rays, {}, blocked);
      cut.tracer().occluded(rays, {}, blocked_too);
      for (std::size_t i = 0; i < kBatch; ++i) {
        nearest += one.hits[i].part == kNone || many.hits[i].part == kNone;
        shadow += !blocked[i] || !blocked_too[i];
        differ += one.hits[i].t != many.hits[i].t || one.hits[i].primitive != many.hits[i].primitive;
      }
    }
  };
  std::vector<std::jthread> threads;
  for (unsigned i = 0; i < (full() ? std::thread::hardware_concurrency() : 1u); ++i) threads.emplace_back(work);
  threads.clear();
  return {batches * kBatch, nearest, shadow, differ};
}

// Vertices are a limit of Embree's: the signs of its edge functions agree along an edge that two triangles share, but
// those of all edges at a vertex may by rounding say together that the ray passes none of its triangles. So are rays that
// pass an edge within rounding: two triangles count as hit, but the ray meets the box of one of them only, or of both,
// as the BVH happens to be.
void report(const std::string& name, const Escapes& e, Aim aim) {
  constexpr double kDiffer = 1e-3;
  const auto share = [&](std::uint64_t n) { return static_cast<double>(n) / static_cast<double>(e.rays); };
  if (aim == Aim::vertices) {
    record_limit(name, "share of rays that escape, shadow rays counted", 0.02, share(e.nearest + e.shadow) / 2, e.rays);
    record_limit(name, "share of hits that are others when cut into parts", kDiffer, share(e.differ), e.rays);
  } else {
    record(name, "rays that escape, shadow rays counted", 0, static_cast<double>(e.nearest + e.shadow), e.rays);
    if (aim == Aim::faces)
      record(name, "hits that are others when cut into parts", 0, static_cast<double>(e.differ), e.rays);
    else
      record_limit(name, "share of hits that are others when cut into parts", kDiffer, share(e.differ), e.rays);
  }
}

class Watertight : public testing::TestWithParam<std::size_t> {};

TEST_P(Watertight, NoRayFromInsideEscapes) {
  const Closed closed = meshes()[GetParam()];
  const std::string text = "Material \"matte\"\n" + closed.mesh.text();
  const World whole(text), cut(text, closed.part_size);
  EXPECT_EQ(whole.parts(), 2u);
  EXPECT_GT(cut.parts(), 6u);
  const auto inside = [&](Random& random) {
    return Vec3(random.uniform(closed.from.x, closed.to.x), random.uniform(closed.from.y, closed.to.y), random.uniform(closed.from.z, closed.to.z));
  };
  const std::string name = fmt::format("{}, whole and in {} parts", closed.name, cut.parts() - 1);
  for (const Aim aim : {Aim::vertices, Aim::edges, Aim::faces}) {
    report(fmt::format("{}: rays at its {}", name, name_of(aim)), escapes(whole, cut, rays(16'000, aim == Aim::vertices ? 2'000'000 : 16'000'000), [&](Random& random) {
             for (;;) {
               const Vec3 from = inside(random), way = target(random, closed.mesh, aim) - from;
               if (glm::length(way) > 1e-3f) return ProbeRay{from, glm::normalize(way)};
             }
           }),
           aim);
  }
  // Along an axis, exactly through it, with zeros of both signs.
  for (const Aim aim : {Aim::vertices, Aim::edges}) {
    if (aim == Aim::vertices && closed.rims_only) continue;
    report(fmt::format("{}: rays parallel to axes at its {}", name, name_of(aim)), escapes(whole, cut, rays(16'000, 2'000'000), [&](Random& random) {
             for (;;) {
               const Vec3 at = target(random, closed.mesh, aim);
               const int axis = static_cast<int>(random.below(3));
               Vec3 from = at, way(0.f);
               from[axis] = inside(random)[axis];
               bool in = true;
               for (int i = 0; i < 3; ++i) in = in && from[i] > static_cast<float>(closed.from[i]) && from[i] < static_cast<float>(closed.to[i]);
               if (!in) continue;
               for (int i = 0; i < 3; ++i) way[i] = random.below(2) ? 0.f : -0.f;
               way[axis] = at[axis] > from[axis] ? 1.f : -1.f;
               return ProbeRay{from, way};
             }
           }),
           aim);
  }
}
INSTANTIATE_TEST_SUITE_P(Meshes, Watertight, testing::Range<std::size_t>(0, 3));

// Rays in the plane of triangles and along shared edges of a closed box: they run in its faces, or start in them and go
// in; whatever they find, it is within the box, and those that go in find the other side.
TEST(Watertight, RaysAlongFacesAndEdgesOfABoxStayInIt) {
  TestMesh box;
  for (std::uint32_t i = 0; i < 8; ++i) box.points.emplace_back(i & 1 ? 2.f : -1.f, i & 2 ? 3.f : -1.f, i & 4 ? 4.f : -1.f);
  for (const glm::u32vec4 q : {glm::u32vec4{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}) {
    box.triangles.push_back({q.x, q.y, q.z});
    box.triangles.push_back({q.x, q.z, q.w});
  }
  const World world("Material \"matte\"\n" + box.text());
  Random random(kSeed);
  std::uint64_t tries = 0, outside = 0, from_face = 0, lost = 0, not_finite = 0;
  for (std::uint64_t round = 0; round < rays(20, 2000); ++round) {
    std::vector<ProbeRay> probes;
    std::vector<bool> goes_in;
    for (int i = 0; i < 1000; ++i) {
      const std::uint32_t a = random.below(8), axis = random.below(3), b = a ^ (1u << axis);
      const Vec3 p = box.points[a], q = box.points[b];
      Vec3 way = glm::normalize(q - p);
      for (int k = 0; k < 3; ++k)
        if (way[k] == 0.f && random.below(2)) way[k] = -0.f;
      const auto along = static_cast<float>(random.uniform(-.5, 1.5));
      Vec3 from = p + along * (q - p);
      const bool in_face = random.below(2);
      if (in_face) {  // parallel to the edge, within the face
        const int other = static_cast<int>((axis + 1 + random.below(2)) % 3);
        from[other] = static_cast<float>(random.uniform(-1, other == 0 ? 2 : other == 1 ? 3 : 4));
      }
      bool in = false;
      if (random.below(3) == 0) {  // from the face, straight into the box
        from = {random.uniform(-.9, 1.9), random.uniform(-.9, 2.9), random.uniform(-.9, 3.9)};
        from[static_cast<int>(axis)] = box.points[a][static_cast<int>(axis)];
        in = true;
      }
      probes.push_back({from, way});
      goes_in.push_back(in);
    }
    const SegmentBatch found = world.trace(probes);
    for (std::size_t i = 0; i < probes.size(); ++i) {
      ++tries;
      const Hit& h = found.hits[i];
      if (goes_in[i]) ++from_face, lost += h.part == kNone;
      if (h.part == kNone) continue;
      not_finite += !std::isfinite(h.t) || !std::isfinite(h.u) || !std::isfinite(h.v) || h.t < 0;
      const Vec3 at = probes[i].origin + h.t * probes[i].direction;
      for (int k = 0; k < 3; ++k) outside += at[k] < box.points[0][k] - 1e-5f || at[k] > box.points[7][k] + 1e-5f;
    }
  }
  record("rays along edges and in faces of a box", "hits outside of the box", 0, static_cast<double>(outside), tries);
  record("rays along edges and in faces of a box", "distances that are no numbers or negative", 0, static_cast<double>(not_finite), tries);
  record("rays from a face into the box", "rays that miss the other side", 0, static_cast<double>(lost), from_face);
}

}  // namespace
}  // namespace cloudrenderer::stability
