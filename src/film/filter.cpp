#include <array>
#include <cmath>
#include <vector>

#include "base/portable_math.h"
#include "base/sampling.h"
#include "film/camera.h"

namespace cloudrenderer {
namespace {

constexpr double kMostAmplified = 1000;  // the integral of |f| over that of f

class BoxFilter final : public Filter {
 public:
  explicit BoxFilter(const Vec2& width) : width_(width) {}
  float value(const Vec2& o) const override {
    return std::fabs(o.x) <= width_.x && std::fabs(o.y) <= width_.y ? 0.25f / (width_.x * width_.y) : 0.f;
  }
  Vec2 width() const override { return width_; }
  Vec2 sample(const Vec2& u) const override { return point(u); }
  Vec2x8 sample8(const Vec2x8& u) const override { return point(u); }
  bool negative(const Vec2&) const override { return false; }

 private:
  template <class F>
  Vec2Of<F> point(const Vec2Of<F>& u) const {
    return {(2.f * u.x - 1.f) * width_.x, (2.f * u.y - 1.f) * width_.y};
  }
  Vec2 width_;
};

class TriangleFilter final : public Filter {
 public:
  explicit TriangleFilter(const Vec2& width) : width_(width) {}
  float value(const Vec2& o) const override {
    const Vec2 left = glm::max(Vec2(0.f), 1.f - glm::abs(o) / width_);
    return left.x * left.y / (width_.x * width_.y);
  }
  Vec2 width() const override { return width_; }
  Vec2 sample(const Vec2& u) const override { return point(u); }
  Vec2x8 sample8(const Vec2x8& u) const override { return point(u); }
  bool negative(const Vec2&) const override { return false; }

 private:
  template <class F>
  static F tent(F u) {
    const F root = lanes::sqrt(lanes::select(u < 0.5f, 2.f * u, lanes::max(0.f, 2.f - 2.f * u)));
    return lanes::select(u < 0.5f, root - 1.f, 1.f - root);
  }
  template <class F>
  Vec2Of<F> point(const Vec2Of<F>& u) const {
    return {tent(u.x) * width_.x, tent(u.y) * width_.y};
  }
  Vec2 width_;
};

// One axis of a separable filter: a table of |f|, and where f is negative.
class TabulatedAxis {
 public:
  static constexpr std::size_t kCells = 2048;

  template <class F>
  TabulatedAxis(float width, F&& f) : width_(width) {
    std::vector<float> values(kCells);
    for (std::size_t i = 0; i < kCells; ++i) {
      const double x =
          (2 * (static_cast<double>(i) + 0.5) / kCells - 1) * static_cast<double>(width);
      const double v = f(x);
      values[i] = static_cast<float>(std::fabs(v));
      negative_[i] = v < 0;
    }
    distribution_ = Distribution1D(values);
    for (std::size_t i = 0; i < kCells; ++i)
      if (negative_[i]) share_below_ += static_cast<double>(distribution_.cell_probability(i));
  }

  float sample(float u, bool& negative) const {
    float pdf;
    std::size_t cell;
    const float x = distribution_.sample(u, pdf, cell);
    negative = negative_[cell];
    return (2.f * x - 1.f) * width_;
  }
  double share_below() const { return share_below_; }  // of samples
  // The density of sample(), with the filter's sign.
  float value(float x) const {
    const float at = 0.5f * (x / width_ + 1.f) * kCells;
    if (!(at >= 0.f && at < kCells)) return 0.f;
    const auto cell = static_cast<std::size_t>(at);
    const float density = distribution_.cell_probability(cell) * (0.5f * kCells) / width_;
    return negative_[cell] ? -density : density;
  }
  float width() const { return width_; }

