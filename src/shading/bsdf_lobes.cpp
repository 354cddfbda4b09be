#include "shading/bsdf_lobes.h"

#include "base/portable_math.h"

namespace cloudrenderer::bsdf {
namespace {

Lobe make(LobeKind kind, const Rgb& scale) {
  Lobe l{};
  l.kind = kind;
  l.scale = scale;
  l.eta = Rgb(1.f);
  return l;
}

void set(Lobe& l, const Microfacets& m) {
  l.distribution = m.distribution;
  l.alpha_x = m.x;
  l.alpha_y = m.y;
  switch (m.distribution) {
    case Distribution::blinn:
      l.norm = (m.x + 2.f) * (0.5f * kInvPi);
      break;
    case Distribution::blinn_anisotropic:
      l.norm = std::sqrt((m.x + 2.f) * (m.y + 2.f)) * (0.5f * kInvPi);
      break;
    case Distribution::trowbridge_reitz:
    case Distribution::trowbridge_reitz_separable:
      l.norm = kInvPi / (m.x * m.y);
      break;
  }
}

void set(Lobe& l, const FresnelTerm& f) {
  l.fresnel = f.kind;
  l.eta = f.eta;
  l.k = f.k;
}

// pbrt-v2 takes 1/roughness as the exponent, at most 10000 (also for what is no number).
float blinn_exponent(float roughness) {
  const float e = 1.f / roughness;
  return e <= 10000.f ? std::max(e, 0.f) : 10000.f;
}

Rgb index_pair(float eta) {
  const float safe = eta > 1e-4f && eta < 1e4f ? eta : 1.f;
  return {safe, 1.f / safe, 0.f};
}

}  // namespace

Lobe lambert(const Rgb& reflectance, bool transmits) {
  Lobe l = make(LobeKind::lambert, reflectance);
  l.transmits = transmits;
  return l;
}

Lobe coated_lambert(const Rgb& scale, float eta, float thickness) {
  Lobe l = make(LobeKind::coated_lambert, scale);
  l.eta = index_pair(eta);
  l.alpha_x = thickness;
  return l;
}

Lobe oren_nayar(const Rgb& reflectance, float sigma) {
  const float s = std::clamp(sigma, 0.f, 90.f) * (kPi / 180.f), s2 = s * s;
  if (!(s2 > 0.f)) return lambert(reflectance);
  Lobe l = make(LobeKind::oren_nayar, reflectance);
  l.alpha_x = 1.f - s2 / (2.f * (s2 + 0.33f));
  l.alpha_y = 0.45f * s2 / (s2 + 0.09f);
  return l;
}

Microfacets blinn(float roughness) {
  const float e = blinn_exponent(roughness);
  return {Distribution::blinn, e, e};
}

Microfacets blinn_anisotropic(float u_roughness, float v_roughness) {
  const float x = blinn_exponent(u_roughness), y = blinn_exponent(v_roughness);
  return {x == y ? Distribution::blinn : Distribution::blinn_anisotropic, x, y};
}

Microfacets trowbridge_reitz(float alpha_x, float alpha_y) {
  const auto safe = [](float a) { return a >= 0.001f ? a : 0.001f; };  // also for what is no number
  return {Distribution::trowbridge_reitz, safe(alpha_x), safe(alpha_y)};
}

float roughness_to_alpha(float roughness) {
  const float x = portable::log(std::max(roughness, 1e-3f));
  return 1.62142f + x * (0.819955f + x * (0.1734f + x * (0.0171201f + x * 0.000640711f)));
}

Microfacets separable(Microfacets m) {
  m.distribution = Distribution::trowbridge_reitz_separable;
  return m;
}

FresnelTerm no_fresnel() { return {Fresnel::none, Rgb(1.f), Rgb(0.f)}; }
FresnelTerm dielectric(float inside_over_outside) {
  return {Fresnel::dielectric, index_pair(inside_over_outside), Rgb(0.f)};
}
FresnelTerm dielectric_one_sided(float beyond_over_incident) {
  return {Fresnel::dielectric_one_sided, index_pair(beyond_over_incident), Rgb(0.f)};
}
FresnelTerm conductor(const Rgb& eta, const Rgb& k) { return {Fresnel::conductor, eta, k}; }
FresnelTerm conductor_v2(const Rgb& eta, const Rgb& k) { return {Fresnel::conductor_v2, eta, k}; }
FresnelTerm disney_fresnel(const Rgb& normal, float metallic, float eta) {
  Rgb e = index_pair(eta);
  e.z = metallic;
  return {Fresnel::disney, e, normal};
}

Lobe microfacet(const Rgb& scale, const Microfacets& m, const FresnelTerm& f, bool transmits) {
  Lobe l = make(LobeKind::microfacet, scale);
  set(l, m);
  set(l, f);
  l.transmits = transmits;
  return l;
}

Lobe microfacet_dielectric(const Rgb& reflectance, const Rgb& transmittance, const Microfacets& m,
                           float eta) {
  // Facets between nearly equal indices bend light by less than its directions can tell: (eta - 1) times their slope.
  constexpr float kLeastBend = 1e-5f;
  if (std::fabs(eta - 1.f) * std::min(m.x, m.y) < kLeastBend) return specular_dielectric(reflectance, transmittance, eta, true);
  Lobe l = make(LobeKind::microfacet_dielectric, reflectance);
  set(l, m);
  set(l, dielectric(eta));
  l.scale2 = transmittance;
  l.scale_radiance = true;
  return l;
}

Lobe fresnel_blend(const Rgb& diffuse, const Rgb& specular, const Microfacets& m) {
  Lobe l = make(LobeKind::fresnel_blend, diffuse);
  set(l, m);
  l.scale2 = specular;
  return l;
}

Lobe measured(const ScatteringTable& table) {
  Lobe l = make(LobeKind::measured, Rgb(1.f));
  l.table = &table;
  return l;
}

Lobe fourier(const ScatteringTable& table) {
  Lobe l = measured(table);
  l.kind = LobeKind::fourier;
  l.transmits = true;
  return l;
}

Lobe specular_reflection(const Rgb& scale, const FresnelTerm& f) {
  Lobe l = make(LobeKind::specular_reflection, scale);
  set(l, f);
  return l;
}

Lobe specular_transmission(const Rgb& scale, float eta, bool scale_radiance) {
  Lobe l = make(LobeKind::specular_transmission, scale);
  set(l, dielectric(eta));
  l.scale_radiance = scale_radiance;
  return l;
}

Lobe specular_dielectric(const Rgb& reflectance, const Rgb& transmittance, float eta,
                         bool scale_radiance) {
  Lobe l = make(LobeKind::specular_dielectric, reflectance);
  set(l, dielectric(eta));
  l.scale2 = transmittance;
  l.scale_radiance = scale_radiance;
  return l;
}

Lobe thin_dielectric(float eta) {
  Lobe l = specular_dielectric(Rgb(1.f), Rgb(1.f), eta, false);
  l.transmits = true;
  return l;
}

void scale_lobe(Lobe& lobe, const Rgb& factor) {
  switch (lobe.kind) {
    case LobeKind::fresnel_blend:
      lobe.eta *= factor;
      break;
    case LobeKind::microfacet_dielectric:
    case LobeKind::specular_dielectric:
    case LobeKind::disney_diffuse:
      lobe.scale *= factor;
      lobe.scale2 *= factor;
      break;
    default:
      lobe.scale *= factor;
  }
}


LobeOf<Float8> in_all_lanes(const Lobe& l) {
  LobeOf<Float8> out;
  out.kind = l.kind;
  out.distribution = l.distribution;
  out.fresnel = l.fresnel;
  out.transmits = l.transmits;
  out.scale_radiance = l.scale_radiance;
  out.scale = Vec3x8(l.scale);
  out.scale2 = Vec3x8(l.scale2);
  out.eta = Vec3x8(l.eta);
  out.k = Vec3x8(l.k);
  out.alpha_x = l.alpha_x;
  out.alpha_y = l.alpha_y;
  out.norm = l.norm;
  out.table = l.table;
  return out;
}
void put(LobeOf<Float8>& out, std::size_t lane, const Lobe& l) {
  lanes::put(out.scale, lane, l.scale);
  lanes::put(out.scale2, lane, l.scale2);
  lanes::put(out.eta, lane, l.eta);
  lanes::put(out.k, lane, l.k);
  lanes::put(out.alpha_x, lane, l.alpha_x);
  lanes::put(out.alpha_y, lane, l.alpha_y);
  lanes::put(out.norm, lane, l.norm);
}

}  // namespace cloudrenderer::bsdf
