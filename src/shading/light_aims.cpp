#include "shading/light_aims.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"
#include "base/sampling.h"

namespace cloudrenderer {
namespace {

// So that nothing in the box is out of the sphere by rounding.
constexpr float kMargin = 1.001f;

// Whether the line through the centre less `to`, along the unit vector d, meets the sphere, as far as directions in float
// can tell: what was aimed at it does.
bool meets(const Vec3& to, float radius, const Vec3& d) {
  constexpr double kRounding = 5e-7;
  const glm::dvec3 way(to), along(d), across = way - along * (glm::dot(way, along) / glm::dot(along, along));
  const double reach = static_cast<double>(radius) + kRounding * glm::length(way);
  return glm::dot(across, across) <= reach * reach;
}

// Chooses a number below `count` with u, and makes another uniform number of it.
template <class Chance>
std::size_t choose(std::size_t count, const Chance& chance, float& u) {
  std::size_t i = 0;
  while (i + 1 < count && u >= chance(i)) u -= chance(i++);
  u = std::clamp(u / chance(i), 0.f, 0x1.fffffep-1f);
  return i;
}

}  // namespace

Vec3 sample_cone(const Vec3& axis, float most, const Vec2& u) {
  const float x = u.x * most, r = std::sqrt(std::max(0.f, x * (2.f - x)));
  float s, c;
  portable::sincos_turn<float>(u.y, s, c);
  return Frame(axis).to_world({r * c, r * s, 1.f - x});
}

LightAims::LightAims(std::span<const Bounds3> boxes) {
  float largest = 0, sum = 0;
  for (const Bounds3& b : boxes.first(std::min(boxes.size(), kMostSpecularBoxes))) {
    const float radius = kMargin * 0.5f * glm::length(b.diagonal());
    if (!(radius > 0.f && radius < 1e15f)) continue;
    aims_.push_back({b.center(), radius, 0});
    largest = std::max(largest, radius);
  }
  for (Aim& a : aims_) sum += a.chance = (a.radius / largest) * (a.radius / largest);
  for (Aim& a : aims_) a.chance = 0.5f / static_cast<float>(aims_.size()) + 0.5f * a.chance / sum;
}

LightAims::View LightAims::from(const Vec3& p, const Vec3& axis, float cosine) const {
  constexpr float kAllSides = 2.f;
  View v;
  float sum = 0;
  for (const Aim& a : aims_) {
    View::Cone c{a.center - p, a.radius, 0, kAllSides};
    const float d2 = glm::dot(c.to, c.to), sin2 = a.radius * a.radius / d2;
    if (sin2 < 1.f) {
      const float own_cosine = std::sqrt(1.f - sin2);
      c.most = c.chance = sin2 / (1.f + own_cosine);
      // Of the sum of the two angles.
      const float together = cosine * own_cosine - std::sqrt((1.f - cosine * cosine) * sin2);
      if (!(c.most > 0.f) || (cosine > -own_cosine && glm::dot(c.to, axis) < together * std::sqrt(d2))) continue;
    }
    sum += c.chance;
    v.cones_[v.count_++] = c;
  }
  for (std::size_t i = 0; i < v.count_; ++i) {
    float& chance = v.cones_[i].chance;
    chance = 0.5f / static_cast<float>(v.count_) + 0.5f * chance / sum;
  }
  return v;
}

bool LightAims::View::choose(Vec2& u, Vec3& direction) {
  chosen_ = cloudrenderer::choose(count_, [&](std::size_t i) { return cones_[i].chance; }, u.x);
  const Cone& c = cones_[chosen_];
  if (!(c.most > 0.f)) return false;
  direction = sample_cone(glm::normalize(c.to), c.most, u);
  return true;
}

float LightAims::View::pdf(const Vec3& direction, float inside) const {
  float sum = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    const Cone& c = cones_[i];
    if (!(c.most > 0.f))
      sum += c.chance * inside;
    else if (i == chosen_ || (glm::dot(c.to, direction) > 0.f && meets(c.to, c.radius, direction)))
      sum += c.chance / (2 * kPi * c.most);
  }
  return sum;
}

Vec3 LightAims::choose_across(const Vec3& direction, Vec2 u, std::size_t& chosen) const {
  chosen = choose(aims_.size(), [&](std::size_t i) { return aims_[i].chance; }, u.x);
  const Aim& a = aims_[chosen];
  const Vec2 at = a.radius * sample_disk<float>(u);
  return a.center + Frame(direction).to_world({at.x, at.y, 0.f});
}

float LightAims::pdf_across(const Vec3& p, const Vec3& direction, std::size_t chosen) const {
  float sum = 0;
  for (std::size_t i = 0; i < aims_.size(); ++i) {
    const Aim& a = aims_[i];
    if (i == chosen || meets(a.center - p, a.radius, direction)) sum += a.chance / (kPi * a.radius * a.radius);
  }
  return sum;
}

}  // namespace cloudrenderer
