#include "shading/bsdf.h"

#include "shading/bsdf_math.h"

namespace cloudrenderer {
namespace {

using namespace bsdf;  // NOLINT: the formulas of this file

// The half vector of a reflection, on wo's side when wi is there too.
struct Half {
  Vec3 wh{0, 0, 1};
  float dot = 1;  // with wo and with wi; > 0
  bool valid = false;
};

Half half_of(const Vec3& wo, const Vec3& wi) {
  Half h;
  const Vec3 sum = wo + wi;
  const float length2 = glm::dot(sum, sum);
  if (!(length2 > 0.f)) return h;
  h.wh = sum * (1.f / std::sqrt(length2));
  h.dot = glm::dot(wi, h.wh);
  h.valid = h.dot > 0.f;
  return h;
}

// f without Fresnel and scale, and the density of sampling the reflected direction by its half
// vector.
[[gnu::always_inline]] inline float reflect_by_normals(const Lobe& l, const Vec3& wo,
                                                       const Vec3& wi, const Half& h, float& pdf) {
  const float co = std::fabs(wo.z), ci = std::fabs(wi.z), d = normal_density(l, h.wh);
  if (l.distribution == Distribution::trowbridge_reitz) {
    const float so = smith_root(l, wo), si = smith_root(l, wi);
    pdf = d * 0.5f / (co + so);
    return d * 0.5f / (ci * so + co * si);  // D G / (4 co ci) with G = 1 / (1 + L(wo) + L(wi))
  }
  // Torrance and Sparrow's V-grooves: G = min(1, 2 h min(co, ci) / dot)
  const float z = std::fabs(h.wh.z);
  const bool masked = 2.f * z * std::min(co, ci) < h.dot;
  pdf = d * z / (4.f * h.dot);
  return (masked ? d * z : d) / (masked ? 2.f * h.dot * std::max(co, ci) : 4.f * co * ci);
}

// Density alone, for lobes whose value has another form.
inline float half_density(const Lobe& l, const Vec3& wo, const Half& h, float d) {
  if (l.distribution == Distribution::trowbridge_reitz)
    return d * 0.5f / (std::fabs(wo.z) + smith_root(l, wo));
  return d * std::fabs(h.wh.z) / (4.f * h.dot);
}

inline Rgb oren_nayar_value(const Lobe& l, const Vec3& wo, const Vec3& wi) {
  // cos(phi_i - phi_o) sin(alpha) tan(beta) = max(0, xi xo + yi yo) / max(|cos i|, |cos o|)
  const float cross = std::max(0.f, wi.x * wo.x + wi.y * wo.y);
  const float t = cross / std::max(std::fabs(wi.z), std::fabs(wo.z));
  return l.scale * (kInvPi * (l.alpha_x + l.alpha_y * t));
}

// The chance of reflecting at a dielectric (micro)facet with Fresnel factor f.
inline float reflect_chance(const Lobe& l, float f) {
  const float r = luminance(l.scale) * f, t = luminance(l.scale2) * (1.f - f);
  return r + t > 0.f ? r / (r + t) : 0.f;
}

inline float incident_eta(const Lobe& l, const Vec3& wo) { return wo.z > 0.f ? l.eta.x : l.eta.y; }

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
  const float root = oh + e * ih;
  if (root == 0.f) return Rgb(0.f);
  const float f = fresnel_dielectric(std::fabs(oh), oh > 0.f ? l.eta.x : l.eta.y);
  const float co = std::fabs(wo.z), ci = std::fabs(wi.z), so = smith_root(l, wo),
              si = smith_root(l, wi);
  const float d = normal_density(l, wh), jacobian = std::fabs(ih) / (root * root);  // times e^2
  // the density of visible normals is D G1 |wo.wh| / co with G1 = 2 co / (co + so)
  pdf = (1.f - reflect_chance(l, f)) * d * 2.f * std::fabs(oh) / (co + so) * jacobian * e * e;
  // G / (co ci) = 2 / (ci so + co si); radiance scaling cancels e^2
  return l.scale2 * ((1.f - f) * d * std::fabs(oh) * jacobian * 2.f / (ci * so + co * si));
}

Rgb fresnel_blend_value(const Lobe& l, float mix, const Vec3& wo, const Vec3& wi, const Half& h,
                        float& pdf) {
  const float co = std::fabs(wo.z), ci = std::fabs(wi.z);
  const float d = normal_density(l, h.wh);
  pdf = (1.f - mix) * ci * kInvPi + mix * half_density(l, wo, h, d);
  const Rgb diffuse =
      l.scale * (Rgb(1.f) - l.scale2) *
      ((28.f / 23.f) * kInvPi * (1.f - pow5(1.f - 0.5f * ci)) * (1.f - pow5(1.f - 0.5f * co)));
  const Rgb glossy = schlick(l.scale2, h.dot) * (d / (4.f * h.dot * std::max(ci, co)));
  return l.eta * (diffuse + glossy);
}

// 1 / n
constexpr std::array<float, Bsdf::kMaxLobes + 1> kEven{0.f,     1.f,     1.f / 2, 1.f / 3, 1.f / 4,
                                                       1.f / 5, 1.f / 6, 1.f / 7, 1.f / 8};

// A rough guess of the share of light a lobe scatters, for choosing among lobes.
float albedo_guess(const Lobe& l, float wo_z, float& mix) {
  const float c = std::min(1.f, std::fabs(wo_z));
  switch (l.kind) {
    case LobeKind::lambert:
    case LobeKind::oren_nayar:
      return luminance(l.scale);
    case LobeKind::microfacet: {
      const float eta =
          wo_z > 0.f || l.fresnel == Fresnel::dielectric_one_sided ? l.eta.x : l.eta.y;
      if ((l.fresnel == Fresnel::dielectric || l.fresnel == Fresnel::dielectric_one_sided) &&
          eta < 1.f) {
        // pbrt's plastic reflects totally beyond 42 degrees; half vectors spread around it
        return luminance(l.scale) * (0.8f - 0.75f * c * c);
      }
      return luminance(l.scale * fresnel(l, c, wo_z > 0.f));
    }
    case LobeKind::microfacet_dielectric:
    case LobeKind::specular_dielectric: {
      const float f = fresnel_dielectric(c, wo_z > 0.f ? l.eta.x : l.eta.y);
      return luminance(l.scale) * f + luminance(l.scale2) * (1.f - f);
    }
    case LobeKind::fresnel_blend: {
      const float glossy = luminance(schlick(l.scale2, c)),
                  diffuse = luminance(l.scale * (Rgb(1.f) - l.scale2));
      const float sum = glossy + diffuse;
      mix = sum > 0.f ? std::clamp(glossy / sum, 0.1f, 0.9f) : 0.5f;
      return luminance(l.eta) * sum;
    }
    case LobeKind::specular_reflection:
      return luminance(l.scale * fresnel(l, c, wo_z > 0.f));
    case LobeKind::specular_transmission:
      return luminance(l.scale) * (1.f - fresnel_dielectric(c, wo_z > 0.f ? l.eta.x : l.eta.y));
  }
  return 0.f;
}

// A direction from a smooth lobe; `u` is a spare uniform number. False when there is none.
bool sample_lobe(const Lobe& l, float mix, const Vec3& wo, float u, const Vec2& u2, Vec3& wi) {
  const float side = wo.z > 0.f ? 1.f : -1.f;
  switch (l.kind) {
    case LobeKind::lambert:
    case LobeKind::oren_nayar:
      wi = sample_cosine(u2);
      wi.z *= l.transmits ? -side : side;
      return true;
    case LobeKind::fresnel_blend:
      if (u >= mix) {
        wi = sample_cosine(u2);
        wi.z *= side;
        return true;
      }
      break;
    default:
      break;
  }
  Vec3 wh = l.distribution == Distribution::trowbridge_reitz
                ? sample_visible_normal(l, Vec3(wo.x * side, wo.y * side, wo.z * side), u2)
                : sample_blinn_normal(l, u2);
  wh *= side;
  const float c = glm::dot(wo, wh);
  if (!(c > 0.f)) return false;
  if (l.kind == LobeKind::microfacet_dielectric) {
    const float f = fresnel_dielectric(c, incident_eta(l, wo));
    if (u >= reflect_chance(l, f))
      return refract(wo, wh, incident_eta(l, wo), wi) && wi.z * wo.z < 0.f;
  }
  wi = 2.f * c * wh - wo;
  if (!(wi.z * wo.z > 0.f)) return false;
  if (l.transmits) wi.z = -wi.z;
  return true;
}

}  // namespace

