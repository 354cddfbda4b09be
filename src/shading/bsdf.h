#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "base/lanes.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

class ScatteringTable;

enum class LobeKind : std::uint8_t {
  lambert,  // also for transmission
  oren_nayar,
  diffuse_exit,           // out of a medium: see subsurface.h
  microfacet,             // reflection; with `transmits` pbrt-v2's BRDFToBTDF of it
  microfacet_dielectric,  // rough reflection and refraction, chosen by Fresnel
  fresnel_blend,          // Ashikhmin and Shirley 2000: diffuse under a glossy coat
  disney_diffuse,         // Burley 2012 and 2015, all that is sampled by the cosine: see bsdf_disney.h
  disney_clearcoat,
  coated_lambert,         // diffuse under a smooth dielectric: what gets in, and out again
  measured,               // a table of reflectances
  fourier,                // a table of both sides
  hair,                   // Chiang et al. 2016: see bsdf_hair.h
  layered,                // through a coat and out again: see bsdf_layered.h
  specular_reflection,
  specular_transmission,
  specular_dielectric  // reflection and refraction, chosen by Fresnel
};
enum class Distribution : std::uint8_t {
  blinn,
  blinn_anisotropic,
  trowbridge_reitz,
  trowbridge_reitz_separable  // masking and shadowing as if independent: pbrt-v3's disney
};
enum class Fresnel : std::uint8_t {
  none,
  dielectric,            // the incident side decides which index comes first
  dielectric_one_sided,  // pbrt-v2's microfacets: always as if from outside
  conductor,             // exact
  conductor_v2,          // pbrt-v2's approximation
  coated_conductor,      // under a smooth coat, mirrors only: see bsdf_layered.h
  disney                 // dielectric, by Schlick's approximation as far as metallic
};

// Which of a distribution's normals are sampled: all, or only those that wo sees. (Of Trowbridge and Reitz's always these.)
enum class Normals : std::uint8_t { all, visible };

// One scattering lobe; which fields count depends on the kind. Plain data without initialisers, so
// that an array of them costs nothing; made by the functions in bsdf_lobes.h. F: one vertex, or
// eight in lanes whose lobes are of the same kinds (see BsdfOf).
template <class F>
struct LobeOf {
  LobeKind kind;
  Distribution distribution;
  Fresnel fresnel;
  bool transmits;       // lambert, oren_nayar, microfacet: scatters to the other side; fourier, hair: also;
                        // specular_dielectric: a thin sheet, straight through
  bool scale_radiance;  // refraction compresses radiance by (eta_i / eta_t)^2, as in pbrt-v3 and
                        // not in pbrt-v2
  Vec3Of<F> scale;      // reflectance (fresnel_blend: diffuse)
  Vec3Of<F> scale2;     // dielectrics: transmittance; fresnel_blend: specular; disney_diffuse: sheen;
                        // hair: absorption; layered and its coat: see bsdf_layered.cpp
  Vec3Of<F> eta;  // conductors; dielectrics: x = inside over outside, y = 1/x (z: disney's metallic);
            // fresnel_blend: factor over all
  Vec3Of<F> k;  // conductors; disney's Fresnel: reflectance at normal incidence; disney_diffuse, hair: see there
  F alpha_x, alpha_y;  // Trowbridge-Reitz widths, Blinn exponents, Oren and Nayar's A and B, or hair's tilt;
                       // coated_lambert: x = thickness
  F norm;              // of the distribution, precomputed; coated_conductor: the coat's index
  const ScatteringTable* table;  // measured, fourier; owned by the Shading
};
using Lobe = LobeOf<float>;

template <class F>
struct BsdfSampleOf {
  Vec3Of<F> wi{};  // unit, world
  // f * |cos| / pdf for the whole BSDF (for specular: of the chosen lobe, chance included)
  Vec3Of<F> weight{F(0)};
  F pdf = 0;  // solid angle, of all non-specular lobes together; 0 when specular
  MaskOf<F> specular{false};
  MaskOf<F> transmission{false};
  F eta = 1;  // ratio of refraction indices crossed (transmitted over incident side), for
                  // roulette and footprints
};
using BsdfSample = BsdfSampleOf<float>;

// The sum of a few lobes in the shading frame. As in pbrt, the geometric normal decides between
// reflection and transmission lobes. eval() and pdf() leave specular lobes out. Lobes are sampled
// in proportion to a guess of their albedo.
//   F: float, or Float8 for eight vertices whose lobes agree in everything but numbers. The formulas
// are the same and so are the bits. Eight at once there are only of kinds that eight_wide() names.
template <class F>
class BsdfOf {
 public:
  // Room for mixed materials (pbrt has room for 8); with more the materials warn.
  static constexpr int kMaxLobes = std::is_same_v<F, float> ? 32 : 8;
  using Vector = Vec3Of<F>;
  using Mask = MaskOf<F>;

