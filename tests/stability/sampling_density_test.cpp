// Densities of phase functions, lights, environment maps and lenses, integrated by quadrature; and that what is sampled
// has the density that is reported, where that can be told exactly.
#include "../film_support.h"
#include "../shading_lights_support.h"
#include "quadrature.h"
#include "record.h"
#include "base/equal_area.h"
#include "shading/light_choice.h"
#include "shading/phase.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

using test::Scene;

// 1 - the cosine of a direction to z, however small.
Vec3 off_axis(double x, double phi) {
  const double r = std::sqrt(x * (2 - x));
  return {static_cast<float>(r * std::cos(phi)), static_cast<float>(r * std::sin(phi)), static_cast<float>(1 - x)};
}

TEST(PhaseFunction, IntegratesToOne) {
  double off_one = 0, worst = 0;
  std::uint64_t count = 0;
  for (const double g : {0.0, 0.5, -0.9, 0.99, -0.999, 0.9999, -0.9999}) {
    const auto gf = static_cast<float>(g);
    const double exact_g = static_cast<double>(gf);
    double integral = 0;
    constexpr int kSteps = 20'000, kTurns = 8;
    // In the logarithm of 1 - cos to the direction of the peak.
    const Vec3 wo(0, 0, g >= 0 ? -1.f : 1.f);
    const double from = std::log(1e-16), step = (std::log(2.0) - from) / kSteps;
    for (int i = 0; i < kSteps; ++i) {
      const double x = std::exp(from + step * (i + 0.5));
      for (int turn = 0; turn < kTurns; ++turn) {
        const Vec3 wi = off_axis(x, 2 * kPiDouble * (turn + 0.3) / kTurns);
        const double density = static_cast<double>(phase_hg(wo, wi, gf));
        integral += density * x * step * 2 * kPiDouble / kTurns;
        // For the angle between the two as they are.
        const glm::dvec3 a(wo), b(wi);
        const double apart = g >= 0 ? glm::dot(a + b, a + b) / 2 : glm::dot(a - b, a - b) / 2, h = std::fabs(exact_g);
        const double d = (1 - h) * (1 - h) + 2 * h * apart;
        worst = std::max(worst, std::fabs(density / ((1 - h * h) / (4 * kPiDouble * d * std::sqrt(d))) - 1));
      }
    }
    off_one = std::max(off_one, std::fabs(integral - 1));
    count += kSteps * kTurns;
  }
  record("phase function, g = -0.9999 to 0.9999", "1 - its integral", 1e-4, off_one, count);
  record("phase function, g = -0.9999 to 0.9999", "relative error of its density", 1e-5, worst, count);
}

// The angle's distribution function is known, so that a sample tells the number that it was made from.
TEST(PhaseFunction, SamplesAreTheInverseOfItsDistribution) {
  double worst = 0;
  constexpr int kSamples = 4096;
  for (const double g : {0.0, 1e-4, 0.5, -0.9, 0.99, -0.999, 0.9999, -0.9999}) {
    const auto gf = static_cast<float>(g);
    const double h = std::fabs(static_cast<double>(gf));
    const Vec3 wo(0, 0, g >= 0 ? -1.f : 1.f);  // the peak is along z
    std::vector<double> found;
    for (int i = 0; i < kSamples; ++i) {
      const Vec3 wi = sample_phase_hg(wo, gf, {(static_cast<float>(i) + 0.5f) / kSamples, 0.37f});
      const double r2 = static_cast<double>(wi.x) * static_cast<double>(wi.x) + static_cast<double>(wi.y) * static_cast<double>(wi.y);
      const double z = static_cast<double>(wi.z), x = z > 0 ? r2 / (1 + std::sqrt(std::max(0.0, 1 - r2))) : 1 - z;  // 1 - cos
      // The share of light within this angle of the peak.
      const double d = (1 - h) * (1 - h) + 2 * h * x;
      found.push_back(h < 1e-9 ? x / 2 : (1 + h) / (2 * h) * (1 - (1 - h) / std::sqrt(d)));
    }
    std::sort(found.begin(), found.end());
    for (int i = 0; i < kSamples; ++i) worst = std::max(worst, std::fabs(found[static_cast<std::size_t>(i)] - (i + 0.5) / kSamples));
  }
  record("samples of the phase function, g = -0.9999 to 0.9999", "error of the distribution function", 1e-4, worst, kSamples);
}

