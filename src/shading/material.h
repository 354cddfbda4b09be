#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/log.h"
#include "scene/description.h"
#include "shading/bsdf.h"
#include "shapes/geometry.h"

namespace cloudrenderer {

struct SubsurfacePoint;

// The size of a pixel at a surface point, in world space: two vectors in the tangent plane that
// span the footprint of the ray, all zero where the scene needs none (no filtered textures). F: of one point, or of eight.
template <class F>
struct FootprintOf {
  Vec3Of<F> dpdx{}, dpdy{};
  Vec2Of<F> duvdx{}, duvdy{};  // the same in the surface's parameters

  FootprintOf() = default;
  FootprintOf(const SurfacePointOf<F>& point, const Vec3Of<F>& x, const Vec3Of<F>& y);
  bool empty() const { return dpdx == Vec3(0.f) && dpdy == Vec3(0.f); }  // of one
};
using Footprint = FootprintOf<float>;

template <class F>
FootprintOf<F>::FootprintOf(const SurfacePointOf<F>& point, const Vec3Of<F>& x, const Vec3Of<F>& y) : dpdx(x), dpdy(y) {
  // Least squares for the components along the tangents.
  const F e = glm::dot(point.dpdu, point.dpdu), f = glm::dot(point.dpdu, point.dpdv);
  const F g = glm::dot(point.dpdv, point.dpdv), det = e * g - f * f, inverse = 1.f / det;
  const MaskOf<F> spans = det > 0.f && lanes::is_finite(inverse);
  const auto solve = [&](const Vec3Of<F>& d) {
    const F a = glm::dot(d, point.dpdu), b = glm::dot(d, point.dpdv);
    const F u = (g * a - f * b) * inverse, v = (e * b - f * a) * inverse;
    const MaskOf<F> solved = spans && lanes::is_finite(u) && lanes::is_finite(v);
    return Vec2Of<F>(lanes::select(solved, u, F(0.f)), lanes::select(solved, v, F(0.f)));
  };
  duvdx = solve(x);
  duvdy = solve(y);
}

// Builds the textures and materials of a scene once (Shading::build) and makes a Bsdf at a point.
// Immutable afterwards; any thread. Memory of texture images counts in bytes().
class Shading {
 public:
  struct Options {
    std::uint64_t texture_budget =
        std::uint64_t{1} << 30;  // resident texels up to here, then mapped temporary files
  };
  // Throws SceneError for what makes no picture; unsupported kinds are warnings and become grey
  // matte (materials) or their constant default (textures).
  static std::unique_ptr<Shading> build(const SceneDescription& scene, const Options& options,
                                        Warnings& warnings);
  // What materials and textures need, so that others can leave it out.
  struct Needs {
    bool footprint = false;  // some texture is filtered
    bool uv = false;         // some texture, bump map or anisotropic material uses uv or tangents
    bool subsurface = false;  // some material has a medium inside
    bool null = false;        // some material is none
  };
  // Throws and warns as build() does, without reading images.
  static Needs check(const SceneDescription& scene, Warnings& warnings);
  virtual ~Shading() = default;

  virtual const Needs& needs() const = 0;
  virtual std::uint64_t bytes() const = 0;

  // True for v3's null material (pass through) at this material index.
  virtual bool is_null(std::uint32_t material) const = 0;

  // The lobes at a point, for which Bsdf::finish() is still to be called. Applies the bump map (changes point.ns and the
  // tangents). material may be kNone (0xffffffff): black. regularized: mirrors and glass of pbrt-v4 are rough, and what is
  // narrow is twice as wide, from 0.1 to 0.3.
  virtual Bsdf lobes(std::uint32_t material, SurfacePoint& point, const Footprint& footprint, bool regularized = false) const = 0;
  // Brings what lobes() reads without a footprint into the cache. False: that is not worth to wait for.
  virtual bool prefetch(std::uint32_t material, const SurfacePoint& point) const = 0;
  // The scattering at a point; `wo` is the unit direction back along the ray.
  Bsdf bsdf(std::uint32_t material, SurfacePoint& point, const Vec3& wo, const Footprint& footprint, bool regularized = false) const {
    Bsdf b = lobes(material, point, footprint, regularized);
    b.finish(wo);
    return b;
  }

  // What is inside of this material at a point. False: nothing.
  virtual bool subsurface(std::uint32_t material, const SurfacePoint& point, const Footprint& footprint,
                          SubsurfacePoint& out) const = 0;

  // Materials of the same kind can be shaded eight at once: constants, whose lobes agree in everything
  // but numbers. 0: the material has no such kind.
  virtual std::uint32_t kind(std::uint32_t material) const = 0;
  std::uint32_t kinds() const { return kinds_; }  // every kind is below this
  // The same scattering as above for eight points of materials of one kind.
  virtual Bsdf8 bsdf(const std::array<std::uint32_t, kLanes>& materials, const Vec3x8& ns, const Vec3x8& ng,
                     const Vec3x8& wo) const = 0;

  // Value of an alpha texture at uv (point filtered); index into SceneDescription::textures.
  virtual float alpha(std::uint32_t texture, const Vec2& uv, const Vec3& p) const = 0;
  // pbrt-v4: what is between 0 and 1 is the part of all rays that meet the surface.
  virtual bool alpha_by_chance(std::uint32_t texture) const = 0;

 protected:
  std::uint32_t kinds_ = 1;
};

}  // namespace cloudrenderer
