// Instances of instances, eight deep, with transforms as bad as they come: what rays find against the product of the same
// matrices in long double.
#include "geometry_meshes.h"
#include "geometry_reference.h"
#include "record.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

constexpr int kLevels = 8;

struct Chain {
  std::string name;
  std::vector<Mat4> levels;  // innermost first
  double missing = 0;        // share of rays that may miss: rays in float, seen from the object, are rounded by more than its size
};

std::string transform_text(const Mat4& m) {
  std::string numbers;
  for (int i = 0; i < 16; ++i) numbers += fmt::format("{:.9g} ", m[i / 4][i % 4]);
  return "Transform [" + numbers + "]\n";
}

// A turn, scales along other axes, a move.
Mat4 level(Random& random, const glm::dvec3& scale, double far) {
  const auto turn = [&] {
    const glm::dvec3 a = random.direction(), b = glm::normalize(glm::cross(a, random.direction()));
    return glm::dmat3(a, b, glm::cross(a, b));
  };
  const glm::dmat3 m = turn() * glm::dmat3(scale.x, 0, 0, 0, scale.y, 0, 0, 0, scale.z) * turn();
  Mat4 out{glm::mat3(m)};
  out[3] = glm::vec4(Vec3(far * random.direction()), 1.f);
  return out;
}

std::vector<Chain> chains(Random& random) {
  std::vector<Chain> all(5);
  all[0].name = "turned and moved";
  all[1].name = "mirrored, scales 1/2 to 2";
  all[2].name = "squeezed to 1e-3 in the middle, stretched by 1e3 above";
  all[3].name = "near-singular: 1e-4 of one axis at the outermost level";
  all[4].name = "near-singular: 1e-6 of one axis at the outermost level";
  all[3].missing = 1e-4;
  all[4].missing = 0.15;
  for (int i = 0; i < kLevels; ++i) {
    const auto any = [&] { return random.log_uniform(0.5, 2) * (random.uniform() < 0.5 ? -1 : 1); };
    all[0].levels.push_back(level(random, glm::dvec3(1), 3));
    all[1].levels.push_back(level(random, {any(), any(), any()}, 3));
    all[2].levels.push_back(level(random, {1, i == 3 ? 1e-3 : i == 5 ? 1e3 : 1, 1}, 1));
    all[3].levels.push_back(level(random, {1, i == 7 ? 1e-4 : 1, 1}, 1));
    all[4].levels.push_back(level(random, {1, i == 7 ? 1e-6 : 1, 1}, 1));
  }
  return all;
}

std::string nested(const Chain& chain, const std::string& shape) {
  std::string text = "Material \"mirror\" \"color Kr\" [1 1 1]\nTransform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]\nObjectBegin \"0\"\n" + shape + "ObjectEnd\n";
  for (int i = 0; i < kLevels; ++i) {
    const std::string instance = "AttributeBegin\n" + transform_text(chain.levels[static_cast<std::size_t>(i)]) + fmt::format("ObjectInstance \"{}\"\nAttributeEnd\n", i);
    text += i + 1 < kLevels ? fmt::format("ObjectBegin \"{}\"\n", i + 1) + instance + "ObjectEnd\n" : instance;
  }
  return text;
}

Real33 magnitudes(const Real33& m) {
  Real33 out(0);
  for (int c = 0; c < 3; ++c) out[c] = glm::abs(m[c]);
  return out;
}

// A point through the chain, and what rounding each level to float (four operations a coordinate, and the matrix) may do.
struct Placed {
  Real3 p, error;
};
Placed place(const Chain& chain, const Real3& p) {
  Placed out{p, Real3(0)};
  constexpr Real kRoundings = 8 * 0x1p-24L;
  for (const Mat4& m : chain.levels) {
    const RealAffine a(m);
    const Real33 size = magnitudes(a.linear);
    out.error = size * out.error + kRoundings * (size * glm::abs(out.p) + glm::abs(a.translation));
    out.p = a.point(out.p);
  }
  return out;
}

TEST(Instances, EightDeepLieWhereTheirMatricesSay) {
  Random random(7);
  const TestMesh mesh = icosphere(1, 1, Vec3(0.f));
  for (const Chain& chain : chains(random)) {
    const World world(nested(chain, mesh.text()));
    const std::uint64_t count = rays(4000, 1'000'000);
    double worst = 0;
    std::uint64_t missed = 0;
    for (std::uint64_t done = 0; done < count;) {
      std::vector<ProbeRay> probes;
      std::vector<std::pair<Real3, Placed>> truth;  // the triangle's normal, the point aimed at
      for (int i = 0; i < 1000; ++i, ++done) {
        const Triangle t = mesh.triangles[random.below(static_cast<std::uint32_t>(mesh.triangles.size()))];
        std::array<Real3, 3> corner;
        Real3 aim(0);
        const Real u = random.uniform(0.1, 0.4), v = random.uniform(0.1, 0.4);
        const std::array<Real, 3> weight = {1 - u - v, u, v};
        for (int k = 0; k < 3; ++k) {
          const Real3 p(mesh.points[t[k]]);
          corner[static_cast<std::size_t>(k)] = place(chain, p).p;
          aim += weight[static_cast<std::size_t>(k)] * p;
        }
        const Placed at = place(chain, aim);
        const Real3 cross = glm::cross(corner[1] - corner[0], corner[2] - corner[0]);
        const Real3 center = place(chain, Real3(0)).p;
        Real3 n = glm::normalize(cross);
        if (glm::dot(n, at.p - center) < 0) n = -n;
        // From outside, within 60 degrees of the normal.
        Real3 way;
        do way = Real3(random.direction());
        while (glm::dot(way, n) < 0.5L);
        const Real far = std::sqrt(glm::length(cross)) * static_cast<Real>(random.log_uniform(1, 100));
        const Vec3 origin(at.p + far * way);
        probes.push_back({origin, Vec3(glm::normalize(at.p - Real3(origin)))});
        truth.emplace_back(n, at);
      }
      SegmentBatch batch = world.trace(probes), hit;
      for (std::size_t i = 0; i < batch.size(); ++i) {
        if (batch.hits[i].part == kNone) {
          ++missed;
          continue;
        }
        hit.segments.push_back(batch.segments[i]);
        hit.hits.push_back(batch.hits[i]);
        hit.next.emplace_back();
      }
      ShadeOutput out;
      world.tracer().shade(hit, out);
      EXPECT_EQ(out.counts.invalid, 0u);
      for (const PathSegment& s : out.continuing) {
        const auto& [n, at] = truth[s.pixel];
        // Where the bounce starts is off the surface by the bound of its error, and so much again may that be wrong.
        const Real bound = glm::dot(glm::abs(n), at.error + 0x1p-18L * glm::abs(at.p));
        worst = std::max(worst, static_cast<double>(std::abs(glm::dot(n, Real3(s.origin) - at.p)) / bound));
      }
    }
    if (chain.missing > 0)
      record_limit("instances 8 deep, " + chain.name, "share of rays that miss", chain.missing, static_cast<double>(missed) / static_cast<double>(count), count);
    else
      record("instances 8 deep, " + chain.name, "rays that miss", 0, static_cast<double>(missed), count);
    record("instances 8 deep, " + chain.name, "distance of bounces from the surface / bound of rounding", 2, worst, count);
  }
}

}  // namespace
}  // namespace cloudrenderer::stability