// Spheres: the density is one over the solid angle, here of 2 pi down to 1e-18 steradian.
TEST(LightDensities, OfSpheres) {
  const auto lights = Scene().quadric(test::sphere(Vec3(0), 1), Rgb(1)).build();
  double worst = 0, near = 0;
  std::uint64_t n = 0;
  for (double distance = 1.0001; distance < 1e9; distance *= 1.02, ++n) {
    const Vec3 p = glm::dvec3(distance) * glm::normalize(glm::dvec3(1, 2, -2)), to = -glm::normalize(p);
    const glm::dvec3 q(p);
    const double sin2 = 1 / glm::dot(q, q), angle = 2 * kPiDouble * sin2 / (1 + std::sqrt(1 - sin2));
    const double pdf = static_cast<double>(lights->emitted_pdf(0, p, to, to, 1.f, p, to, 0));
    // 1 - sin^2 has the rounding of p, squared.
    (distance < 1.01 ? near : worst) = std::max(distance < 1.01 ? near : worst, std::fabs(pdf * angle - 1));
  }
  record("sphere light from 1.01 radii to 1e9 radii (2.7 to 3e-18 sr)", "1 - the integral of its density", 1e-4, worst, n);
  record("sphere light from 1.0001 to 1.01 radii", "1 - the integral of its density", 1e-4, near, n);
}

// Flat lights: over the area, where the integrand is smooth.
TEST(LightDensities, OfParallelogramsAndTriangles) {
  double worst = 0;
  std::uint64_t n = 0;
  for (const double size : {1e-6, 1e-3, 1.0, 1e3, 1e6})
    for (const double height : {1e-3, 1.0, 1e3}) {
      const auto s = static_cast<float>(size), h = static_cast<float>(height * size);
      const std::vector<Vec3> corners{{-s, -s, h}, {-s, s, h}, {s, s, h}, {s, -s, h}};
      for (const bool two : {false, true}) {
        const std::vector<Triangle> t = two ? std::vector<Triangle>{{0, 1, 2}} : test::kTwoTriangles;
        const auto lights = Scene().mesh(corners, t, Rgb(1)).build();
        const Vec3 p(0.3f * s, 0.1f * s, 0), ng(0, 0, -1);
        const Quadrature q(1e-6, 20'000);
        const auto inside = [&](double x, double y) {
          const glm::dvec3 at = glm::dvec3(corners[0]) + x * glm::dvec3(corners[1] - corners[0]) + y * glm::dvec3(corners[2] - corners[1]);
          const glm::dvec3 w = at - glm::dvec3(p);
          const double d = glm::length(w), cosine = w.z / d;
          const double pdf = static_cast<double>(lights->emitted_pdf(0, p, {0, 0, 1}, Vec3(w / d), static_cast<float>(d), Vec3(at), ng, 0));
          return pdf * cosine / (d * d) * 4 * size * size;
        };
        // The triangle 0 1 2 is the half x > y of the square.
        const double integral = two ? q.integrate([&](double x, double v) { return x * inside(x, x * v); }, 0, 1, 0, 1)
                                    : q.integrate(inside, 0, 1, 0, 1);
        worst = std::max(worst, std::fabs(integral - 1));
        ++n;
      }
    }
  record("parallelogram and triangle lights of 1e-6 to 1e6, from 1e-3 to 1e3 times their size", "1 - the integral of the density", 1e-4, worst, n);
}

TEST(LightDensities, OfDisksAndEllipsoids) {
  double worst_disk = 0, worst_ellipsoid = 0;
  std::uint64_t n = 0;
  for (const double size : {1e-4, 1.0, 1e4}) {
    const auto s = static_cast<float>(size);
    Quadric disk;
    disk.kind = QuadricKind::disk;
    disk.radius = s;
    const auto lights = Scene().quadric(disk, Rgb(1)).build();
    for (const double height : {0.01, 1.0, 100.0}) {
      const Vec3 p(0.2f * s, 0.1f * s, static_cast<float>(height * size));
      const double integral = Quadrature(1e-6, 20'000).integrate([&](double r, double phi) {
        const glm::dvec3 at(r * size * std::cos(phi), r * size * std::sin(phi), 0), w = at - glm::dvec3(p);
        const double d = glm::length(w);
        const double pdf = static_cast<double>(lights->emitted_pdf(0, p, {0, 0, -1}, Vec3(w / d), static_cast<float>(d), Vec3(at), {0, 0, 1}, 0));
        return pdf * (-w.z / d) / (d * d) * r * size * size;
      }, 0, 1, 0, 2 * kPiDouble);
      worst_disk = std::max(worst_disk, std::fabs(integral - 1));
      ++n;
    }
    // A distorted sphere: the whole cone of its object space is sampled. In the world that is the image of the cone.
    Quadric ball = test::sphere(Vec3(0), 1);
    const Mat4 m = glm::scale(Mat4(1.f), s * Vec3(2.4f, 1.2f, -1.8f));
    ball.object_to_world = Transform(m);
    const auto distorted = Scene().quadric(ball, Rgb(1)).build();
    for (const double away : {1.2, 3.0, 1000.0}) {
      const glm::dvec3 object(0, 0, away);
      const Vec3 p(glm::dmat3(glm::mat3(m)) * object);
      const double sin2 = 1 / (away * away), top = sin2 / (1 + std::sqrt(1 - sin2));
      const double integral = Quadrature(1e-6, 20'000).integrate([&](double x, double phi) {
        const double c = 1 - x * top, r = std::sqrt(x * top * (2 - x * top));
        const glm::dvec3 world = glm::dmat3(glm::mat3(m)) * glm::dvec3(r * std::cos(phi), r * std::sin(phi), -c);
        const double stretch = glm::length(world);
        const double pdf = static_cast<double>(distorted->emitted_pdf(0, p, Vec3(0), Vec3(world / stretch), 1.f, p, {0, 0, 1}, 0));
        const double volume = std::fabs(glm::determinant(glm::dmat3(glm::mat3(m))));
        return pdf * volume / (stretch * stretch * stretch) * top;
      }, 0, 1, 0, 2 * kPiDouble);
      worst_ellipsoid = std::max(worst_ellipsoid, std::fabs(integral - 1));
    }
  }
  record("disk lights of radius 1e-4 to 1e4, from 0.01 to 100 radii", "1 - the integral of the density", 1e-4, worst_disk, n);
  record("ellipsoid lights of size 1e-4 to 1e4, from 1.2 to 1000 radii", "1 - the integral of the density", 1e-4, worst_ellipsoid, n);
}

