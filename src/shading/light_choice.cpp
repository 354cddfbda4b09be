#include "shading/light_choice.h"

#include <algorithm>
#include <cmath>

namespace cloudrenderer {
namespace {

// What a light below the horizon of the shading normal still gets: bump maps and interpolated
// normals let it count.
constexpr float kBelowHorizon = 0.05f;
// Keeps sums finite next to a point light.
constexpr float kLargest = 1e30f;
// Points of an emitter that are nearer than this part of its squared radius count as if they were there.
constexpr float kNear2 = 0.1f;

template <class F>
F sine(F cosine) {
  return lanes::sqrt(lanes::max(0.f, 1.f - cosine * cosine));
}

// cos(max(0, a - b)) from the cosines and sines of two angles in [0, pi].
template <class F>
F cos_difference(F cos_a, F sin_a, F cos_b, F sin_b) {
  return lanes::select(cos_a > cos_b, F(1.f), cos_a * cos_b + sin_a * sin_b);
}

template <class F>
F clamp(F x, float low, float high) {
  return lanes::min(lanes::max(x, low), high);
}

}  // namespace

template <class F>
F importance(const EmitterBounds& b, const Vec3Of<F>& p, const Vec3Of<F>& n) {
  using lanes::select, lanes::min, lanes::max;
  const MaskOf<F> side = !lanes::is_black(n);
  if (b.shape == EmitterShape::everywhere) return b.strength;
  if (b.shape == EmitterShape::distant)
    return select(side, b.strength * max(glm::dot(n, Vec3Of<F>(b.axis)), kBelowHorizon), F(b.strength));

  const Vec3Of<F> w = Vec3Of<F>(b.center) - p;
  const F d2 = glm::dot(w, w);
  const float r2 = b.radius * b.radius;
  const F inverse = 1.f / lanes::sqrt(max(d2, 1e-30f));
  // The sine of the angle that the bounding sphere may add, as an upper bound: cos(a - b) <= cos a
  // + sin b.
  const F slack = select(d2 > r2, b.radius * inverse, F(1.f));
  // From inside its sphere a single emitter gives at most what it gives at the rim. Of a cluster
  // some are near.
  const float nearest2 = b.shape == EmitterShape::cone ? 0.25f * r2 : r2;
  F value = select(side, b.strength * clamp<F>(glm::dot(n, w) * inverse + slack, kBelowHorizon, 1.f), F(b.strength));
  if (b.shape != EmitterShape::omni) {
    const F c = -glm::dot(Vec3Of<F>(b.axis), w) * inverse;
    switch (b.shape) {
      case EmitterShape::planar:
        value = select(c > 0.f, value * min(1.f, c + slack), F(0.f));
        break;
      case EmitterShape::planar_two_sided:
        value *= min(1.f, lanes::abs(c) + slack);
        break;
      default: {
        if (b.cos_spread <= -1.f) break;
        const F clamped = clamp<F>(c, -1.f, 1.f);
        const F off_spread = cos_difference<F>(clamped, sine(clamped), b.cos_spread, sine(b.cos_spread));
        const F off = cos_difference<F>(off_spread, sine(off_spread), lanes::sqrt(max(0.f, 1.f - slack * slack)), slack);
        const F cone = select(off + 1e-5f < b.cos_emission, F(0.f), value * clamp<F>(off, 0.01f, 1.f));
        value = select(slack >= 1.f, value, cone);
      }
    }
  }
  return min(value / max(max(d2, nearest2), 1e-30f), kLargest);
}
template float importance<float>(const EmitterBounds&, const Vec3&, const Vec3&);
template Float8 importance<Float8>(const EmitterBounds&, const Vec3x8&, const Vec3x8&);

// The mean of what its points give, where there are some, and a tenth of the bound: between the points more may be seen of it, and bump
// maps turn the normal.
template <class F>
F LightChoice::weight_of(const Item& item, const Vec3Of<F>& p, const Vec3Of<F>& n) {
  using lanes::select, lanes::max;
  const EmitterBounds& b = item.bounds;
  const F bound = importance<F>(b, p, n);
  if (item.points.count == 0) return bound;
  const MaskOf<F> side = !lanes::is_black(n);
  const bool two_sided = b.shape == EmitterShape::planar_two_sided;
  F sum = 0.f;
  for (std::uint32_t i = 0; i < item.points.count; ++i) {
    const Vec3Of<F> w = Vec3Of<F>(item.points.at[i]) - p;
    const F d2 = max(glm::dot(w, w), std::max(kNear2 * b.radius * b.radius, 1e-30f)), c = -glm::dot(Vec3Of<F>(b.axis), w);
    const F emitted = two_sided ? lanes::abs(c) : max(0.f, c), received = select(side, max(0.f, glm::dot(n, w)), lanes::sqrt(d2));
    const F inverse = 1.f / d2;
    sum += emitted * inverse * (received * inverse);
  }
  return lanes::min(0.1f * bound + sum * (b.strength / static_cast<float>(item.points.count)), kLargest);
}

LightChoice::LightChoice(std::span<const EmitterBounds> emitters, std::span<const EmitterPoints> points)
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
      items_.push_back({b, ItemKind::emitter, i, i < points.size() ? points[i] : EmitterPoints{}});
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
    items_.push_back({tree_.root(), ItemKind::tree, 0, {}});
  }
  if (!strengths.empty()) {
    group_ = Distribution1D(strengths);
    for (const std::uint32_t i : group_emitters_)
      places_[i].item = static_cast<std::uint32_t>(items_.size());
    items_.push_back({group, ItemKind::group, 0, {}});
  }
}

