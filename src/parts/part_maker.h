#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "parts/grid_spool.h"
#include "parts/part_builder.h"
#include "parts/partition.h"
#include "parts/spool.h"

namespace cloudrenderer {

// Turns items into the chunks, quadrics and instances of a part: one chunk a shape (several for
// millions of triangles), each vertex that they use once, with its bits as they are.
class PartMaker {
 public:
  // `memory`: bytes that making one chunk may use.
  PartMaker(const Spool::View& view, std::span<const InstanceRecord> instances, std::span<const MotionRecord> motions,
            const GridSpool::View& grids, std::uint64_t memory);

  // Sorts the items by shape and primitive and adds them.
  void add(std::span<Item> items, PartBuilder& to);
  // The items of a shape, in the order of its triangles; those that are not finite are left out.
  template <class Sink>
  void items_of(std::uint32_t row, const Sink& sink) const {
    const ShapeRow& r = view_.rows[row];
    if (r.quadric != kNone) return sink(Item{r.box, row, 0});
    if (r.curve != kNone) {
      for (std::uint64_t i = 0; i < r.triangle_count; ++i) {
        Item item{{}, row, static_cast<std::uint32_t>(i)};
        if (view_.curve_box(r, item.primitive, item.box)) sink(item);
      }
      return;
    }
    const auto positions = view_.positions.subspan(static_cast<std::size_t>(r.first_vertex));
    for (std::uint64_t i = 0; i < r.triangle_count; ++i) {
      Item item{{}, row, static_cast<std::uint32_t>(i)};
      if (triangle_box(positions, view_.triangles[static_cast<std::size_t>(r.first_triangle + i)],
                       item.box))
        sink(item);
    }
  }
  float cost(const Item& item) const;

 private:
  void add_curve(const ShapeRow& row, std::span<const Item> items, PartBuilder& to);
  void add_triangles(const ShapeRow& row, std::span<const Item> items, PartBuilder& to);
  void number_vertices();

  Spool::View view_;
  std::span<const InstanceRecord> instances_;
  std::span<const MotionRecord> motions_;  // of all instances
  GridSpool::View grids_;
  std::size_t chunk_triangles_;
  // Of the chunk in work; kept to save allocations.
  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> primitives_, vertices_, number_;
  std::vector<Vec3> positions_, normals_;
  std::vector<Vec2> uvs_;
};

}  // namespace cloudrenderer
