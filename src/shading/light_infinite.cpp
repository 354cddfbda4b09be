#include "shading/light_infinite.h"

#include <cmath>

#include "base/portable_math.h"
#include "shading/equal_area.h"
#include "shading/light_map.h"
#include "shading/light_record.h"

namespace cloudrenderer {
namespace {

// Cells of the sampling table along the azimuth; larger maps share cells.
constexpr std::size_t kMaxCells = 4096;
constexpr double kPiDouble = 3.14159265358979323846;

float luminance_of(const Rgb& c) { return std::max(0.f, luminance(c)); }

}  // namespace

InfiniteLight::InfiniteLight(const LightDesc& desc, Warnings& warnings, bool read) {
  constant_ = light_color(desc.params, "L", desc.location, warnings);
  to_world_ = glm::mat3(desc.light_to_world.matrix());
  to_light_ = glm::mat3(desc.light_to_world.inverse_matrix());
  inverse_volume_ = 1.f / std::fabs(glm::determinant(to_world_));
  if (!desc.light_to_world.is_invertible() || !std::isfinite(inverse_volume_))
    throw SceneError{desc.location, "the light's transformation cannot be inverted"};
  mean_ = constant_;
  if (const std::string path = desc.params.string("mapname", ""); !path.empty()) {
    LightMap map = read_light_map(path, constant_, read, desc.location, "the light is constant", warnings);
    width_ = map.width;
    height_ = map.height;
    texels_ = std::move(map.texels);
  }
  const float wanted = desc.params.real("illuminance", -1.f);
  const bool square = desc.params.string("mapping", "") == "equalarea";
  equal_area_ = square && width_ == height_;
  if (square && !equal_area_)
    warnings.add(desc.location, "the map is not square, so it cannot be one of pbrt-v4: it is taken "
                                "for a latitude-longitude map");
  if (!has_map()) return;
  if (wanted > 0.f && equal_area_)
    if (const double have = illuminance(); have > 0)
      for (Rgb& texel : texels_) texel *= static_cast<float>(static_cast<double>(wanted) / have);
  equal_area_ ? prepare_equal_area() : prepare_sampling();
}

Rgb InfiniteLight::nearest(const Vec2& uv) const {
  const auto at = [](float x, int size) {
    return static_cast<std::size_t>(
        std::clamp(static_cast<int>(x * static_cast<float>(size)), 0, size - 1));
  };
  return texels_[at(uv.y, height_) * static_cast<std::size_t>(width_) + at(uv.x, width_)];
}

double InfiniteLight::illuminance() const {
  double sum = 0;
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      const Vec2 uv((static_cast<float>(x) + 0.5f) / static_cast<float>(width_),
                    (static_cast<float>(y) + 0.5f) / static_cast<float>(height_));
      const float z = equal_area_square_to_sphere(uv).z;
      if (z > 0.f) sum += static_cast<double>(luminance(nearest(uv)) * z);
    }
  return sum * 2 * kPiDouble / (static_cast<double>(width_) * static_cast<double>(height_));
}

// Every texel has the same solid angle; cells of the table hold whole texels.
void InfiniteLight::prepare_equal_area() {
  const auto w = static_cast<std::size_t>(width_), h = static_cast<std::size_t>(height_);
  const std::size_t columns = std::min(w, kMaxCells / 2), rows = std::min(h, kMaxCells / 2);
  std::vector<double> sums(columns * rows);
  glm::dvec3 total(0);
  for (std::size_t y = 0; y < h; ++y)
    for (std::size_t x = 0; x < w; ++x) {
      const Rgb& texel = texels_[y * w + x];
      total += glm::dvec3(texel);
      // A texel that lies in two cells counts in both, or there would be light without a density.
      const double l = static_cast<double>(luminance_of(texel));
      const std::size_t r0 = y * rows / h, r1 = ((y + 1) * rows - 1) / h;
      const std::size_t c0 = x * columns / w, c1 = ((x + 1) * columns - 1) / w;
      for (std::size_t r = r0; r <= r1; ++r)
        for (std::size_t c = c0; c <= c1; ++c) sums[r * columns + c] += l;
    }
  std::vector<float> cells(sums.begin(), sums.end());
  mean_ = Rgb(total / static_cast<double>(w * h));
  distribution_ = Distribution2D(cells, columns, rows);
  cells_ = cells.size();
}

