#include "shading/light_choice.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cloudrenderer {
namespace {

// What a light below the horizon of the shading normal still gets: bump maps and interpolated
// normals let it count.
constexpr float kBelowHorizon = 0.05f;
// Keeps sums finite next to a point light.
constexpr float kLargest = 1e30f;

float sine(float cosine) { return std::sqrt(std::max(0.f, 1.f - cosine * cosine)); }

// cos(max(0, a - b)) from the cosines and sines of two angles in [0, pi].
float cos_difference(float cos_a, float sin_a, float cos_b, float sin_b) {
  return cos_a > cos_b ? 1.f : cos_a * cos_b + sin_a * sin_b;
}

}  // namespace

float importance(const EmitterBounds& b, const Vec3& p, const Vec3& n) {
  const bool side = n != Vec3(0.f);
  if (b.shape == EmitterShape::everywhere) return b.strength;
  if (b.shape == EmitterShape::distant)
    return side ? b.strength * std::max(glm::dot(n, b.axis), kBelowHorizon) : b.strength;

  const Vec3 w = b.center - p;
  const float d2 = glm::dot(w, w), r2 = b.radius * b.radius;
  const float inverse = 1.f / std::sqrt(std::max(d2, 1e-30f));
  // The sine of the angle that the bounding sphere may add, as an upper bound: cos(a - b) <= cos a
  // + sin b.
  const float slack = d2 > r2 ? b.radius * inverse : 1.f;
  // From inside its sphere a single emitter gives at most what it gives at the rim. Of a cluster
  // some are near.
  const float nearest2 = b.shape == EmitterShape::cone ? 0.25f * r2 : r2;
  float value = b.strength;
  if (side) value *= std::clamp(glm::dot(n, w) * inverse + slack, kBelowHorizon, 1.f);
  if (b.shape != EmitterShape::omni) {
    const float c = -glm::dot(b.axis, w) * inverse;
    switch (b.shape) {
      case EmitterShape::planar:
        if (!(c > 0.f)) return 0.f;
        value *= std::min(1.f, c + slack);
        break;
      case EmitterShape::planar_two_sided:
        value *= std::min(1.f, std::fabs(c) + slack);
        break;
      default: {
        if (slack >= 1.f || b.cos_spread <= -1.f) break;
        const float clamped = std::clamp(c, -1.f, 1.f);
        const float off_spread =
            cos_difference(clamped, sine(clamped), b.cos_spread, sine(b.cos_spread));
        const float off =
            cos_difference(off_spread, sine(off_spread), std::sqrt(1.f - slack * slack), slack);
        if (off + 1e-5f < b.cos_emission) return 0.f;
        value *= std::clamp(off, 0.01f, 1.f);
      }
    }
  }
  return std::min(value / std::max(std::max(d2, nearest2), 1e-30f), kLargest);
}

LightChoice::LightChoice(std::span<const EmitterBounds> emitters)
    : single_(emitters.size() == 1), places_(emitters.size()) {
  const auto at_infinity = [](const EmitterBounds& b) {
    return b.shape == EmitterShape::distant || b.shape == EmitterShape::everywhere;
  };
  const auto unplaced =
      static_cast<std::size_t>(std::count_if(emitters.begin(), emitters.end(), at_infinity));
  const bool list_all = emitters.size() <= kListed;
  const bool list_unplaced = list_all || unplaced < kListed;

  std::vector<EmitterBounds> placed;
  std::vector<float> strengths;
  EmitterBounds group;
  group.shape = EmitterShape::everywhere;
  for (std::uint32_t i = 0; i < emitters.size(); ++i) {
    const EmitterBounds& b = emitters[i];
    if (list_all || (list_unplaced && at_infinity(b))) {
      places_[i].item = static_cast<std::uint32_t>(items_.size());
      items_.push_back({b, ItemKind::emitter, i});
    } else if (at_infinity(b)) {
      places_[i].inside = static_cast<std::uint32_t>(strengths.size());
      strengths.push_back(b.strength);
      group_emitters_.push_back(i);
      group.strength += b.strength;
    } else {
      places_[i].inside = static_cast<std::uint32_t>(placed.size());
      placed.push_back(b);
      tree_emitters_.push_back(i);
    }
  }
  if (!placed.empty()) {
    tree_ = LightTree(placed);
    for (const std::uint32_t i : tree_emitters_)
      places_[i].item = static_cast<std::uint32_t>(items_.size());
    items_.push_back({tree_.root(), ItemKind::tree, 0});
  }
  if (!strengths.empty()) {
    group_ = Distribution1D(strengths);
    for (const std::uint32_t i : group_emitters_)
      places_[i].item = static_cast<std::uint32_t>(items_.size());
    items_.push_back({group, ItemKind::group, 0});
  }
}

std::int64_t LightChoice::sample_many(const Vec3& p, const Vec3& n, float u, float& chance) const {
  std::array<float, kListed> weights;
  float total = 0;
  for (std::size_t i = 0; i < items_.size(); ++i)
    total += weights[i] = importance(items_[i].bounds, p, n);
  if (!(total > 0.f)) return -1;
  float rest = u * total;
  std::size_t chosen = items_.size();
  for (std::size_t i = 0; i < items_.size(); ++i) {
    if (!(weights[i] > 0.f)) continue;
    chosen = i;
    if (rest < weights[i]) break;
    rest -= weights[i];
  }
  const Item& item = items_[chosen];
  chance = weights[chosen] / total;
  if (item.kind == ItemKind::emitter) return item.emitter;

  const float inner = std::clamp(rest / weights[chosen], 0.f, 0.99999994f);
  if (item.kind == ItemKind::tree) {
    const std::int64_t found = tree_.sample(p, n, inner, chance);
    return found < 0 ? found : std::int64_t{tree_emitters_[static_cast<std::size_t>(found)]};
  }
  float density;
  std::size_t cell;
  group_.sample(inner, density, cell);
  chance *= group_.cell_probability(cell);
  return group_emitters_[cell];
}

float LightChoice::chance_many(std::uint32_t emitter, const Vec3& p, const Vec3& n) const {
  const Place& place = places_[emitter];
  float total = 0, own = 0;
  for (std::size_t i = 0; i < items_.size(); ++i) {
    const float w = importance(items_[i].bounds, p, n);
    total += w;
    if (i == place.item) own = w;
  }
  if (!(own > 0.f)) return 0.f;
  const float chosen = own / total;
  switch (items_[place.item].kind) {
    case ItemKind::tree:
      return chosen * tree_.chance(place.inside, p, n);
    case ItemKind::group:
      return chosen * group_.cell_probability(place.inside);
    default:
      return chosen;
  }
}

std::uint64_t LightChoice::bytes() const {
  return items_.size() * sizeof(Item) + places_.size() * sizeof(Place) + tree_.bytes() +
         (tree_emitters_.size() + 3 * group_emitters_.size()) * sizeof(std::uint32_t);
}

}  // namespace cloudrenderer
