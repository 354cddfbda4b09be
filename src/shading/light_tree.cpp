#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "base/portable_math.h"
#include "shading/light_choice.h"

namespace cloudrenderer {
namespace {

// Normals within `spread` of the axis, emission within `emission` of each normal; angles in
// radians.
struct Directions {
  Vec3 axis{0, 0, 1};
  float spread = -1;  // below 0: empty
  float emission = 0;
};

// What an inner node needs to know of what is below it.
struct Cluster {
  Bounds3 box;
  Directions directions;
  float strength = 0;
};

Directions merge(const Directions& x, const Directions& y) {
  if (x.spread < 0) return y;
  if (y.spread < 0) return x;
  const Directions& a = x.spread >= y.spread ? x : y;
  const Directions& b = x.spread >= y.spread ? y : x;
  Directions out{a.axis, a.spread, std::max(a.emission, b.emission)};
  const float cosine = glm::dot(a.axis, b.axis);
  const float between = portable::acos(cosine);
  if (std::min(between + b.spread, kPi) <= a.spread) return out;
  out.spread = (a.spread + between + b.spread) / 2;
  Vec3 tangent = b.axis - cosine * a.axis;
  const float length = glm::length(tangent);
  if (out.spread >= kPi || length < 1e-6f) {
    out.spread = between < 1e-3f ? std::min(kPi, std::max(a.spread, b.spread) + between) : kPi;
    return out;
  }
  tangent /= length;
  float s, c;
  portable::sincos(out.spread - a.spread, s, c);
  out.axis = glm::normalize(c * a.axis + s * tangent);
  out.spread += 1e-4f;  // rounding must not leave a normal outside
  return out;
}

Directions directions_of(const EmitterBounds& b) {
  switch (b.shape) {
    case EmitterShape::planar:
      return {b.axis, 0.f, kPi / 2};
    case EmitterShape::cone:
      return {b.axis, portable::acos(b.cos_spread), portable::acos(b.cos_emission)};
    default:
      return {{0, 0, 1}, kPi, kPi / 2};
  }
}

Bounds3 box_of(const EmitterBounds& b) {
  return {b.center - Vec3(b.radius), b.center + Vec3(b.radius)};
}

Cluster merge(const Cluster& a, const Cluster& b) {
  Cluster out{a.box, merge(a.directions, b.directions), a.strength + b.strength};
  out.box.extend(b.box);
  return out;
}

EmitterBounds bounds_of(const Cluster& c) {
  EmitterBounds out;
  out.center = c.box.center();
  out.radius = 0.5f * glm::length(c.box.diagonal()) * 1.00001f;
  out.axis = c.directions.axis;
  out.strength = c.strength;
  out.shape = EmitterShape::cone;
  out.cos_spread = c.directions.spread >= kPi ? -1.f : portable::cos(c.directions.spread);
  out.cos_emission = c.directions.emission >= kPi ? -1.f : portable::cos(c.directions.emission);
  return out;
}

// The orientation measure of Conty Estevez and Kulla, section 4.1.
float orientation_cost(const Directions& d) {
  const float w = std::min(d.spread + d.emission, kPi);
  float s, c;
  portable::sincos(d.spread, s, c);
  return 2 * kPi * (1 - c) +
         kPi / 2 * (2 * w * s - portable::cos(d.spread - 2 * w) - 2 * d.spread * s + c);
}

float cost(const Cluster& c) {
  const Vec3 d = c.box.diagonal();
  // A flat or empty box still has an extent that tells near from far.
  const float area = c.box.surface_area() + 1e-6f * glm::dot(d, d);
  return c.strength * orientation_cost(c.directions) * area;
}

}  // namespace

struct LightTree::Builder {
  static constexpr int kBuckets = 12;
  static constexpr int kMedianFrom =
      30;  // depth from which halves have equal counts: trails have 64 bits

  LightTree& tree;
  std::span<const EmitterBounds> emitters;
  std::vector<std::uint32_t> order;

  Cluster cluster(std::uint32_t e) const {
    const EmitterBounds& b = emitters[e];
    return {box_of(b), directions_of(b), b.strength};
  }

  // Appends the node of order[begin, end) and everything below it.
  Cluster build(std::size_t begin, std::size_t end, std::uint64_t trail, int depth) {
    const std::size_t at = tree.nodes_.size();
    tree.nodes_.emplace_back();
    if (end - begin == 1) {
      const std::uint32_t e = order[begin];
      tree.nodes_[at] = {emitters[e], e, true};
      tree.trails_[e] = trail;
      return cluster(e);
    }
    const std::size_t middle = split(begin, end, depth);
    const Cluster first = build(begin, middle, trail, depth + 1);
    const auto second_at = static_cast<std::uint32_t>(tree.nodes_.size());
    const Cluster second = build(middle, end, trail | std::uint64_t{1} << depth, depth + 1);
    const Cluster both = merge(first, second);
    tree.nodes_[at] = {bounds_of(both), second_at, false};
    return both;
  }

