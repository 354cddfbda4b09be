#include "shading/warp_2d.h"

#include <algorithm>
#include <cmath>

namespace cloudrenderer {
namespace {

struct Between {
  std::size_t low, high;
  float share;  // of high
};

Between find(const std::vector<float>& nodes, float x) {
  const auto above = static_cast<std::size_t>(std::upper_bound(nodes.begin(), nodes.end(), x) - nodes.begin());
  if (above == 0) return {0, 0, 0.f};
  if (above == nodes.size()) return {above - 1, above - 1, 0.f};
  return {above - 1, above, (x - nodes[above - 1]) / (nodes[above] - nodes[above - 1])};
}

// The share x of a cell's width up to which a density has the integral `part`, where it goes from a to b: the root of a
// quadratic, in the form without cancellation.
float part_of_cell(float a, float b, float part) {
  const float root = a + std::sqrt(std::max(0.f, a * a + 2.f * part * (b - a)));
  return root > 0.f ? std::clamp(2.f * part / root, 0.f, 1.f) : 0.5f;
}
float cell_integral(float a, float b, float x) { return x * (a + 0.5f * x * (b - a)); }

// The cell of count - 1 that has the integral `wanted`; before(i) is the integral of the first i cells and does not
// fall.
template <class Before>
std::size_t search(std::size_t count, float wanted, Before before) {
  std::size_t low = 0, high = count - 1;
  while (high - low > 1) {
    const std::size_t middle = low + (high - low) / 2;
    (before(middle) <= wanted ? low : high) = middle;
  }
  return low;
}

}  // namespace

SliceMix SliceNodes::at(float first, float second) const {
  const Between a = find(nodes_[0], first), b = find(nodes_[1], second);
  const std::size_t stride = nodes_[1].size();
  SliceMix mix;
  mix.count = 0;
  const auto add = [&](std::size_t slice, float share) {
    if (!(share > 0.f)) return;
    mix.slice[mix.count] = slice;
    mix.share[mix.count++] = share;
  };
  add(a.low * stride + b.low, (1.f - a.share) * (1.f - b.share));
  add(a.low * stride + b.high, (1.f - a.share) * b.share);
  add(a.high * stride + b.low, a.share * (1.f - b.share));
  add(a.high * stride + b.high, a.share * b.share);
  return mix;
}

GridCell grid_cell(const Vec2& p, std::size_t columns, std::size_t rows) {
  const auto place = [](float x, std::size_t nodes, float& rest) {
    const float at = std::clamp(x, 0.f, 1.f) * static_cast<float>(nodes - 1);
    const std::size_t cell = std::min(static_cast<std::size_t>(at), nodes - 2);
    rest = at - static_cast<float>(cell);
    return cell;
  };
  GridCell c;
  c.column = place(p.x, columns, c.x);
  c.row = place(p.y, rows, c.y);
  return c;
}

Warp2D::Warp2D(std::size_t columns, std::size_t rows, std::vector<float> values)
    : columns_(columns), rows_(rows), values_(std::move(values)), along_(values_.size()) {
  const std::size_t slices = values_.size() / (columns * rows);
  rows_before_.resize(slices * rows);
  std::vector<double> along(columns * rows), before(rows);
  for (std::size_t s = 0; s < slices; ++s) {
    float* v = values_.data() + s * columns * rows;
    std::for_each(v, v + columns * rows, [](float& x) { x = std::max(x, 0.f); });
    const auto integrate = [&] {
      double row_before = 0;
      for (std::size_t row = 0; row < rows; ++row) {
        double sum = 0;
        for (std::size_t i = row * columns; i < (row + 1) * columns; ++i) {
          if (i > row * columns) sum += 0.5 * (static_cast<double>(v[i - 1]) + static_cast<double>(v[i]));
          along[i] = sum;
        }
        before[row] = row == 0 ? 0 : before[row - 1] + 0.5 * (row_before + sum);
        row_before = sum;
      }
      return before[rows - 1];
    };
    if (!(integrate() > 0)) {
      std::fill(v, v + columns * rows, 1.f);
      integrate();
    }
    const double cells = static_cast<double>(columns - 1) * static_cast<double>(rows - 1), total = before[rows - 1];
    for (std::size_t i = 0; i < columns * rows; ++i) {
      v[i] = static_cast<float>(static_cast<double>(v[i]) * cells / total);
      along_[s * columns * rows + i] = static_cast<float>(along[i] * static_cast<double>(rows - 1) / total);
    }
    for (std::size_t row = 0; row < rows; ++row) rows_before_[s * rows + row] = static_cast<float>(before[row] / total);
  }
}

float Warp2D::mixed(const std::vector<float>& table, std::size_t at, std::size_t per_slice, const SliceMix& mix) const {
  float sum = 0.f;
  for (std::size_t i = 0; i < mix.count; ++i) sum += mix.share[i] * table[mix.slice[i] * per_slice + at];
  return sum;
}

float Warp2D::row_sum(std::size_t row, const SliceMix& mix) const {
  return mixed(along_, row * columns_ + columns_ - 1, columns_ * rows_, mix);
}

float Warp2D::between(const std::vector<float>& table, const GridCell& c, std::size_t column,
                      const SliceMix& mix) const {
  const std::size_t at = c.row * columns_ + column;
  return (1.f - c.y) * mixed(table, at, columns_ * rows_, mix) +
         c.y * mixed(table, at + columns_, columns_ * rows_, mix);
}

Vec2 Warp2D::sample(const Vec2& u, const SliceMix& mix, float& pdf) const {
  const auto width = static_cast<float>(columns_ - 1), height = static_cast<float>(rows_ - 1);
  const float total = mixed(rows_before_, rows_ - 1, rows_, mix);
  const auto before_row = [&](std::size_t row) { return mixed(rows_before_, row, rows_, mix); };
  GridCell c;
  c.row = search(rows_, u.y * total, before_row);
  c.y = part_of_cell(row_sum(c.row, mix), row_sum(c.row + 1, mix), (u.y * total - before_row(c.row)) * height);
  const auto before_column = [&](std::size_t column) { return between(along_, c, column, mix); };
  const float wanted = u.x * before_column(columns_ - 1);
  c.column = search(columns_, wanted, before_column);
  const float a = between(values_, c, c.column, mix), b = between(values_, c, c.column + 1, mix);
  c.x = part_of_cell(a, b, (wanted - before_column(c.column)) * width);
  pdf = ((1.f - c.x) * a + c.x * b) / total;
  return {(static_cast<float>(c.column) + c.x) / width, (static_cast<float>(c.row) + c.y) / height};
}

Vec2 Warp2D::invert(const Vec2& p, const SliceMix& mix, float& pdf) const {
  const auto width = static_cast<float>(columns_ - 1), height = static_cast<float>(rows_ - 1);
  const GridCell c = grid_cell(p, columns_, rows_);
  const float a = between(values_, c, c.column, mix), b = between(values_, c, c.column + 1, mix);
  const float row = between(along_, c, columns_ - 1, mix), total = mixed(rows_before_, rows_ - 1, rows_, mix);
  const float x = between(along_, c, c.column, mix) + cell_integral(a, b, c.x) / width;
  const float y = mixed(rows_before_, c.row, rows_, mix) +
                  cell_integral(row_sum(c.row, mix), row_sum(c.row + 1, mix), c.y) / height;
  pdf = ((1.f - c.x) * a + c.x * b) / total;
  return {row > 0.f ? std::min(x / row, 1.f) : p.x, std::min(y / total, 1.f)};
}

float Warp2D::pdf(const Vec2& p, const SliceMix& mix) const {
  const GridCell c = grid_cell(p, columns_, rows_);
  return ((1.f - c.x) * between(values_, c, c.column, mix) + c.x * between(values_, c, c.column + 1, mix)) /
         mixed(rows_before_, rows_ - 1, rows_, mix);
}

}  // namespace cloudrenderer
