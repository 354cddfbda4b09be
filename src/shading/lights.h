#pragma once
#include <cstdint>
#include <memory>
#include <span>

#include "base/lanes.h"
#include "base/log.h"
#include "cloudrenderer/math.h"
#include "parts/part.h"
#include "scene/description.h"

namespace cloudrenderer {

// A chosen light, as seen from a point; F: float or Float8.
template <class F>
struct LightSampleOf {
  Vec3Of<F> wi{};  // unit, towards the light
  F distance = 0;  // to the point on the light, or infinity; a shadow ray ends just before it
  Vec3Of<F> radiance{F(0)};  // emitted towards the point; delta lights: intensity over distance^2, or so
  F pdf = 0;  // by solid angle, times the chance of the light; delta lights: that chance
  // By solid angle: what weighs against the BSDF's density. As pdf, but for disks of pbrt-v2.
  F weight_pdf = 0;
  MaskOf<F> delta{false};
  F emission = 0;  // Lights::emission of it, after want_emission()
};
using LightSample = LightSampleOf<float>;
using LightSample8 = LightSampleOf<Float8>;

// A ray that leaves a light.
struct LightRay {
  Vec3 origin, direction;  // unit
  Rgb weight{0};  // the light's power on it, over the density of the choice
  Vec3 normal{};  // of a shape's surface, on the side that it leaves
  std::uint32_t emitter = 0;
  bool found = false;  // rays can find the light, too
};

// All lights of a scene, and how one is chosen at a point. Built from the description and the main
// scene's emissive shapes; immutable, any thread. Lights are numbered: infinite and delta lights,
// then emissive shapes.
class Lights {
 public:
  // `main_part` holds every emissive shape (chunks and quadrics with light != kNone).
  // `shape_lights` as in Manifest. Light maps are read through OpenImageIO. scene_bounds: for
  // distant and infinite lights' power.
  static std::unique_ptr<Lights> build(const SceneDescription& scene,
                                       std::span<const AreaLightId> shape_lights,
                                       const Part& main_part, const Bounds3& scene_bounds,
                                       Warnings& warnings);
  // Throws and warns as build() does for the scene's directives, without reading light maps. True if some light shines
  // from infinitely far on all sides.
  static bool check(const SceneDescription& scene, Warnings& warnings);
  virtual ~Lights() = default;
  virtual bool empty() const = 0;
  virtual bool has_infinite() const = 0;
  virtual bool has_choice() const = 0;  // there is more than one light; without, sample() takes any u_light
  virtual std::uint64_t bytes() const = 0;
  // There is a disk of pbrt-v2, or a lamp that rays do not find, whose light depends on the weights of the estimates
  // (LightSample::weight_pdf): these are to be those of pbrt, with Bsdf::even_pdf.
  virtual bool weighs_alone() const = 0;
  // Some lamp is lit by samples on one side and shows light on the other: a disk of pbrt-v2, a mirrored sphere of pbrt-v3.
  virtual bool disagrees() const = 0;

  // Chooses a light with u_light and a direction with u. `n` is the shading normal on the side
  // whose light matters: turned towards the viewer for a surface that only reflects, the zero
  // vector where both sides count (transmission, media). Light from below n's horizon is sampled
  // rarely, or left to the BSDF's samples; the estimate stays right with any n. Returns false when
  // nothing can arrive. A pure function of its arguments.
  virtual bool sample(const Vec3& p, const Vec3& n, float u_light, const Vec2& u,
                      LightSample& out) const = 0;
  // The same for the `active` ones of eight points: the same bits in each lane.
  virtual Mask8 sample(Mask8 active, const Vec3x8& p, const Vec3x8& n, Float8 u_light, const Vec2x8& u,
                       LightSample8& out) const = 0;

  // Radiance that arrives at p along `direction` (unit) from outside the scene: all infinite lights.
  // pdf is what sample(p, n) has for this direction (chance of the lights included).
  virtual Rgb escaped(const Vec3& p, const Vec3& n, const Vec3& direction, float& pdf) const = 0;
  // The same where no density is needed: camera rays and specular bounces.
  virtual Rgb escaped(const Vec3& p, const Vec3& direction) const = 0;
  // Both for eight: the same bits in each `active` lane.
  virtual Vec3x8 escaped(Mask8 active, const Vec3x8& p, const Vec3x8& n, const Vec3x8& direction, Float8& pdf) const = 0;
  virtual Vec3x8 escaped(Mask8 active, const Vec3x8& p, const Vec3x8& direction) const = 0;

  // Radiance that the emissive shape `light` (running number) emits at a hit towards -direction;
  // ng: the surface's geometric normal as in SurfacePoint; uv counts where there are pictures. pdf: what sample(p, n) has for this
  // direction, p, n being where the ray started. `t` is the distance along the unit direction,
  // `primitive` the source triangle number (any for quadrics). A pdf of 0: the shape is not found
  // by sample(), all weight is with the ray that hit it. Disks of pbrt-v2: LightSample::weight_pdf.
  virtual Rgb emitted(std::uint32_t light, const Vec3& ng, const Vec3& direction, std::uint32_t primitive,
                      const Vec2& uv) const = 0;
  // Light of `light` that counts for camera rays and specular bounces alone.
  virtual bool is_only_seen(std::uint32_t light) const = 0;
  virtual bool has_pictures() const = 0;  // of emissive shapes
  virtual float emitted_pdf(std::uint32_t light, const Vec3& p, const Vec3& n,
                            const Vec3& direction, float t, const Vec3& hit_point,
                            const Vec3& hit_ng, std::uint32_t primitive) const = 0;

  // Rays that leave lights. What weighs them against the other ways to find light is their emission: the chance of the light
  // times, of a shape, the density of the point by area and that of the direction by solid angle over the cosine; of light
  // from outside, that of the direction, and of the point by area across it; of a point, that of the direction over the
  // squared distance. It is for weights only: shapes that a transformation distorts count as even, and the cosine of a ray that
  // is aimed as a half.
  // Rays are aimed at the boxes from now on, a share of them if there are boxes; without, none is. Before the first one.
  virtual void aim(std::span<const Bounds3> boxes, float share) = 0;
  // Samples tell their emission from now on. Before the first one.
  virtual void want_emission() = 0;
  // A ray out of a light of the scene. False: none, by these numbers.
  virtual bool emit(float u_light, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const = 0;
  // wi, distance: from p to the light's point.
  virtual float emission(std::uint32_t emitter, const Vec3& p, const Vec3& wi, float distance) const = 0;
  // Of a point of the emissive shape `light`, against `direction`; 0: no rays leave it.
  virtual float shape_emission(std::uint32_t light, std::uint32_t primitive, const Vec3& point, const Vec3& direction) const = 0;
  // Of all infinite lights, at p against `direction`.
  virtual float infinite_emission(const Vec3& p, const Vec3& direction) const = 0;
  // What sample(p, n) has for the point of a ray that has left a light.
  virtual float pdf_of(const LightRay& ray, const Vec3& p, const Vec3& n) const = 0;
};

}  // namespace cloudrenderer
