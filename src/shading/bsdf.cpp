#include "shading/bsdf.h"

#include <type_traits>

#include "shading/bsdf_disney.h"
#include "shading/bsdf_hair.h"
#include "shading/bsdf_math.h"
#include "shading/bsdf_specular.h"
#include "shading/scattering_table.h"

namespace cloudrenderer {
namespace {

// What a coat lets through, the same on both sides of the surface.
template <class F>
F coat_transmittance(const LobeOf<F>& l, F c) {
  const F passed = 1.f - bsdf::fresnel_dielectric<F>(c, l.eta.x);
  return passed * bsdf::attenuation<F>(l.alpha_x, bsdf::refracted_cosine<F>(c, l.eta.x));
}

using namespace bsdf;  // NOLINT: the formulas of this file

// The half vector of a reflection, on wo's side when wi is there too.
template <class F>
struct Half {
  Vec3Of<F> wh{0, 0, 1};
  F dot = 1;  // with wo and with wi; > 0
  MaskOf<F> valid{false};
};

template <class F>
Half<F> half_of(const Vec3Of<F>& wo, const Vec3Of<F>& wi) {
  Half<F> h;
  const Vec3Of<F> sum = wo + wi;
  const F length2 = glm::dot(sum, sum), length = lanes::sqrt(length2);
  h.wh = sum * (1.f / length);
  h.dot = 0.5f * length;  // of unit vectors; at grazing angles a dot product would be their lengths' rounding
  h.valid = length2 > 0.f;
  return h;
}

// Of sampling a direction by Blinn's normals; pbrt takes them as they are, we those that wo sees (visible_in_groove()).
template <class F>
F blinn_density(const Vec3Of<F>& wo, const Half<F>& h, F d, Normals normals) {
  const F z = lanes::abs(h.wh.z), co = lanes::abs(wo.z);
  if (normals == Normals::all) return d * z / (4.f * h.dot);
  const MaskOf<F> masked = 2.f * z * co < h.dot;
  return lanes::select(masked, d * z, d) / lanes::select(masked, 2.f * h.dot, 4.f * co);  // D G1(wo) / (4 co)
}

// f without Fresnel and scale, and the density of sampling the reflected direction by its half
// vector.
template <class F>
[[gnu::always_inline]] inline F reflect_by_normals(const LobeOf<F>& l, const Vec3Of<F>& wo, const Vec3Of<F>& wi,
                                                   const Half<F>& h, Normals normals, F& pdf) {
  const F co = lanes::abs(wo.z), ci = lanes::abs(wi.z), d = normal_density(l, h.wh);
  if (l.distribution >= Distribution::trowbridge_reitz) {
    const F so = smith_root(l, wo), si = smith_root(l, wi);
    pdf = d * 0.5f / (co + so);
    if (l.distribution == Distribution::trowbridge_reitz_separable)
      return d / ((co + so) * (ci + si));  // G = G1(wo) G1(wi)
    return d * 0.5f / (ci * so + co * si);  // D G / (4 co ci) with G = 1 / (1 + L(wo) + L(wi))
  }
  // Torrance and Sparrow's V-grooves: G = min(1, 2 h min(co, ci) / dot)
  const F z = lanes::abs(h.wh.z);
  const MaskOf<F> masked = 2.f * z * lanes::min(co, ci) < h.dot;
  pdf = blinn_density(wo, h, d, normals);
  return lanes::select(masked, d * z, d) / lanes::select(masked, 2.f * h.dot * lanes::max(co, ci), 4.f * co * ci);
}

// Density alone, for lobes whose value has another form.
template <class F>
F half_density(const LobeOf<F>& l, const Vec3Of<F>& wo, const Half<F>& h, F d, Normals normals) {
  if (l.distribution >= Distribution::trowbridge_reitz) return d * 0.5f / (lanes::abs(wo.z) + smith_root(l, wo));
  return blinn_density(wo, h, d, normals);
}

template <class F>
Vec3Of<F> oren_nayar_value(const LobeOf<F>& l, const Vec3Of<F>& wo, const Vec3Of<F>& wi) {
  // cos(phi_i - phi_o) sin(alpha) tan(beta) = max(0, xi xo + yi yo) / max(|cos i|, |cos o|)
  const F cross = lanes::max(0.f, wi.x * wo.x + wi.y * wo.y);
  const F t = cross / lanes::max(lanes::abs(wi.z), lanes::abs(wo.z));
  return l.scale * (kInvPi * (l.alpha_x + l.alpha_y * t));
}

Rgb rough_transmission(const Lobe& l, const Vec3& wo, const Vec3& wi, float& pdf) {
  pdf = 0.f;
  const float e = incident_eta(l, wo);
  Vec3 wh = wo + e * wi;
  const float length2 = glm::dot(wh, wh);
  if (!(length2 > 0.f)) return Rgb(0.f);
  wh *= (wh.z < 0.f ? -1.f : 1.f) / std::sqrt(length2);
  const float oh = glm::dot(wo, wh), ih = glm::dot(wi, wh);
  if (!(oh * ih < 0.f) || !(oh * wo.z > 0.f))
    return Rgb(0.f);  // else the facet is seen from its back
  const float f = fresnel_dielectric(std::fabs(oh), oh > 0.f ? l.eta.x : l.eta.y);
  const float co = std::fabs(wo.z), ci = std::fabs(wi.z), so = smith_root(l, wo),
              si = smith_root(l, wi);
  const float d = normal_density(l, wh), jacobian = std::fabs(ih) / length2;  // times e^2; oh + e ih is wh's length
  // the density of visible normals is D G1 |wo.wh| / co with G1 = 2 co / (co + so)
  pdf = (1.f - reflect_chance(l, f)) * d * 2.f * std::fabs(oh) / (co + so) * jacobian * e * e;
  // G / (co ci) = 2 / (ci so + co si); radiance scaling cancels e^2
  const float masking = l.distribution == Distribution::trowbridge_reitz_separable ? 4.f / ((co + so) * (ci + si))
                                                                                   : 2.f / (ci * so + co * si);
  return l.scale2 * ((1.f - f) * d * std::fabs(oh) * jacobian * masking);
}

template <class F>
Vec3Of<F> fresnel_blend_value(const LobeOf<F>& l, F mix, const Vec3Of<F>& wo, const Vec3Of<F>& wi, const Half<F>& h,
                              Normals normals, F& pdf) {
  const F co = lanes::abs(wo.z), ci = lanes::abs(wi.z);
  const F d = normal_density(l, h.wh);
  pdf = (1.f - mix) * ci * kInvPi + mix * half_density(l, wo, h, d, normals);
  const Vec3Of<F> diffuse =
      l.scale * (Vec3Of<F>(F(1.f)) - l.scale2) *
      ((28.f / 23.f) * kInvPi * (1.f - pow5<F>(1.f - 0.5f * ci)) * (1.f - pow5<F>(1.f - 0.5f * co)));
  const Vec3Of<F> glossy = schlick<F>(l.scale2, h.dot) * (d / (4.f * h.dot * lanes::max(ci, co)));
  return l.eta * (diffuse + glossy);
}

// 1 / n
constexpr auto kEven = [] {
  std::array<float, Bsdf::kMaxLobes + 1> even{};
  for (std::size_t n = 1; n < even.size(); ++n) even[n] = 1.f / static_cast<float>(n);
  return even;
}();

// A rough guess of the share of light a lobe scatters, for choosing among lobes.
template <class F>
F albedo_guess(const LobeOf<F>& l, F wo_z, F& mix) {
  using lanes::luminance;
  const F c = lanes::min(1.f, lanes::abs(wo_z));
  const MaskOf<F> outside = wo_z > 0.f;
  switch (l.kind) {
    case LobeKind::lambert:
    case LobeKind::oren_nayar:
    case LobeKind::diffuse_exit:
      return luminance(l.scale);
    case LobeKind::microfacet: {
      const bool one_sided = l.fresnel == Fresnel::dielectric_one_sided;
      const F eta = lanes::select(MaskOf<F>(one_sided) || outside, l.eta.x, l.eta.y);
      const MaskOf<F> total = MaskOf<F>(one_sided || l.fresnel == Fresnel::dielectric) && eta < 1.f;
      // pbrt's plastic reflects totally beyond 42 degrees; half vectors spread around it
      const F spread = luminance(l.scale) * (0.8f - 0.75f * c * c);
      if (!lanes::any(!total)) return spread;
      return lanes::select(total, spread, luminance<F>(l.scale * fresnel(l, c, outside)));
    }
    case LobeKind::fresnel_blend: {
      const F glossy = luminance(schlick(l.scale2, c)),
              diffuse = luminance<F>(l.scale * (Vec3Of<F>(F(1.f)) - l.scale2));
      const F sum = glossy + diffuse;
      mix = lanes::select(sum > 0.f, lanes::min(lanes::max(glossy / sum, 0.1f), 0.9f), F(0.5f));
      return luminance(l.eta) * sum;
    }
    case LobeKind::disney_diffuse:
      return luminance(l.scale) + 0.1f * luminance(l.scale2);
    case LobeKind::coated_lambert:
      return luminance(l.scale) * coat_transmittance(l, c);
    case LobeKind::specular_reflection:
      return luminance<F>(l.scale * fresnel(l, c, outside));
    case LobeKind::microfacet_dielectric:
    case LobeKind::specular_dielectric:
    case LobeKind::specular_transmission: {
      const F f = is_thin(l) ? thin_reflectance(l, c) : fresnel_dielectric<F>(c, lanes::select(outside, l.eta.x, l.eta.y));
      return l.kind == LobeKind::specular_transmission ? luminance(l.scale) * (1.f - f)
                                                       : luminance(l.scale) * f + luminance(l.scale2) * (1.f - f);
    }
    default:
      break;
  }
  if constexpr (std::is_same_v<F, float>) {
    switch (l.kind) {
      case LobeKind::measured:
      case LobeKind::fourier:
        return luminance(l.scale) * l.table->albedo(wo_z);
      case LobeKind::hair:
        return luminance(l.scale);
      case LobeKind::layered:
        return layered_albedo(l, c);
      case LobeKind::disney_clearcoat:
        return luminance(l.scale) * clearcoat_albedo(c);
      default:
        break;
    }
  }
  return 0.f;
}

// A direction from a smooth lobe; `u` is a spare uniform number. False when there is none.
template <class F>
MaskOf<F> sample_lobe(const LobeOf<F>& l, F mix, const Vec3Of<F>& wo, F u, const Vec2Of<F>& u2, Vec3Of<F>& wi) {
  if constexpr (std::is_same_v<F, float>) {
    if (l.kind == LobeKind::measured || l.kind == LobeKind::fourier) return l.table->sample(wo, u, u2, wi);
    if (l.kind == LobeKind::hair) return sample_hair(l, wo, u, u2, wi);
    if (l.kind == LobeKind::layered) return sample_layered(l, wo, u, u2, wi);
    if (l.kind == LobeKind::disney_clearcoat) return sample_clearcoat(l, wo, u2, wi);
  }
  const F side = lanes::select(wo.z > 0.f, F(1.f), F(-1.f));
  MaskOf<F> diffuse{l.kind == LobeKind::lambert || l.kind == LobeKind::oren_nayar || l.kind == LobeKind::disney_diffuse ||
                    l.kind == LobeKind::coated_lambert || l.kind == LobeKind::diffuse_exit};
  if (l.kind == LobeKind::fresnel_blend) diffuse = u >= mix;
  if (lanes::any(diffuse)) {
    wi = sample_cosine(u2);
    wi.z *= l.transmits ? -side : side;
    if (!lanes::any(!diffuse)) return MaskOf<F>(true);
  }
  const Vec3Of<F> above = wo * side;
  Vec3Of<F> wh;
  if (l.distribution >= Distribution::trowbridge_reitz) {
    wh = sample_visible_normal<F>(l, above, u2);
  } else {
    const F left = l.kind == LobeKind::fresnel_blend ? lanes::min(u / mix, 0x1.fffffep-1f) : u;
    wh = visible_in_groove<F>(sample_blinn_normal(l, u2), above, left);
  }
  wh *= side;
  const F c = glm::dot(wo, wh);
  if constexpr (std::is_same_v<F, float>) {
    if (l.kind == LobeKind::microfacet_dielectric && c > 0.f) {
      const float f = fresnel_dielectric(c, incident_eta(l, wo));
      if (u >= reflect_chance(l, f)) return refract(wo, wh, incident_eta(l, wo), wi) && wi.z * wo.z < 0.f;
    }
  }
  Vec3Of<F> glossy = 2.f * c * wh - wo;
  const MaskOf<F> valid = c > 0.f && glossy.z * wo.z > 0.f;
  if (l.transmits) glossy.z = -glossy.z;
  wi = lanes::select(diffuse, wi, glossy);
  return diffuse || valid;
}

template <class F>
BsdfSampleOf<F> select(MaskOf<F> m, const BsdfSampleOf<F>& a, const BsdfSampleOf<F>& b) {
  using lanes::select;
  return {select(m, a.wi, b.wi),
          select(m, a.weight, b.weight),
          select(m, a.pdf, b.pdf),
          select(m, a.specular, b.specular),
          select(m, a.transmission, b.transmission),
          select(m, a.eta, b.eta)};
}

// A lobe with rough refraction, reflected or refracted; f without the cosine.
Rgb rough_dielectric(const Lobe& l, const Vec3& wo, const Vec3& wi, const Half<float>& half, bool same, bool reflect,
                     float& pdf) {
  pdf = 0.f;
  if (!same && !reflect) return rough_transmission(l, wo, wi, pdf);
  if (!half.valid) return Rgb(0.f);
  const float v = reflect_by_normals(l, wo, wi, half, Normals::visible, pdf);
  const float r = fresnel_dielectric(half.dot, half.wh.z > 0.f ? l.eta.x : l.eta.y);
  if (same)
    pdf *= reflect_chance(l, r);
  else  // the normals disagree: pbrt evaluates the reflection all the same
    rough_transmission(l, wo, wi, pdf);
  return reflect ? l.scale * (r * v) : Rgb(0.f);
}

// Of the kinds that never come eight wide.
[[gnu::noinline]] Rgb rare_value(const Lobe& l, const Vec3& wo, const Vec3& wi, const Half<float>& half, float& pdf) {
  if (l.kind == LobeKind::hair) return hair_value(l, wo, wi, pdf);
  if (l.kind == LobeKind::disney_clearcoat) {
    pdf = 0.f;
    if (!half.valid) return Rgb(0.f);
    const Rgb value = clearcoat_value(l, wo, wi, half.wh, half.dot, pdf);
    if (!(wo.z * wi.z > 0.f)) pdf = 0.f;
    return value;
  }
  return l.scale * l.table->value_and_pdf(wo, wi, pdf);
}

// All diffuse parts of the disney material.
template <class F>
[[gnu::noinline]] Vec3Of<F> disney_diffuse_value(const LobeOf<F>& l, const Vec3Of<F>& wo, const Vec3Of<F>& wi,
                                                 const Half<F>& half) {
  return disney_diffuse<F>(l, lanes::abs(wo.z), lanes::abs(wi.z), lanes::select(half.valid, half.dot, F(0.f)));
}

}  // namespace

bool eight_wide(const Lobe& l) {
  if (l.kind >= LobeKind::specular_reflection) return l.fresnel != Fresnel::coated_conductor;
  return !l.transmits && (l.kind == LobeKind::lambert || l.kind == LobeKind::oren_nayar ||
                          l.kind == LobeKind::microfacet || l.kind == LobeKind::fresnel_blend ||
                          l.kind == LobeKind::disney_diffuse || l.kind == LobeKind::coated_lambert);
}

template <class F>
Vec3Of<F> BsdfOf<F>::evaluate(const Vector& wo, const Vector& wi, Mask reflect, F& pdf, Normals normals) const {
  pdf = 0.f;
  Vector f(F(0.f));
  const F co = lanes::abs(wo.z), ci = lanes::abs(wi.z);
  const Mask grazing = co == 0.f || ci == 0.f;
  const Mask same = wo.z * wi.z > 0.f;
  const Half<F> half = half_ ? half_of<F>(wo, wi) : Half<F>{};
  const auto add = [&](Mask counts, const Vector& value, Mask sampled, F density) {
    f = lanes::select(counts, f + value, f);
    pdf = lanes::select(sampled, pdf + density, pdf);
  };
  for (int i = 0; i < count_; ++i) {
    const LobeOf<F>& l = lobes_[static_cast<std::size_t>(i)];
    const Chance& chance = chance_[static_cast<std::size_t>(i)];
    const Mask counts = l.transmits ? !reflect : reflect, sampled = l.transmits ? !same : same;
    switch (l.kind) {
      case LobeKind::lambert:
        add(counts, l.scale * F(kInvPi), sampled, chance.weight * ci * kInvPi);
        break;
      case LobeKind::oren_nayar:
        add(counts, oren_nayar_value(l, wo, wi), sampled, chance.weight * ci * kInvPi);
        break;
      case LobeKind::diffuse_exit:
        add(counts, l.scale * (kInvPi * (1.f - fresnel_dielectric<F>(ci, l.eta.x))), sampled, chance.weight * ci * kInvPi);
        break;
      case LobeKind::microfacet: {
        const Vector w(wi.x, wi.y, l.transmits ? -wi.z : wi.z);
        const Half<F> h = l.transmits ? half_of<F>(wo, w) : half;
        if (!lanes::any(h.valid)) break;
        F p;
        const F v = reflect_by_normals(l, wo, w, h, normals, p);
        add(counts && h.valid, l.scale * fresnel<F>(l, h.dot, h.wh.z > 0.f) * v, sampled && h.valid, chance.weight * p);
        break;
      }
      case LobeKind::fresnel_blend: {
        if (!lanes::any(half.valid)) break;
        F p;
        const Vector value = fresnel_blend_value(l, chance.mix, wo, wi, half, normals, p);
        add(reflect && half.valid, value, same && half.valid, chance.weight * p);
        break;
      }
      case LobeKind::microfacet_dielectric:
        if constexpr (std::is_same_v<F, float>) {
          float p;
          f += rough_dielectric(l, wo, wi, half, same, reflect, p);
          pdf += chance.weight * p;
        }
        break;
      case LobeKind::disney_diffuse:
        add(counts, disney_diffuse_value(l, wo, wi, half), sampled, chance.weight * ci * kInvPi);
        break;
      case LobeKind::coated_lambert:
        add(counts, l.scale * (coat_transmittance(l, co) * coat_transmittance(l, ci) * kInvPi), sampled,
            chance.weight * ci * kInvPi);
        break;
      case LobeKind::measured:
      case LobeKind::fourier:
      case LobeKind::hair:
      case LobeKind::disney_clearcoat:
        if constexpr (std::is_same_v<F, float>) {
          float p;
          const Rgb value = rare_value(l, wo, wi, half, p);
          if (reflect || l.transmits) f += value;
          pdf += chance.weight * p;
        }
        break;
      case LobeKind::layered:
        if constexpr (std::is_same_v<F, float>) {
          if (grazing) break;
          if (reflect) f += l.scale * layered_value(l, wo, wi, salt_);
          if (same) pdf += chance.weight * layered_density(l, wo, wi);
        }
        break;
      default:
        break;  // specular
    }
  }
  pdf = lanes::select(grazing, F(0.f), pdf);
  return lanes::select(grazing, Vector(F(0.f)), f);
}

template <class F>
Vec3Of<F> BsdfOf<F>::eval(const Vector& wo, const Vector& wi) const {
  F density;
  return evaluate(frame_.to_local(wo), frame_.to_local(wi), glm::dot(wi, ng_) * glm::dot(wo, ng_) > 0.f, density);
}

template <class F>
F BsdfOf<F>::pdf(const Vector& wo, const Vector& wi) const {
  F density;
  evaluate(frame_.to_local(wo), frame_.to_local(wi), Mask(true), density);
  return density;
}

template <class F>
F BsdfOf<F>::even_pdf(const Vector& wo, const Vector& wi) const {
  BsdfOf even = *this;
  float smooth = 0.f;
  for (int i = 0; i < count_; ++i) smooth += lobe(i).kind < LobeKind::specular_reflection ? 1.f : 0.f;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) even.chance_[i] = {F(1.f / smooth), F(0.5f)};
  F density;
  even.evaluate(frame_.to_local(wo), frame_.to_local(wi), Mask(true), density, Normals::all);
  return density;
}

