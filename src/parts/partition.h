#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// One thing that can be put into a part: a triangle, a quadric or an instance. Stored in temporary
// files.
struct Item {
  Bounds3 box;
  std::uint32_t source = 0;     // row of the table of shapes; kInstanceItem: an instance; kBrickItem: a brick
  std::uint32_t primitive = 0;  // triangle of the shape, or number of the instance or brick
};
static_assert(sizeof(Item) == 32);
inline constexpr std::uint32_t kInstanceItem = 0xffffffffu, kBrickItem = 0xfffffffeu;

// Predicted loaded bytes of an item.
using ItemCost = std::function<float(const Item&)>;

// Divides items into runs that are compact in space and about `capacity` bytes each, by binned cuts
// at box centres chosen by the surface area heuristic. Works in place with a fixed amount of
// memory: the items may be a mapped file of any size. `fits` gets each run of at most `capacity`
// predicted bytes, may reorder it, and says whether it is accepted; a refused run of more than one
// item is cut again.
void partition(std::span<Item> items, const ItemCost& cost, double capacity,
               const std::function<bool(std::span<Item>)>& fits);

// Four to eight boxes (fewer for fewer items) that hold all items' boxes: the top of a bounding
// volume hierarchy over them. May reorder the items.
std::vector<Bounds3> tight_boxes(std::span<Item> items);

}  // namespace cloudrenderer
