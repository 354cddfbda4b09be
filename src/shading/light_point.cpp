// LightSource "point", "spot" and "distant": lights that only a light sample finds.
#include "base/portable_math.h"
#include "shading/light_map.h"
#include "shading/light_record.h"

namespace cloudrenderer {
namespace {

Vec3 unit(const LightDesc& desc, const Vec3& v) {
  const float length = glm::length(v);
  if (!(length > 0.f && length < kInfinity))
    throw SceneError{desc.location,
                     "the light needs a direction: `from` and `to` must be different points"};
  return v / length;
}

EmitterBounds bounds_at(const Vec3& position, float strength) {
  EmitterBounds b;
  b.center = position;
  b.strength = strength;
  return b;
}

// A distorting transformation makes another cone: then nothing is ruled out beforehand.
void bound_by_cone(const LightDesc& desc, const Vec3& axis, float cosine, EmitterBounds& out) {
  const glm::mat3 m(desc.light_to_world.matrix());
  const float x = glm::length(m[0]), y = glm::length(m[1]), z = glm::length(m[2]);
  if (!(std::max({x, y, z}) < 1.001f * std::min({x, y, z}))) return;
  out.shape = EmitterShape::cone;
  out.axis = axis;
  out.cos_spread = 1;
  out.cos_emission = std::max(-1.f, cosine - 1e-3f);
}

template <class F>
MaskOf<F> towards(const Vec3& position, const Vec3Of<F>& p, LightSampleOf<F>& out, F& inverse_square) {
  const Vec3Of<F> w = Vec3Of<F>(position) - p;
  const F d2 = glm::dot(w, w);
  out.distance = lanes::sqrt(d2);
  out.wi = w / out.distance;
  inverse_square = 1.f / d2;
  out.pdf = 1;
  out.delta = MaskOf<F>(true);
  return d2 > 1e-30f && d2 < kInfinity;
}

}  // namespace

Rgb light_color(const ParamSet& params, const char* name, const FileLocation& where, Warnings& warnings) {
  const Rgb c = params.rgb(name, Rgb(1.f)) * params.rgb("scale", Rgb(1.f));
  for (const char* samples : {"nsamples", "samples"}) params.integer(samples, 1);
  if (!is_finite(c)) throw SceneError{where, "the light's radiance must be finite"};
  const Rgb shown = glm::max(c, Rgb(0.f));
  if (shown != c) warnings.add(where, std::string("the light's ") + name + " has negative channels in RGB: they are taken as 0");
  return shown;
}

std::optional<EmitterAndBounds> make_point(const LightDesc& desc, Warnings& warnings) {
  EmitterAndBounds out;
  Emitter& e = out.emitter;
  e.radiance = light_color(desc.params, "I", desc.location, warnings);
  // As in pbrt, `from` is added after the transformation.
  e.position = desc.params.point3("from", Vec3(0.f)) + desc.light_to_world.point(Vec3(0.f));
  out.bounds = bounds_at(e.position, average(e.radiance));
  if (!(out.bounds.strength > 0.f)) return std::nullopt;
  return out;
}

template <class F>
MaskOf<F> sample_point(const Emitter& e, const Vec3Of<F>& p, LightSampleOf<F>& out) {
  F inverse_square;
  const MaskOf<F> arrives = towards<F>(e.position, p, out, inverse_square);
  out.radiance = Vec3Of<F>(e.radiance) * inverse_square;
  return arrives;
}
template bool sample_point<float>(const Emitter&, const Vec3&, LightSample&);
template Mask8 sample_point<Float8>(const Emitter&, const Vec3x8&, LightSample8&);

std::optional<EmitterAndBounds> make_spot(const LightDesc& desc, SpotCone& cone, Warnings& warnings) {
  EmitterAndBounds out;
  Emitter& e = out.emitter;
  e.kind = EmitterKind::spot;
  e.radiance = light_color(desc.params, "I", desc.location, warnings);
  const Vec3 from = desc.params.point3("from", Vec3(0.f)),
             to = desc.params.point3("to", Vec3(0, 0, 1));
  const float angle = desc.params.real("coneangle", 30.f),
              delta = desc.params.real("conedeltaangle", 5.f);
  const Vec3 direction = unit(desc, to - from);
  e.position = desc.light_to_world.point(from);
  e.axis = unit(desc, desc.light_to_world.vector(direction));
  // The cone is measured in the light's space, where its axis is z.
  const Frame frame(direction);
  cone.world_to_light = glm::transpose(glm::mat3(frame.s, frame.t, frame.n)) *
                        glm::mat3(desc.light_to_world.inverse_matrix());
  cone.smooth = desc.params.string("falloff", "") == "smoothstep";
  cone.cos_total = portable::cos(angle * (kPi / 180));
  cone.cos_start = portable::cos((angle - delta) * (kPi / 180));

  out.bounds = bounds_at(e.position, average(e.radiance));
  if (!(out.bounds.strength > 0.f)) return std::nullopt;
  bound_by_cone(desc, e.axis, cone.cos_total, out.bounds);
  return out;
}

template <class F>
MaskOf<F> sample_spot(const Emitter& e, const SpotCone& cone, const Vec3Of<F>& p, LightSampleOf<F>& out) {
  F inverse_square;
  const MaskOf<F> apart = towards<F>(e.position, p, out, inverse_square);
  if (!lanes::any(apart)) return apart;
  const glm::mat3& m = cone.world_to_light;
  const Vec3Of<F> local = Vec3Of<F>(m[0]) * -out.wi.x + Vec3Of<F>(m[1]) * -out.wi.y + Vec3Of<F>(m[2]) * -out.wi.z;
  const F cosine = local.z / lanes::sqrt(glm::dot(local, local));
  // pbrt-v2 and v3: the fourth power
  const F t = (cosine - cone.cos_total) / (cone.cos_start - cone.cos_total);
  const F falloff = lanes::select(cosine <= cone.cos_start, cone.smooth ? t * t * (3.f - 2.f * t) : (t * t) * (t * t), F(1.f));
  out.radiance = Vec3Of<F>(e.radiance) * (falloff * inverse_square);
  return apart && cosine >= cone.cos_total && falloff > 0.f;
}
template bool sample_spot<float>(const Emitter&, const SpotCone&, const Vec3&, LightSample&);
template Mask8 sample_spot<Float8>(const Emitter&, const SpotCone&, const Vec3x8&, LightSample8&);

std::optional<EmitterAndBounds> make_mapped(const LightDesc& desc, const DirectionalMap& map, Warnings& warnings) {
  EmitterAndBounds out;
  Emitter& e = out.emitter;
  e.kind = EmitterKind::mapped;
  e.radiance = light_color(desc.params, "I", desc.location, warnings);
  e.position = desc.light_to_world.point(Vec3(0.f));
  out.bounds = bounds_at(e.position, average(e.radiance * map.largest()));
  if (!(out.bounds.strength > 0.f)) return std::nullopt;
  if (const float cosine = map.cos_widest(); cosine > 0.f)
    bound_by_cone(desc, unit(desc, desc.light_to_world.vector({0, 0, 1})), cosine, out.bounds);
  return out;
}

bool sample_mapped(const Emitter& e, const DirectionalMap& map, const Vec3& p, LightSample& out) {
  float inverse_square;
  if (!towards<float>(e.position, p, out, inverse_square)) return false;
  out.radiance = e.radiance * map.factor(-out.wi) * inverse_square;
  return !is_black(out.radiance);
}

std::optional<EmitterAndBounds> make_distant(const LightDesc& desc, Warnings& warnings) {
  EmitterAndBounds out;
  Emitter& e = out.emitter;
  e.kind = EmitterKind::distant;
  e.radiance = light_color(desc.params, "L", desc.location, warnings);
  const Vec3 from = desc.params.point3("from", Vec3(0.f)),
             to = desc.params.point3("to", Vec3(0, 0, 1));
  e.axis = unit(desc, desc.light_to_world.vector(from - to));
  out.bounds.shape = EmitterShape::distant;
  out.bounds.axis = e.axis;
  out.bounds.strength = average(e.radiance);
  if (!(out.bounds.strength > 0.f)) return std::nullopt;
  return out;
}

template <class F>
MaskOf<F> sample_distant(const Emitter& e, LightSampleOf<F>& out) {
  out.wi = Vec3Of<F>(e.axis);
  out.distance = kInfinity;
  out.radiance = Vec3Of<F>(e.radiance);
  out.pdf = 1;
  out.delta = MaskOf<F>(true);
  return MaskOf<F>(true);
}
template bool sample_distant<float>(const Emitter&, LightSample&);
template Mask8 sample_distant<Float8>(const Emitter&, LightSample8&);

}  // namespace cloudrenderer
