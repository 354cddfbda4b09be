#include "shading/light_map.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"
#include "base/equal_area.h"
#include "images/images.h"
#include "scene/color_space.h"
#include "shading/texture_image.h"

namespace cloudrenderer {

LightMap read_light_map(const Entity& light, const char* name, Dialect dialect, const Rgb& scale, bool read, const char* instead,
                        Warnings& warnings) {
  LightMap map;
  const FileLocation& where = light.location;
  const std::string path = light.params.string(name, "");
  const bool decodes = light.params.boolean("srgb", false);
  if (path.empty()) return map;
  const auto give_up = [&](const std::string& why) {
    warnings.add(where, "the map " + path + " cannot be read (" + why + "), " + instead);
    return LightMap{};
  };
  std::string why;
  const auto input = open_image(path, false, why);
  if (!input) return give_up(why);
  const ImageInfo& info = input->info();
  const auto channels = static_cast<std::size_t>(info.channels);
  if (info.width < 1 || info.height < 1 || channels < 1) return give_up("it is empty");
  map.width = info.width;
  map.height = info.height;
  if (!read) return map;
  const auto count = static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height);
  map.texels.resize(count);
  // Large maps are read to where they stay.
  const bool in_place = info.rgb == std::array{0, 1, 2};
  std::vector<float> values(in_place ? 0 : count * channels);
  if (in_place ? !input->read(3, &map.texels[0].x, why) : !input->read(info.channels, values.data(), why)) return give_up(why);
  ImageEncoding srgb;
  srgb.srgb = true;
  // The maps of pbrt-v4 have the colours of the space that they name.
  const auto space = decodes && info.chromaticities ? ColorSpace::find(*info.chromaticities) : std::nullopt;
  std::size_t bad = 0, negative = 0;
  for (std::size_t p = 0; p < count; ++p) {
    for (std::size_t i = 0; !in_place && i < 3; ++i)
      map.texels[p][static_cast<int>(i)] = values[p * channels + static_cast<std::size_t>(info.rgb[i])];
    if (decodes && !info.is_float)
      for (int i = 0; i < 3; ++i) map.texels[p][i] = srgb.decode(map.texels[p][i]);
    if (space) map.texels[p] = space->to_working(map.texels[p]);
    map.texels[p] *= scale;
    if (!is_finite(map.texels[p])) {
      map.texels[p] = Rgb(0.f);
      ++bad;
    }
    const Rgb shown = glm::max(map.texels[p], Rgb(0.f));
    negative += shown != map.texels[p];
    map.texels[p] = shown;
  }
  if (dialect == Dialect::v2 && is_upside_down_in_v2(path))
    for (auto low = map.texels.begin(), high = map.texels.end() - info.width; low < high; low += info.width, high -= info.width)
      std::swap_ranges(low, low + info.width, high);
  if (negative != 0)
    warnings.add(where, path + ": " + std::to_string(negative) + " texels have negative channels, which are taken as 0");
  if (bad != 0)
    warnings.add(where, path + ": " + std::to_string(bad) + " texels are not finite: black is used");
  return map;
}

DirectionalMap::DirectionalMap(Kind kind, const LightDesc& desc, Dialect dialect, bool read, Warnings& warnings)
    : kind_(kind), world_to_light_(glm::mat3(desc.light_to_world.inverse_matrix())) {
  if (!desc.light_to_world.is_invertible())
    throw SceneError{desc.location, "the light's transformation cannot be inverted"};
  map_ = read_light_map(desc, "mapname", dialect, Rgb(1.f), read, "the light is even", warnings);
  if (!map_.empty()) {
    largest_ = Rgb(0.f);
    for (const Rgb& texel : map_.texels) largest_ = glm::max(largest_, texel);
  }
  nearest_ = desc.params.boolean("srgb", false);
  const bool v4 = desc.params.string("mapping", "") == "equalarea";
  equal_area_ = v4 && map_.width == map_.height;
  if (v4 && !equal_area_)
    warnings.add(desc.location, "a map of equal areas must be square, not " + std::to_string(map_.width) + " x " +
                                    std::to_string(map_.height) + ": its rows are taken for heights");
  if (v4)  // which has no colours here
    for (Rgb& texel : map_.texels) texel = Rgb((texel.x + texel.y + texel.z) * (1.f / 3.f));
  if (kind == Kind::projection) {
    const float fov = desc.params.real("fov", 45.f);
    if (!(fov > 0.f && fov < 180.f))
      throw SceneError{desc.location, "fov must be above 0 and below 180 degrees"};
    tangent_ = portable::tan(0.5f * fov * (kPi / 180));
    const float aspect = map_.empty() ? 1.f : static_cast<float>(map_.width) / static_cast<float>(map_.height);
    screen_ = aspect > 1.f ? Vec2(aspect, 1.f) : Vec2(1.f, 1.f / aspect);
  }
  const float power = desc.params.real("power", 0.f);
  if (!(power < kInfinity)) throw SceneError{desc.location, "the light's power must be finite"};
  if (power > 0.f) set_power(power);
}

