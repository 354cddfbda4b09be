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

// Eight numbers that are computed together, on any processor (a vector type of GCC and Clang).
using PartMapLanes = float __attribute__((vector_size(32)));

// The boxes of all parts but part 0 (which everyone holds), with a small BVH over them. Immutable; any thread.
class PartMap {
 public:
  explicit PartMap(std::span<const PartInfo> parts);
  std::size_t part_count() const { return part_count_; }  // part 0 included

  // The parts whose boxes the ray enters within [0, t_max], in the order (t_enter, part): a pure
  // function of the ray and the map, the same list for every t_max up to the cut (entries with
  // t_enter > t_max are left out). Returns how many are written: all, or the out.size() nearest.
  // Conservative against rounding.
  std::size_t candidates(const Vec3& origin, const Vec3& direction, float t_max,
                         std::span<Candidate> out) const;

 private:
  static constexpr std::uint32_t kLanes = 8;
  // Eight boxes, tested together: of parts (leaves), or of other nodes. Unused lanes are empty.
  struct Node {
    PartMapLanes bounds[2][3];  // the smallest coordinates, the largest ones
    std::uint32_t child[kLanes];  // a part, or a node
  };
  struct Entry {
    Bounds3 bounds;
    std::uint32_t child = 0;
  };
  std::uint32_t add_node(std::span<const Entry> entries);
  std::vector<Entry> group(std::span<Entry> entries);

  std::vector<Node> nodes_;  // leaves first
  std::size_t leaves_ = 0;
  std::uint32_t root_ = kNone;
  std::size_t part_count_ = 0;
};

}  // namespace cloudrenderer
