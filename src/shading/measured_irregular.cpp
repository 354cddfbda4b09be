#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/portable_math.h"
#include "scene/lexer.h"
#include "scene/spectrum.h"
#include "shading/measured.h"

namespace cloudrenderer {
namespace {

// Where a pair of directions stands among the measurements: isotropic and symmetric, near pairs
// near each other (Marschner's thesis, 1998): product of the sines, angle between the azimuths
// over pi, product of the cosines.
Vec3 place_of(const Vec3& wo, const Vec3& wi) {
  const float sines = std::sqrt(std::max(0.f, (1.f - wo.z * wo.z) * (1.f - wi.z * wi.z)));
  const float azimuth =
      portable::atan2(std::fabs(wo.x * wi.y - wo.y * wi.x), wo.x * wi.x + wo.y * wi.y);
  return {sines, azimuth * kInvPi, wo.z * wi.z};
}

Vec3 polar(double theta, double phi) {
  const double s = portable::sin(theta);
  return {static_cast<float>(s * portable::cos(phi)), static_cast<float>(s * portable::sin(phi)),
          static_cast<float>(portable::cos(theta))};
}

struct Measurement {
  Vec3 place;
  Rgb value;
  int axis = 0;  // that divides the tree here
};

// Means of the measurements near a place, weighted by exp(-100 d^2) within a radius that grows
// until there are three, as in pbrt-v2. The measurements are a balanced kd-tree: the middle of a
// range divides it.
class IrregularTable final : public ReflectanceTable {
 public:
  explicit IrregularTable(std::vector<Measurement> measurements) : tree_(std::move(measurements)) {
    std::vector<std::size_t> order(tree_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    divide(order, 0, order.size());
    std::vector<Measurement> sorted;
    sorted.reserve(tree_.size());
    for (const std::size_t i : order) sorted.push_back(tree_[i]);
    tree_ = std::move(sorted);
  }

  Rgb value(const Vec3& wo, const Vec3& wi) const override {
    constexpr float kFirstRadius2 = 0.001f, kLastRadius2 = 1.5f;
    Near near{place_of(wo, wi), kFirstRadius2};
    for (;;) {
      near.count = 0;
      near.weight = 0.0;
      near.sum = glm::dvec3(0.0);
      gather(near, 0, tree_.size());
      if (near.count > 2 || near.radius2 > kLastRadius2) break;
      near.radius2 *= 2.f;
    }
    if (!(near.weight > 0.0)) return Rgb(0.f);
    return Rgb(glm::max(near.sum, 0.0) / near.weight);
  }
  std::uint64_t bytes() const override { return tree_.size() * sizeof(Measurement); }

 private:
  struct Near {
    Vec3 place;
    float radius2;
    int count = 0;
    double weight = 0.0;
    glm::dvec3 sum{0.0};
  };

  // Every host has to divide alike, so that sums have the same order: equal coordinates are told
  // apart by the place in the file.
  void divide(std::vector<std::size_t>& order, std::size_t first, std::size_t last) {
    if (last - first < 2) return;
    Bounds3 box;
    for (std::size_t i = first; i < last; ++i) box.extend(tree_[order[i]].place);
    const Vec3 size = box.max - box.min;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const auto at = [&](std::size_t i) { return order.begin() + static_cast<std::ptrdiff_t>(i); };
    const std::size_t middle = first + (last - first) / 2;
    std::nth_element(at(first), at(middle), at(last), [&](std::size_t a, std::size_t b) {
      const float x = tree_[a].place[axis], y = tree_[b].place[axis];
      return x < y || (x == y && a < b);
    });
    tree_[order[middle]].axis = axis;
    divide(order, first, middle);
    divide(order, middle + 1, last);
  }

  void gather(Near& near, std::size_t first, std::size_t last) const {
    while (first < last) {
      const std::size_t middle = first + (last - first) / 2;
      const Measurement& m = tree_[middle];
      const Vec3 d = near.place - m.place;
      if (const float d2 = glm::dot(d, d); d2 < near.radius2) {
        const double w = portable::exp(-100.0 * static_cast<double>(d2));
        near.sum += w * glm::dvec3(m.value);
        near.weight += w;
        ++near.count;
      }
      const float across = d[m.axis];
      const bool both = across * across < near.radius2;
      if (both) gather(near, first, middle);
      if (both || across >= 0.f)
        first = middle + 1;
      else
        last = middle;
    }
  }

  std::vector<Measurement> tree_;
};

// The numbers of a text file, with their places.
class Numbers {
 public:
  explicit Numbers(const std::shared_ptr<const SourceText>& text) : lexer_(text) {}
  bool at_end() { return lexer_.peek().kind == Token::Kind::end; }
  double next(const char* what) {
    const Token t = lexer_.next();
    if (t.kind != Token::Kind::number)
      throw SceneError(lexer_.location(t),
                       std::string("expected ") + what + ", found " + Lexer::describe(t));
    const double v = lexer_.to_double(t);
    if (!(std::fabs(v) <= kLargest))
      throw SceneError(lexer_.location(t), "the number is too large");
    return v;
  }
  FileLocation here() const { return lexer_.here(); }

 private:
  static constexpr double kLargest = 1e9;
  Lexer lexer_;
};

}  // namespace

std::unique_ptr<ReflectanceTable> read_irregular_brdf(const std::string& path, Dialect dialect,
                                                      const FileLocation& where) {
  auto text = SourceText::open(path);
  if (!text) throw SceneError(where, "measured reflectance: " + text.error());
  Numbers numbers(*text);
  constexpr double kMostWavelengths = 4096;
  const double count = numbers.next("the number of wavelengths");
  if (!(count >= 1 && count <= kMostWavelengths) || count != std::floor(count))
    throw SceneError(numbers.here(), "the number of wavelengths must be from 1 to 4096");
  SampledSpectrum spectrum;
  for (int i = 0; i < static_cast<int>(count); ++i)
    spectrum.wavelengths.push_back(numbers.next("a wavelength"));
  spectrum.values.resize(spectrum.wavelengths.size());
  std::vector<Measurement> measurements;
  while (!numbers.at_end()) {
    const double theta_i = numbers.next("an angle"), phi_i = numbers.next("an angle"),
                 theta_o = numbers.next("an angle"), phi_o = numbers.next("an angle");
    for (double& v : spectrum.values) v = numbers.next("a value");
    measurements.push_back({place_of(polar(theta_o, phi_o), polar(theta_i, phi_i)),
                            spectrum_to_rgb(spectrum, dialect)});
  }
  if (measurements.empty()) throw SceneError(numbers.here(), "expected measurements");
  return std::make_unique<IrregularTable>(std::move(measurements));
}

}  // namespace cloudrenderer
