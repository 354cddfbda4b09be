#include "shading/fourier.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;
constexpr int kIterations = 60;  // halving alone then gives 2^-60
constexpr float kEvenShare = 0.02f;

// Of the angle around the normal between wo and the way that the light takes on.
double cosine_between(const Vec3& wo, const Vec3& wi) {
  const float sines2 = (wo.x * wo.x + wo.y * wo.y) * (wi.x * wi.x + wi.y * wi.y);
  if (!(sines2 > 0.f)) return 1;
  return static_cast<double>(std::clamp(-(wi.x * wo.x + wi.y * wo.y) / std::sqrt(sines2), -1.f, 1.f));
}

// sum of a_k cos(k phi)
float cosine_series(std::span<const float> a, double cosine) {
  double sum = 0, now = 1, before = cosine;  // cos(0), cos(-phi)
  for (const float x : a) {
    sum += static_cast<double>(x) * now;
    const double next = 2 * cosine * now - before;
    before = now;
    now = next;
  }
  return static_cast<float>(sum);
}

// x in [low, high] with f(x) = 0, where f rises: Newton's steps as long as they stay between the bounds. f gives the value
// and the slope.
template <class Function>
double root(double low, double high, double tolerance, Function f) {
  double x = 0.5 * (low + high);
  for (int i = 0; i < kIterations; ++i) {
    const auto [value, slope] = f(x);
    if (std::fabs(value) <= tolerance) break;
    (value > 0 ? high : low) = x;
    x -= value / slope;
    if (!(x > low && x < high)) x = 0.5 * (low + high);
  }
  return x;
}

struct ValueAndSlope {
  double value, slope;
};

// An angle in [0, pi] whose share of the series' integral is u; any angle evenly if that is not above 0.
double sample_angle(std::span<const float> a, float u) {
  const double first = a.empty() ? 0 : static_cast<double>(a[0]), share = static_cast<double>(u) * kPiDouble;
  if (!(first > 0)) return share;
  return root(0, kPiDouble, 1e-7 * first, [&](double x) {
    const double c = portable::cos(x), sine = portable::sin(x);
    double integral = first * (x - share), value = first;
    double cos_before = 1, cos_now = c, sin_before = 0, sin_now = sine;
    for (std::size_t k = 1; k < a.size(); ++k) {
      const auto coefficient = static_cast<double>(a[k]);
      integral += coefficient * sin_now / static_cast<double>(k);
      value += coefficient * cos_now;
      const double cos_next = 2 * c * cos_now - cos_before, sin_next = 2 * c * sin_now - sin_before;
      cos_before = cos_now;
      cos_now = cos_next;
      sin_before = sin_now;
      sin_now = sin_next;
    }
    return ValueAndSlope{integral, value};
  });
}

}  // namespace

std::size_t FourierTable::cell(float mu) const {
  const auto above = std::upper_bound(mu_.begin(), mu_.end(), mu);
  return std::min(static_cast<std::size_t>(std::max<std::ptrdiff_t>(above - mu_.begin(), 1)) - 1, mu_.size() - 2);
}

FourierTable::Weights FourierTable::weights(float mu) const {
  Weights w;
  w.inside = mu >= mu_.front() && mu <= mu_.back();
  if (!w.inside) return w;
  const std::size_t i = cell(mu);
  const float width = mu_[i + 1] - mu_[i], t = (mu - mu_[i]) / width, t2 = t * t, t3 = t2 * t;
  const bool left = i > 0, right = i + 2 < mu_.size();
  w.node = {left ? i - 1 : i, i, i + 1, right ? i + 2 : i + 1};
  // A cubic with the slopes of the chords through the neighbours; at the ends, of the cell itself.
  const float at0 = (t3 - 2 * t2 + t) * (left ? width / (mu_[i + 1] - mu_[i - 1]) : 1.f);
  const float at1 = (t3 - t2) * (right ? width / (mu_[i + 2] - mu_[i]) : 1.f);
  const float rise = 3 * t2 - 2 * t3;
  w.weight = {0.f, 1.f - rise - at1, rise + at0, 0.f};
  (left ? w.weight[0] : w.weight[1]) -= at0;
  (right ? w.weight[3] : w.weight[2]) += at1;
  return w;
}

void FourierTable::series(const Weights& o, const Weights& i, std::size_t channels, Series& out) const {
  out.order = 0;
  const auto each = [&](const auto& visit) {
    for (std::size_t a = 0; a < 4; ++a)
      for (std::size_t b = 0; b < 4; ++b) {
        const float weight = o.weight[a] * i.weight[b];
        if (weight != 0.f) visit(o.node[a] * mu_.size() + i.node[b], weight);
      }
  };
  each([&](std::size_t at, float) { out.order = std::max<std::size_t>(out.order, order_[at]); });
  std::fill_n(out.a.begin(), out.order * channels, 0.f);
  each([&](std::size_t at, float weight) {
    const float* from = coefficients_.data() + offset_[at];
    for (std::size_t c = 0; c < channels; ++c)
      for (std::size_t k = 0; k < order_[at]; ++k) out.a[c * out.order + k] += weight * *from++;
  });
}

// The integrals of a_0, for sampling. The file has those of its splines, which may fall.
void FourierTable::integrate() {
  const std::size_t n = mu_.size();
  first_.resize(n * n);
  cumulative_.resize(n * n);
  for (std::size_t row = 0; row < n; ++row) {
    double sum = 0;
    for (std::size_t column = 0; column < n; ++column) {
      const std::size_t at = row * n + column;
      first_[at] = order_[at] > 0 ? std::max(0.f, coefficients_[offset_[at]]) : 0.f;
      if (column > 0) sum += static_cast<double>(0.5f * (first_[at] + first_[at - 1]) * (mu_[column] - mu_[column - 1]));
      cumulative_[at] = static_cast<float>(sum);
    }
  }
}