  BsdfOf() {}  // NOLINT: lobes stay unwritten on purpose
  BsdfOf(const FrameOf<F>& shading, const Vector& ng) : frame_(shading), ng_(ng) {}
  BsdfOf(const BsdfOf& b) { copy(b); }
  BsdfOf& operator=(const BsdfOf& b) {
    if (this != &b) copy(b);
    return *this;
  }
  ~BsdfOf() = default;

  // Returns false when there is no room left.
  bool add(const LobeOf<F>& lobe) {
    if (count_ == kMaxLobes) return false;
    note(lobe);
    lobes_[static_cast<std::size_t>(count_++)] = lobe;
    return true;
  }
  void add(std::span<const LobeOf<F>> lobes) {
    for (const LobeOf<F>& l : lobes) add(l);
  }
  // Sets the lobes' sampling weights for this wo (albedo estimates). Call once after the last lobe.
  void finish(const Vector& wo);

  // Estimates of lobes that have no formula are functions of the directions and this number, which differs from
  // point to point: pixels that see and are lit along the same directions must not have the same noise.
  void set_salt(std::uint32_t salt) { salt_ = salt; }

  bool empty() const { return count_ == 0; }
  bool has_smooth() const {
    return smooth_;
  }  // some lobe is not specular: light sampling makes sense
  Vector eval(const Vector& wo, const Vector& wi) const;  // f, without the cosine
  F pdf(const Vector& wo, const Vector& wi) const;
  // As pdf, with even chances of the smooth lobes and Normals::all: what pbrt weighs a light's density against.
  F even_pdf(const Vector& wo, const Vector& wi) const;
  // eval * |cos(ns, wi)| and pdf in one pass: what light sampling needs.
  Vector eval_cos(const Vector& wo, const Vector& wi, F& pdf) const;
  // u_lobe chooses the lobe. False for an absorbed path (weight 0).
  Mask sample(const Vector& wo, F u_lobe, const Vec2Of<F>& u, BsdfSampleOf<F>& out) const;

  const FrameOf<F>& frame() const { return frame_; }
  const Vector& ng() const { return ng_; }
  int lobe_count() const { return count_; }
  const LobeOf<F>& lobe(int i) const { return lobes_[static_cast<std::size_t>(i)]; }
  LobeOf<F>& lobe(int i) { return lobes_[static_cast<std::size_t>(i)]; }
  F weight(int i) const { return chance_[static_cast<std::size_t>(i)].weight; }

 private:
  // How a lobe is sampled.
  struct Chance {
    F weight;  // of choosing the lobe
    F mix;     // fresnel_blend: of sampling the glossy part
  };

  void note(const LobeOf<F>& lobe) {
    smooth_ = smooth_ || lobe.kind < LobeKind::specular_reflection;
    half_ = half_ || (lobe.kind >= LobeKind::microfacet && lobe.kind <= LobeKind::disney_clearcoat);
  }
  void copy(const BsdfOf& b) {  // only the lobes that exist
    frame_ = b.frame_;
    ng_ = b.ng_;
    count_ = b.count_;
    smooth_ = b.smooth_;
    half_ = b.half_;
    salt_ = b.salt_;
    for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
      lobes_[i] = b.lobes_[i];
      chance_[i] = b.chance_[i];
    }
  }
  // What sample() says of the directions wi (local) that smooth lobes have given where `found`.
  Mask complete(const Vector& wo_world, const Vector& wo, const Vector& wi, Mask found, BsdfSampleOf<F>& out) const;
  // Sum of the smooth lobes without the cosine, and their density, for local directions.
  Vector evaluate(const Vector& wo, const Vector& wi, Mask reflect, F& pdf, Normals normals = Normals::visible) const;

  FrameOf<F> frame_;
  Vector ng_{0, 0, 1};
  int count_ = 0;
  bool smooth_ = false;  // some lobe is not specular
  bool half_ = false;    // some lobe wants the half vector
  std::uint32_t salt_ = 0;
  std::array<Chance, kMaxLobes> chance_;
  std::array<LobeOf<F>, kMaxLobes> lobes_;
};
using Bsdf = BsdfOf<float>;
using Bsdf8 = BsdfOf<Float8>;
extern template class BsdfOf<float>;
extern template class BsdfOf<Float8>;

// True for lobes that Bsdf8 has formulas for.
bool eight_wide(const Lobe& lobe);

}  // namespace cloudrenderer
