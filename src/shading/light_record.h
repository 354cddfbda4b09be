#pragma once
// What the lights of a scene become: plain records that one switch samples. Private to the lights.
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "shading/light_choice.h"
#include "shading/lights.h"
#include "shapes/geometry.h"

namespace cloudrenderer {

enum class EmitterKind : std::uint8_t {
  point,
  spot,
  mapped,  // goniometric, projection
  distant,
  infinite,
  triangle,
  parallelogram,  // by area, or as it is seen (light_flat.cpp)
  disk,           // whole, also elliptic: by area
  sphere,         // whole, not distorted: by the visible cone
  sphere_part,    // clipped or distorted: by the visible cone of the whole sphere in object space
  quadric         // part of a disk, cylinder: by area
};

struct LightMap;

// The smallest thing that is chosen: a light of the scene, or one triangle (or parallelogram) of an
// emissive mesh.
struct Emitter {
  EmitterKind kind = EmitterKind::point;
  bool two_sided = false;
  bool by_solid_angle = false;  // where it is seen large: a rectangle whose light does not depend on the density
  bool outward = true;      // sphere: the outside emits
  bool invisible = false;   // no ray finds it
  bool weighed = false;     // see Emission; else samples of an invisible one have all of the weight
  std::uint32_t index = 0;  // of its spot cone, map, infinite light or quadric
  std::uint32_t picture = kNone;  // of a triangle: its number among those of the lights; `radiance` is the mean then
  // From here to area_pdf flats_of() takes the numbers at once.
  Rgb radiance{0};          // or intensity
  Vec3 position{};          // or centre, or corner
  Vec3 edge0{}, edge1{};    // of triangles and parallelograms; a disk's half axes
  Vec3 axis{};              // unit: normal of the emitting side; towards a distant light
  float area_pdf = 0;       // 1 / area
  float radius2 = 0;        // of the sphere
  void hide(const struct Emission& emission);  // if that one is hidden
};

// What an AreaLightSource says.
struct Emission {
  Rgb radiance{0};
  bool two_sided = false;
  float power = 0;      // pbrt-v4: of each primitive, which shines by radiance * power / (pi * its area * its sides)
  std::uint32_t patches = 0;  // so many primitives are all of a mesh, with as many triangles each; 0: triangles are
  bool invisible = false;  // its alpha is 0 everywhere
  bool only_seen = false;  // before pbrt-v4: of an object, whose shapes light nothing
  bool weighed = false;    // before pbrt-v4 samples of such a light have their weights as if rays could find it
  std::shared_ptr<const LightMap> picture;  // pbrt-v4: the radiance of triangles is `scale` times it, that of others `radiance`
  Rgb scale{1};
};

// A triangle with a picture; uv by its place.
struct EmitterPicture {
  const LightMap* map = nullptr;  // of an Emission
  Rgb scale{1};
  Vec3 corner{}, u{}, v{};  // uv = uv0 + (dot(p - corner, u), dot(p - corner, v))
  Vec2 uv0{};
  Rgb radiance(const Vec3& p) const;
};
// Of corners with an area, and their uvs.
EmitterPicture make_picture(const Emission& emission, float power, const std::array<Vec3, 3>& p, const std::array<Vec2, 3>& uv);

inline void Emitter::hide(const Emission& emission) {
  invisible = emission.invisible;
  weighed = emission.weighed;
}

struct SpotCone {
  glm::mat3 world_to_light{1.f};
  float cos_total = 0,
        cos_start = 0;  // no light outside of the first, all of it inside of the second
  bool smooth = false;  // pbrt-v4's rim
};

struct EmissiveQuadric {
  Quadric quadric;
  bool flip = false;
  glm::mat3 to_world{1.f}, to_object{1.f};
  Vec3 offset{};             // world position of the object's origin
  float inverse_volume = 1;  // 1 / |det to_world|
};

// Whether m keeps angles.
inline bool is_similarity(const glm::mat3& m) {
  const float x = glm::dot(m[0], m[0]), y = glm::dot(m[1], m[1]), z = glm::dot(m[2], m[2]);
  const float tolerance = 1e-5f * x;
  return std::fabs(x - y) < tolerance && std::fabs(x - z) < tolerance &&
         std::fabs(glm::dot(m[0], m[1])) < tolerance &&
         std::fabs(glm::dot(m[0], m[2])) < tolerance && std::fabs(glm::dot(m[1], m[2])) < tolerance;
}

inline float average(const Rgb& c) { return (c.x + c.y + c.z) * (1.f / 3.f); }

// One density for all of a scene's emitters with a point on them: from area to solid angle; 0 seen
// edge-on.
template <class F>
F solid_angle_pdf(F area_pdf, F distance2, F cosine) {
  return lanes::select(cosine > 1e-7f, area_pdf * distance2 / cosine, F(0.f));
}

// The parameter `name` times "scale": finite, or SceneError, and not negative. RGB of a narrow band of wavelengths can be;
// such channels are 0, with a warning.
Rgb light_color(const ParamSet& params, const char* name, const FileLocation& where, Warnings& warnings);

// Primitives of an emissive shape: the first one's number among those of all, and how many.
struct PrimitiveRange {
  std::uint32_t first = 0, count = 0;
};

inline bool can_be_sampled(std::span<const Emission> emissions, std::uint32_t light) {
  return light < emissions.size() && !emissions[light].only_seen;
}

// Of each emissive shape; without primitives where it cannot be sampled.
std::vector<PrimitiveRange> primitive_ranges(const Part& part, std::span<const Emission> emissions);

// By which factor each primitive of a light with a power shines; `ranges` of each emissive shape. Primitives of 0 area do
// not. As in pbrt-v4 the area is that of a quadric in its object space, of a triangle in the world's, and of a bilinear
// patch all that its triangles have.
std::vector<float> power_factors(const Part& part, std::span<const Emission> emissions, std::span<const PrimitiveRange> ranges, std::uint32_t total);

// Of each emissive shape. Looks up all parameters of every AreaLightSource; without `read_maps` pictures are only opened.
std::vector<Emission> read_emissions(const SceneDescription& scene, std::span<const AreaLightId> shape_lights, Warnings& warnings,
                                     bool read_maps);

struct EmitterAndBounds {
  Emitter emitter;
  EmitterBounds bounds;
  EmitterPoints points;
};

// LightSource directives; each looks up all parameters of its kind. Nothing for a light that gives
// no light.
std::optional<EmitterAndBounds> make_point(const LightDesc& desc, Warnings& warnings);
std::optional<EmitterAndBounds> make_spot(const LightDesc& desc, SpotCone& cone, Warnings& warnings);
std::optional<EmitterAndBounds> make_distant(const LightDesc& desc, Warnings& warnings);

// F: one point or eight that ask the same emitter.
template <class F>
MaskOf<F> sample_point(const Emitter& e, const Vec3Of<F>& p, LightSampleOf<F>& out);
template <class F>
MaskOf<F> sample_spot(const Emitter& e, const SpotCone& cone, const Vec3Of<F>& p, LightSampleOf<F>& out);
template <class F>
MaskOf<F> sample_distant(const Emitter& e, LightSampleOf<F>& out);

// Corner and two edges; `normal` is the emitting side. Nothing where the area is no positive
// number.
std::optional<EmitterAndBounds> make_flat(EmitterKind kind, const Vec3& corner, const Vec3& edge0,
                                          const Vec3& edge1, const Vec3& normal,
                                          const Rgb& radiance, bool two_sided);
// Two triangles that share an edge and together are a parallelogram: most rectangular lights are given so.
bool parallelogram(const std::array<Vec3, 3>& a, const std::array<Vec3, 3>& b, Vec3& corner, Vec3& edge0, Vec3& edge1);
inline bool is_flat(const Emitter& e) {
  return e.kind == EmitterKind::triangle || e.kind == EmitterKind::parallelogram || e.kind == EmitterKind::disk;
}
// Flat emitters as they are sampled: one, the same for eight points, or one for each.
template <class F>
struct FlatOf {
  Vec3Of<F> radiance, position, edge0, edge1, axis;
  F area_pdf;
  MaskOf<F> two_sided, triangle, disk, by_solid_angle;  // the last: where it is seen large
};
template <class F>
FlatOf<F> flat_of(const Emitter& e);
FlatOf<Float8> flats_of(const std::array<const Emitter*, kLanes>& emitters);
template <class F>
MaskOf<F> sample_flat(const FlatOf<F>& e, const Vec3Of<F>& p, const Vec2Of<F>& u, LightSampleOf<F>& out);
// By solid angle, of a point of it at the distance t.
float flat_pdf(const Emitter& e, const Vec3& p, const Vec3& direction, float t);

// Nothing for kinds that cannot be sampled.
std::optional<EmitterAndBounds> make_quadric(const Quadric& q, bool flip, const Rgb& radiance,
                                             bool two_sided, EmissiveQuadric& record);
template <class F>
MaskOf<F> sample_sphere(const Emitter& e, const Vec3Of<F>& p, const Vec2Of<F>& u, LightSampleOf<F>& out);
float sphere_pdf(const Emitter& e, const Vec3& p);
bool sample_sphere_part(const Emitter& e, const EmissiveQuadric& q, const Vec3& p, const Vec2& u,
                        LightSample& out);
float sphere_part_pdf(const EmissiveQuadric& q, const Vec3& p, const Vec3& direction);
bool sample_quadric(const Emitter& e, const EmissiveQuadric& q, const Vec3& p, const Vec2& u,
                    LightSample& out);
inline float quadric_pdf(const EmissiveQuadric& q, const Vec3& direction, float t,
                         const Vec3& normal) {
  return solid_angle_pdf(area_pdf(q.quadric, normal), t * t,
                         std::fabs(glm::dot(normal, direction)));
}

}  // namespace cloudrenderer