// The table's cells hold the map as it is looked up: a texel spreads over its neighbours by
// bilinear filtering, with weights 1/8, 3/4, 1/8 on each axis, so that no direction with light has
// a density of 0.
void InfiniteLight::prepare_sampling() {
  const auto w = static_cast<std::size_t>(width_), h = static_cast<std::size_t>(height_);
  const std::size_t columns = std::min(w, kMaxCells), rows = std::min(h, kMaxCells / 2);
  std::vector<float> cells(columns * rows);
  std::vector<float> line(w), spread(w);
  std::vector<double> sum(columns);
  glm::dvec3 total(0);
  double total_weight = 0;
  const auto texel_row = [&](std::size_t y, float weight) {
    for (std::size_t x = 0; x < w; ++x) line[x] += weight * luminance_of(texels_[y * w + x]);
  };
  for (std::size_t row = 0; row < rows; ++row) {
    const std::size_t y0 = row * h / rows, y1 = std::max(y0 + 1, ((row + 1) * h + rows - 1) / rows);
    std::fill(sum.begin(), sum.end(), 0.0);
    for (std::size_t y = y0; y < y1; ++y) {
      const double sine =
          portable::sin(kPiDouble * (static_cast<double>(y) + 0.5) / static_cast<double>(h));
      std::fill(line.begin(), line.end(), 0.f);
      texel_row(y == 0 ? h - 1 : y - 1, 0.125f);
      texel_row(y, 0.75f);
      texel_row(y + 1 == h ? 0 : y + 1, 0.125f);
      for (std::size_t x = 0; x < w; ++x)
        spread[x] = 0.125f * (line[x == 0 ? w - 1 : x - 1] + line[x + 1 == w ? 0 : x + 1]) +
                    0.75f * line[x];
      for (std::size_t c = 0; c < columns; ++c) {
        const std::size_t x0 = c * w / columns,
                          x1 = std::max(x0 + 1, ((c + 1) * w + columns - 1) / columns);
        double s = 0;
        for (std::size_t x = x0; x < x1; ++x) s += static_cast<double>(spread[x]);
        sum[c] += sine * s / static_cast<double>(x1 - x0);
      }
    }
    for (std::size_t c = 0; c < columns; ++c)
      cells[row * columns + c] = static_cast<float>(sum[c] / static_cast<double>(y1 - y0));
  }
  for (std::size_t y = 0; y < h; ++y) {
    const double sine =
        portable::sin(kPiDouble * (static_cast<double>(y) + 0.5) / static_cast<double>(h));
    for (std::size_t x = 0; x < w; ++x) total += sine * glm::dvec3(texels_[y * w + x]);
    total_weight += sine * static_cast<double>(w);
  }
  mean_ = Rgb(total / total_weight);
  distribution_ = Distribution2D(cells, columns, rows);
  cells_ = cells.size();
}

InfiniteLight::MapPoint InfiniteLight::map_point(const Vec3& direction) const {
  const Vec3 local = to_light_ * direction;
  const float inverse = 1.f / glm::length(local);
  MapPoint m;
  m.stretch = inverse * inverse * inverse * inverse_volume_;
  if (equal_area_) {
    m.uv = equal_area_sphere_to_square(local * inverse);
    m.sine = 1.f;
    return m;
  }
  m.sine = std::sqrt(local.x * local.x + local.y * local.y);
  float phi = portable::atan2(local.y, local.x);
  if (phi < 0.f) phi += 2 * kPi;
  m.uv = {phi * (1.f / (2 * kPi)), portable::atan2(m.sine, local.z) * kInvPi};
  m.sine *= inverse;
  return m;
}

Rgb InfiniteLight::lookup(const Vec2& uv) const {
  return equal_area_ ? nearest(uv) : bilinear(texels_, width_, height_, uv);
}

float InfiniteLight::map_pdf(const MapPoint& m) const {
  if (equal_area_) return distribution_.pdf(m.uv) * m.stretch * (0.25f * kInvPi);
  if (!(m.sine > 1e-7f)) return 0.f;
  return distribution_.pdf(m.uv) * m.stretch / (2 * kPi * kPi * m.sine);
}

Rgb InfiniteLight::radiance(const Vec3& direction) const {
  return has_map() ? lookup(map_point(direction).uv) : constant_;
}

bool InfiniteLight::sample(const Vec3& n, const Vec2& u, Vec3& direction, float& pdf,
                           Rgb& radiance) const {
  if (!has_map()) {
    radiance = constant_;
    if (n == Vec3(0.f)) {
      direction = sample_uniform_sphere(u);
      pdf = 1.f / (4 * kPi);
      return true;
    }
    const Vec3 local = sample_cosine_hemisphere(u);
    direction = Frame(n).to_world(local);
    pdf = local.z * kInvPi;
    return pdf > 0.f;
  }
  const Vec2 uv = distribution_.sample(u, pdf);
  if (equal_area_) {
    const Vec3 world = to_world_ * equal_area_square_to_sphere(uv);
    const float length = glm::length(world);
    direction = world / length;
    radiance = lookup(uv);
    pdf *= length * length * length * inverse_volume_ * (0.25f * kInvPi);
    return pdf > 0.f && pdf < kInfinity;
  }
  float sin_theta, cos_theta, sin_phi, cos_phi;
  portable::sincos(uv.y * kPi, sin_theta, cos_theta);
  portable::sincos(uv.x * 2 * kPi, sin_phi, cos_phi);
  const Vec3 world = to_world_ * Vec3(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta);
  const float length = glm::length(world);
  direction = world / length;
  if (!(sin_theta > 1e-7f)) return false;
  radiance = lookup(uv);
  pdf *= length * length * length * inverse_volume_ / (2 * kPi * kPi * sin_theta);
  return pdf > 0.f && pdf < kInfinity;
}

float InfiniteLight::pdf(const Vec3& n, const Vec3& direction) const {
  if (has_map()) return map_pdf(map_point(direction));
  return n == Vec3(0.f) ? 1.f / (4 * kPi) : std::max(0.f, glm::dot(n, direction)) * kInvPi;
}

Rgb InfiniteLight::radiance_and_pdf(const Vec3& n, const Vec3& direction, float& pdf_out) const {
  if (!has_map()) {
    pdf_out = pdf(n, direction);
    return constant_;
  }
  const MapPoint m = map_point(direction);
  pdf_out = map_pdf(m);
  return lookup(m.uv);
}

}  // namespace cloudrenderer