template <class F, std::size_t N>
void LightChoice::sample_many(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& n, F u,
                              std::array<std::int64_t, N>& emitters, F& chance) const {
  using lanes::select;
  std::array<F, kListed> weights;
  F total = 0.f;
  for (std::size_t i = 0; i < items_.size(); ++i) total += weights[i] = weight_of<F>(items_[i], p, n);
  // The item in whose share of the total the number lies; the last one with a share if rounding leads beyond it.
  F rest = u * total, item = -1.f, weight = 1.f;
  MaskOf<F> open = active && total > 0.f;
  for (std::size_t i = 0; i < items_.size(); ++i) {
    const MaskOf<F> possible = open && weights[i] > 0.f, here = possible && rest < weights[i];
    item = select(possible, F(static_cast<float>(i)), item);
    weight = select(possible, weights[i], weight);
    rest = select(possible && !here, rest - weights[i], rest);
    open = open && !here;
  }
  chance = weight / total;
  const F inner = clamp<F>(rest / weight, 0.f, 0.99999994f);
  emitters.fill(-1);
  lanes::for_each(active && item >= 0.f, [&](std::size_t lane) {
    const Item& chosen = items_[static_cast<std::size_t>(lanes::get(item, lane))];
    emitters[lane] = chosen.emitter;
    if (chosen.kind == ItemKind::emitter) return;
    float c = lanes::get(chance, lane);
    emitters[lane] = sample_inside(chosen, lanes::get(p, lane), lanes::get(n, lane), lanes::get(inner, lane), c);
    lanes::put(chance, lane, c);
  });
}
template void LightChoice::sample_many<float, 1>(bool, const Vec3&, const Vec3&, float, std::array<std::int64_t, 1>&,
                                                 float&) const;
template void LightChoice::sample_many<Float8, kLanes>(Mask8, const Vec3x8&, const Vec3x8&, Float8,
                                                       std::array<std::int64_t, kLanes>&, Float8&) const;

std::int64_t LightChoice::sample_inside(const Item& item, const Vec3& p, const Vec3& n, float rest, float& chance) const {
  if (item.kind == ItemKind::tree) {
    const std::int64_t found = tree_.sample(p, n, rest, chance);
    return found < 0 ? found : std::int64_t{tree_emitters_[static_cast<std::size_t>(found)]};
  }
  float density;
  std::size_t cell;
  group_.sample(rest, density, cell);
  chance *= group_.cell_probability(cell);
  return group_emitters_[cell];
}

float LightChoice::chance_many(std::uint32_t emitter, const Vec3& p, const Vec3& n) const {
  const Place& place = places_[emitter];
  float total = 0, own = 0;
  for (std::size_t i = 0; i < items_.size(); ++i) {
    const float w = weight_of<float>(items_[i], p, n);
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
