#include "shading/light_rays.h"

#include <algorithm>
#include <cmath>

#include "shapes/surface.h"

namespace cloudrenderer {
namespace {

bool is_shape(EmitterKind kind) { return kind >= EmitterKind::triangle; }

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
  infinite_emitters_.resize(records.infinite.size());
  for (std::uint32_t i = 0; i < records.emitters.size(); ++i) {
    const Emitter& e = records.emitters[i];
    const float chance = choice_.cell_probability(i);
    if (e.kind == EmitterKind::infinite) infinite_emitters_[e.index] = i;
    even_.push_back(is_shape(e.kind) ? chance / area(e) : chance);
    if (!(even_.back() < kInfinity)) even_.back() = 0;
  }
}

void LightRays::aim(std::span<const Bounds3> boxes, float share) {
  aims_ = LightAims(boxes);
  aimed_ = aims_.empty() ? 0.f : share;
}

bool LightRays::is_aimed(float& u) const {
  if (aimed_ == 0.f || aimed_ == 1.f) return aimed_ == 1.f;
  const bool aimed = u < aimed_;
  u = std::min(aimed ? u / aimed_ : (u - aimed_) / (1.f - aimed_), 0x1.fffffep-1f);
  return aimed;
}

float LightRays::across(const Vec3& p, const Vec3& direction, std::size_t chosen) const {
  const float disk = 1.f / (kPi * radius_ * radius_);
  return aimed_ > 0.f ? (1.f - aimed_) * disk + aimed_ * aims_.pdf_across(p, direction, chosen) : disk;
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
  Vec2 u = u_direction;
  const float sides = e.two_sided ? 2.f : 1.f;
  const bool aimed = is_aimed(u.x);
  LightAims::View view;
  if (aimed_ > 0.f) view = aims_.from(p, n, e.two_sided ? -1.f : 0.f);
  if (aimed && view.empty()) return false;
  if (!aimed || !view.choose(u, out.direction)) {
    // Of the two sides each has half of the numbers.
    if (e.two_sided) {
      if (u.x < 0.5f) n = -n;
      u.x = std::min(u.x < 0.5f ? 2.f * u.x : 2.f * u.x - 1.f, 0x1.fffffep-1f);
    }
    out.direction = Frame(n).to_world(sample_cosine_hemisphere(u));
  }
  if (e.two_sided && glm::dot(n, out.direction) < 0.f) n = -n;
  const float cosine = glm::dot(n, out.direction);
  if (!(cosine > 0.f)) return false;
  const float even = cosine / (kPi * sides);
  const float pdf = aimed_ > 0.f ? (1.f - aimed_) * even + aimed_ * view.pdf(out.direction, even) : even;
  // Points by formula are within a few ulps of where rays find the shape.
  constexpr float kError = 0x1p-20f;
  const Vec3 size = glm::abs(p) + glm::abs(e.position) + glm::abs(e.edge0) + glm::abs(e.edge1);
  out.origin = ray_start(p, ray_offset(p, size * kError, n), n, out.direction);
  const Rgb radiance = e.picture == kNone ? e.radiance : records_.pictures[e.picture].radiance(p);
  out.weight = radiance * (cosine / (area_pdf * pdf));
  out.normal = n;
  return true;
}

bool LightRays::emit_from_point(const Emitter& e, const Vec2& u_direction, LightRay& out) const {
  const float spread = one_minus_cos(e, records_.spots), even = 1.f / (2 * kPi * spread);
  const Vec3 axis = spread < 2.f ? e.axis : Vec3(0, 0, 1);
  Vec2 u = u_direction;
  const bool aimed = is_aimed(u.x);
  LightAims::View view;
  if (aimed_ > 0.f) view = aims_.from(e.position, axis, spread <= 1.f ? 1.f - spread : -1.f);
  if (aimed && view.empty()) return false;
  out.origin = e.position;
  if (!aimed || !view.choose(u, out.direction)) out.direction = sample_cone(axis, spread, u);
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
  // Directions beside the cone are dark.
  out.weight = seen.radiance / (aimed_ > 0.f ? (1.f - aimed_) * even + aimed_ * view.pdf(out.direction, even) : even);
  return true;
}

bool LightRays::emit_from_outside(const Emitter& e, const Vec2& u_point, const Vec2& u_direction, LightRay& out) const {
  Vec3 towards = e.axis;
  out.weight = e.radiance;
  if (e.kind == EmitterKind::infinite) {
    float pdf;
    if (!records_.infinite[e.index].sample<float>(true, Vec3(0.f), u_direction, towards, pdf, out.weight) || !(pdf > 0.f)) return false;
    out.weight /= pdf;
  }
  Vec2 u = u_point;
  std::size_t chosen = LightAims::kNoneChosen;
  if (is_aimed(u.x)) {
    out.origin = aims_.choose_across(towards, u, chosen);
  } else {
    const Vec2 at = radius_ * sample_disk<float>(u);
    out.origin = center_ + Frame(towards).to_world({at.x, at.y, 0.f});
  }
  out.weight /= across(out.origin, towards, chosen);
  out.direction = -towards;
  if (e.kind == EmitterKind::infinite)
    if (const auto& portal = records_.infinite[e.index].portal()) return portal->enters(out.origin, towards);
  out.origin += towards * (1.01f * radius_ - glm::dot(out.origin - center_, towards));
  return true;
}

float LightRays::emission(std::uint32_t emitter, const Vec3& p, const Vec3& wi, float distance) const {
  if (choice_.size() == 0) return 0.f;
  const Emitter& e = records_.emitters[emitter];
  if (e.kind == EmitterKind::infinite) return infinite_emission(p, wi);
  if (e.kind == EmitterKind::distant) return even_[emitter] * across(p, wi);
  const bool shape = is_shape(e.kind);
  const float spread = shape ? 0.f : one_minus_cos(e, records_.spots);
  const float even = shape ? 1.f / (kPi * (e.two_sided ? 2.f : 1.f)) : 1.f / (2 * kPi * spread);
  float density = even;
  if (aimed_ > 0.f) {
    // The normal is not known at a sample's point: the cosine counts as a half.
    constexpr float kOverCosine = 2.f;
    const LightAims::View view = aims_.from(p + wi * distance, Vec3(0, 0, 1), -1.f);
    density = (1.f - aimed_) * even + aimed_ * (shape ? kOverCosine : 1.f) * view.pdf(-wi, shape ? even / kOverCosine : even);
  }
  return even_[emitter] * (shape ? density : density / (distance * distance));
}

float LightRays::infinite_emission(const Vec3& p, const Vec3& direction) const {
  float sum = 0;
  for (std::size_t i = 0; i < infinite_emitters_.size(); ++i) {
    float pdf;
    (void)records_.infinite[i].radiance_and_pdf<float>(true, Vec3(0.f), direction, pdf);
    sum += even_[infinite_emitters_[i]] * pdf;
  }
  return sum > 0.f ? sum * across(p, direction) : 0.f;
}

}  // namespace cloudrenderer