void DirectionalMap::set_power(float power) {
  if (map_.empty()) return;
  double sum = 0, area = 4 * static_cast<double>(kPi), count = 0;
  if (kind_ == Kind::projection)
    area = 4.0 * static_cast<double>(screen_.x) * static_cast<double>(screen_.y) * static_cast<double>(tangent_) *
           static_cast<double>(tangent_);
  for (int y = 0; y < map_.height; ++y)
    for (int x = 0; x < map_.width; ++x) {
      double weight = 1;  // solid angle of the texel, but for its area
      if (kind_ == Kind::projection) {
        const Vec2 at((static_cast<float>(x) + 0.5f) / static_cast<float>(map_.width),
                      (static_cast<float>(y) + 0.5f) / static_cast<float>(map_.height));
        const Vec2 p = (2.f * at - Vec2(1.f)) * screen_ * tangent_;
        const double cosine = 1 / std::sqrt(1 + static_cast<double>(glm::dot(p, p)));
        weight = cosine * cosine * cosine;
      }
      sum += weight * static_cast<double>(luminance(map_.texels[static_cast<std::size_t>(y) * static_cast<std::size_t>(map_.width) +
                                                               static_cast<std::size_t>(x)]));
      count += 1;
    }
  if (!(sum > 0)) return;
  const auto factor = static_cast<float>(static_cast<double>(power) * count / (area * sum));
  for (Rgb& texel : map_.texels) texel *= factor;
  largest_ *= factor;
}

Rgb DirectionalMap::lookup(const Vec2& uv) const {
  return nearest_ ? nearest(map_.texels, map_.width, map_.height, uv) : bilinear(map_.texels, map_.width, map_.height, uv);
}

Rgb DirectionalMap::factor(const Vec3& world_direction) const {
  const Vec3 d = world_to_light_ * world_direction;
  if (kind_ == Kind::goniometric) {
    if (map_.empty()) return Rgb(1.f);
    if (equal_area_) {
      const Vec2 uv = equal_area_sphere_to_square(glm::normalize(Vec3(d.x, d.z, d.y)));
      return lookup(uv);
    }
    // y is up, and the azimuth runs from x to z.
    float azimuth = portable::atan2(d.z, d.x);
    if (azimuth < 0.f) azimuth += 2 * kPi;
    const float polar = portable::atan2(std::sqrt(d.x * d.x + d.z * d.z), d.y);
    return lookup({azimuth * 0.5f * kInvPi, polar * kInvPi});
  }
  constexpr float kNear = 1e-3f;  // pbrt's: nothing behind the light, or nearly beside it
  if (!(d.z >= kNear)) return Rgb(0.f);
  const Vec2 at = Vec2(d) / (d.z * tangent_);
  if (!(std::fabs(at.x) <= screen_.x && std::fabs(at.y) <= screen_.y)) return Rgb(0.f);
  if (map_.empty()) return Rgb(1.f);
  return lookup((at + screen_) / (2.f * screen_));
}

float DirectionalMap::cos_widest() const {
  if (kind_ == Kind::goniometric) return -1.f;
  return 1.f / std::sqrt(1.f + tangent_ * tangent_ * glm::dot(screen_, screen_));
}

Rgb mean(const LightMap& map) {
  if (map.empty()) return Rgb(1.f);
  glm::dvec3 sum(0);
  for (const Rgb& texel : map.texels) sum += glm::dvec3(texel);
  return Rgb(sum / static_cast<double>(map.texels.size()));
}

Rgb clamped(const LightMap& map, Vec2 uv) {
  if (!std::isfinite(uv.x) || !std::isfinite(uv.y)) uv = Vec2(0.f);
  const auto axis = [](float x, int size, int& low, int& high) {
    const float at = std::clamp(x, -1.f, 2.f) * static_cast<float>(size) - 0.5f, floor = std::floor(at);
    low = std::clamp(static_cast<int>(floor), 0, size - 1);
    high = std::clamp(static_cast<int>(floor) + 1, 0, size - 1);
    return at - floor;
  };
  int x0, x1, y0, y1;
  const float s = axis(uv.x, map.width, x0, x1), t = axis(1.f - uv.y, map.height, y0, y1);
  const auto texel = [&](int x, int y) { return map.texels[static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) + static_cast<std::size_t>(x)]; };
  return (texel(x0, y0) * (1.f - s) + texel(x1, y0) * s) * (1.f - t) + (texel(x0, y1) * (1.f - s) + texel(x1, y1) * s) * t;
}

}  // namespace cloudrenderer
