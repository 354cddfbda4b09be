#pragma once
// The phase function of Henyey and Greenstein 1941, in forms that do not cancel where it is a narrow peak: with the
// distance of two directions in place of their cosine.
#include "base/portable_math.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Density by solid angle of scattering from a ray that came from `wo` towards `wi` (both unit, both point away from the
// point); positive g scatters forwards.
inline float phase_hg(const Vec3& wo, const Vec3& wi, float g) {
  // 1 + g^2 - 2 |g| c = (1 - |g|)^2 + 2 |g| (1 - c) for the cosine c to the peak, and 2 (1 - c) is a squared distance
  const Vec3 apart = g < 0.f ? wi - wo : wi + wo;
  const float h = std::fabs(g), rest = 1.f - h, denominator = rest * rest + h * glm::dot(apart, apart);
  return rest * (1.f + h) / (4.f * kPi * denominator * std::sqrt(denominator));
}

// A direction with that density.
inline Vec3 sample_phase_hg(const Vec3& wo, float g, const Vec2& u) {
  const float h = std::fabs(g), rest = 1.f - h, from_peak = g < 0.f ? 1.f - u.x : u.x;
  const float across = rest + 2.f * h * (1.f - from_peak), root = rest * (1.f + h) / across;
  const float x = std::min(from_peak * rest * (root + rest) / across, 2.f);  // 1 - the cosine to the peak
  const float sine = std::sqrt(x * (2.f - x)), cosine = g < 0.f ? x - 1.f : 1.f - x;
  float s, c;
  portable::sincos_turn(u.y, s, c);
  return Frame(-wo).to_world({sine * c, sine * s, cosine});
}

}  // namespace cloudrenderer