template <class F>
Vec3Of<F> BsdfOf<F>::eval_cos(const Vector& wo, const Vector& wi, F& pdf) const {
  const Vector local = frame_.to_local(wi);
  const Mask reflect = glm::dot(wi, ng_) * glm::dot(wo, ng_) > 0.f;
  return evaluate(frame_.to_local(wo), local, reflect, pdf) * lanes::abs(local.z);
}

template <class F>
void BsdfOf<F>::finish(const Vector& wo) {
  if (count_ == 0) return;
  const F z = glm::dot(wo, frame_.n);
  if (count_ == 1) {
    chance_[0].weight = 1.f;
    if (lobes_[0].kind == LobeKind::fresnel_blend) albedo_guess(lobes_[0], z, chance_[0].mix);
    return;
  }
  const auto count = static_cast<std::size_t>(count_);
  F sum = 0.f;
  for (std::size_t i = 0; i < count; ++i) {
    const F guess = albedo_guess(lobes_[i], z, chance_[i].mix);
    chance_[i].weight = lanes::select(guess > 0.f && guess < 1e9f, guess, F(0.f));
    sum += chance_[i].weight;
  }
  // No lobe is starved: a guess may be wrong by much at grazing angles.
  const F floor = kEven[count] * 0.02f, factor = lanes::select(sum > 0.f, 0.98f / sum, F(0.f));
  for (std::size_t i = 0; i < count; ++i)
    chance_[i].weight = lanes::select(sum > 0.f, floor + factor * chance_[i].weight, F(kEven[count]));
}

