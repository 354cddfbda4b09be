#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "cloudrenderer/math.h"
#include "parts/part.h"

namespace cloudrenderer {

// One part that a ray may hit.
struct Candidate {
  std::uint32_t part;
  float t_enter;  // conservative: never later than the true entry of any of the part's boxes
};

// The boxes of all parts but part 0 (which everyone holds), with a small BVH over them. Immutable; any thread.
class PartMap {
 public:
  explicit PartMap(std::span<const PartInfo> parts);
  std::size_t part_count() const;  // part 0 included

  // The parts whose boxes the ray enters within [0, t_max], in the order (t_enter, part): a pure function of the ray
  // and the map, the same list for every t_max up to the cut (entries with t_enter > t_max are left out).
  // Returns how many there are; at most out.size() nearest are written. Conservative against rounding.
  std::size_t candidates(const Vec3& origin, const Vec3& direction, float t_max, std::span<Candidate> out) const;

 private:
  struct Box {
    Bounds3 bounds;
    std::uint32_t part;
  };
  struct Node {
    Bounds3 bounds;
    std::uint32_t first, count;  // leaf: boxes [first, first + count); inner: count 0, children first, first + 1
  };
  std::vector<Box> boxes_;
  std::vector<Node> nodes_;
  std::size_t part_count_ = 0;
};

}  // namespace cloudrenderer
