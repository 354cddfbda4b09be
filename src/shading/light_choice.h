#pragma once
// Which light to sample at a point. Private to the lights.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/lanes.h"
#include "base/sampling.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

enum class EmitterShape : std::uint8_t {
  omni,    // somewhere in the sphere, emits in all directions
  planar,  // flat, emits to the side of axis, by the cosine
  planar_two_sided,
  cone,       // directions within spread + emission of the axis
  distant,    // axis points towards it, everywhere in the scene
  everywhere  // from all directions
};

// Where an emitter (or a group of them) is, where it emits to, and how strongly: enough for an
// estimate of the irradiance that it gives without obstacles, which is never 0 where there is some.
struct EmitterBounds {
  Vec3 center{};
  float radius = 0;
  Vec3 axis{};
  float strength =
      0;  // radiant intensity at its best, mean of the channels; at infinity: irradiance
  float cos_spread = -1;    // cone: half angle that holds the normals ...
  float cos_emission = -1;  // ... and how far each emits off its normal
  EmitterShape shape = EmitterShape::omni;
};

// Points spread evenly over a flat emitter, or none: what it gives as the mean of what they give.
struct EmitterPoints {
  std::array<Vec3, 4> at{};
  std::uint32_t count = 0;
};

// n: see Lights::sample. Zero only if nothing arrives; below the horizon of n a small value is
// left.
template <class F>
F importance(const EmitterBounds& b, const Vec3Of<F>& p, const Vec3Of<F>& n);
inline float importance(const EmitterBounds& b, const Vec3& p, const Vec3& n) { return importance<float>(b, p, n); }

// A binary tree over emitters with a place, followed from the root by the children's importance
// (Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting",
// without the splitting).
class LightTree {
 public:
  LightTree() = default;
  explicit LightTree(std::span<const EmitterBounds> emitters);
  bool empty() const { return nodes_.empty(); }
  const EmitterBounds& root() const { return nodes_.front().bounds; }
  // The number of an emitter, or -1 when nothing arrives; multiplies `chance`.
  std::int64_t sample(const Vec3& p, const Vec3& n, float u, float& chance) const;
  float chance(std::uint32_t emitter, const Vec3& p, const Vec3& n) const;
  std::uint64_t bytes() const {
    return nodes_.size() * sizeof(Node) + trails_.size() * sizeof(std::uint64_t);
  }

 private:
  struct Node {
    EmitterBounds bounds;
    std::uint32_t next =
        0;  // leaf: the emitter; else the second child (the first one follows its parent)
    bool leaf = false;
  };
  struct Builder;
  std::vector<Node> nodes_;
  std::vector<std::uint64_t> trails_;  // of each emitter: bit d is its way at depth d
};

// Up to kListed emitters are weighed one by one, flat ones by some points; beyond that those with a place go into a tree,
// those without (if there are still too many) into one group chosen by strength alone. Pure
// functions of (p, n, u).
class LightChoice {
 public:
  static constexpr std::size_t kListed = 16;

  LightChoice() = default;
  // points: of each emitter; fewer: others have none.
  explicit LightChoice(std::span<const EmitterBounds> emitters, std::span<const EmitterPoints> points = {});
  bool single() const { return single_; }  // there is one emitter, number 0, with chance 1
  // The number of an emitter, or -1 when nothing arrives.
  std::int64_t sample(const Vec3& p, const Vec3& n, float u, float& chance) const {
    if (single_) {
      chance = 1;
      return 0;
    }
    std::array<std::int64_t, 1> emitter;
    sample_many<float>(true, p, n, u, emitter, chance);
    return emitter[0];
  }
  // The same for the `active` ones of eight.
  void sample(Mask8 active, const Vec3x8& p, const Vec3x8& n, Float8 u, std::array<std::int64_t, kLanes>& emitters,
              Float8& chance) const {
    sample_many<Float8>(active, p, n, u, emitters, chance);
  }
  float chance(std::uint32_t emitter, const Vec3& p, const Vec3& n) const {
    return single_ ? 1.f : chance_many(emitter, p, n);
  }
  std::uint64_t bytes() const;

 private:
  enum class ItemKind : std::uint8_t { emitter, tree, group };
  struct Item {
    EmitterBounds bounds;
    ItemKind kind = ItemKind::emitter;
    std::uint32_t emitter = 0;
    EmitterPoints points;
  };
  template <class F>
  static F weight_of(const Item& item, const Vec3Of<F>& p, const Vec3Of<F>& n);
  struct Place {
    std::uint32_t item = 0, inside = 0;  // number of the item, and inside of the tree or group
  };
  template <class F, std::size_t N>
  void sample_many(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& n, F u, std::array<std::int64_t, N>& emitters,
                   F& chance) const;
  // Of an item that stands for several, which `rest` (in [0, 1)) chooses among; multiplies `chance`.
  std::int64_t sample_inside(const Item& item, const Vec3& p, const Vec3& n, float rest, float& chance) const;
  float chance_many(std::uint32_t emitter, const Vec3& p, const Vec3& n) const;

  bool single_ = false;
  std::vector<Item> items_;    // at most kListed
  std::vector<Place> places_;  // of each emitter
  LightTree tree_;
  std::vector<std::uint32_t> tree_emitters_, group_emitters_;
  Distribution1D group_;
};

}  // namespace cloudrenderer