template <class F>
MaskOf<F> BsdfOf<F>::sample(const Vector& wo_world, F u_lobe, const Vec2Of<F>& u, BsdfSampleOf<F>& out) const {
  const Vector wo = frame_.to_local(wo_world);
  if (count_ == 0) return Mask(false);
  // Lobe i is chosen where the number lies in its part of [0, 1).
  std::array<Mask, kMaxLobes> chosen;
  Mask open(true);
  F chance = 1.f;
  for (int i = 0; i < count_; ++i) {
    const Mask here = i + 1 < count_ ? open && u_lobe < weight(i) : open;
    chosen[static_cast<std::size_t>(i)] = here;
    chance = lanes::select(here, weight(i), chance);
    open = open && !here;
    u_lobe = lanes::select(open, u_lobe - weight(i), u_lobe);
  }
  const F rest = lanes::min(u_lobe / chance, 0x1.fffffep-1f);
  Mask found(false), mirrors(false), mirrored(false);
  BsdfSampleOf<F> specular;  // of the lanes that have chosen a specular lobe
  Vector wi(F(0.f));
  for (int i = 0; i < count_; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (!lanes::any(chosen[k])) continue;
    const LobeOf<F>& l = lobes_[k];
    if (l.kind >= LobeKind::specular_reflection) {
      BsdfSampleOf<F> own;
      const Mask valid = sample_specular(l, chance, wo, rest, frame_, own);
      if (!lanes::any(!chosen[k])) {
        out = own;
        return valid;
      }
      specular = lanes::any(mirrors) ? select(chosen[k], own, specular) : own;
      mirrors = mirrors || chosen[k];
      mirrored = mirrored || (chosen[k] && valid);
      continue;
    }
    if (l.kind == LobeKind::microfacet_dielectric) out.eta = incident_eta(l, wo);
    Vector direction(F(0.f));
    const Mask valid = sample_lobe(l, chance_[k].mix, wo, rest, u, direction);
    wi = lanes::select(chosen[k], direction, wi);
    found = found || (chosen[k] && valid);
  }
  found = complete(wo_world, wo, wi, found, out);
  if (lanes::any(mirrors)) out = select(mirrors, specular, out);
  return found || mirrored;
}

template <class F>
MaskOf<F> BsdfOf<F>::complete(const Vector& wo_world, const Vector& wo, const Vector& wi, Mask found,
                              BsdfSampleOf<F>& out) const {
  out.wi = frame_.to_world(wi);
  const Mask reflect = glm::dot(out.wi, ng_) * glm::dot(wo_world, ng_) > 0.f;
  out.specular = Mask(false);
  out.transmission = !reflect;
  out.eta = lanes::select(wi.z * wo.z < 0.f, out.eta, F(1.f));
  found = found && wo.z != 0.f;
  if (count_ == 1 && lobes_[0].kind == LobeKind::lambert) {  // the most frequent case needs no evaluation
    out.pdf = lanes::abs(wi.z) * kInvPi;
    out.weight = lobes_[0].scale;
    return found && out.pdf > 0.f && reflect != Mask(lobes_[0].transmits);
  }
  if (!lanes::any(found)) return found;
  const Vector f = evaluate(wo, wi, reflect, out.pdf);
  out.weight = f * (lanes::abs(wi.z) / out.pdf);
  return found && out.pdf > 0.f && !lanes::is_black(f);
}

template class BsdfOf<float>;
template class BsdfOf<Float8>;

}  // namespace cloudrenderer