FourierTable::Rows FourierTable::rows(float mu_o) const {
  const std::size_t i = cell(mu_o);
  return {i, std::clamp((mu_o - mu_[i]) / (mu_[i + 1] - mu_[i]), 0.f, 1.f)};
}

float FourierTable::between(const Rows& r, const std::vector<float>& table, std::size_t column) const {
  const float* low = table.data() + r.low * mu_.size() + column;
  return (1.f - r.high_share) * low[0] + r.high_share * low[mu_.size()];
}

float FourierTable::column_pdf(const Rows& r, float mu_i) const {
  const float even = 1.f / (mu_.back() - mu_.front()), total = between(r, cumulative_, mu_.size() - 1);
  if (!(total > 0.f)) return even;
  const std::size_t i = cell(mu_i);
  const float t = (mu_i - mu_[i]) / (mu_[i + 1] - mu_[i]);
  const float here = (1.f - t) * between(r, first_, i) + t * between(r, first_, i + 1);
  return kEvenShare * even + (1.f - kEvenShare) * here / total;
}

float FourierTable::sample_column(const Rows& r, float u) const {
  const float total = between(r, cumulative_, mu_.size() - 1);
  if (u < kEvenShare || !(total > 0.f)) {
    if (total > 0.f) u /= kEvenShare;
    return mu_.front() + u * (mu_.back() - mu_.front());
  }
  const float target = (u - kEvenShare) / (1.f - kEvenShare) * total;
  std::size_t low = 0, high = mu_.size() - 1;
  while (high - low > 1) {
    const std::size_t middle = (low + high) / 2;
    (between(r, cumulative_, middle) <= target ? low : high) = middle;
  }
  // The root of a quadratic, in the form without cancellation.
  const float f0 = between(r, first_, low), f1 = between(r, first_, low + 1);
  const float from = between(r, cumulative_, low), all = between(r, cumulative_, low + 1) - from;
  const float x = all > 0.f ? std::clamp((target - from) / all, 0.f, 1.f) : 0.5f;
  const float root = f0 + std::sqrt(std::max(0.f, f0 * f0 + x * (f1 * f1 - f0 * f0)));
  const float t = root > 0.f ? x * (f0 + f1) / root : x;
  return mu_[low] + std::min(t, 1.f) * (mu_[low + 1] - mu_[low]);
}

Rgb FourierTable::value(const Vec3& wo, const Vec3& wi) const {
  const float mu_i = -wi.z, mu_o = wo.z;
  const Weights o = weights(mu_o), i = weights(mu_i);
  if (!o.inside || !i.inside || mu_i == 0.f) return Rgb(0.f);
  Series s;
  series(o, i, channels_, s);
  const double cosine = cosine_between(wo, wi);
  float scale = 1.f / std::fabs(mu_i);
  if (mu_i * mu_o > 0.f) {  // refraction compresses radiance
    const float eta = mu_i > 0.f ? 1.f / eta_ : eta_;
    scale *= eta * eta;
  }
  const auto evaluate = [&](std::size_t c) { return cosine_series(s.channel(c), cosine); };
  const float y = std::max(0.f, evaluate(0));
  if (channels_ == 1) return Rgb(y * scale);
  // The channels are luminance, red and blue; these are the factors of pbrt-v3.
  const float r = evaluate(1), b = evaluate(2), g = 1.39829f * y - 0.100913f * b - 0.297375f * r;
  return glm::max(Rgb(r, g, b) * scale, Rgb(0.f));
}

float FourierTable::pdf(const Vec3& wo, const Vec3& wi) const {
  const Weights o = weights(wo.z), i = weights(-wi.z);
  if (!o.inside || !i.inside) return 0.f;
  Series s;
  series(o, i, 1, s);
  const float y = cosine_series(s.channel(0), cosine_between(wo, wi));
  if (!(y > 0.f)) return 0.f;
  const float a0 = s.a[0];
  return column_pdf(rows(wo.z), -wi.z) * (a0 > 0.f ? y / (2.f * kPi * a0) : 0.5f * kInvPi);
}

bool FourierTable::sample(const Vec3& wo, float u, const Vec2& u2, Vec3& wi) const {
  const Weights o = weights(wo.z);
  if (!o.inside) return false;
  const float mu = std::clamp(sample_column(rows(wo.z), u2.x), mu_.front(), mu_.back());
  Series s;
  series(o, weights(mu), 1, s);
  const double phi = sample_angle(s.channel(0), u2.y);
  const float c = portable::cos(static_cast<float>(phi)), sine = (u < 0.5f ? 1.f : -1.f) * portable::sin(static_cast<float>(phi));
  const float across = std::sqrt(wo.x * wo.x + wo.y * wo.y), r = std::sqrt(std::max(0.f, 1.f - mu * mu));
  const float x = across > 0.f ? wo.x / across : 1.f, y = across > 0.f ? wo.y / across : 0.f;
  wi = glm::normalize(-Vec3(r * (c * x - sine * y), r * (sine * x + c * y), mu));
  return true;
}

float FourierTable::albedo(float cosine) const {
  return 2.f * kPi * between(rows(cosine), cumulative_, mu_.size() - 1);
}

std::uint64_t FourierTable::bytes() const {
  return sizeof *this + (mu_.size() + first_.size() + cumulative_.size() + coefficients_.size()) * sizeof(float) +
         (offset_.size() + order_.size()) * sizeof(std::uint32_t);
}

}  // namespace cloudrenderer