// A map of one sun over an even sky. In every cell of the table the density is even in (u, v), so one point a cell is
// exact; and sampling by a fine grid of numbers must find each cell as often as the density says.
void expect_map_density(int width, int height, float sun, const std::string& name) {
  const test::MapFile map(width, height, [&](int x, int y) { return Rgb(x == width / 3 && y == height / 3 ? sun : 1.f); });
  const auto lights = Scene().light("infinite", {test::string("mapname", map.path())}).build();
  double integral = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double theta = kPiDouble * (y + 0.5) / height, phi = 2 * kPiDouble * (x + 0.5) / width;
      const Vec3 w(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
      float pdf;
      lights->escaped(Vec3(0), Vec3(0), w, pdf);
      integral += static_cast<double>(pdf) * std::sin(theta);
    }
  integral *= 2 * kPiDouble * kPiDouble / (static_cast<double>(width) * height);
  record(name, "1 - the integral of the density", 1e-4, std::fabs(integral - 1), static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height));
}

TEST(LightDensities, OfASunInAMap) {
  expect_map_density(512, 256, 1e5f, "environment map of 512 x 256 with a sun of 1e5 to 1");
  expect_map_density(512, 256, 1e8f, "environment map of 512 x 256 with a sun of 1e8 to 1");
  if (full()) expect_map_density(4096, 2048, 1e5f, "environment map of 4096 x 2048 with a sun of 1e5 to 1");
}

// Numbers have 24 bits: all of them are tried. Each cell must come as often as its density says.
TEST(Distributions, SampleCellsAsOftenAsTheirDensitySays) {
  for (const float sun : {10.f, 1e5f, 1e8f}) {
    std::vector<float> values(1000, 1.f);
    values[300] = sun;
    values[700] = 0.f;
    const Distribution1D d(values);
    std::vector<std::uint32_t> seen(values.size());
    constexpr std::uint32_t kAll = 1u << 24;
    for (std::uint32_t i = 0; i < kAll; ++i) {
      float pdf;
      std::size_t cell;
      d.sample(static_cast<float>(i) * 0x1p-24f, pdf, cell);
      ++seen[cell];
    }
    double worst = 0, sum = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double reported = static_cast<double>(d.cell_probability(i)), found = seen[i] * 0x1p-24;
      sum += reported;
      worst = std::max(worst, reported == found ? 0 : std::fabs(found / reported - 1));
      const double x = (static_cast<double>(i) + 0.5) / 1000;
      EXPECT_NEAR(static_cast<double>(d.pdf(static_cast<float>(x))) / 1000, reported, 1e-6 * reported);
      if (values[i] == 0.f) {
        EXPECT_EQ(seen[i], 0u);
      }
    }
    char name[80];
    std::snprintf(name, sizeof name, "table of 1000 cells, one %g times the others", static_cast<double>(sun));
    record(name, "relative error of a cell's frequency", 1e-6, worst, kAll);
    record(name, "1 - the sum of the cells' chances", 1e-6, std::fabs(sum - 1), values.size());
  }
}

