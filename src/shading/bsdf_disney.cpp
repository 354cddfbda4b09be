#include "shading/bsdf_disney.h"

namespace cloudrenderer::bsdf {
namespace {

constexpr float kClearcoatAlpha = 0.25f;  // of its masking, whatever the gloss

// G1 / (2 cosine) by Smith.
float clearcoat_masking(float cosine) {
  constexpr float a2 = kClearcoatAlpha * kClearcoatAlpha;
  return 1.f / (cosine + std::sqrt(a2 + (1.f - a2) * cosine * cosine));
}

float schlick_of_coat(float c) { return 0.04f + 0.96f * pow5(std::max(0.f, 1.f - c)); }

}  // namespace

Lobe disney_diffuse(const DisneyDiffuse& d) {
  Lobe l{};
  l.kind = LobeKind::disney_diffuse;
  l.scale = d.color;
  l.scale2 = d.sheen;
  l.eta = Rgb(1.f);
  l.k = {d.diffuse, d.flat, d.roughness};
  return l;
}

Lobe disney_clearcoat(float weight, float gloss) {
  Lobe l{};
  l.kind = LobeKind::disney_clearcoat;
  l.scale = Rgb(weight);
  l.eta = Rgb(1.f);
  const float alpha = 0.1f + std::clamp(gloss, 0.f, 1.f) * (0.001f - 0.1f);
  l.alpha_x = alpha * alpha;
  l.alpha_y = 2.f * portable::log(alpha);
  l.norm = (l.alpha_x - 1.f) / (kPi * l.alpha_y);  // of Burley's distribution with exponent 1
  return l;
}

Rgb clearcoat_value(const Lobe& l, const Vec3& wo, const Vec3& wi, const Vec3& wh, float dot, float& pdf) {
  // 1 + (a^2 - 1) cos^2 without cancellation
  const float d = l.norm / (sine2(wh) + l.alpha_x * wh.z * wh.z);
  pdf = d * std::fabs(wh.z) / (4.f * dot);
  return l.scale * (0.25f * d * schlick_of_coat(dot) * clearcoat_masking(std::fabs(wo.z)) *
                    clearcoat_masking(std::fabs(wi.z)));
}

bool sample_clearcoat(const Lobe& l, const Vec3& wo, const Vec2& u, Vec3& wi) {
  // 1 - cos^2 = (a^(2 - 2u) - a^2) / (1 - a^2)
  const float s2 = std::clamp((portable::exp((1.f - u.x) * l.alpha_y) - l.alpha_x) / (1.f - l.alpha_x), 0.f, 1.f);
  const float r = std::sqrt(s2), side = wo.z > 0.f ? 1.f : -1.f;
  float s, c;
  portable::sincos_turn(u.y, s, c);
  const Vec3 wh = side * Vec3(r * c, r * s, std::sqrt(1.f - s2));
  const float dot = glm::dot(wo, wh);
  wi = 2.f * dot * wh - wo;
  return dot > 0.f && wi.z * wo.z > 0.f;
}

float clearcoat_albedo(float cosine) {
  // the distribution is narrow: as if it were a mirror
  return 0.25f * schlick_of_coat(cosine);
}

}  // namespace cloudrenderer::bsdf
