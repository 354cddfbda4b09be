// Sizes from 1e-6 to 1e9, offsets up to 1e7 sizes, cameras inside, on and up to 1e6 sizes away, against long double.
#include "../integrator_support.h"
#include "geometry_meshes.h"
#include "geometry_reference.h"
#include "record.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

constexpr std::uint64_t kSeed = 11;
// Every scene takes milliseconds to make: the ordinary run has the ends and the middle.
std::vector<double> sizes() { return full() ? std::vector<double>{1e-6, 1e-3, 1, 1e3, 1e6, 1e9} : std::vector<double>{1e-6, 1, 1e9}; }
std::vector<double> offsets() { return full() ? std::vector<double>{0, 1, 1e3, 1e5, 1e7} : std::vector<double>{0, 1e3, 1e7}; }  // in sizes
constexpr double kCameras[] = {0, 1, 2, 1e3, 1e6};    // in sizes from the center; 1 of a sphere is on it

// A float vector at about that distance: what is measured from it counts with its rounding.
Vec3 camera_at(Random& random, const Vec3& center, double size, double distance) {
  const double d = distance == 0 ? size * random.uniform(0, 0.9) : distance == 1 ? size : size * distance * random.uniform(1, 2);
  return Vec3(glm::dvec3(center) + d * random.direction());
}

