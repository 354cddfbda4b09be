#include "shading/light_infinite.h"

#include <OpenImageIO/imageio.h>

#include <array>
#include <cmath>

#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

// Cells of the sampling table along the azimuth; larger maps share cells.
constexpr std::size_t kMaxCells = 4096;
constexpr double kPiDouble = 3.14159265358979323846;

int wrap(int i, int size) {
  i %= size;
  return i < 0 ? i + size : i;
}

float luminance_of(const Rgb& c) { return std::max(0.f, luminance(c)); }

}  // namespace

InfiniteLight::InfiniteLight(const LightDesc& desc, Warnings& warnings) {
  constant_ = desc.params.rgb("L", Rgb(1.f)) * desc.params.rgb("scale", Rgb(1.f));
  for (const char* samples : {"nsamples", "samples"}) desc.params.integer(samples, 1);
  if (!is_finite(constant_)) throw SceneError{desc.location, "the light's radiance must be finite"};
  to_world_ = glm::mat3(desc.light_to_world.matrix());
  to_light_ = glm::mat3(desc.light_to_world.inverse_matrix());
  inverse_volume_ = 1.f / std::fabs(glm::determinant(to_world_));
  if (!desc.light_to_world.is_invertible() || !std::isfinite(inverse_volume_))
    throw SceneError{desc.location, "the light's transformation cannot be inverted"};
  mean_ = constant_;
  if (const std::string path = desc.params.string("mapname", ""); !path.empty())
    read_map(desc, path, warnings);
  if (has_map()) prepare_sampling();
}

void InfiniteLight::read_map(const LightDesc& desc, const std::string& path, Warnings& warnings) {
  const auto give_up = [&](const std::string& why) {
    warnings.add(desc.location,
                 "the map " + path + " cannot be read (" + why + "), the light is constant");
  };
  const auto input = OIIO::ImageInput::open(path);
  if (!input) return give_up(OIIO::geterror());
  const OIIO::ImageSpec& spec = input->spec();
  const auto channels = static_cast<std::size_t>(spec.nchannels);
  if (spec.width < 1 || spec.height < 1 || channels < 1) return give_up("it is empty");
  const auto count = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height);
  std::array<std::size_t, 3> source{};
  for (std::size_t i = 0; i < 3; ++i) {
    const int named = spec.channelindex(std::string(1, "RGB"[i]));
    source[i] = named >= 0 ? static_cast<std::size_t>(named) : channels >= 3 ? i : 0;  // else grey
  }
  // Values as they are in the file: pbrt takes 8 bit maps as linear too.
  std::vector<float> values(count * channels);
  if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, values.data()))
    return give_up(input->geterror());
  width_ = spec.width;
  height_ = spec.height;
  texels_.resize(count);
  std::size_t bad = 0;
  for (std::size_t p = 0; p < count; ++p) {
    for (std::size_t i = 0; i < 3; ++i)
      texels_[p][static_cast<int>(i)] =
          values[p * channels + source[i]] * constant_[static_cast<int>(i)];
    if (!is_finite(texels_[p])) {
      texels_[p] = Rgb(0.f);
      ++bad;
    }
  }
  if (bad != 0)
    warnings.add(desc.location,
                 path + ": " + std::to_string(bad) + " texels are not finite, black is used");
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
  m.sine = std::sqrt(local.x * local.x + local.y * local.y);
  float phi = portable::atan2(local.y, local.x);
  if (phi < 0.f) phi += 2 * kPi;
  m.uv = {phi * (1.f / (2 * kPi)), portable::atan2(m.sine, local.z) * kInvPi};
  m.sine *= inverse;
  m.stretch = inverse * inverse * inverse * inverse_volume_;
  return m;
}

Rgb InfiniteLight::lookup(const Vec2& uv) const {
  const float s = uv.x * static_cast<float>(width_) - 0.5f,
              t = uv.y * static_cast<float>(height_) - 0.5f;
  const float s0 = std::floor(s), t0 = std::floor(t), ds = s - s0, dt = t - t0;
  const int x0 = wrap(static_cast<int>(s0), width_), x1 = x0 + 1 == width_ ? 0 : x0 + 1;
  const int y0 = wrap(static_cast<int>(t0), height_), y1 = y0 + 1 == height_ ? 0 : y0 + 1;
  const auto texel = [&](int x, int y) {
    return texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                   static_cast<std::size_t>(x)];
  };
  return (texel(x0, y0) * (1.f - ds) + texel(x1, y0) * ds) * (1.f - dt) +
         (texel(x0, y1) * (1.f - ds) + texel(x1, y1) * ds) * dt;
}

float InfiniteLight::map_pdf(const MapPoint& m) const {
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
