#include "base/sampling.h"

#include <array>
#include <bit>

namespace cloudrenderer {

Distribution1D::Distribution1D(std::span<const float> values) : size_(values.size()), cdf_(values.size() + 1 + kLanes, 2.f) {
  const std::size_t n = values.size();
  double sum = 0;
  for (const float v : values) sum += static_cast<double>(v);
  const bool even = !(sum > 0);
  if (even)
    sum = static_cast<double>(n);
  else
    integral_ = static_cast<float>(sum / static_cast<double>(n));
  const auto value = [&](std::size_t i) { return even ? 1.f : values[i]; };
  // In quanta; whatever is not 0 gets one at least.
  std::vector<std::uint32_t> quanta(n + 1, 0);
  double running = 0;
  for (std::size_t i = 0; i < n; ++i) {
    running += static_cast<double>(value(i));
    const auto nearest = static_cast<std::uint32_t>(std::min(running / sum, 1.0) * kQuanta + 0.5);
    quanta[i + 1] = std::max(nearest, quanta[i] + (value(i) > 0.f));
  }
  quanta[n] = kQuanta;
  for (std::size_t i = n; i-- > 1;) quanta[i] = std::min(quanta[i], quanta[i + 1] - (value(i) > 0.f));
  for (std::size_t i = 0; i <= n; ++i) cdf_[i] = static_cast<float>(quanta[i]) * (1.f / kQuanta);
  guide_.resize((n + kLanes - 1) / kLanes);
  std::uint32_t piece = 0;
  for (std::size_t i = 0; i < guide_.size(); ++i) {
    const float u = static_cast<float>(i) / static_cast<float>(guide_.size());
    while (piece + 1 < n && cdf_[piece + 1] <= u) ++piece;
    guide_[i] = piece;
  }
}

float Distribution1D::sample(float u, float& pdf, std::size_t& cell) const {
  // The last entry that is <= u, and so starts a piece of non-zero width.
  cell = guide_[block_of(u)];
  while (cell > 0 && cdf_[cell] > u) --cell;  // where the block was rounded up
  // Eight at a time: mostly that is all.
  std::size_t below;
  do {
    below = static_cast<std::size_t>(std::popcount(lanes::to_bits(Float8::load(&cdf_[cell + 1]) <= u)));
    cell += below;
  } while (below == kLanes);
  const float width = cdf_[cell + 1] - cdf_[cell];
  const float d = width > 0.f ? std::min((u - cdf_[cell] + 0.5f / kQuanta) / width, 0.99999994f) : 0.5f;
  const float n = static_cast<float>(size());
  pdf = width * n;
  return std::min((static_cast<float>(cell) + d) / n, 0.99999994f);
}

float Distribution1D::pdf(float x) const {
  const auto n = static_cast<std::ptrdiff_t>(size());
  const auto i = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(x * static_cast<float>(n)), 0, n - 1);
  return cell_probability(static_cast<std::size_t>(i)) * static_cast<float>(n);
}

Distribution2D::Distribution2D(std::span<const float> values, std::size_t width, std::size_t height) {
  std::vector<float> weights(height);
  rows_.reserve(height);
  for (std::size_t y = 0; y < height; ++y) {
    rows_.emplace_back(values.subspan(y * width, width));
    weights[y] = rows_.back().integral();
  }
  marginal_ = Distribution1D(weights);
}

Vec2 Distribution2D::sample(const Vec2& u, float& pdf) const {
  float pdf_v, pdf_u;
  std::size_t row, column;
  const float v = marginal_.sample(u.y, pdf_v, row);
  const float x = rows_[row].sample(u.x, pdf_u, column);
  pdf = pdf_u * pdf_v;
  return {x, v};
}

Vec2x8 Distribution2D::sample(Mask8 active, const Vec2x8& u, Float8& pdf) const {
  std::array<std::size_t, kLanes> rows;
  Vec2x8 at;
  lanes::for_each(active, [&](std::size_t i) {
    float density;
    lanes::put(at.y, i, marginal_.sample(lanes::get(u.y, i), density, rows[i]));
    lanes::put(pdf, i, density);
    rows_[rows[i]].prefetch_guide(lanes::get(u.x, i));
  });
  lanes::for_each(active, [&](std::size_t i) { rows_[rows[i]].prefetch_piece(lanes::get(u.x, i)); });
  lanes::for_each(active, [&](std::size_t i) {
    float density;
    std::size_t column;
    lanes::put(at.x, i, rows_[rows[i]].sample(lanes::get(u.x, i), density, column));
    lanes::put(pdf, i, density * lanes::get(pdf, i));
  });
  return at;
}

std::uint64_t Distribution2D::bytes() const {
  std::uint64_t n = marginal_.bytes() + rows_.size() * sizeof(Distribution1D);
  for (const Distribution1D& row : rows_) n += row.bytes();
  return n;
}

float Distribution2D::pdf(const Vec2& p) const {
  const auto n = static_cast<std::ptrdiff_t>(rows_.size());
  const auto row = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(p.y * static_cast<float>(n)), 0, n - 1);
  return rows_[static_cast<std::size_t>(row)].pdf(p.x) * marginal_.pdf(p.y);
}

}  // namespace cloudrenderer
