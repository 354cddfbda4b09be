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
                     std::span<const MotionRecord> motions, const GridSpool::View& grids, std::uint64_t memory)
    : view_(view),
      instances_(instances),
      motions_(motions),
      grids_(grids),
      chunk_triangles_(static_cast<std::size_t>(
          std::clamp<std::uint64_t>(memory / kWorkBytes, 1024, std::uint64_t{1} << 21))) {}

float PartMaker::cost(const Item& item) const {
  if (item.source == kInstanceItem)
    return static_cast<float>(loaded_bytes::kInstance +
                              loaded_bytes::kMotion * motions_of(motions_, item.primitive).size());
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
      const std::uint32_t n = items[i++].primitive;
      to.add_instance(instances_[n], motions_of(motions_, n));
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
    if (row.curve != kNone) {
      while (end < items.size() && items[end].source == source) ++end;
      add_curve(row, items.subspan(i, end - i), to);
      i = end;
      continue;
    }
    while (end < items.size() && items[end].source == source && end - i < chunk_triangles_) ++end;
    add_triangles(row, items.subspan(i, end - i), to);
    i = end;
  }
}

void PartMaker::add_curve(const ShapeRow& row, std::span<const Item> items, PartBuilder& to) {
  const SpooledCurve& curve = view_.curves[row.curve];
  CurveGroup group;
  group.object_to_world = curve.object_to_world;
  group.kind = static_cast<std::uint32_t>(curve.kind);
  group.placed = curve.object_to_world.is_identity() ? 0 : 1;
  group.log2_segments = curve.log2_segments;
  group.material = row.material;
  group.light = row.light;
  group.alpha_texture = row.alpha_texture;
  group.shadow_alpha_texture = row.shadow_alpha_texture;
  group.flip = row.flip;
  std::vector<std::uint32_t> segments;
  for (std::size_t i = 0; i < items.size();) {
    const std::uint32_t number = items[i].primitive >> curve.log2_segments;
    segments.clear();
    for (; i < items.size() && items[i].primitive >> curve.log2_segments == number; ++i)
      segments.push_back(items[i].primitive - (number << curve.log2_segments));
    const CurvePiece piece = view_.piece(row, number);
    CurveRecord record;
    record.shape = row.shape;
    record.piece = number;
    record.width = piece.width;
    to.add_curve_piece(group, record, piece, segments);
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
