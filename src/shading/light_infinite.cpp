#include "shading/light_infinite.h"

#include <cmath>
#include <type_traits>

#include "base/portable_math.h"
#include "base/equal_area.h"
#include "shading/light_map.h"
#include "shading/light_record.h"

namespace cloudrenderer {
namespace {

// Cells of the sampling table along the azimuth; larger maps share cells.
constexpr std::size_t kMaxCells = 4096;
constexpr double kPiDouble = 3.14159265358979323846;

float luminance_of(const Rgb& c) { return std::max(0.f, luminance(c)); }

template <class F>
Vec3Of<F> times(const glm::mat3& m, const Vec3Of<F>& v) {
  return Vec3Of<F>(m[0]) * v.x + Vec3Of<F>(m[1]) * v.y + Vec3Of<F>(m[2]) * v.z;
}

}  // namespace

InfiniteLight::InfiniteLight(const LightDesc& desc, Dialect dialect, Warnings& warnings, bool read) {
  constant_ = light_color(desc.params, "L", desc.location, warnings);
  to_world_ = glm::mat3(desc.light_to_world.matrix());
  to_light_ = glm::mat3(desc.light_to_world.inverse_matrix());
  inverse_volume_ = 1.f / std::fabs(glm::determinant(to_world_));
  if (!desc.light_to_world.is_invertible() || !std::isfinite(inverse_volume_))
    throw SceneError{desc.location, "the light's transformation cannot be inverted"};
  mean_ = constant_;
  portal_ = Portal::of(desc, warnings);
  LightMap map = read_light_map(desc, "mapname", dialect, constant_, read, "the light is constant", warnings);
  width_ = map.width;
  height_ = map.height;
  texels_ = std::move(map.texels);
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

double InfiniteLight::illuminance() const {
  double sum = 0;
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      const Vec2 uv((static_cast<float>(x) + 0.5f) / static_cast<float>(width_),
                    (static_cast<float>(y) + 0.5f) / static_cast<float>(height_));
      const float z = equal_area_square_to_sphere(uv).z;
      if (z > 0.f) sum += static_cast<double>(luminance(nearest(texels_, width_, height_, uv)) * z);
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
}

template <class F>
InfiniteLight::MapPoint<F> InfiniteLight::map_point(MaskOf<F> active, const Vec3Of<F>& direction) const {
  const Vec3Of<F> local = times<F>(to_light_, direction);
  const F inverse = 1.f / lanes::sqrt(glm::dot(local, local));
  MapPoint<F> m;
  m.stretch = inverse * inverse * inverse * inverse_volume_;
  if (equal_area_) {
    lanes::for_each(active, [&](std::size_t i) {
      lanes::put(m.uv, i, equal_area_sphere_to_square(lanes::get(local, i) * lanes::get(inverse, i)));
    });
    m.sine = 1.f;
    return m;
  }
  m.sine = lanes::sqrt(local.x * local.x + local.y * local.y);
  const F phi = portable::atan2_near(local.y, local.x);
  m.uv = {lanes::select(phi < 0.f, phi + 2 * kPi, phi) * (1.f / (2 * kPi)), portable::atan2_near(m.sine, local.z) * kInvPi};
  m.uv = {lanes::min(m.uv.x, 1.f), lanes::min(m.uv.y, 1.f)};
  m.sine *= inverse;
  return m;
}

template <class F>
Vec3Of<F> InfiniteLight::lookup(MaskOf<F> active, const Vec2Of<F>& uv) const {
  Vec3Of<F> radiance(F(0.f));
  // Of eight none waits for the texels of another one.
  if constexpr (!std::is_same_v<F, float>)
    lanes::for_each(active, [&](std::size_t i) { prefetch_texels(texels_, width_, height_, lanes::get(uv, i)); });
  lanes::for_each(active, [&](std::size_t i) {
    const Vec2 at = lanes::get(uv, i);
    lanes::put(radiance, i, equal_area_ ? nearest(texels_, width_, height_, at) : bilinear(texels_, width_, height_, at));
  });
  return radiance;
}

template <class F>
F InfiniteLight::map_pdf(MaskOf<F> active, const MapPoint<F>& m) const {
  F density(0.f);
  lanes::for_each(active, [&](std::size_t i) { lanes::put(density, i, distribution_.pdf(lanes::get(m.uv, i))); });
  if (equal_area_) return density * m.stretch * (0.25f * kInvPi);
  return lanes::select(m.sine > 1e-7f, density * m.stretch / (2 * kPi * kPi * m.sine), F(0.f));
}

template <class F>
Vec3Of<F> InfiniteLight::radiance(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& direction) const {
  const Vec3Of<F> radiance = has_map() ? lookup<F>(active, map_point<F>(active, direction).uv) : Vec3Of<F>(constant_);
  F density;
  return portal_ ? lanes::select(portal_->passes<F>(p, direction, density), radiance, Vec3Of<F>(F(0.f))) : radiance;
}

template <class F>
MaskOf<F> InfiniteLight::sample(MaskOf<F> active, const Vec3Of<F>& n, const Vec2Of<F>& u, Vec3Of<F>& direction, F& pdf,
                                Vec3Of<F>& radiance) const {
  if (!has_map()) {
    radiance = Vec3Of<F>(constant_);
    const MaskOf<F> all_around = lanes::is_black(n);
    const Vec2Of<F> disk = sample_disk(u);
    const F z = lanes::sqrt(lanes::max(0.f, 1.f - disk.x * disk.x - disk.y * disk.y));
    direction = lanes::select(all_around, sample_uniform_sphere<F>(u), FrameOf<F>(n).to_world({disk.x, disk.y, z}));
    pdf = lanes::select(all_around, F(1.f / (4 * kPi)), z * kInvPi);
    return active && pdf > 0.f;
  }
  const Vec2Of<F> uv = distribution_.sample(active, u, pdf);
  radiance = lookup<F>(active, uv);
  Vec3Of<F> local(F(0.f));
  F sine(1.f);
  if (equal_area_) {
    lanes::for_each(active, [&](std::size_t i) { lanes::put(local, i, equal_area_square_to_sphere(lanes::get(uv, i))); });
    pdf *= 0.25f * kInvPi;
  } else {
    F z, x, y;
    portable::sincos_turn<F>(0.5f * uv.y, sine, z);
    portable::sincos_turn<F>(uv.x, y, x);
    local = {sine * x, sine * y, z};
    pdf /= 2 * kPi * kPi * sine;
  }
  const Vec3Of<F> world = times<F>(to_world_, local);
  const F length = lanes::sqrt(glm::dot(world, world));
  direction = world * (1.f / length);
  pdf *= length * length * length * inverse_volume_;
  return active && sine > 1e-7f && pdf > 0.f && pdf < kInfinity;
}

template <class F>
Vec3Of<F> InfiniteLight::radiance_and_pdf(MaskOf<F> active, const Vec3Of<F>& n, const Vec3Of<F>& direction, F& pdf) const {
  if (!has_map()) {
    pdf = lanes::select(lanes::is_black(n), F(1.f / (4 * kPi)), lanes::max(0.f, glm::dot(n, direction)) * kInvPi);
    return Vec3Of<F>(constant_);
  }
  const MapPoint<F> m = map_point<F>(active, direction);
  pdf = map_pdf<F>(active, m);
  return lookup<F>(active, m.uv);
}

template <class F>
MaskOf<F> InfiniteLight::sample_at(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& n, const Vec2Of<F>& u, Vec3Of<F>& direction,
                                   F& pdf, Vec3Of<F>& radiance) const {
  if (!portal_) return sample<F>(active, n, u, direction, pdf, radiance);
  const MaskOf<F> through = u.x < 0.5f;
  const Vec2Of<F> again{lanes::select(through, u.x, u.x - 0.5f) * 2.f, u.y};
  const MaskOf<F> found = sample<F>(active, n, again, direction, pdf, radiance);
  const Vec3Of<F> way = portal_->point<F>(again) - p;
  direction = lanes::select(through, way * (1.f / lanes::sqrt(glm::dot(way, way))), direction);
  radiance = radiance_and_pdf_at<F>(active, p, n, direction, pdf);
  return active && (through || found) && pdf > 0.f && pdf < kInfinity;
}

template <class F>
Vec3Of<F> InfiniteLight::radiance_and_pdf_at(MaskOf<F> active, const Vec3Of<F>& p, const Vec3Of<F>& n, const Vec3Of<F>& direction,
                                             F& pdf) const {
  const Vec3Of<F> radiance = radiance_and_pdf<F>(active, n, direction, pdf);
  if (!portal_) return radiance;
  F density;
  const MaskOf<F> passes = portal_->passes<F>(p, direction, density);
  pdf = 0.5f * (pdf + density);
  return lanes::select(passes, radiance, Vec3Of<F>(F(0.f)));
}

template Vec3 InfiniteLight::radiance<float>(bool, const Vec3&, const Vec3&) const;
template Vec3x8 InfiniteLight::radiance<Float8>(Mask8, const Vec3x8&, const Vec3x8&) const;
template bool InfiniteLight::sample<float>(bool, const Vec3&, const Vec2&, Vec3&, float&, Vec3&) const;
template Mask8 InfiniteLight::sample<Float8>(Mask8, const Vec3x8&, const Vec2x8&, Vec3x8&, Float8&, Vec3x8&) const;
template Vec3 InfiniteLight::radiance_and_pdf<float>(bool, const Vec3&, const Vec3&, float&) const;
template Vec3x8 InfiniteLight::radiance_and_pdf<Float8>(Mask8, const Vec3x8&, const Vec3x8&, Float8&) const;
template bool InfiniteLight::sample_at<float>(bool, const Vec3&, const Vec3&, const Vec2&, Vec3&, float&, Vec3&) const;
template Mask8 InfiniteLight::sample_at<Float8>(Mask8, const Vec3x8&, const Vec3x8&, const Vec2x8&, Vec3x8&, Float8&, Vec3x8&) const;
template Vec3 InfiniteLight::radiance_and_pdf_at<float>(bool, const Vec3&, const Vec3&, const Vec3&, float&) const;
template Vec3x8 InfiniteLight::radiance_and_pdf_at<Float8>(Mask8, const Vec3x8&, const Vec3x8&, const Vec3x8&, Float8&) const;

}  // namespace cloudrenderer