TEST(Sizes, SpheresAreFoundWhereTheyAre) {
  Random random(kSeed);
  for (const double camera : kCameras) {
    std::uint64_t tries = 0, missed = 0, made_up = 0;
    double worst = 0;
    for (const double size : sizes()) {
      for (const double offset : offsets()) {
        const Vec3 center = Vec3(size * offset * glm::dvec3(.6, -.5, .7));
        const auto radius = static_cast<float>(size);
        const World world(fmt::format("Material \"mirror\"\nTransform [1 0 0 0 0 1 0 0 0 0 1 0 {:.9g} {:.9g} {:.9g} 1]\nShape \"sphere\" \"float radius\" [{:.9g}]",
                                      center.x, center.y, center.z, radius));
        std::vector<ProbeRay> probes;
        for (std::uint64_t i = 0; i < rays(400, 40'000); ++i) {
          const Vec3 from = camera_at(random, center, size, camera);
          // Within a disc around it that is a fifth larger than it.
          const glm::dvec3 to = glm::dvec3(center) + 1.2 * size * std::sqrt(random.uniform()) * random.direction();
          const Vec3 way(glm::normalize(to - glm::dvec3(from)));
          if (glm::dvec3(from) != to) probes.push_back({from, way});
        }
        const SegmentBatch found = world.trace(probes);
        for (std::size_t i = 0; i < probes.size(); ++i) {
          const Real3 o = Real3(probes[i].origin) - Real3(center), w(probes[i].direction);
          const Real length2 = glm::dot(w, w), near = -glm::dot(o, w) / length2, r = radius;
          const Real3 across = glm::cross(o, w);
          const Real aside2 = glm::dot(across, across) / length2, aside = std::sqrt(aside2);
          // Along the rim, and for a start on the surface itself, rounding decides.
          if (std::abs(aside - r) < 1e-6L * r) continue;
          const Real half = aside < r ? std::sqrt((r - aside) * (r + aside) / length2) : 0;
          Real t = near - half;
          const Real start = (glm::length(o) - r) * (glm::length(o) + r) / length2 / (near + half);  // the first root again, without cancellation
          if (near + half > 0) t = start;
          if (std::abs(t) < 1e-7L * r || std::abs(near + half) < 1e-7L * r) continue;
          if (t < 0) t = near + half;
          const bool there = aside < r && t > 0;
          ++tries;
          const bool hit = found.hits[i].part != kNone;
          missed += there && !hit;
          made_up += !there && hit;
          if (there && hit) worst = std::max(worst, static_cast<double>(std::abs(static_cast<Real>(found.hits[i].t) - t) / (0x1p-24L * t + 1e-11L * r)));
        }
      }
    }
    const std::string name = "spheres of 1e-6 to 1e9, up to 1e7 radii off, camera " +
                             (camera == 0 ? std::string("inside") : camera == 1 ? std::string("on it") : fmt::format("{:g} radii away", camera));
    record(name, "hits that are missed", 0, static_cast<double>(missed), tries);
    record(name, "hits that are made up", 0, static_cast<double>(made_up), tries);
    record(name, "error of t / (half an ulp + 1e-11 radii)", 1.01, worst, tries);
  }
}

TEST(Sizes, TrianglesAreFoundWhereTheyAre) {
  Random random(kSeed + 1);
  for (const double camera : {0.01, 2.0, 1e3, 1e6}) {
    std::uint64_t tries = 0, inside = 0, near = 0, missed = 0, made_up = 0;
    double worst = 0, worst_t = 0;
    for (const double size : sizes()) {
      for (const double offset : offsets()) {
        const glm::dvec3 center = size * offset * glm::dvec3(.6, -.5, .7);
        TestMesh mesh;
        // As they are once they are rounded; where nothing is left of the triangle there is nothing to find.
        for (const glm::dvec3& p : {glm::dvec3(-.8, -.5, .1), glm::dvec3(.9, -.3, -.2), glm::dvec3(.1, .9, .3)}) mesh.points.push_back(Vec3(center + size * p));
        mesh.triangles = {{0, 1, 2}};
        const std::array<Real3, 3> v = {Real3(mesh.points[0]), Real3(mesh.points[1]), Real3(mesh.points[2])};
        const Real3 cross = glm::cross(v[1] - v[0], v[2] - v[0]);
        if (glm::length(cross) < static_cast<Real>(0.1 * size * size)) continue;
        const Real3 n = glm::normalize(cross);
        const World world("Material \"mirror\"\n" + mesh.text());
        std::vector<ProbeRay> probes;
        for (std::uint64_t i = 0; i < rays(400, 40'000); ++i) {
          const Vec3 from = Vec3(center + size * camera * random.uniform(1, 2) * random.direction());
          const Real3 to = v[0] + static_cast<Real>(random.uniform(-.2, 1.2)) * (v[1] - v[0]) + static_cast<Real>(random.uniform(-.2, 1.2)) * (v[2] - v[0]);
          probes.push_back({from, Vec3(glm::normalize(to - Real3(from)))});
        }
        const SegmentBatch found = world.trace(probes);
        for (std::size_t i = 0; i < probes.size(); ++i) {
          const Real3 o(probes[i].origin), w(probes[i].direction);
          const Real cosine = glm::dot(w, n), t = glm::dot(v[0] - o, n) / cosine;
          const Real3 p = o + t * w;
          const Real area2 = glm::dot(cross, cross);
          const Real b1 = glm::dot(glm::cross(p - v[0], v[2] - v[0]), cross) / -area2 * -1, b2 = glm::dot(glm::cross(v[1] - v[0], p - v[0]), cross) / area2;
          const Real least = std::min({b1, b2, 1 - b1 - b2});
          // Embree sees the corners from the ray's origin, in float: they are off by an ulp of their distance.
          Real reach = 0;
          for (const Real3& corner : v) reach = std::max(reach, glm::length(corner - o));
          const Real off = 0x1p-22L * reach / std::abs(cosine), margin = 2 * off / static_cast<Real>(size);
          ++tries;
          const bool hit = found.hits[i].part != kNone;
          made_up += hit && (least < -margin || t < -off);
          if (least > margin && t > off) ++inside, missed += !hit;
          if (!hit) continue;
          const Hit& h = found.hits[i];
          const Real3 at = (1 - static_cast<Real>(h.u) - static_cast<Real>(h.v)) * v[0] + static_cast<Real>(h.u) * v[1] + static_cast<Real>(h.v) * v[2];
          worst = std::max(worst, static_cast<double>(glm::length(at - p) / off));
          // Seen from far and along its plane a triangle is turned by these ulps.
          if (off > static_cast<Real>(0.5 * size)) continue;
          ++near;
          worst_t = std::max(worst_t, static_cast<double>(std::abs(static_cast<Real>(h.t) - t) / off));
        }
      }
    }
    const std::string name = fmt::format("triangles of 1e-6 to 1e9, up to 1e7 sizes off, camera {:g} sizes away", camera);
    if (inside) record(name, "hits that are missed", 0, static_cast<double>(missed), inside);
    record(name, "hits that are made up", 0, static_cast<double>(made_up), tries);
    record(name, "distance along the plane from the true hit / (4 roundings of the distance / cosine)", 1, worst, tries);
    if (near) record(name, "error of t / (8 roundings of the distance / cosine)", 1, worst_t / 2, near);
  }
}

// Everything that has a length, times `s`.
std::string scaled_scene(double s, std::string& head) {
  const auto n = [&](std::initializer_list<double> v) {
    std::string out;
    for (const double x : v) out += fmt::format("{:.9g} ", static_cast<float>(static_cast<double>(static_cast<float>(x)) * s));
    return out;
  };
  const auto move = [&](double x, double y, double z) { return "Transform [1 0 0 0 0 1 0 0 0 0 1 0 " + n({x, y, z}) + "1]\n"; };
  head = "LookAt " + n({0, -6, 3, 0, 0, .5}) + " 0 0 1\nCamera \"perspective\" \"float fov\" [40]\n"
         "Film \"image\" \"integer xresolution\" [32] \"integer yresolution\" [24] \"string filename\" \"a.exr\"\n"
         "Sampler \"sobol\" \"integer pixelsamples\" [16]\nIntegrator \"path\" \"integer maxdepth\" [6]\n";
  TestMesh ball = icosphere(1, static_cast<float>(.4 * s), Vec3(0.f));
  return "LightSource \"infinite\" \"rgb L\" [.2 .3 .4]\n"
         "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [5 5 5]\n" + move(-2, 0, 3) + "Shape \"sphere\" \"float radius\" [" + n({.4}) + "]\nAttributeEnd\n"
         "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [3 2 1]\nShape \"trianglemesh\" \"integer indices\" [0 1 2 2 3 0] \"point P\" [" + n({2, 1, 3, 2, 2, 3, 1, 2, 3, 1, 1, 3}) + "]\nAttributeEnd\n"
         "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [2 2 4]\n" + move(1.5, -1, 3) + "Shape \"disk\" \"float radius\" [" + n({.3}) + "]\nAttributeEnd\n"
         "Material \"matte\" \"rgb Kd\" [.5 .4 .3]\nShape \"trianglemesh\" \"integer indices\" [0 1 2 2 3 0] \"point P\" [" + n({-4, -4, 0, 4, -4, 0, 4, 4, 0, -4, 4, 0}) + "]\n"
         "Material \"plastic\" \"rgb Kd\" [.3 .1 .1] \"rgb Ks\" [.5 .5 .5] \"float roughness\" [.1]\n"
         "AttributeBegin\n" + move(-1, 0, 0) + "Shape \"cone\" \"float radius\" [" + n({.6}) + "] \"float height\" [" + n({1.5}) + "]\nAttributeEnd\n"
         "Material \"glass\"\nAttributeBegin\n" + move(.3, -1.5, .6) + "Shape \"sphere\" \"float radius\" [" + n({.5}) + "]\nAttributeEnd\n"
         "Material \"metal\" \"float uroughness\" [.05] \"float vroughness\" [.2]\nAttributeBegin\n" + move(1.4, 0, 0) + "Shape \"cylinder\" \"float radius\" [" + n({.4}) + "] \"float zmin\" [0] \"float zmax\" [" + n({1.2}) + "]\nAttributeEnd\n"
         "AttributeBegin\n" + move(.5, 1.5, .8) + "Shape \"paraboloid\" \"float radius\" [" + n({.4}) + "] \"float zmax\" [" + n({.8}) + "]\nAttributeEnd\n"
         "Material \"matte\" \"rgb Kd\" [.2 .2 .6]\nTransform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]\n"
         "ObjectBegin \"thing\"\n" + ball.text() + "ObjectEnd\n"
         "AttributeBegin\n" + move(-.5, -2, .5) + "ObjectInstance \"thing\"\nAttributeEnd\n"
         "AttributeBegin\n" + move(-2, -1, .5) + "ObjectInstance \"thing\"\nAttributeEnd\n";
}

std::vector<glm::dvec3> picture(double s, RayCounts& counts, Sums& sums) {
  std::string head;
  const std::string text = scaled_scene(s, head);
  const World world(text, std::uint64_t{64} << 20, head);
  sums = render(world.tracer(), 16384, counts);
  std::vector<glm::dvec3> pixels(32 * 24, glm::dvec3(0));
  for (const auto& [where, sum] : sums) {
    glm::dvec3 c;
    for (int i = 0; i < 3; ++i) c[i] = std::ldexp(static_cast<double>(sum[static_cast<std::size_t>(i)]), -world.tracer().job().k) / 16;
    pixels[where.first] += c;
  }
  return pixels;
}

TEST(Sizes, AScaledSceneHasTheSamePicture) {
  RayCounts counts;
  Sums one, other;
  const std::vector<glm::dvec3> reference = picture(1, counts, one);
  EXPECT_EQ(counts.invalid, 0u);
  for (const double s : {0x1p-17, 0x1p17}) {
    counts = {};
    picture(s, counts, other);
    std::uint64_t differ = 0;
    for (const auto& [where, sum] : one) differ += other.at(where) != sum;
    record(fmt::format("a scene times {:g}", s), "samples that differ in a bit", 0, static_cast<double>(differ), one.size());
    EXPECT_EQ(counts.invalid, 0u);
  }
  for (const double s : {1e-5, 1e5}) {
    counts = {};
    const std::vector<glm::dvec3> scaled = picture(s, counts, other);
    EXPECT_EQ(counts.invalid, 0u);
    double error = 0, mean = 0;
    for (std::size_t i = 0; i < scaled.size(); ++i) {
      const glm::dvec3 d = scaled[i] - reference[i];
      error += glm::dot(d, d);
      mean += glm::dot(reference[i], reference[i]);
      EXPECT_GE(std::min({scaled[i].x, scaled[i].y, scaled[i].z}), 0);
    }
    record(fmt::format("a scene times {:g}", s), "mean squared difference of the pictures / mean square", 1e-3, error / mean, one.size());
  }
}

}  // namespace
}  // namespace cloudrenderer::stability
