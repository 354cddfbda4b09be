#pragma once
// The phase function of Henyey and Greenstein 1941.
#include "base/portable_math.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Density by solid angle of scattering from a ray that came from `wo` towards `wi` (both point away from the point);
// positive g scatters forwards.
inline float phase_hg(const Vec3& wo, const Vec3& wi, float g) {
  const float denominator = std::max(1.f + g * g + 2.f * g * glm::dot(wo, wi), 1e-12f);
  return (1.f - g * g) / (4.f * kPi * denominator * std::sqrt(denominator));
}

// A direction with that density.
inline Vec3 sample_phase_hg(const Vec3& wo, float g, const Vec2& u) {
  float cosine = 1.f - 2.f * u.x;  // to the way that the ray went
  if (std::fabs(g) > 1e-3f) {
    const float root = (1.f - g * g) / (1.f + g - 2.f * g * u.x);
    cosine = std::clamp((1.f + g * g - root * root) / (2.f * g), -1.f, 1.f);
  }
  const float sine = std::sqrt(std::max(0.f, 1.f - cosine * cosine));
  float s, c;
  portable::sincos_turn(u.y, s, c);
  return Frame(-wo).to_world({sine * c, sine * s, cosine});
}

}  // namespace cloudrenderer
