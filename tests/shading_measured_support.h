#pragma once
// Measured reflectances whose tables are formulas.
#include <cmath>
#include <memory>

#include "shading/measured.h"

namespace cloudrenderer::testing {

// A diffuse surface with a lobe of cos^exponent about the half vector; symmetric.
class FormulaTable final : public ReflectanceTable {
 public:
  FormulaTable(float diffuse, float glossy, float exponent)
      : diffuse_(diffuse), glossy_(glossy), exponent_(exponent) {}
  Rgb value(const Vec3& wo, const Vec3& wi) const override {
    const Vec3 h = wo + wi;
    const float length = glm::length(h);
    const float cosine = length > 0.f ? std::fabs(h.z) / length : 0.f;
    return Rgb(diffuse_ * kInvPi +
               glossy_ * (exponent_ + 8.f) / (8.f * kPi) * std::pow(cosine, exponent_));
  }
  std::uint64_t bytes() const override { return sizeof *this; }

 private:
  float diffuse_, glossy_, exponent_;
};

inline MeasuredReflectance formula(float diffuse, float glossy, float exponent) {
  return MeasuredReflectance(std::make_unique<FormulaTable>(diffuse, glossy, exponent));
}

}  // namespace cloudrenderer::testing
