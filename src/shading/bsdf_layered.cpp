#include "shading/bsdf_layered.h"

#include "shading/bsdf_layered_slab.h"
#include "shading/bsdf_lobes.h"
#include "shading/bsdf_math.h"

namespace cloudrenderer::bsdf {
namespace {

struct Node {
  float x, weight;
};
// Gauss and Legendre's rule on [0, 1].
constexpr std::array<Node, 8> kNodes{{{0.01985507f, 0.05061427f},
                                      {0.10166676f, 0.11119052f},
                                      {0.23723380f, 0.15685332f},
                                      {0.40828268f, 0.18134189f},
                                      {0.59171732f, 0.18134189f},
                                      {0.76276620f, 0.15685332f},
                                      {0.89833324f, 0.11119052f},
                                      {0.98014493f, 0.05061427f}}};

// Facets between nearly equal indices bend light by less than its directions can tell.
bool is_rough(const Coat& c) {
  constexpr float kLeastBend = 1e-5f;
  const float least = std::min(c.alpha_x, c.alpha_y);
  return std::max(c.alpha_x, c.alpha_y) > 0.f && std::fabs(c.eta - 1.f) * std::max(least, 0.001f) >= kLeastBend;
}

// The coat's own reflection, with the numbers that the light below needs.
Lobe surface(const Coat& c) {
  const FresnelTerm fresnel = dielectric_one_sided(c.eta);
  Lobe l = is_rough(c) ? microfacet(Rgb(1.f), trowbridge_reitz(c.alpha_x, c.alpha_y), fresnel)
                       : specular_reflection(Rgb(1.f), fresnel);
  l.scale2 = {c.thickness, c.g, static_cast<float>(c.walks + Slab::kWalks * c.events)};
  return l;
}

// How the light that comes out again is sampled: in part by the cosine, else by a microfacet lobe as wide as the two rough
// layers make it together, which a smooth coat of this index bends.
struct Proposal {
  Lobe facets;
  float index;
  float cosine;  // chance
};

// A facet of the coat tilted by a small angle x turns light inside by (1 - 1/eta) x, on both ways; one of the base turns it by
// 2 x. A half vector turns by half of that, and outside by eta times as much. Of a wide lobe inside the coat much is kept by
// total reflection: it is taken for one outside, which is true near the normal only.
Proposal proposal(const Slab& s) {
  if (s.diffuse()) return {{}, 1.f, 1.f};
  constexpr float kNarrow = 0.15f;
  const float bend = (1.f - 1.f / s.eta) * (1.f - 1.f / s.eta) * 0.5f;
  float extra = 0.f, cosine = 0.3f;
  if (s.scatters) {
    cosine += 0.4f * (1.f - attenuation(2.f * s.thickness, 1.f));
    if (!s.rough && s.mirror()) extra = (1.f - std::fabs(s.g)) / s.eta;  // all that this lobe has comes from the medium
  }
  const auto width = [&](float coat, float base) {
    const float outer = s.rough ? coat : 0.f;
    return std::sqrt(base * base + bend * outer * outer + extra * extra);
  };
  const float x = width(s.coat.alpha_x, s.base.alpha_x), y = width(s.coat.alpha_y, s.base.alpha_y);
  const float index = std::max(x, y) < kNarrow ? s.eta : 1.f, scale = s.eta / index;
  return {microfacet(Rgb(1.f), trowbridge_reitz(std::min(scale * x, 1.f), std::min(scale * y, 1.f)), no_fresnel()), index, cosine};
}

// A direction outside, still upwards; z is made positive.
Vec3 bent(const Vec3& w, float index) { return {w.x / index, w.y / index, refracted_cosine(std::fabs(w.z), index)}; }

}  // namespace

bool needs_walk(const Coat& c) { return is_rough(c) || (!is_black(c.albedo) && c.thickness > 0.f); }

float coat_internal(float eta, float thickness) {
  // From the inside all is reflected up to the critical angle; beyond it the cosine outside is the smoother variable.
  const float critical2 = std::max(0.f, (eta - 1.f) * (eta + 1.f)) / (eta * eta), critical = std::sqrt(critical2);
  float sum = 0.f;
  for (const Node& n : kNodes) {
    const float inside = critical * n.x, beyond = std::sqrt(critical2 + (1.f - critical2) * n.x * n.x);
    sum += 2.f * n.x * n.weight *
           (critical2 * attenuation(2.f * thickness, inside) +
            (1.f - critical2) * fresnel_dielectric(n.x, eta) * attenuation(2.f * thickness, beyond));
  }
  return std::min(sum, 1.f);
}

Layers coated_diffuse(const Coat& c, const Rgb& reflectance, float internal) {
  Layers out;
  const Lobe coat = surface(c);
  if (needs_walk(c)) {
    Lobe base = coated_lambert(Rgb(1.f), c.eta);
    base.kind = LobeKind::layered;
    base.k = reflectance;
    base.scale2 = c.albedo;
    out.lobes = {coat, base};
    out.count = 2;
    return out;
  }
  // Refraction spreads what enters over the whole hemisphere: eta^2. The light between the layers is a geometric series
  // of diffuse light (Saunderson 1942).
  // It ends with the base's last event.
  const Rgb again = reflectance * internal;
  Rgb lost(1.f);
  for (int i = 0; i < c.events && !is_black(lost); i += 2) lost *= again;
  const Rgb diffuse = reflectance / (c.eta * c.eta) * (Rgb(1.f) - lost) / glm::max(Rgb(1.f) - again, Rgb(1e-6f));
  if (!is_black(diffuse)) out.lobes[out.count++] = coated_lambert(diffuse, c.eta, c.thickness);
  out.lobes[out.count++] = coat;
  return out;
}

Layers coated_conductor(const Coat& c, const Rgb& eta, const Rgb& k, float alpha_x, float alpha_y) {
  Layers out;
  Lobe coat = surface(c);
  const bool mirror = !(std::max(alpha_x, alpha_y) > 0.f);
  if (mirror && !is_rough(c)) {
    coat.fresnel = Fresnel::coated_conductor;
    coat.eta = eta;
    coat.k = k;
    coat.norm = c.eta;
  }
  out.lobes[out.count++] = coat;
  if (mirror && !needs_walk(c)) return out;
  Lobe base = microfacet(Rgb(1.f), trowbridge_reitz(alpha_x, alpha_y), conductor(eta, k));
  base.kind = LobeKind::layered;
  if (mirror) base.alpha_x = base.alpha_y = 0.f;
  base.scale2 = c.albedo;
  out.lobes[out.count++] = base;
  return out;
}

Rgb coated_mirror(const Lobe& l, float c) {
  const float inside = refracted_cosine(c, l.norm), f = fresnel_dielectric(c, l.norm);
  const Rgb metal = by_channel(l.eta, l.k, [inside](float n, float k) { return conductor_channel(inside, n, k); });
  const Rgb once = metal * attenuation(2.f * l.scale2.x, inside);  // down and up again
  return Rgb(f) + (1.f - f) * (1.f - f) * once / (1.f - f * once);
}

float layered_density(const Lobe& l, const Vec3& wo, const Vec3& wi) {
  const Proposal p = proposal(Slab(l));
  const float ci = std::fabs(wi.z), cosine = p.cosine * ci * kInvPi;
  if (p.cosine == 1.f) return cosine;
  const Vec3 o = bent(wo, p.index), i = bent(wi, p.index), wh = o + i;
  const float inside = normal_density(p.facets, wh / glm::length(wh)) * 0.5f / (o.z + smith_root(p.facets, o));
  return cosine + (1.f - p.cosine) * inside * ci / (p.index * p.index * i.z);
}

bool sample_layered(const Lobe& l, const Vec3& wo, float u, const Vec2& u2, Vec3& wi) {
  const Proposal p = proposal(Slab(l));
  if (u < p.cosine) {
    wi = sample_cosine(u2);
  } else {
    const Vec3 o = bent(wo, p.index), wh = sample_visible_normal(p.facets, o, u2), i = 2.f * glm::dot(o, wh) * wh - o;
    wi = {i.x * p.index, i.y * p.index, 0.f};
    const float z2 = 1.f - sine2(wi);
    if (!(i.z > 0.f) || !(z2 > 0.f)) return false;  // kept inside
    wi.z = std::sqrt(z2);
  }
  const bool above = wi.z > 0.f;
  if (wo.z < 0.f) wi.z = -wi.z;
  return above;
}

float layered_albedo(const Lobe& l, float c) {
  const Slab s(l);
  const float through = attenuation(2.f * s.thickness, refracted_cosine(c, s.eta));
  const Rgb base = s.diffuse() ? l.k : fresnel(l, 1.f, true);
  const float inside = luminance(base) * through + 0.4f * luminance(l.scale2) * (1.f - through);
  return luminance(l.scale) * (1.f - fresnel_dielectric(c, s.eta)) * inside;
}

}  // namespace cloudrenderer::bsdf
