#include "shading/measured.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"
#include "shading/bsdf_math.h"
#include "shading/fourier.h"

namespace cloudrenderer {
namespace {

constexpr double kHalfPi = 1.57079632679489661923;

// Where cell k of n begins. The square makes the cells finer towards 0, as the MERL tables have
// them.
double half_angle(double k, double n) { return k / n * (k / n) * kHalfPi; }

// 1 - cosine of a unit vector, precise near the pole.
float versine(const Vec3& h) { return bsdf::sine2<float>(h) / (1.f + h.z); }

// Point i of a sequence that fills the unit cube evenly (Roberts: powers of the root of
// x^4 = x + 1).
Vec3 even_point(int i) {
  const auto along = [i](double step) {
    const double x = 0.5 + step * i;
    return std::min(static_cast<float>(x - std::floor(x)), 0x1.fffffep-1f);
  };
  return {along(0.81917251339616444), along(0.67104360670378921), along(0.54970047790197026)};
}

// The light's direction for a half vector at (sine, 0, cosine) and the light's polar coordinates
// about it.
Vec3 light_direction(double half, double theta, double phi) {
  const double s = portable::sin(half), c = portable::cos(half);
  const double x = portable::sin(theta) * portable::cos(phi),
               y = portable::sin(theta) * portable::sin(phi), z = portable::cos(theta);
  return {static_cast<float>(x * c + z * s), static_cast<float>(y),
          static_cast<float>(z * c - x * s)};
}

}  // namespace

MeasuredReflectance::MeasuredReflectance(std::unique_ptr<const ReflectanceTable> table)
    : table_(std::move(table)) {
  tabulate_shares(tabulate_half_vectors());
}

// Returns the smallest mean of a cell, as the value of a diffuse surface below the gloss.
float MeasuredReflectance::tabulate_half_vectors() {
  constexpr int kPolar = 8, kAround = 8;
  constexpr double kWidest = 1.2;  // radians; beyond it everything shines
  for (std::size_t k = 0; k <= kCells; ++k) {
    const double s = portable::sin(0.5 * half_angle(static_cast<double>(k), kCells));
    edges_[k] = static_cast<float>(2 * s * s);
  }
  std::array<float, kCells> mean{};
  float smallest = kInfinity;
  for (std::size_t k = 0; k < kCells; ++k) {
    const double half = half_angle(static_cast<double>(k) + 0.5, kCells);
    const Vec3 h = light_direction(half, 0, 0);
    float sum = 0.f;
    int count = 0;
    for (int i = 0; i < kPolar; ++i)
      for (int j = 0; j < kAround; ++j) {
        const Vec3 wi =
            light_direction(half, (i + 0.5) / kPolar * kWidest, (j + 0.5) / kAround * 2 * kHalfPi);
        const Vec3 wo = 2.f * glm::dot(wi, h) * h - wi;
        if (!(wi.z > 0.f && wo.z > 0.f)) continue;
        sum += luminance(table_->value(wo, wi));
        ++count;
      }
    if (count == 0) continue;
    mean[k] = sum / static_cast<float>(count);
    smallest = std::min(smallest, mean[k]);
  }
  std::array<float, kCells> chance{};
  for (std::size_t k = 0; k < kCells; ++k)
    chance[k] = std::max(0.f, mean[k] - smallest) * (edges_[k + 1] - edges_[k]) *
                (1.f - 0.5f * (edges_[k] + edges_[k + 1]));
  cells_ = Distribution1D(chance);
  for (std::size_t k = 0; k < kCells; ++k)
    density_[k] = cells_.cell_probability(k) / (2 * kPi * (edges_[k + 1] - edges_[k]));
  return smallest < kInfinity ? smallest : 0.f;
}

void MeasuredReflectance::tabulate_shares(float diffuse) {
  constexpr int kSamples = 512;
  const float even = cells_.integral() > 0.f ? 0.5f : 0.f;
  for (std::size_t a = 0; a < kAngles; ++a) {
    const float z = (static_cast<float>(a) + 0.5f) / kAngles;
    const Vec3 wo(std::sqrt(1.f - z * z), 0.f, z);
    mix_[a] = even;
    double sum = 0.0;
    for (int i = 0; i < kSamples; ++i) {
      const Vec3 u = even_point(i);
      Vec3 wi;
      if (!sample(wo, u.x, {u.y, u.z}, wi)) continue;
      const float density = pdf(wo, wi);
      if (density > 0.f)
        sum += static_cast<double>(luminance(table_->value(wo, wi)) * wi.z / density);
    }
    albedo_[a] = static_cast<float>(sum / kSamples);
    const float rest = albedo_[a] > 0.f ? 1.f - diffuse * kPi / albedo_[a] : 0.f;
    mix_[a] = even > 0.f ? std::clamp(rest, 0.f, 0.9f) : 0.f;
  }
}

std::size_t MeasuredReflectance::angle_of(float cosine) {
  return std::min(static_cast<std::size_t>(std::fabs(cosine) * kAngles), kAngles - 1);
}

float MeasuredReflectance::half_density(const Vec3& h) const {
  const auto above = std::upper_bound(edges_.begin(), edges_.end(), versine(h));
  const auto cell =
      static_cast<std::size_t>(std::max<std::ptrdiff_t>(above - edges_.begin(), 1)) - 1;
  return density_[std::min(cell, kCells - 1)];
}

float MeasuredReflectance::pdf(const Vec3& wo, const Vec3& wi) const {
  if (!(wo.z * wi.z > 0.f)) return 0.f;
  const float mix = mix_[angle_of(wo.z)];
  const float cosine = (1.f - mix) * std::fabs(wi.z) * kInvPi;
  if (mix == 0.f) return cosine;
  Vec3 h = wo.z > 0.f ? wo + wi : -(wo + wi);
  h *= 1.f / std::sqrt(glm::dot(h, h));
  return cosine + mix * half_density(h) / (4.f * std::fabs(glm::dot(wi, h)));
}

bool MeasuredReflectance::sample(const Vec3& wo, float u, const Vec2& u2, Vec3& wi) const {
  const float side = wo.z > 0.f ? 1.f : -1.f;
  if (u >= mix_[angle_of(wo.z)]) {
    wi = side * bsdf::sample_cosine<float>(u2);
    return true;
  }
  float ignored;
  std::size_t cell;
  const float x = cells_.sample(u2.x, ignored, cell);
  const float part = std::clamp(x * kCells - static_cast<float>(cell), 0.f, 1.f);
  const float t = edges_[cell] + part * (edges_[cell + 1] - edges_[cell]);
  float s, c;
  portable::sincos_turn(u2.y, s, c);
  const float r = std::sqrt(std::max(0.f, t * (2.f - t)));
  const Vec3 h = side * Vec3(r * c, r * s, 1.f - t);
  const float cosine = glm::dot(wo, h);
  wi = 2.f * cosine * h - wo;
  return cosine > 0.f && wi.z * side > 0.f;
}

namespace {

// What is in the slot; read first if nothing is.
template <class Table, class Read>
const Table* read_once(std::unique_ptr<const Table>& slot, std::uint64_t& bytes, Read read) {
  if (!slot) {
    slot = read();
    bytes += slot->bytes();
  }
  return slot.get();
}

}  // namespace

const MeasuredReflectance* MeasuredStore::get(const std::string& path, Dialect dialect,
                                              const FileLocation& where) {
  return read_once(files_[path], bytes_, [&] {
    const bool irregular = path.ends_with(".brdf") || path.ends_with(".BRDF");
    return std::make_unique<MeasuredReflectance>(irregular ? read_irregular_brdf(path, dialect, where) : read_merl(path, where));
  });
}

const ScatteringTable* MeasuredStore::get_fourier(const std::string& path, const FileLocation& where) {
  return read_once(fourier_[path], bytes_, [&] { return FourierTable::read(path, where); });
}

const RglTable* MeasuredStore::get_rgl(const std::string& path, const FileLocation& where) {
  return read_once(rgl_[path], bytes_, [&] { return RglTable::read(path, where); });
}

}  // namespace cloudrenderer
