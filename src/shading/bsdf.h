#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

enum class LobeKind : std::uint8_t {
  lambert,  // also for transmission
  oren_nayar,
  microfacet,             // reflection; with `transmits` pbrt-v2's BRDFToBTDF of it
  microfacet_dielectric,  // rough reflection and refraction, chosen by Fresnel
  fresnel_blend,          // Ashikhmin and Shirley 2000: diffuse under a glossy coat
  specular_reflection,
  specular_transmission,
  specular_dielectric  // reflection and refraction, chosen by Fresnel
};
enum class Distribution : std::uint8_t { blinn, blinn_anisotropic, trowbridge_reitz };
enum class Fresnel : std::uint8_t {
  none,
  dielectric,            // the incident side decides which index comes first
  dielectric_one_sided,  // pbrt-v2's microfacets: always as if from outside
  conductor,             // exact
  conductor_v2           // pbrt-v2's approximation
};

// One scattering lobe; which fields count depends on the kind. Plain data without initialisers, so
// that an array of them costs nothing; made by the functions in bsdf_lobes.h.
struct Lobe {
  LobeKind kind;
  Distribution distribution;
  Fresnel fresnel;
  bool transmits;       // lambert, oren_nayar, microfacet: scatters to the other side
  bool scale_radiance;  // refraction compresses radiance by (eta_i / eta_t)^2, as in pbrt-v3 and
                        // not in pbrt-v2
  Rgb scale;            // reflectance (fresnel_blend: diffuse)
  Rgb scale2;           // dielectrics: transmittance; fresnel_blend: specular
  Rgb eta;  // conductors; dielectrics: x = inside over outside, y = 1/x; fresnel_blend: factor over
            // all
  Rgb k;    // conductors
  float alpha_x, alpha_y;  // Trowbridge-Reitz widths, Blinn exponents, or Oren and Nayar's A and B
  float norm;              // of the distribution, precomputed
};

struct BsdfSample {
  Vec3 wi{};  // unit, world
  Rgb weight{
      0};  // f * |cos| / pdf for the whole BSDF (for specular: of the chosen lobe, chance included)
  float pdf = 0;  // solid angle, of all non-specular lobes together; 0 when specular
  bool specular = false;
  bool transmission = false;
  float eta = 1;  // ratio of refraction indices crossed (transmitted over incident side), for
                  // roulette and footprints
};

// The sum of a few lobes in the shading frame. As in pbrt, the geometric normal decides between
// reflection and transmission lobes. eval() and pdf() leave specular lobes out. Lobes are sampled
// in proportion to a guess of their albedo.
class Bsdf {
 public:
  static constexpr int kMaxLobes = 8;

  Bsdf() {}  // NOLINT: lobes stay unwritten on purpose
  Bsdf(const Frame& shading, const Vec3& ng) : frame_(shading), ng_(ng) {}
  Bsdf(const Bsdf& b) { copy(b); }
  Bsdf& operator=(const Bsdf& b) {
    if (this != &b) copy(b);
    return *this;
  }
  ~Bsdf() = default;

  // Returns false when there is no room left.
  bool add(const Lobe& lobe) {
    if (count_ == kMaxLobes) return false;
    note(lobe);
    lobes_[static_cast<std::size_t>(count_++)] = lobe;
    return true;
  }
  void add(std::span<const Lobe> lobes) {
    for (const Lobe& l : lobes) add(l);
  }
  // Sets the lobes' sampling weights for this wo (albedo estimates). Call once after the last lobe.
  void finish(const Vec3& wo);

  bool empty() const { return count_ == 0; }
  bool has_smooth() const {
    return smooth_;
  }  // some lobe is not specular: light sampling makes sense
  Rgb eval(const Vec3& wo, const Vec3& wi) const;  // f, without the cosine
  float pdf(const Vec3& wo, const Vec3& wi) const;
  // As pdf, with even chances of the smooth lobes: what pbrt weighs a light's density against.
  float even_pdf(const Vec3& wo, const Vec3& wi) const;
  // eval * |cos(ns, wi)| and pdf in one pass: what light sampling needs.
  Rgb eval_cos(const Vec3& wo, const Vec3& wi, float& pdf) const;
  // u_lobe chooses the lobe. Returns false for an absorbed path (weight 0).
  bool sample(const Vec3& wo, float u_lobe, const Vec2& u, BsdfSample& out) const;

  const Frame& frame() const { return frame_; }
  const Vec3& ng() const { return ng_; }
  int lobe_count() const { return count_; }
  const Lobe& lobe(int i) const { return lobes_[static_cast<std::size_t>(i)]; }
  Lobe& lobe(int i) { return lobes_[static_cast<std::size_t>(i)]; }
  float weight(int i) const { return chance_[static_cast<std::size_t>(i)].weight; }

 private:
  // How a lobe is sampled.
  struct Chance {
    float weight;  // of choosing the lobe
    float mix;     // fresnel_blend: of sampling the glossy part
  };

  void note(const Lobe& lobe) {
    smooth_ = smooth_ || lobe.kind < LobeKind::specular_reflection;
    half_ = half_ || (lobe.kind >= LobeKind::microfacet && lobe.kind <= LobeKind::fresnel_blend);
  }
  void copy(const Bsdf& b) {  // only the lobes that exist
    frame_ = b.frame_;
    ng_ = b.ng_;
    count_ = b.count_;
    smooth_ = b.smooth_;
    half_ = b.half_;
    for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
      lobes_[i] = b.lobes_[i];
      chance_[i] = b.chance_[i];
    }
  }
  // Sum of the smooth lobes without the cosine, and their density, for local directions.
  Rgb evaluate(const Vec3& wo, const Vec3& wi, bool reflect, float& pdf) const;
  bool finish_specular(const Lobe& lobe, float chance, const Vec3& wo, float u,
                       BsdfSample& out) const;

  Frame frame_;
  Vec3 ng_{0, 0, 1};
  int count_ = 0;
  bool smooth_ = false;  // some lobe is not specular
  bool half_ = false;    // some lobe wants the half vector
  std::array<Chance, kMaxLobes> chance_;
  std::array<Lobe, kMaxLobes> lobes_;
};

}  // namespace cloudrenderer
