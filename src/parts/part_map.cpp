#include "parts/part_map.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "base/lanes.h"

namespace cloudrenderer {
namespace {

using Lanes = PartMapLanes;
constexpr std::size_t kFewLeaves = 10;  // measured: 12 take 65 ns a ray in a row, 57 as a tree
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

using Four = float __attribute__((vector_size(16)));
using FourBits = int __attribute__((vector_size(16)));
inline Four four(const Vec3& v) { return Four{v.x, v.y, v.z, 0.f}; }
inline Four all_four(float x) { return Four{x, x, x, x}; }
inline Four magnitude(const Four& v) { return reinterpret_cast<Four>(reinterpret_cast<FourBits>(v) & 0x7fffffff); }

// A ray made ready for many box tests, three axes at once. Infinite inverses are clamped, so that no product is NaN.
struct SlabRay {
  Four start, end, inverse;  // the origin, widened against the direction and along it
  std::size_t nearer[3];     // which of a box's bounds comes first along an axis: no branch, it would be guessed wrong
  float t_max;               // finite, so that a box at infinity is not entered

  // False for a ray that is never traced; here it would make NaNs.
  static bool bounded(const Four& o, const Four& d) {
    const FourBits in = (magnitude(o) <= all_four(1e18f)) & (magnitude(d) <= all_four(1e18f));
    return (in[0] & in[1] & in[2]) != 0;
  }
  SlabRay(const Four& o, const Four& d, float t) : t_max(std::min(t, kLargest)) {
    inverse = all_four(1.f) / d;
    inverse = inverse < all_four(-kLargest) ? all_four(-kLargest) : inverse;
    inverse = inverse > all_four(kLargest) ? all_four(kLargest) : inverse;
    const FourBits sign = reinterpret_cast<FourBits>(inverse) & std::numeric_limits<int>::min();
    const Four e = reinterpret_cast<Four>(reinterpret_cast<FourBits>(magnitude(o) * kSlack) | sign);
    start = o + e;
    end = o - e;
    for (int a = 0; a < 3; ++a) nearer[a] = sign[a] == 0 ? 0 : 1;
  }

  // Which of eight boxes the ray enters, and at which distances.
  std::uint32_t enter(const Lanes (&bounds)[2][3], Lanes& t) const {
    Lanes t0{}, t1 = t_max - Lanes{};
    for (std::size_t a = 0; a < 3; ++a) {
      const Lanes n = (bounds[nearer[a]][a] - start[a]) * inverse[a];
      const Lanes f = (bounds[1 - nearer[a]][a] - end[a]) * inverse[a];
      t0 = n > t0 ? n : t0;
      t1 = f < t1 ? f : t1;
    }
    t = t0 * kEarlier;
    return lanes::to_bits(Mask8::of(t <= t1));
  }
};

}  // namespace

PartMap::PartMap(std::span<const PartInfo> parts) : part_count_(parts.size()) {
  std::vector<Entry> level;
  for (std::uint32_t p = 1; p < parts.size(); ++p)
    for (const Bounds3& b : parts[p].boxes)
      if (!b.empty()) level.push_back({widened(b), p});
  if (level.empty()) return;
  do {
    level = group(level);
    if (leaves_ == 0) leaves_ = nodes_.size();
  } while (level.size() > 1);
  root_ = level[0].child;
}

// Nodes of eight neighbours, by cutting across the longest axis where that leaves whole groups, nearest to the middle.
std::vector<PartMap::Entry> PartMap::group(std::span<Entry> entries) {
  std::vector<Entry> out;
  std::vector<std::span<Entry>> todo{entries};
  while (!todo.empty()) {
    const std::span<Entry> some = todo.back();
    todo.pop_back();
    if (some.size() <= kLanes) {
      Entry e;
      for (const Entry& member : some) e.bounds.extend(member.bounds);
      e.child = add_node(some);
      out.push_back(e);
      continue;
    }
    Bounds3 centers;
    for (const Entry& e : some) centers.extend(e.bounds.center());
    const Vec3 d = centers.diagonal();
    const int axis = d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2;
    const std::size_t half = (some.size() + kLanes - 1) / kLanes / 2 * kLanes;
    std::nth_element(some.begin(), some.begin() + static_cast<std::ptrdiff_t>(half), some.end(), [axis](const Entry& a, const Entry& b) {
      const float ca = a.bounds.center()[axis], cb = b.bounds.center()[axis];
      return ca != cb ? ca < cb : a.child < b.child;
    });
    todo.push_back(some.subspan(half));
    todo.push_back(some.first(half));
  }
  return out;
}

std::uint32_t PartMap::add_node(std::span<const Entry> entries) {
  Node node;
  for (std::uint32_t i = 0; i < kLanes; ++i) {
    const Entry e = i < entries.size() ? entries[i] : Entry{};
    for (int a = 0; a < 3; ++a) {
      node.bounds[0][a][i] = e.bounds.min[a];
      node.bounds[1][a][i] = e.bounds.max[a];
    }
    node.child[i] = e.child;
  }
  nodes_.push_back(node);
  return static_cast<std::uint32_t>(nodes_.size() - 1);
}

std::size_t PartMap::candidates(const Vec3& origin, const Vec3& direction, float t_max,
                                std::span<Candidate> out) const {
  const Four o = four(origin), d = four(direction);
  if (root_ == kNone || !SlabRay::bounded(o, d)) return 0;
  const SlabRay ray(o, d, t_max);
  std::size_t found = 0;
  const auto insert = [&](Candidate c) {
    std::size_t i = 0;  // the part's place, if another of its boxes has come already
    while (i < found && out[i].part != c.part) ++i;
    if (i < found) {
      if (c.t_enter >= out[i].t_enter) return;
    } else if (found < out.size()) {
      ++found;
    } else if (i == 0 || c.t_enter > out[i - 1].t_enter || (c.t_enter == out[i - 1].t_enter && c.part > out[i - 1].part)) {
      return;
    } else {
      --i;  // the farthest falls out
    }
    for (; i > 0 && (c.t_enter < out[i - 1].t_enter || (c.t_enter == out[i - 1].t_enter && c.part < out[i - 1].part)); --i)
      out[i] = out[i - 1];
    out[i] = c;
  };

  // Few boxes: all are tested before any answer is looked at, so that no test waits for another.
  if (leaves_ <= kFewLeaves) {
    std::array<Lanes, kFewLeaves> t;
    std::array<std::uint64_t, (kFewLeaves + 7) / 8> inside{};
    for (std::size_t n = 0; n < leaves_; ++n) inside[n / 8] |= std::uint64_t{ray.enter(nodes_[n].bounds, t[n])} << (n % 8 * 8);
    for (std::size_t w = 0; w < inside.size(); ++w)
      for (; inside[w]; inside[w] &= inside[w] - 1) {
        const auto bit = static_cast<std::size_t>(std::countr_zero(inside[w])), n = 8 * w + bit / 8;
        insert({nodes_[n].child[bit % 8], t[n][bit % 8]});
      }
    return found;
  }
  std::array<std::uint32_t, 96> stack;  // seven more a level
  std::size_t depth = 0;
  stack[depth++] = root_;
  while (depth > 0) {
    const std::uint32_t at = stack[--depth];
    const Node& node = nodes_[at];
    Lanes t;
    for (std::uint32_t inside = ray.enter(node.bounds, t); inside; inside &= inside - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(inside));
      if (at < leaves_)
        insert({node.child[i], t[i]});
      else
        stack[depth++] = node.child[i];
    }
  }
  return found;
}

}  // namespace cloudrenderer