 private:
  float width_;
  double share_below_ = 0;
  Distribution1D distribution_;
  std::array<bool, kCells> negative_{};
};

class TabulatedFilter final : public Filter {
 public:
  template <class F>
  TabulatedFilter(const Vec2& width, F&& f)
      : x_(width.x, [&](double t) { return f(t, static_cast<double>(width.x)); }),
        y_(width.y, [&](double t) { return f(t, static_cast<double>(width.y)); }) {
    // Below zero is where one axis is and the other is not.
    const double px = x_.share_below(), py = y_.share_below(), below = px * (1 - py) + py * (1 - px);
    if (below == 0) return;
    lobes_ = {(1 - below) / (1 - 2 * below), below / (1 - 2 * below)};
  }
  Vec2 sample(const Vec2& u) const override {
    bool negative;
    return {x_.sample(u.x, negative), y_.sample(u.y, negative)};
  }
  Vec2x8 sample8(const Vec2x8& u) const override {
    Vec2x8 out;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Vec2 p = sample(lanes::get(u, i));
      lanes::put(out.x, i, p.x);
      lanes::put(out.y, i, p.y);
    }
    return out;
  }
  bool negative(const Vec2& u) const override {
    if (lobes_.below == 0) return false;
    bool x, y;
    x_.sample(u.x, x);
    y_.sample(u.y, y);
    return x != y;
  }
  FilterLobes lobes() const override { return lobes_; }
  float value(const Vec2& o) const override {
    return x_.value(o.x) * y_.value(o.y) * static_cast<float>(lobes_.above + lobes_.below);
  }
  Vec2 width() const override { return {x_.width(), y_.width()}; }

 private:
  TabulatedAxis x_, y_;
  FilterLobes lobes_;
};

// Mitchell and Netravali 1988, support [-2, 2].
double mitchell(double x, double b, double c) {
  x = std::fabs(x);
  if (x >= 2) return 0;
  if (x > 1)
    return ((-b - 6 * c) * x * x * x + (6 * b + 30 * c) * x * x + (-12 * b - 48 * c) * x +
            (8 * b + 24 * c)) /
           6;
  return ((12 - 9 * b - 6 * c) * x * x * x + (-18 + 12 * b + 6 * c) * x * x + (6 - 2 * b)) / 6;
}

double sinc(double x) {
  const double y = 3.14159265358979323846 * std::fabs(x);
  return y < 1e-5 ? 1 : portable::sin(y) / y;
}

std::unique_ptr<Filter> make(const Entity& desc, Dialect dialect, Warnings& warnings) {
  const ParamSet& params = desc.params;
  const auto width = [&](float otherwise) {
    const Vec2 w(params.real("xwidth", otherwise), params.real("ywidth", otherwise));
    if (!(w.x > 0.f && w.y > 0.f && w.x <= 1e3f && w.y <= 1e3f))
      throw SceneError{desc.location,
                       "the filter's xwidth and ywidth must be above 0 and at most 1000"};
    return w;
  };
  if (desc.type == "triangle") return std::make_unique<TriangleFilter>(width(2.f));
  if (desc.type == "gaussian") {
    const auto alpha = static_cast<double>(params.real("alpha", 2.f));
    return std::make_unique<TabulatedFilter>(width(2.f), [alpha](double x, double w) {
      return std::max(0.0, portable::exp(-alpha * x * x) - portable::exp(-alpha * w * w));
    });
  }
  if (desc.type == "mitchell") {
    const auto b = static_cast<double>(params.real("B", 1.f / 3.f)),
               c = static_cast<double>(params.real("C", 1.f / 3.f));
    return std::make_unique<TabulatedFilter>(
        width(2.f), [b, c](double x, double w) { return mitchell(2 * x / w, b, c); });
  }
  if (desc.type == "sinc") {
    const auto tau = static_cast<double>(params.real("tau", 3.f));
    if (!(tau > 0)) throw SceneError{desc.location, "the filter's tau must be above 0"};
    // v2 stretches tau cycles over the width, v3 counts both factors in pixels.
    if (dialect == Dialect::v2)
      return std::make_unique<TabulatedFilter>(
          width(4.f), [tau](double x, double w) { return sinc(tau * x / w) * sinc(x / w); });
    return std::make_unique<TabulatedFilter>(
        width(4.f), [tau](double x, double) { return sinc(x) * sinc(x / tau); });
  }
  if (!desc.type.empty() && desc.type != "box")
    warnings.add(desc.location, "pixel filter \"" + desc.type + "\" is unknown, \"box\" is used");
  return std::make_unique<BoxFilter>(width(0.5f));
}

}  // namespace

std::unique_ptr<Filter> Filter::build(const Entity& desc, Warnings& warnings, Dialect dialect) {
  std::unique_ptr<Filter> filter = make(desc, dialect, warnings);
  if (const FilterLobes lobes = filter->lobes(); !(lobes.above + lobes.below <= kMostAmplified))
    throw SceneError{desc.location, "the filter's positive and negative lobes cancel: its picture would be noise"};
  desc.params.report_unused("PixelFilter \"" + desc.type + "\"", warnings);
  return filter;
}

}  // namespace cloudrenderer
