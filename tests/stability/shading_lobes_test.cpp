// Lobes from the sharpest to the roughest, at grazing angles, and with shading normals that oppose the geometric one.
#include "../shading_bsdf_cases.h"
#include "quadrature.h"
#include "record.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

using namespace bsdf;
using testing::BsdfCase;

// D G / (4 cos cos) and the density of visible normals' reflections, D G1 / (4 cos), in double (Heitz 2014, 2018; of V-grooves Heitz and
// d'Eon 2014).
struct Exact {
  double value, pdf;
};
Exact trowbridge_reitz_exact(double ax, double ay, const glm::dvec3& wo, const glm::dvec3& wi) {
  const glm::dvec3 h = glm::normalize(wo + wi);
  const double q = h.x * h.x / (ax * ax) + h.y * h.y / (ay * ay) + h.z * h.z, d = 1 / (kPiDouble * ax * ay * q * q);
  const auto root = [&](const glm::dvec3& w) { return std::sqrt(w.z * w.z + ax * ax * w.x * w.x + ay * ay * w.y * w.y); };
  const double co = std::fabs(wo.z), ci = std::fabs(wi.z);
  return {d / (2 * (ci * root(wo) + co * root(wi))), d / (2 * (co + root(wo)))};
}
Exact blinn_exact(double e, const glm::dvec3& wo, const glm::dvec3& wi) {
  const glm::dvec3 h = glm::normalize(wo + wi);
  const double d = (e + 2) / (2 * kPiDouble) * std::pow(std::fabs(h.z), e), dot = glm::length(wo + wi) / 2;
  const double co = std::fabs(wo.z), ci = std::fabs(wi.z);
  const auto masking = [&](double c) { return std::min(1.0, 2 * std::fabs(h.z) * c / dot); };
  return {d * masking(std::min(co, ci)) / (4 * co * ci), d * masking(co) / (4 * co)};
}

