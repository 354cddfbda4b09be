#include "base/sampling.h"

namespace cloudrenderer {

Distribution1D::Distribution1D(std::span<const float> values) : values_(values.begin(), values.end()) {
  cdf_.resize(values_.size() + 1);
  double sum = 0;
  for (const float v : values_) sum += static_cast<double>(v);
  if (!(sum > 0)) {
    std::fill(values_.begin(), values_.end(), 1.f);
    sum = static_cast<double>(values_.size());
  } else {
    integral_ = static_cast<float>(sum / static_cast<double>(values_.size()));
  }
  double running = 0;
  for (std::size_t i = 0; i < values_.size(); ++i) {
    cdf_[i] = static_cast<float>(running / sum);
    running += static_cast<double>(values_[i]);
  }
  cdf_.back() = 1.f;
  // From here on values_ are densities.
  const double scale = static_cast<double>(values_.size()) / sum;
  for (float& v : values_) v = static_cast<float>(static_cast<double>(v) * scale);
}

float Distribution1D::sample(float u, float& pdf, std::size_t& cell) const {
  // The last entry that is <= u and starts a piece of non-zero width.
  const auto it = std::upper_bound(cdf_.begin(), cdf_.end(), u);
  cell = static_cast<std::size_t>(std::max<std::ptrdiff_t>(it - cdf_.begin() - 1, 0));
  cell = std::min(cell, values_.size() - 1);
  const float width = cdf_[cell + 1] - cdf_[cell];
  const float d = width > 0.f ? std::min((u - cdf_[cell]) / width, 0.99999994f) : 0.5f;
  pdf = values_[cell];
  const float n = static_cast<float>(values_.size());
  return std::min((static_cast<float>(cell) + d) / n, 0.99999994f);
}

float Distribution1D::pdf(float x) const {
  const auto n = static_cast<std::ptrdiff_t>(values_.size());
  const auto i = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(x * static_cast<float>(n)), 0, n - 1);
  return values_[static_cast<std::size_t>(i)];
}

float Distribution1D::cell_probability(std::size_t cell) const {
  return values_[cell] / static_cast<float>(values_.size());
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

float Distribution2D::pdf(const Vec2& p) const {
  const auto n = static_cast<std::ptrdiff_t>(rows_.size());
  const auto row = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(p.y * static_cast<float>(n)), 0, n - 1);
  return rows_[static_cast<std::size_t>(row)].pdf(p.x) * marginal_.pdf(p.y);
}

}  // namespace cloudrenderer
