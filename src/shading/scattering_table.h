#pragma once
#include <cstdint>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// A scattering function that is read from a file, with its sampling. Directions are unit, in the
// shading frame (z = normal). Immutable; any thread.
class ScatteringTable {
 public:
  virtual ~ScatteringTable() = default;
  virtual Rgb value(const Vec3& wo, const Vec3& wi) const = 0;  // f, without the cosine
  virtual float pdf(const Vec3& wo, const Vec3& wi) const = 0;  // density of sample()
  // Both; for tables that find them by the same steps.
  virtual Rgb value_and_pdf(const Vec3& wo, const Vec3& wi, float& density) const {
    density = pdf(wo, wi);
    return value(wo, wi);
  }
  // u and u2 are uniform. False when there is no direction.
  virtual bool sample(const Vec3& wo, float u, const Vec2& u2, Vec3& wi) const = 0;
  // The share of light that is scattered, roughly; the cosine of wo tells the side.
  virtual float albedo(float cosine) const = 0;
  virtual std::uint64_t bytes() const = 0;
};

}  // namespace cloudrenderer
