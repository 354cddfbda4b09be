#pragma once
#include <array>
#include <cstdint>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

enum class LobeKind : std::uint8_t {
  lambert_reflection, lambert_transmission, oren_nayar, oren_nayar_transmission,
  specular_reflection, specular_transmission, specular_dielectric,  // both, chosen by Fresnel
  microfacet_reflection, microfacet_transmission, fresnel_blend
};
enum class Distribution : std::uint8_t { blinn, blinn_anisotropic, trowbridge_reitz, beckmann };
enum class Fresnel : std::uint8_t { none, dielectric, conductor, conductor_v2 };

// One scattering lobe; which fields count depends on the kind. Plain data, built at every shading point.
struct Lobe {
  LobeKind kind = LobeKind::lambert_reflection;
  Distribution distribution = Distribution::trowbridge_reitz;
  Fresnel fresnel = Fresnel::none;
  bool swap_sides = false;   // pbrt-v2's BRDFToBTDF: a reflection lobe used for transmission
  Rgb scale{0};              // reflectance or transmittance
  Rgb scale2{0};             // fresnel_blend: specular; specular_dielectric: transmittance
  Rgb eta{1}, k{0};          // dielectric: eta.x = inside over outside
  float alpha_x = 0, alpha_y = 0;  // roughness or Blinn exponents; Oren-Nayar A and B
  float weight = 1;          // chance of being sampled, set by Bsdf::add / finish
};

struct BsdfSample {
  Vec3 wi{};       // unit, world
  Rgb weight{0};   // f * |cos| / pdf for the whole BSDF (for specular: of the chosen lobe, chance included)
  float pdf = 0;   // solid angle, of all non-specular lobes together; 0 when specular
  bool specular = false;
  bool transmission = false;
  float eta = 1;   // ratio of refraction indices crossed (transmitted over incident side), for roulette and footprints
};

// The sum of a few lobes in the shading frame. As in pbrt, the geometric normal decides between reflection and
// transmission lobes. eval() and pdf() leave specular lobes out. Lobes are sampled in proportion to `weight`.
class Bsdf {
 public:
  static constexpr int kMaxLobes = 8;

  Bsdf() = default;
  Bsdf(const Frame& shading, const Vec3& ng) : frame_(shading), ng_(ng) {}

  void add(const Lobe& lobe) {
    if (count_ < kMaxLobes) lobes_[static_cast<std::size_t>(count_++)] = lobe;
  }
  // Sets the lobes' sampling weights for this wo (albedo estimates). Call once after the last add().
  void finish(const Vec3& wo);

  bool empty() const { return count_ == 0; }
  bool has_smooth() const;       // some lobe is not specular: light sampling makes sense
  Rgb eval(const Vec3& wo, const Vec3& wi) const;    // f, without the cosine
  float pdf(const Vec3& wo, const Vec3& wi) const;
  // eval * |cos(ns, wi)| and pdf in one pass: what light sampling needs.
  Rgb eval_cos(const Vec3& wo, const Vec3& wi, float& pdf) const;
  // u_lobe chooses the lobe. Returns false for an absorbed path (weight 0).
  bool sample(const Vec3& wo, float u_lobe, const Vec2& u, BsdfSample& out) const;

  const Frame& frame() const { return frame_; }
  const Vec3& ng() const { return ng_; }
  int lobe_count() const { return count_; }
  const Lobe& lobe(int i) const { return lobes_[static_cast<std::size_t>(i)]; }

 private:
  Frame frame_;
  Vec3 ng_{0, 0, 1};
  int count_ = 0;
  std::array<Lobe, kMaxLobes> lobes_{};
};

}  // namespace cloudrenderer
