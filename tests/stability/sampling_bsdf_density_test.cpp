// Every BSDF's density, integrated over the sphere, and the share of samples that it cannot place are 1 together.
#include "../shading_bsdf_cases.h"
#include "quadrature.h"
#include "record.h"
#include "world.h"

namespace cloudrenderer::stability {
namespace {

using namespace bsdf;
using testing::BsdfCase;

struct DensityCase {
  BsdfCase bsdf;
  double width = 1e-2;  // of its peaks
  double bound = 1e-4;
  Kind kind = Kind::bound;
};

std::vector<DensityCase> cases() {
  const Rgb eta(0.2f, 0.92f, 1.1f), k(3.9f, 2.45f, 2.14f), sigma(0.1f, 0.4f, 1.2f);
  const FresnelTerm metal = conductor(eta, k);
  static const MeasuredReflectance satin = testing::formula(0.3f, 0.4f, 20.f);
  static const auto layered = testing::fourier_table({.albedo = 0.9f, .through = 0.3f});
  static const auto brushed = testing::rgl_table({.alpha_x = 0.1, .alpha_y = 0.4, .phis = 9, .folds = 2});
  static const auto lacquer = testing::rgl_table({.alpha_x = 0.2, .alpha_y = 0.2, .diffuse = 0.4, .gloss = 0.5});
  return {
      {{"Lambert", {lambert(Rgb(0.7f))}}},
      {{"Oren and Nayar", {oren_nayar(Rgb(0.7f), 30.f)}}},
      {{"Lambert through a coat", {coated_lambert(Rgb(0.5f), 1.5f)}}},
      {{"diffuse exit", {diffuse_exit(1.5f)}}},
      {{"disney's diffuse", {disney_diffuse(DisneyDiffuse{Rgb(0.5f), 0.7f, 0.3f, 0.5f, Rgb(0.2f)})}}},
      {{"Blinn, roughness 0.3", {microfacet(Rgb(1.f), blinn(0.3f), metal)}}},
      {{"Blinn, roughness 0.01", {microfacet(Rgb(1.f), blinn(0.01f), metal)}}},
      {{"Blinn, roughness 1e-5", {microfacet(Rgb(1.f), blinn(1e-5f), metal)}, true, true}, 1e-3},
      {{"Trowbridge and Reitz, width 1", {microfacet(Rgb(1.f), trowbridge_reitz(1.f, 1.f), metal)}}},
      {{"Trowbridge and Reitz, width 0.1", {microfacet(Rgb(1.f), trowbridge_reitz(0.1f, 0.1f), metal)}}},
      {{"Trowbridge and Reitz, widths 0.5 and 0.05", {microfacet(Rgb(1.f), trowbridge_reitz(0.5f, 0.05f), metal)}}},
      {{"Trowbridge and Reitz, width 1e-5", {microfacet(Rgb(1.f), trowbridge_reitz(1e-5f, 1e-5f), metal)}}, 3e-5},
      {{"glossy over diffuse, Blinn", {fresnel_blend(Rgb(0.4f), Rgb(0.1f), blinn_anisotropic(0.1f, 0.02f))}}},
      {{"glossy over diffuse, Trowbridge and Reitz", {fresnel_blend(Rgb(0.4f), Rgb(0.1f), trowbridge_reitz(0.3f, 0.15f))}}},
      // At a cosine of 0.1 the refracted part is 1.5e-4 more than its samples; why is not known.
      {{"rough glass, width 0.3", {microfacet_dielectric(Rgb(1.f), Rgb(1.f), trowbridge_reitz(0.3f, 0.3f), 1.5f)}}, 1e-2, 2.5e-4, Kind::limit},
      {{"rough glass, width 0.03, index 3", {microfacet_dielectric(Rgb(1.f), Rgb(1.f), trowbridge_reitz(0.03f, 0.03f), 3.f)}}, 1e-3},
      {{"disney's clear coat, satin", {disney_clearcoat(1.f, 0.f)}}},
      {{"disney's clear coat, gloss 0.9", {disney_clearcoat(1.f, 0.9f)}}, 1e-3},
      {{"measured", {measured(satin)}}},
      // Where its series falls below 0 it counts as 0, so that the rest is a little more than 1.
      {{"fourier", {fourier(*layered)}}, 1e-2, 2e-4, Kind::limit},
      {{"brushed metal of the RGL's format", {measured(*brushed)}}},
      {{"lacquer of the RGL's format", {measured(*lacquer)}}},
      {{"hair", {hair({0.3f, 1.55f, sigma, 0.3f, 0.3f, 2.f})}}},
      {{"hair, roughness 0.1", {hair({0.7f, 1.55f, sigma, 0.1f, 0.1f, 0.f})}}},
  };
}

// Mirrored, where at grazing angles a peak is much higher than wide, and bent through.
std::vector<std::pair<Vec3, double>> peaks(const Vec3& wo, double width) {
  std::vector<std::pair<Vec3, double>> out;
  const double phi = std::atan2(static_cast<double>(-wo.y), static_cast<double>(-wo.x)), z = static_cast<double>(wo.z);
  for (int i = 1; i < 32; ++i) out.push_back({direction(std::clamp(z * i / 12, -1.0, 1.0), phi), width});
  out.push_back({direction(z, phi), width});
  for (const float index : {1.5f, 3.f}) {
    Vec3 wi;
    if (refract(wo, {0, 0, wo.z > 0 ? 1.f : -1.f}, wo.z > 0 ? index : 1 / index, wi)) out.push_back({wi, width});
  }
  return out;
}

TEST(BsdfDensities, IntegrateToOneWithWhatTheyCannotPlace) {
  const std::vector<Vec3> viewers{direction(0.8, 0.3), direction(0.1, 4), direction(-0.5, 1)};
  const std::uint64_t samples = rays(100'000, 20'000'000);
  const double from_counting = full() ? 0 : 2e-3;  // of the lost
  for (const DensityCase& c : cases()) {
    double worst = 0;
    for (const Vec3& wo : viewers) {
      const Bsdf b = make_bsdf(c.bsdf, wo);
      const double inside = integrate_sphere([&](const Vec3& w) { return b.pdf(wo, w); }, peaks(wo, c.width),
                                             Quadrature(2e-5, full() ? 400'000 : 10'000));
      std::uint64_t lost = 0;
      for (std::uint64_t i = 0; i < samples; ++i) {
        const glm::dvec3 u = even_point(i);
        BsdfSample s;
        lost += !b.sample(wo, below_one(u.x), {below_one(u.y), below_one(u.z)}, s);
      }
      const double error = std::fabs(inside + static_cast<double>(lost) / static_cast<double>(samples) - 1);
      worst = std::max(worst, error);
    }
    record("density of " + c.bsdf.name, "1 - its integral - the share of samples without value", c.bound + from_counting, worst, samples * viewers.size(), c.kind);
  }
}

}  // namespace
}  // namespace cloudrenderer::stability
