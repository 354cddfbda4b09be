#include "parts/part_map.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "base/lanes.h"

namespace cloudrenderer {
namespace {

using Lanes = PartMapLanes;
constexpr std::uint32_t kPartBit = 0x80000000u;
constexpr float kLargest = std::numeric_limits<float>::max();
// What a coordinate of a hit may be off by, relative to the largest number that went into it: a few
// roundings of the box, of the ray's origin and of the tracer's own hit distance.
constexpr float kSlack = 0x1p-20f;
constexpr float kEarlier = 1.f - 0x1p-20f;  // the same for the distance along the ray

Bounds3 widened(const Bounds3& b) {
  if (b.empty()) return {};
  const Vec3 e = kSlack * glm::max(glm::abs(b.min), glm::abs(b.max)) + 1e-30f;
  return {glm::max(b.min - e, Vec3(-kLargest)), glm::min(b.max + e, Vec3(kLargest))};
}

inline float smallest(Lanes v) {
  const auto less = [](const Lanes& x, const Lanes& y) { return x < y ? x : y; };
  v = less(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
  v = less(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
  v = less(v, __builtin_shufflevector(v, v, 1, 0, 3, 2, 5, 4, 7, 6));
  return v[0];
}

// A ray made ready for many box tests. Infinite inverses are clamped, so that no product is NaN.
struct SlabRay {
  std::array<float, 3> start, end,
      inverse;  // the origin, widened against the direction and along it
  std::array<bool, 3> up;
  float t_max;

  SlabRay(const Vec3& origin, const Vec3& direction, float t) : t_max(t) {
    for (int a = 0; a < 3; ++a) {
      const auto i = static_cast<std::size_t>(a);
      inverse[i] = std::clamp(1.f / direction[a], -kLargest, kLargest);
      up[i] = inverse[i] >= 0.f;
      const float e = kSlack * std::fabs(origin[a]);
      start[i] = up[i] ? origin[a] + e : origin[a] - e;
      end[i] = up[i] ? origin[a] - e : origin[a] + e;
    }
  }

  // Entry distances of eight boxes, infinite where the ray misses.
  Lanes enter(const Lanes (&min)[3], const Lanes (&max)[3]) const {
    Lanes t0{}, t1 = t_max - Lanes{};
    for (std::size_t a = 0; a < 3; ++a) {
      const Lanes n = ((up[a] ? min[a] : max[a]) - start[a]) * inverse[a];
      const Lanes f = ((up[a] ? max[a] : min[a]) - end[a]) * inverse[a];
      t0 = n > t0 ? n : t0;
      t1 = f < t1 ? f : t1;
    }
    t0 *= kEarlier;
    return t0 <= t1 ? t0 : kInfinity - Lanes{};
  }
};

}  // namespace

PartMap::PartMap(std::span<const PartInfo> parts) : part_count_(parts.size()) {
  std::vector<Entry> all;
  for (std::uint32_t p = 1; p < parts.size(); ++p) {
    Entry whole;
    std::vector<Entry> boxes;
    for (const Bounds3& b : parts[p].boxes) {
      if (b.empty()) continue;
      boxes.push_back({widened(b), 0});
      whole.bounds.extend(boxes.back().bounds);
    }
    if (boxes.empty()) continue;
    whole.child = kPartBit | static_cast<std::uint32_t>(parts_.size());
    PartBoxes pb{p, static_cast<std::uint32_t>(nodes_.size()), 0};
    for (std::size_t i = 0; i < boxes.size(); i += kLanes, ++pb.count)
      add_node(std::span(boxes).subspan(i, std::min<std::size_t>(kLanes, boxes.size() - i)));
    parts_.push_back(pb);
    all.push_back(whole);
  }
  if (!all.empty()) root_ = build(all);
}

std::uint32_t PartMap::add_node(std::span<const Entry> entries) {
  Node node;
  for (std::uint32_t i = 0; i < kLanes; ++i) {
    const Entry e = i < entries.size() ? entries[i] : Entry{};
    for (int a = 0; a < 3; ++a) {
      node.min[a][i] = e.bounds.min[a];
      node.max[a][i] = e.bounds.max[a];
    }
    node.child[i] = e.child;
  }
  nodes_.push_back(node);
  return static_cast<std::uint32_t>(nodes_.size() - 1);
}

// Up to eight groups of neighbours, by halving the largest group at the median of its longest axis.
std::uint32_t PartMap::build(std::span<Entry> entries) {
  if (entries.size() <= kLanes) return add_node(entries);
  std::vector<std::span<Entry>> groups{entries};
  while (groups.size() < kLanes) {
    const auto largest = std::max_element(groups.begin(), groups.end(),
                                          [](auto a, auto b) { return a.size() < b.size(); });
    const std::span<Entry> group = *largest;
    if (group.size() < 2) break;
    Bounds3 centers;
    for (const Entry& e : group) centers.extend(e.bounds.center());
    const Vec3 d = centers.diagonal();
    const int axis = d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2;
    const std::size_t half = group.size() / 2;
    std::nth_element(group.begin(), group.begin() + static_cast<std::ptrdiff_t>(half), group.end(),
                     [axis](const Entry& a, const Entry& b) {
                       const float ca = a.bounds.center()[axis], cb = b.bounds.center()[axis];
                       return ca != cb ? ca < cb : a.child < b.child;
                     });
    *largest = group.first(half);
    groups.push_back(group.subspan(half));
  }
  std::vector<Entry> children;
  for (const std::span<Entry> group : groups) {
    Entry e;
    for (const Entry& member : group) e.bounds.extend(member.bounds);
    e.child = group.size() == 1 ? group[0].child : build(group);
    children.push_back(e);
  }
  return add_node(children);
}

std::size_t PartMap::candidates(const Vec3& origin, const Vec3& direction, float t_max,
                                std::span<Candidate> out) const {
  // Such a ray is never traced; here it would make NaNs.
  const auto bounded = [](const Vec3& v) {
    return max_component(glm::abs(v)) <= 1e18f && is_finite(v);
  };
  if (root_ == kNone || !bounded(origin) || !bounded(direction)) return 0;
  const SlabRay ray(origin, direction, t_max);
  std::size_t found = 0;
  const auto insert = [&](Candidate c) {
    std::size_t i = std::min(found, out.size());
    if (i == out.size()) {
      ++found;
      if (i == 0) return;
      --i;  // the farthest falls out, if the new one is nearer
      if (c.t_enter > out[i].t_enter || (c.t_enter == out[i].t_enter && c.part > out[i].part))
        return;
    } else {
      ++found;
    }
    for (; i > 0 && (c.t_enter < out[i - 1].t_enter ||
                     (c.t_enter == out[i - 1].t_enter && c.part < out[i - 1].part));
         --i)
      out[i] = out[i - 1];
    out[i] = c;
  };

  std::array<std::uint32_t, 96> stack;  // 8^12 parts deep: groups are halves of halves
  std::size_t depth = 0;
  stack[depth++] = root_;
  while (depth > 0) {
    const Node& node = nodes_[stack[--depth]];
    const Lanes t = ray.enter(node.min, node.max);
    for (std::uint32_t hit = lanes::to_bits(Mask8::of(t < kInfinity)); hit; hit &= hit - 1) {
      const std::uint32_t child = node.child[std::countr_zero(hit)];
      if (!(child & kPartBit)) {
        stack[depth++] = child;
        continue;
      }
      const PartBoxes& part = parts_[child & ~kPartBit];
      float nearest = kInfinity;
      for (std::uint32_t n = 0; n < part.count; ++n) {
        const Node& boxes = nodes_[part.first + n];
        nearest = std::min(nearest, smallest(ray.enter(boxes.min, boxes.max)));
      }
      if (nearest != kInfinity) insert({part.part, nearest});
    }
  }
  return found;
}

}  // namespace cloudrenderer
