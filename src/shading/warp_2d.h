#pragma once
// Functions over the unit square that depend on two more parameters: a grid of values for each pair of the parameters'
// nodes (a slice), linear between the values and between the slices.
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// The slices between which a pair of parameters lies, with their shares (together 1).
struct SliceMix {
  std::size_t count = 1;
  std::array<std::size_t, 4> slice{};
  std::array<float, 4> share{1.f};
};

// The nodes of two parameters; the slices of the second one lie next to each other.
class SliceNodes {
 public:
  SliceNodes() = default;
  SliceNodes(std::vector<float> first, std::vector<float> second) : nodes_{std::move(first), std::move(second)} {}
  // Beyond the first and the last node everything stays as it is there.
  SliceMix at(float first, float second) const;
  std::size_t slices() const { return nodes_[0].size() * nodes_[1].size(); }
  const std::vector<float>& first() const { return nodes_[0]; }
  const std::vector<float>& second() const { return nodes_[1]; }

 private:
  std::array<std::vector<float>, 2> nodes_;  // each rises
};

// Where a point lies in a grid of columns x rows: between column and column + 1, and so the rows.
struct GridCell {
  std::size_t column, row;
  float x, y;  // in [0, 1]
};
GridCell grid_cell(const Vec2& p, std::size_t columns, std::size_t rows);

// Values, row by row, slice by slice. At least two columns and rows.
template <class T>
class GridStack {
 public:
  GridStack() = default;
  GridStack(std::size_t columns, std::size_t rows, std::vector<T> values)
      : columns_(columns), rows_(rows), values_(std::move(values)) {}

  T value(const Vec2& p, const SliceMix& mix) const {
    const GridCell c = grid_cell(p, columns_, rows_);
    T sum(0.f);
    for (std::size_t i = 0; i < mix.count; ++i) {
      const T* low = values_.data() + (mix.slice[i] * rows_ + c.row) * columns_ + c.column;
      const T* high = low + columns_;
      sum += mix.share[i] *
             ((1.f - c.y) * ((1.f - c.x) * low[0] + c.x * low[1]) + c.y * ((1.f - c.x) * high[0] + c.x * high[1]));
    }
    return sum;
  }
  std::uint64_t bytes() const { return values_.size() * sizeof(T); }

 private:
  std::size_t columns_ = 0, rows_ = 0;
  std::vector<T> values_;
};

// The values as densities, and the map of the unit square to itself that has them: y by the sums of the rows, then x by
// the row between two of the grid. Its inverse is exact up to rounding.
class Warp2D {
 public:
  Warp2D() = default;
  // values: finite; below 0 counts as 0, and a slice of nothing else is even.
  Warp2D(std::size_t columns, std::size_t rows, std::vector<float> values);

  Vec2 sample(const Vec2& u, const SliceMix& mix, float& pdf) const;
  Vec2 invert(const Vec2& p, const SliceMix& mix, float& pdf) const;  // the u that gives p
  float pdf(const Vec2& p, const SliceMix& mix) const;
  std::uint64_t bytes() const { return (values_.size() + along_.size() + rows_before_.size()) * sizeof(float); }

 private:
  float mixed(const std::vector<float>& table, std::size_t at, std::size_t per_slice, const SliceMix& mix) const;
  float row_sum(std::size_t row, const SliceMix& mix) const;
  // Of a table like values_, between two rows.
  float between(const std::vector<float>& table, const GridCell& c, std::size_t column, const SliceMix& mix) const;

  std::size_t columns_ = 0, rows_ = 0;
  std::vector<float> values_;       // scaled so that each slice has the integral 1
  std::vector<float> along_;        // the integral of a row from its first column on
  std::vector<float> rows_before_;  // the integral of the rows' sums from the first row on
};

}  // namespace cloudrenderer