Rgb Bsdf::evaluate(const Vec3& wo, const Vec3& wi, bool reflect, float& pdf) const {
  pdf = 0.f;
  Rgb f(0.f);
  const float co = std::fabs(wo.z), ci = std::fabs(wi.z);
  if (co == 0.f || ci == 0.f) return f;
  const bool same = wo.z * wi.z > 0.f;
  const Half half = half_ ? half_of(wo, wi) : Half{};
  for (int i = 0; i < count_; ++i) {
    const Lobe& l = lobes_[static_cast<std::size_t>(i)];
    const Chance& chance = chance_[static_cast<std::size_t>(i)];
    const bool counts = reflect != l.transmits, sampled = same != l.transmits;
    switch (l.kind) {
      case LobeKind::lambert:
        if (counts) f += l.scale * kInvPi;
        if (sampled) pdf += chance.weight * ci * kInvPi;
        break;
      case LobeKind::oren_nayar:
        if (counts) f += oren_nayar_value(l, wo, wi);
        if (sampled) pdf += chance.weight * ci * kInvPi;
        break;
      case LobeKind::microfacet: {
        const Vec3 w(wi.x, wi.y, l.transmits ? -wi.z : wi.z);
        const Half h = l.transmits ? half_of(wo, w) : half;
        if (!h.valid) break;
        float p;
        const float v = reflect_by_normals(l, wo, w, h, p);
        if (counts) f += l.scale * fresnel(l, h.dot, h.wh.z > 0.f) * v;
        if (sampled) pdf += chance.weight * p;
        break;
      }
      case LobeKind::microfacet_dielectric: {
        float p = 0.f;
        if (same) {
          if (!half.valid) break;
          const float v = reflect_by_normals(l, wo, wi, half, p);
          const float r = fresnel_dielectric(half.dot, half.wh.z > 0.f ? l.eta.x : l.eta.y);
          if (reflect) f += l.scale * (r * v);
          pdf += chance.weight * p * reflect_chance(l, r);
        } else if (reflect) {  // the normals disagree: pbrt evaluates the reflection all the same
          if (!half.valid) break;
          const float v = reflect_by_normals(l, wo, wi, half, p);
          f += l.scale * (v * fresnel_dielectric(half.dot, half.wh.z > 0.f ? l.eta.x : l.eta.y));
          rough_transmission(l, wo, wi, p);
          pdf += chance.weight * p;
        } else {
          f += rough_transmission(l, wo, wi, p);
          pdf += chance.weight * p;
        }
        break;
      }
      case LobeKind::fresnel_blend:
        if (half.valid) {
          float p;
          const Rgb value = fresnel_blend_value(l, chance.mix, wo, wi, half, p);
          if (reflect) f += value;
          if (same) pdf += chance.weight * p;
        }
        break;
      default:
        break;  // specular
    }
  }
  return f;
}

