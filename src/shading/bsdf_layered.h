#pragma once
// A dielectric coat over a diffuse surface or a conductor, with a medium between them: what the coat reflects at once, and
// light that goes through it, in another lobe. That one has a closed form where all is smooth; else its value is an
// estimate by a walk between the layers: Guo, Hasan and Zhao, "Position-Free Monte Carlo Simulation for Arbitrary Layered
// BSDFs", 2018; what the numbers mean: Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th ed., section 14.3.
//   Estimates take their random numbers from the directions and the Bsdf's salt, so that they are functions.
#include <array>
#include <cstdint>
#include <span>

#include "shading/bsdf.h"

namespace cloudrenderer::bsdf {

// Light ends by roulette; this many events are met in thick media only that absorb nothing.
inline constexpr int kMostCoatEvents = 1000, kMostCoatWalks = 64;

struct Coat {
  float eta = 1.5f;                      // inside over outside
  float alpha_x = 0.f, alpha_y = 0.f;    // Trowbridge-Reitz widths; 0: smooth
  float thickness = 0.f;                 // in mean free paths of the medium
  Rgb albedo{0};                         // of the medium's particles; black: they only absorb
  float g = 0.f;                         // of Henyey and Greenstein's phase function
  int walks = 1;                         // an estimate's
  int events = kMostCoatEvents;          // of light between the layers, each reflection and each scattering, until it is lost
};

struct Layers {
  std::array<Lobe, 2> lobes;
  std::size_t count = 0;
  std::span<const Lobe> all() const { return {lobes.data(), count}; }
};
// What a smooth coat sends back, as a share of even light, of what a diffuse surface below sends up.
float coat_internal(float eta, float thickness);
// `internal`: the above, for smooth coats that do not scatter.
Layers coated_diffuse(const Coat& coat, const Rgb& reflectance, float internal);
// eta, k: relative to the coat. Widths of 0: smooth.
Layers coated_conductor(const Coat& coat, const Rgb& eta, const Rgb& k, float alpha_x, float alpha_y);
bool needs_walk(const Coat& coat);

// A mirror under a smooth coat, with all that goes to and fro between the two.
Rgb coated_mirror(const Lobe& l, float c);

// Of a layered lobe. It stands behind the lobe of its coat in the Bsdf.
Rgb layered_value(const Lobe& l, const Vec3& wo, const Vec3& wi, std::uint32_t salt);
float layered_density(const Lobe& l, const Vec3& wo, const Vec3& wi);
bool sample_layered(const Lobe& l, const Vec3& wo, float u, const Vec2& u2, Vec3& wi);
float layered_albedo(const Lobe& l, float c);  // a guess

}  // namespace cloudrenderer::bsdf
