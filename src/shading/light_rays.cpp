#include "shading/light_rays.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"
#include "shapes/surface.h"

namespace cloudrenderer {
namespace {

bool is_shape(EmitterKind kind) { return kind >= EmitterKind::triangle; }

// By solid angle, 1 - cos from 0 to `most`.
Vec3 around(const Vec3& axis, float most, const Vec2& u) {
  const float x = u.x * most, r = std::sqrt(std::max(0.f, x * (2.f - x)));
  float s, c;
  portable::sincos_turn<float>(u.y, s, c);
  return Frame(axis).to_world({r * c, r * s, 1.f - x});
}

float one_minus_cos(const Emitter& e, std::span<const SpotCone> spots) {
  // A light space with other angles than the world's has no cone there.
  if (e.kind != EmitterKind::spot || !is_similarity(spots[e.index].world_to_light)) return 2.f;
  return std::clamp(1.f - spots[e.index].cos_total, 1e-6f, 2.f);
}

}  // namespace

LightRays::LightRays(const EmitterRecords& records, const Bounds3& scene)
    : records_(records), center_(scene.center()), radius_(0.5f * glm::length(scene.diagonal())) {
  if (records.emitters.empty() || !(radius_ < kInfinity)) return;
  std::vector<float> chances;
  double sum = 0;
  for (const Emitter& e : records.emitters) {
    chances.push_back(power(e));
    sum += static_cast<double>(chances.back());
  }
  if (!(sum > 0) || !(sum < 1e30)) {
    std::ranges::fill(chances, 1.f);
    sum = static_cast<double>(chances.size());
  }
  const auto mean = static_cast<float>(sum / static_cast<double>(chances.size()));
  for (float& c : chances) c += mean;
  choice_ = Distribution1D(chances);
  const float disk = kPi * radius_ * radius_;
  infinite_emitters_.resize(records.infinite.size());
  for (std::uint32_t i = 0; i < records.emitters.size(); ++i) {
    const Emitter& e = records.emitters[i];
    const float chance = choice_.cell_probability(i), sides = e.two_sided ? 2.f : 1.f;
    if (e.kind == EmitterKind::infinite) infinite_emitters_[e.index] = i;
    even_.push_back(is_shape(e.kind) ? chance / (kPi * sides * area(e))
                    : e.kind == EmitterKind::distant || e.kind == EmitterKind::infinite ? chance / disk
                                                                                        : chance / (2 * kPi * one_minus_cos(e, records_.spots)));
    if (!(even_.back() < kInfinity)) even_.back() = 0;
  }
}

float LightRays::area(const Emitter& e) const {
  const bool flat = e.kind == EmitterKind::triangle || e.kind == EmitterKind::parallelogram;
  return flat ? 1.f / e.area_pdf : surface_area(records_.quadrics[e.index].quadric);
}

float LightRays::power(const Emitter& e) const {
  const float strength = average(e.radiance);
  switch (e.kind) {
    case EmitterKind::point:
    case EmitterKind::mapped:
      return 4 * kPi * strength;
    case EmitterKind::spot:
      return 2 * kPi * one_minus_cos(e, records_.spots) * strength;
    case EmitterKind::distant:
      return kPi * radius_ * radius_ * strength;
    case EmitterKind::infinite:
      return 4 * kPi * kPi * radius_ * radius_ * average(records_.infinite[e.index].mean());
    default:
      return kPi * strength * area(e) * (e.two_sided ? 2.f : 1.f);
  }
}

bool LightRays::emit(float u_light, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const {
  if (choice_.size() == 0) return false;
  float pdf;
  std::size_t number;
  (void)choice_.sample(u_light, pdf, number);
  const Emitter& e = records_.emitters[number];
  const bool made = is_shape(e.kind) ? emit_from_shape(e, u_point, u_direction, out)
                    : e.kind == EmitterKind::distant || e.kind == EmitterKind::infinite
                        ? emit_from_outside(e, u_point, u_direction, out)
                        : emit_from_point(e, u_direction, out);
  if (!made) return false;
  out.weight /= choice_.cell_probability(number);
  out.emitter = static_cast<std::uint32_t>(number);
  out.found = (is_shape(e.kind) || e.kind == EmitterKind::infinite) && !e.invisible;
  return !is_black(out.weight) && is_finite(out.weight);
}

bool LightRays::emit_from_shape(const Emitter& e, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const {
  Vec3 p, n;
  float area_pdf = e.area_pdf;
  if (e.kind == EmitterKind::triangle || e.kind == EmitterKind::parallelogram) {
    const Vec2 b = e.kind == EmitterKind::triangle ? sample_triangle<float>(u_point) : u_point;
    p = e.position + e.edge0 * b.x + e.edge1 * b.y;
    n = e.axis;
  } else {
    const EmissiveQuadric& q = records_.quadrics[e.index];
    if (!sample_area(q.quadric, q.flip, u_point, p, n, area_pdf)) return false;
  }
  if (!(area_pdf > 0.f && area_pdf < kInfinity)) return false;
  // Of the two sides each has half of the numbers.
  Vec2 u = u_direction;
  const float sides = e.two_sided ? 2.f : 1.f;
  if (e.two_sided) {
    if (u.x < 0.5f) n = -n;
    u.x = std::min(u.x < 0.5f ? 2.f * u.x : 2.f * u.x - 1.f, 0x1.fffffep-1f);
  }
  out.direction = Frame(n).to_world(sample_cosine_hemisphere(u));
  // Points by formula are within a few ulps of where rays find the shape.
  constexpr float kError = 0x1p-20f;
  const Vec3 size = glm::abs(p) + glm::abs(e.position) + glm::abs(e.edge0) + glm::abs(e.edge1);
  out.origin = ray_start(p, ray_offset(p, size * kError, n), n, out.direction);
  out.weight = e.radiance * (kPi * sides / area_pdf);
  out.normal = n;
  return true;
}

bool LightRays::emit_from_point(const Emitter& e, const Vec2& u_direction, LightRay& out) const {
  const float spread = one_minus_cos(e, records_.spots);
  out.origin = e.position;
  out.direction = around(spread < 2.f ? e.axis : Vec3(0, 0, 1), spread, u_direction);
  LightSample seen;  // from a unit away
  const Vec3 p = e.position + out.direction;
  if (e.kind == EmitterKind::mapped) {
    seen.radiance = e.radiance * records_.maps[e.index].factor(out.direction);
  } else if (e.kind == EmitterKind::spot) {
    if (!sample_spot<float>(e, records_.spots[e.index], p, seen)) return false;
    seen.radiance *= glm::dot(p - e.position, p - e.position);
  } else {
    seen.radiance = e.radiance;
  }
  out.weight = seen.radiance * (2 * kPi * spread);
  return true;
}

bool LightRays::emit_from_outside(const Emitter& e, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const {
  const float disk = kPi * radius_ * radius_;
  Vec3 towards = e.axis;
  if (e.kind == EmitterKind::infinite) {
    float pdf;
    Rgb radiance;
    if (!records_.infinite[e.index].sample<float>(true, Vec3(0.f), u_direction, towards, pdf, radiance) || !(pdf > 0.f)) return false;
    out.weight = radiance * (disk / pdf);
  } else {
    out.weight = e.radiance * disk;
  }
  const Vec2 at = radius_ * sample_disk<float>(u_point);
  const Frame frame(towards);
  out.direction = -towards;
  out.origin = center_ + frame.to_world({at.x, at.y, 1.01f * radius_});
  return true;
}

float LightRays::emission(std::uint32_t emitter, const Vec3& wi, float distance) const {
  if (choice_.size() == 0) return 0.f;
  const Emitter& e = records_.emitters[emitter];
  if (e.kind == EmitterKind::infinite) return infinite_emission(wi);
  return is_shape(e.kind) || e.kind == EmitterKind::distant ? even_[emitter] : even_[emitter] / (distance * distance);
}

float LightRays::infinite_emission(const Vec3& direction) const {
  float sum = 0;
  for (std::size_t i = 0; i < infinite_emitters_.size(); ++i) {
    float pdf;
    (void)records_.infinite[i].radiance_and_pdf<float>(true, Vec3(0.f), direction, pdf);
    sum += even_[infinite_emitters_[i]] * pdf;
  }
  return sum;
}

}  // namespace cloudrenderer