Rgb Bsdf::eval(const Vec3& wo, const Vec3& wi) const {
  float pdf;
  return evaluate(frame_.to_local(wo), frame_.to_local(wi),
                  glm::dot(wi, ng_) * glm::dot(wo, ng_) > 0.f, pdf);
}

float Bsdf::pdf(const Vec3& wo, const Vec3& wi) const {
  float pdf;
  evaluate(frame_.to_local(wo), frame_.to_local(wi), true, pdf);
  return pdf;
}

float Bsdf::even_pdf(const Vec3& wo, const Vec3& wi) const {
  Bsdf even = *this;
  float smooth = 0.f;
  for (int i = 0; i < count_; ++i) smooth += lobe(i).kind < LobeKind::specular_reflection ? 1.f : 0.f;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) even.chance_[i] = {1.f / smooth, 0.5f};
  return even.pdf(wo, wi);
}

Rgb Bsdf::eval_cos(const Vec3& wo, const Vec3& wi, float& pdf) const {
  const Vec3 local = frame_.to_local(wi);
  const bool reflect = glm::dot(wi, ng_) * glm::dot(wo, ng_) > 0.f;
  return evaluate(frame_.to_local(wo), local, reflect, pdf) * std::fabs(local.z);
}

void Bsdf::finish(const Vec3& wo) {
  if (count_ == 0) return;
  const float z = glm::dot(wo, frame_.n);
  if (count_ == 1) {
    chance_[0].weight = 1.f;
    if (lobes_[0].kind == LobeKind::fresnel_blend) albedo_guess(lobes_[0], z, chance_[0].mix);
    return;
  }
  const auto count = static_cast<std::size_t>(count_);
  float sum = 0.f;
  for (std::size_t i = 0; i < count; ++i) {
    const float guess = albedo_guess(lobes_[i], z, chance_[i].mix);
    chance_[i].weight = guess > 0.f && guess < 1e9f ? guess : 0.f;
    sum += chance_[i].weight;
  }
  // No lobe is starved: a guess may be wrong by much at grazing angles.
  const float floor = kEven[count] * 0.02f, factor = sum > 0.f ? 0.98f / sum : 0.f;
  for (std::size_t i = 0; i < count; ++i)
    chance_[i].weight = sum > 0.f ? floor + factor * chance_[i].weight : kEven[count];
}