  std::size_t split(std::size_t begin, std::size_t end, int depth) {
    Bounds3 centers;
    for (std::size_t i = begin; i < end; ++i) centers.extend(emitters[order[i]].center);
    const Vec3 extent = centers.diagonal();
    const float longest = max_component(extent);
    int best_axis = -1, best_bucket = 0;
    float best = kInfinity;
    const auto bucket = [&](std::uint32_t e, int axis) {
      const float x = (emitters[e].center[axis] - centers.min[axis]) / extent[axis];
      return std::clamp(static_cast<int>(x * kBuckets), 0, kBuckets - 1);
    };
    for (int axis = 0; axis < 3 && depth < kMedianFrom; ++axis) {
      if (!(extent[axis] > 0.f)) continue;
      std::array<Cluster, kBuckets> buckets;
      for (std::size_t i = begin; i < end; ++i) {
        Cluster& c = buckets[static_cast<std::size_t>(bucket(order[i], axis))];
        c = merge(c, cluster(order[i]));
      }
      std::array<float, kBuckets> above{};
      Cluster running;
      for (std::size_t i = kBuckets - 1; i > 0; --i) {
        running = merge(running, buckets[i]);
        above[i] = running.directions.spread < 0 ? -1.f : cost(running);
      }
      running = {};
      for (std::size_t i = 0; i + 1 < kBuckets; ++i) {
        running = merge(running, buckets[i]);
        if (running.directions.spread < 0 || above[i + 1] < 0.f) continue;
        // Thin boxes cost more along their long side (the paper's regulariser).
        const float total = (cost(running) + above[i + 1]) * (longest / extent[axis]);
        if (total < best) {
          best = total;
          best_axis = axis;
          best_bucket = static_cast<int>(i);
        }
      }
    }
    const auto from = order.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto to = order.begin() + static_cast<std::ptrdiff_t>(end);
    if (best_axis >= 0) {
      const auto middle = std::stable_partition(
          from, to, [&](std::uint32_t e) { return bucket(e, best_axis) <= best_bucket; });
      return static_cast<std::size_t>(middle - order.begin());
    }
    const auto middle = from + (to - from) / 2;
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0
                     : extent.y >= extent.z                       ? 1
                                                                  : 2;
    std::nth_element(from, middle, to, [&](std::uint32_t a, std::uint32_t b) {
      const float ca = emitters[a].center[axis], cb = emitters[b].center[axis];
      return ca < cb || (ca == cb && a < b);
    });
    return static_cast<std::size_t>(middle - order.begin());
  }
};

LightTree::LightTree(std::span<const EmitterBounds> emitters) : trails_(emitters.size()) {
  if (emitters.empty()) return;
  nodes_.reserve(2 * emitters.size());
  Builder builder{*this, emitters, std::vector<std::uint32_t>(emitters.size())};
  std::iota(builder.order.begin(), builder.order.end(), 0u);
  builder.build(0, emitters.size(), 0, 0);
}

std::int64_t LightTree::sample(const Vec3& p, const Vec3& n, float u, float& chance) const {
  std::uint32_t at = 0;
  while (!nodes_[at].leaf) {
    const std::uint32_t second = nodes_[at].next;
    const float a = importance(nodes_[at + 1].bounds, p, n),
                b = importance(nodes_[second].bounds, p, n);
    if (!(a + b > 0.f)) return -1;
    const float share = a / (a + b);
    if (u < share) {
      u = std::min(u / share, 0.99999994f);
      chance *= share;
      ++at;
    } else {
      const float other = b / (a + b);
      if (!(other > 0.f)) return -1;
      u = std::clamp((u - share) / other, 0.f, 0.99999994f);
      chance *= other;
      at = second;
    }
  }
  return nodes_[at].next;
}

float LightTree::chance(std::uint32_t emitter, const Vec3& p, const Vec3& n) const {
  float out = 1;
  std::uint32_t at = 0;
  for (std::uint64_t trail = trails_[emitter]; !nodes_[at].leaf; trail >>= 1) {
    const std::uint32_t second = nodes_[at].next;
    const float a = importance(nodes_[at + 1].bounds, p, n),
                b = importance(nodes_[second].bounds, p, n);
    if (!(a + b > 0.f)) return 0.f;
    out *= (trail & 1 ? b : a) / (a + b);
    at = trail & 1 ? second : at + 1;
  }
  return out;
}

}  // namespace cloudrenderer