TEST(LightChoices, SumToOne) {
  Random random(17);
  for (const int count : {5, 1000, 20'000}) {
    std::vector<EmitterBounds> lights(static_cast<std::size_t>(count));
    for (EmitterBounds& b : lights) {
      b.center = Vec3(random.direction()) * static_cast<float>(random.log_uniform(1e-3, 1e4));
      b.radius = static_cast<float>(random.log_uniform(1e-6, 1));
      b.axis = Vec3(random.direction());
      b.strength = static_cast<float>(random.log_uniform(1e-4, 1e6));
      b.shape = random.uniform() < 0.3 ? EmitterShape::planar : random.uniform() < 0.1 ? EmitterShape::distant : EmitterShape::omni;
    }
    const LightChoice choice(lights);
    double worst = 0;
    const int points = count > 1000 ? 4 : 50;
    for (int k = 0; k < points; ++k) {
      const Vec3 p = Vec3(random.direction()) * static_cast<float>(random.log_uniform(1e-3, 1e5));
      const Vec3 n = k % 3 == 0 ? Vec3(0.f) : Vec3(random.direction());
      double sum = 0;
      for (std::uint32_t i = 0; i < lights.size(); ++i) sum += static_cast<double>(choice.chance(i, p, n));
      // The tree may end where nothing arrives.
      double lost = 0;
      constexpr int kTries = 4096;
      for (int i = 0; i < kTries; ++i) {
        float chance;
        lost += choice.sample(p, n, (static_cast<float>(i) + 0.5f) / kTries, chance) < 0;
      }
      worst = std::max(worst, lost == 0 ? std::fabs(sum - 1) : std::max(0.0, std::fabs(sum + lost / kTries - 1) - 2.0 / std::sqrt(kTries)));
    }
    record("choice among " + std::to_string(count) + " lights, seed 17", "1 - the sum of the chances", 1e-4, worst,
           static_cast<std::uint64_t>(points));
  }
}

TEST(EqualArea, GoesToTheSphereAndBack) {
  Random random(23);
  double worst = 0;
  const std::uint64_t n = rays(100'000, 5'000'000);
  for (std::uint64_t i = 0; i < n; ++i) {
    // Everywhere, and near the poles.
    const double away = i % 2 ? random.log_uniform(1e-7, 0.5) : random.uniform(), a = random.uniform(0, 2 * kPiDouble);
    const glm::dvec2 p = i % 2 ? glm::dvec2(0.5 + away * std::cos(a), 0.5 + away * std::sin(a)) : glm::dvec2(away, random.uniform());
    if (p.x < 0 || p.x >= 1 || p.y < 0 || p.y >= 1) continue;
    const Vec2 uv(p), back = equal_area_sphere_to_square(equal_area_square_to_sphere(uv));
    worst = std::max(worst, static_cast<double>(glm::length(back - uv)));
  }
  record("map of equal areas to the sphere and back, seed 23", "distance / width of the map", 4e-7, worst, n);
}

// A disk of even density: cells of the square keep their area.
TEST(Lenses, OfEvenDensity) {
  constexpr int kCells = 32, kEdge = 64;
  double worst = 0;
  for (int y = 0; y < kCells; ++y)
    for (int x = 0; x < kCells; ++x) {
      double area = 0;
      const auto at = [&](int i) {
        const int side = i / kEdge % 4, k = i % kEdge;
        const double t = static_cast<double>(k) / kEdge, px = side == 0 ? t : side == 1 ? 1 : side == 2 ? 1 - t : 0,
                     py = side == 0 ? 0 : side == 1 ? t : side == 2 ? 1 : 1 - t;
        return glm::dvec2(sample_disk<float>({static_cast<float>((x + px) / kCells), static_cast<float>((y + py) / kCells)}));
      };
      for (int i = 0; i < 4 * kEdge; ++i) {
        const glm::dvec2 a = at(i), b = at(i + 1);
        area += 0.5 * (a.x * b.y - a.y * b.x);
      }
      worst = std::max(worst, std::fabs(area * kCells * kCells / kPiDouble - 1));
    }
  record("points of a lens", "relative error of the density", 1e-4, worst, kCells * kCells);
}

}  // namespace
}  // namespace cloudrenderer::stability
