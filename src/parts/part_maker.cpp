#include "parts/part_maker.h"

#include <algorithm>
#include <tuple>

namespace cloudrenderer {
namespace {

// What one triangle of a chunk costs while the chunk is made: its entries in the arrays below.
constexpr std::uint64_t kWorkBytes = 256;

template <class T>
void gather(std::vector<T>& out, std::span<const T> from, std::span<const std::uint32_t> which) {
  out.clear();
  for (const std::uint32_t i : which) out.push_back(from[i]);
}

}  // namespace

PartMaker::PartMaker(const Spool::View& view, std::span<const InstanceRecord> instances,
                     const GridSpool::View& grids, std::uint64_t memory)
    : view_(view),
      instances_(instances),
      grids_(grids),
      chunk_triangles_(static_cast<std::size_t>(
          std::clamp<std::uint64_t>(memory / kWorkBytes, 1024, std::uint64_t{1} << 21))) {}

float PartMaker::cost(const Item& item) const {
  if (item.source == kInstanceItem) return static_cast<float>(loaded_bytes::kInstance);
  if (item.source == kBrickItem)
    return static_cast<float>(loaded_bytes::kBrick +
                              sizeof(float) * grids_.bricks[item.primitive].record.sample_count());
  return view_.rows[item.source].item_bytes;
}

void PartMaker::add(std::span<Item> items, PartBuilder& to) {
  std::sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
    return std::tie(a.source, a.primitive) < std::tie(b.source, b.primitive);
  });
  for (std::size_t i = 0; i < items.size();) {
    const std::uint32_t source = items[i].source;
    if (source == kInstanceItem) {
      to.add_instance(instances_[items[i++].primitive]);
      continue;
    }
    if (source == kBrickItem) {
      const SpooledBrick& b = grids_.bricks[items[i++].primitive];
      to.add_brick(b.record, grids_.samples(b));
      continue;
    }
    const ShapeRow& row = view_.rows[source];
    if (row.quadric != kNone) {
      to.add_quadric({view_.quadrics[row.quadric], row.shape, row.material, row.light,
                      row.alpha_texture, row.flip});
      ++i;
      continue;
    }
    std::size_t end = i;
    while (end < items.size() && items[end].source == source && end - i < chunk_triangles_) ++end;
    add_triangles(row, items.subspan(i, end - i), to);
    i = end;
  }
}

void PartMaker::add_triangles(const ShapeRow& row, std::span<const Item> items, PartBuilder& to) {
  triangles_.clear();
  primitives_.clear();
  for (const Item& item : items) {
    triangles_.push_back(
        view_.triangles[static_cast<std::size_t>(row.first_triangle + item.primitive)]);
    primitives_.push_back(item.primitive);
  }
  number_vertices();

  const auto at = [](auto span, std::uint64_t first) {
    return span.subspan(static_cast<std::size_t>(first));
  };
  ChunkData data;
  gather(positions_, at(view_.positions, row.first_vertex), vertices_);
  data.positions = positions_;
  if (row.first_normal != ShapeRow::kNoArray) {
    gather(normals_, at(view_.normals, row.first_normal), vertices_);
    data.normals = normals_;
  }
  if (row.first_uv != ShapeRow::kNoArray) {
    gather(uvs_, at(view_.uvs, row.first_uv), vertices_);
    data.uvs = uvs_;
  }
  data.triangles = triangles_;
  data.primitives = primitives_;
  MeshChunk chunk;
  chunk.shape = row.shape;
  chunk.material = row.material;
  chunk.light = row.light;
  chunk.alpha_texture = row.alpha_texture;
  chunk.shadow_alpha_texture = row.shadow_alpha_texture;
  chunk.flip = row.flip;
  to.add_chunk(chunk, data);
}

// Renumbers the vertices that triangles_ use, in the order of the source, and lists them in
// vertices_.
void PartMaker::number_vertices() {
  std::uint32_t low = kNone, high = 0;
  for (const Triangle& t : triangles_)
    for (int i = 0; i < 3; ++i) {
      low = std::min(low, t[i]);
      high = std::max(high, t[i]);
    }
  vertices_.clear();
  const std::size_t range = std::size_t{high} - low + 1;
  if (range <= 12 * triangles_.size()) {  // a table over the range is small
    number_.assign(range, 0);
    for (const Triangle& t : triangles_)
      for (int i = 0; i < 3; ++i) number_[t[i] - low] = 1;
    for (std::size_t v = 0; v < range; ++v)
      if (number_[v]) {
        number_[v] = static_cast<std::uint32_t>(vertices_.size());
        vertices_.push_back(low + static_cast<std::uint32_t>(v));
      }
    for (Triangle& t : triangles_)
      for (int i = 0; i < 3; ++i) t[i] = number_[t[i] - low];
    return;
  }
  for (const Triangle& t : triangles_)
    for (int i = 0; i < 3; ++i) vertices_.push_back(t[i]);
  std::sort(vertices_.begin(), vertices_.end());
  vertices_.erase(std::unique(vertices_.begin(), vertices_.end()), vertices_.end());
  for (Triangle& t : triangles_)
    for (int i = 0; i < 3; ++i)
      t[i] = static_cast<std::uint32_t>(std::lower_bound(vertices_.begin(), vertices_.end(), t[i]) -
                                        vertices_.begin());
}

}  // namespace cloudrenderer