// At sampled directions, where what rounds is what matters. A half vector known to 2^-23 moves the density of a lobe of
// width a by the factor 4 * 2^-23 / a at most (its logarithm's steepest slope is below 4 / a), besides its own rounding.
TEST(Microfacets, HaveTheirValuesFromTheSharpestToTheRoughest) {
  const std::uint64_t n = rays(2'000, 1'000'000);
  for (const bool is_blinn : {false, true}) {
    double value = 0, density = 0, weight = 0;  // errors over their bounds
    std::uint64_t made = 0;
    for (const float rough : {1e-5f, 1e-4f, 1e-3f, 1e-2f, 0.1f, 1.f}) {
      const Microfacets m = is_blinn ? blinn(rough) : trowbridge_reitz(rough, rough);
      const double width = is_blinn ? 1 / std::sqrt(static_cast<double>(m.x)) : static_cast<double>(m.x);
      const double bound = 4 * 0x1p-23 / width + (is_blinn ? 1e-5 : 2e-6);  // Blinn: of cosine_power()
      const Lobe lobe = microfacet(Rgb(1.f), m, no_fresnel());
      Random random(31);
      for (const double z : {1.0, 0.5, 1e-2, 1e-4, 1e-6}) {
        const Vec3 wo = direction(z, 0.4);
        Bsdf b(Frame(), Vec3(0, 0, 1));
        b.add(lobe);
        b.finish(wo);
        for (std::uint64_t i = 0; i < n; ++i) {
          BsdfSample s;
          if (!b.sample(wo, 0.5f, {below_one(random.uniform()), below_one(random.uniform())}, s)) continue;
          ++made;
          if (!is_finite(s.weight) || !std::isfinite(s.pdf)) {
            ADD_FAILURE() << "not finite, seed 31: roughness " << rough << ", cosine " << z;
            continue;
          }
          const glm::dvec3 o(wo), w(s.wi);
          const Exact exact = is_blinn ? blinn_exact(static_cast<double>(m.x), o, w)
                                       : trowbridge_reitz_exact(static_cast<double>(m.x), static_cast<double>(m.y), o, w);
          float pdf;
          const double f = static_cast<double>(b.eval_cos(wo, s.wi, pdf).x);
          density = std::max(density, std::fabs(static_cast<double>(pdf) / exact.pdf - 1) / bound);
          value = std::max(value, std::fabs(f / (exact.value * std::fabs(w.z)) - 1) / bound);
          weight = std::max(weight, std::fabs(static_cast<double>(s.weight.x) / (exact.value * std::fabs(w.z) / exact.pdf) - 1));
        }
      }
    }
    const std::string name = std::string(is_blinn ? "Blinn" : "Trowbridge and Reitz") + ", roughness 1e-5 to 1, cosines 1 to 1e-6, seed 31";
    record(name, "error of the density / what a half vector known to 2^-23 allows", 1, density, made);
    record(name, "error of the value / what a half vector known to 2^-23 allows", 1, value, made);
    // The distribution cancels from a weight.
    record(name, "relative error of a sample's weight", 2e-6, weight, made);
  }
}

// What of a white furnace comes back, against the integral of the formula in double.
TEST(Microfacets, KeepTheEnergyOfTheirFormula) {
  double worst = 0;
  const std::uint64_t n = rays(20'000, 2'000'000);
  for (const double alpha : {1e-3, 1e-2, 0.1, 1.0})
    for (const double z : {0.9, 0.1, 1e-3}) {
      const auto a = static_cast<float>(alpha);
      const Vec3 wo = direction(z, 0.0);
      Bsdf b(Frame(), Vec3(0, 0, 1));
      b.add(microfacet(Rgb(1.f), trowbridge_reitz(a, a), no_fresnel()));
      b.finish(wo);
      double sampled = 0, exact = 0;
      const double roughness = static_cast<double>(a);
      for (std::uint64_t i = 0; i < n; ++i) {
        const glm::dvec3 u = even_point(i);
        BsdfSample s;
        if (b.sample(wo, 0.5f, {below_one(u.y), below_one(u.z)}, s)) sampled += static_cast<double>(s.weight.x);
        // The same by visible normals in double: the weight is G2 / G1.
        const glm::dvec3 o(wo), v = glm::normalize(glm::dvec3(roughness * o.x, roughness * o.y, o.z));
        const double phi = 2 * kPiDouble * u.z, t = (1 - u.y) * (1 + v.z) - v.z, r = std::sqrt(std::max(0.0, 1 - t * t));
        const glm::dvec3 h = glm::normalize(glm::dvec3(roughness * (r * std::cos(phi) + v.x), roughness * (r * std::sin(phi) + v.y), t + v.z));
        const glm::dvec3 w = 2 * glm::dot(o, h) * h - o;
        if (w.z > 0) {
          const Exact e = trowbridge_reitz_exact(roughness, roughness, o, w);
          exact += e.value * w.z / e.pdf;
        }
      }
      worst = std::max(worst, std::fabs(sampled - exact) / static_cast<double>(n));
    }
  record("Trowbridge and Reitz in a white furnace, widths 1e-3 to 1, cosines 1e-3 to 0.9", "error of the energy", 1e-4, worst, n);
}

// Rough glass whose two sides have nearly the same index: nothing of the light is lost, but for masking.
TEST(Microfacets, RoughGlassOfIndexOneIsAir) {
  const std::uint64_t n = rays(20'000, 1'000'000);
  for (const float index : {1.f, 1.000001f, 1.00001f, 1.0001f, 1.001f, 1.01f})
    for (const float rough : {1e-3f, 0.1f, 1.f}) {
      double lost = 0, bent = 0;
      for (const double z : {0.9, -0.9}) {
        const Vec3 wo = direction(z, 0.3);
        Bsdf b(Frame(), Vec3(0, 0, 1));
        b.add(microfacet_dielectric(Rgb(1.f), Rgb(1.f), trowbridge_reitz(rough, rough), index));
        b.finish(wo);
        double sum = 0, bends = 0;
        for (std::uint64_t i = 0; i < n; ++i) {
          const glm::dvec3 u = even_point(i);
          BsdfSample s;
          if (!b.sample(wo, below_one(u.x), {below_one(u.y), below_one(u.z)}, s)) continue;
          sum += static_cast<double>(s.weight.x * s.eta * s.eta);
          bends += static_cast<double>(glm::length(s.wi + wo)) * static_cast<double>(s.weight.x);
        }
        lost = std::max(lost, std::fabs(1 - sum / static_cast<double>(n)));
        bent = std::max(bent, bends / static_cast<double>(n));
      }
      // Masking takes 1 - G2 / G1: for the roughest a few per cent at this angle; light that goes straight on is masked once.
      char name[96];
      std::snprintf(name, sizeof name, "rough glass of index %g, width %g", static_cast<double>(index), static_cast<double>(rough));
      record(name, "share of the light that is lost", rough < 0.5f ? 3e-3 : 0.07, lost, n);
      // A facet bends by (index - 1) times the tangent of its angle, 4 in the mean over the roughest as seen.
      record(name, "mean bend / (index - 1)", 6, index == 1.f ? bent * 1e6 : bent / static_cast<double>(index - 1.f), n);
    }
}

// Any direction of view and of light, any normals: values and densities are finite and not negative, weights bounded by
// what the model allows. All kinds of BSDFs, with directions near grazing for both normals.
TEST(Lobes, AreFiniteWithAnyNormals) {
  const std::uint64_t n = rays(100, 20'000);
  for (int kind = 0; kind < testing::kBsdfKinds; ++kind) {
    Random random(41);
    std::uint64_t bad = 0, tries = 0;
    std::string name;
    for (std::uint64_t i = 0; i < n; ++i) {
      const BsdfCase c = testing::random_case(kind, [&] { return static_cast<float>(random.uniform()); });
      name = c.name;
      const glm::dvec3 ng = random.direction();
      // Shading normals: near, perpendicular, opposed.
      glm::dvec3 ns = i % 4 == 0 ? ng : i % 4 == 1 ? -ng : random.direction();
      if (i % 4 == 2) ns = glm::normalize(ns - glm::dot(ns, ng) * ng * (1 - 1e-7));
      const auto grazing = [&](const glm::dvec3& about) {
        const glm::dvec3 w = random.direction();
        return Vec3(glm::normalize(w - glm::dot(w, about) * about + about * random.log_uniform(1e-9, 1) * (random.uniform() < 0.5 ? -1.0 : 1.0)));
      };
      const Vec3 wo = i % 3 == 0 ? grazing(ng) : i % 3 == 1 ? grazing(ns) : Vec3(random.direction());
      Bsdf b(Frame{Vec3(ns)}, Vec3(ng));
      b.add(std::span<const Lobe>(c.lobes));
      b.finish(wo);
      const auto fine = [](const Rgb& x, float pdf) {
        return is_finite(x) && x.x >= 0.f && x.y >= 0.f && x.z >= 0.f && std::isfinite(pdf) && pdf >= 0.f;
      };
      for (int k = 0; k < 32; ++k, ++tries) {
        BsdfSample s;
        if (b.sample(wo, below_one(random.uniform()), {k == 0 ? 0.f : below_one(random.uniform()), k == 1 ? 0.f : below_one(random.uniform())}, s))
          bad += !fine(s.weight, s.pdf) || !is_finite(s.wi) || std::fabs(glm::length(s.wi) - 1.f) > 1e-5f;
        const Vec3 wi = k % 4 == 0 ? wo : k % 4 == 1 ? -wo : k % 4 == 2 ? grazing(ns) : grazing(ng);
        float pdf;
        const Rgb f = b.eval_cos(wo, wi, pdf);
        bad += !fine(f, pdf);
      }
    }
    record(name + ", any normals, grazing views, seed 41", "values that are negative or not finite", 0, static_cast<double>(bad), tries);
  }
}

// A white diffuse surface scatters all light, whatever its shading normal is: over the hemisphere of the geometric normal,
// |cos| to any direction integrates to pi. Half of it is found by light samples alone.
TEST(Lobes, DiffuseKeepsAllLightWithAnyNormal) {
  double worst = 0;
  std::uint64_t n = 0;
  for (const double bend : {0.0, 0.3, 1.0, 1.5, 1.6, 2.5, kPiDouble}) {
    const Vec3 ns(std::sin(bend), 0, std::cos(bend));
    Bsdf b(Frame{ns}, Vec3(0, 0, 1));
    b.add(lambert(Rgb(1.f)));
    const Vec3 wo = direction(0.6, 1);
    b.finish(wo);
    const double all = integrate_sphere([&](const Vec3& wi) {
      float pdf;
      return b.eval_cos(wo, wi, pdf).x;
    }, {}, Quadrature(5e-5, 60'000));
    worst = std::max(worst, std::fabs(all - 1));
    ++n;
  }
  record("diffuse with shading normals 0 to 180 degrees off", "1 - the light that it scatters", 1e-4, worst, n);
}

}  // namespace
}  // namespace cloudrenderer::stability