bool Bsdf::finish_specular(const Lobe& l, float chance, const Vec3& wo, float u,
                           BsdfSample& out) const {
  const float c = std::fabs(wo.z), side = wo.z > 0.f ? 1.f : -1.f;
  out.specular = true;
  out.pdf = 0.f;
  out.eta = 1.f;
  bool reflects = l.kind == LobeKind::specular_reflection;
  Rgb weight;
  if (reflects) {
    weight = l.scale * fresnel(l, c, wo.z > 0.f);
  } else {
    const float f = fresnel_dielectric(c, incident_eta(l, wo));
    if (l.kind == LobeKind::specular_dielectric) {
      const float reflecting = reflect_chance(l, f);
      reflects = u < reflecting;
      weight = reflects ? l.scale * (f / reflecting) : l.scale2 * ((1.f - f) / (1.f - reflecting));
    } else {
      weight = l.scale * (1.f - f);
    }
  }
  Vec3 wi(-wo.x, -wo.y, wo.z);
  if (!reflects) {
    const float eta = incident_eta(l, wo);
    if (!refract(wo, Vec3(0, 0, side), eta, wi)) return false;
    if (l.scale_radiance) weight *= 1.f / (eta * eta);
    out.eta = eta;
  }
  out.transmission = !reflects;
  out.weight = weight * (1.f / chance);
  out.wi = glm::normalize(frame_.to_world(wi));
  return !is_black(out.weight);
}

bool Bsdf::sample(const Vec3& wo_world, float u_lobe, const Vec2& u, BsdfSample& out) const {
  const Vec3 wo = frame_.to_local(wo_world);
  if (count_ == 0 || wo.z == 0.f) return false;
  int chosen = 0;
  while (chosen + 1 < count_ && u_lobe >= weight(chosen)) u_lobe -= weight(chosen++);
  const Lobe& l = lobe(chosen);
  const Chance& chance = chance_[static_cast<std::size_t>(chosen)];
  const float rest = std::min(u_lobe / chance.weight, 0x1.fffffep-1f);
  if (l.kind >= LobeKind::specular_reflection)
    return finish_specular(l, chance.weight, wo, rest, out);

  Vec3 wi;
  if (!sample_lobe(l, chance.mix, wo, rest, u, wi)) return false;
  out.wi = frame_.to_world(wi);
  const bool reflect = glm::dot(out.wi, ng_) * glm::dot(wo_world, ng_) > 0.f;
  out.specular = false;
  out.transmission = !reflect;
  out.eta = 1.f;
  if (count_ == 1 && l.kind == LobeKind::lambert) {  // the most frequent case needs no evaluation
    out.pdf = std::fabs(wi.z) * kInvPi;
    out.weight = l.scale;
    return out.pdf > 0.f && reflect != l.transmits;
  }
  if (l.kind == LobeKind::microfacet_dielectric && wi.z * wo.z < 0.f) out.eta = incident_eta(l, wo);
  const Rgb f = evaluate(wo, wi, reflect, out.pdf);
  if (!(out.pdf > 0.f) || is_black(f)) return false;
  out.weight = f * (std::fabs(wi.z) / out.pdf);
  return true;
}

}  // namespace cloudrenderer
