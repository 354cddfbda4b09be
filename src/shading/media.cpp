#include "shading/media.h"

#include <algorithm>
#include <cmath>

#include "base/portable_math.h"
#include "scene/spectrum.h"

namespace cloudrenderer {
namespace {

// A ray's way through a medium: the density along it in closed form, in double, since differences of large optical
// depths count.
class Stretch {
 public:
  Stretch(const Medium& m, const MediumRay& ray) {
    double far = static_cast<double>(ray.t_max);
    if (m.bounded) {
      const Vec3 o = m.world_to_medium.point(ray.origin), d = m.world_to_medium.vector(ray.direction);
      for (int i = 0; i < 3; ++i) {
        if (d[i] == 0.f) {
          if (!(o[i] >= m.low[i] && o[i] <= m.high[i])) far = -1;
          continue;
        }
        const double inverse = 1.0 / static_cast<double>(d[i]);
        double a = (static_cast<double>(m.low[i]) - static_cast<double>(o[i])) * inverse;
        double b = (static_cast<double>(m.high[i]) - static_cast<double>(o[i])) * inverse;
        if (a > b) std::swap(a, b);
        start_ = std::max(start_, a);
        far = std::min(far, b);
      }
      if (m.exponential) {
        const auto height = static_cast<double>(glm::dot(o - m.low, m.up));
        rate_ = static_cast<double>(m.b) * static_cast<double>(glm::dot(d, m.up));
        at_start_ = static_cast<double>(m.a) * portable::exp(-(static_cast<double>(m.b) * height + rate_ * start_));
      }
    }
    length_ = far > start_ ? far - start_ : 0;
  }

  bool empty() const { return length_ <= 0; }
  // Of the medium, in distances along the ray.
  double start() const { return start_; }
  double length() const { return length_; }
  double density(double t) const { return at_start_ * (rate_ == 0 ? 1 : portable::exp(-rate_ * (t - start_))); }
  // Integral of the density up to t.
  double depth(double t) const {
    const double s = std::min(t - start_, length_);
    if (!(s > 0)) return 0;
    const double x = rate_ * s;
    if (std::fabs(x) < 1e-3) return at_start_ * s * (1 - x * (1.0 / 2 - x * (1.0 / 6 - x * (1.0 / 24))));
    return at_start_ * s * ((1 - portable::exp(-x)) / x);
  }
  // Where the integral reaches `depth`; beyond the stretch: infinity.
  double inverse_depth(double depth) const {
    if (!(at_start_ > 0) || empty()) return static_cast<double>(kInfinity);
    const double straight = depth / at_start_, x = rate_ * straight;
    double s = straight;
    if (x >= 1) return static_cast<double>(kInfinity);
    if (std::fabs(x) >= 1e-4)
      s = -portable::log(1 - x) / rate_;
    else
      s = straight * (1 + x * (1.0 / 2 + x * (1.0 / 3)));
    return s < length_ ? start_ + s : static_cast<double>(kInfinity);
  }

 private:
  double start_ = 0, length_ = 0;
  double at_start_ = 1, rate_ = 0;  // density and how fast it decreases along the ray
};

// Optical depth of the media before t.
class OpticalDepth {
 public:
  // From `from` to t.
  void add(const Medium& m, const Stretch& s, double t, double from = 0) {
    const double depth = s.depth(t) - s.depth(from);
    for (int c = 0; c < 3; ++c)
      if (m.sigma_t[c] > 0.f) depth_[c] += static_cast<double>(m.sigma_t[c]) * depth;
  }
  Rgb transmittance() const { return attenuation(1); }
  Rgb inverse_transmittance() const { return attenuation(-1); }

 private:
  Rgb attenuation(double sign) const {
    Rgb out;
    for (int c = 0; c < 3; ++c) out[c] = portable::exp(-static_cast<float>(sign * depth_[c]));
    return out;
  }

  glm::dvec3 depth_{0.0};
};

Rgb transmittance_to(std::span<const Medium> media, const MediumRay& ray, double t) {
  OpticalDepth depth;
  for (const Medium& m : media) depth.add(m, Stretch(m, ray), t);
  return depth.transmittance();
}

float mean(const Rgb& c) { return (c.x + c.y + c.z) * (1.f / 3.f); }

Rgb coefficient(const MediumDesc& desc, const char* name, const Rgb& otherwise, float scale = 1) {
  const Rgb c = desc.params.rgb(name, otherwise) * scale;
  for (int i = 0; i < 3; ++i)
    if (!(c[i] >= 0.f && c[i] < kInfinity))
      throw SceneError{desc.location, std::string(name) + " of a medium must be finite and at least 0"};
  return c;
}

void set_box(const MediumDesc& desc, Medium& m) {
  const Vec3 a = desc.params.point3("p0", Vec3(0.f)), b = desc.params.point3("p1", Vec3(1.f));
  m.low = glm::min(a, b);
  m.high = glm::max(a, b);
  const Vec3 size = m.high - m.low;
  if (!(size.x > 0.f && size.y > 0.f && size.z > 0.f) || !is_finite(size))
    throw SceneError{desc.location, "the box of a medium, from p0 to p1, must have a volume"};
  m.bounded = true;
  m.world_to_medium = desc.medium_to_world.inverse();
}

void set_exponential(const MediumDesc& desc, Medium& m) {
  m.exponential = true;
  m.a = desc.params.real("a", 1.f);
  m.b = desc.params.real("b", 1.f);
  const Vec3 up = desc.params.vector3("updir", Vec3(0, 1, 0));
  const float length = glm::length(up);
  if (!(m.a >= 0.f && m.a < kInfinity) || !std::isfinite(m.b))
    throw SceneError{desc.location, "a of an exponential volume must be at least 0, a and b finite"};
  if (!(length > 0.f && length < kInfinity)) throw SceneError{desc.location, "updir must be a direction"};
  m.up = up / length;
}

// A light of pbrt-v4 that is given in its own units, and not by its luminance, counts times this: the integral of the
// observer's Y.
constexpr float kPhotometric = 106.856895f;

std::uint32_t channel_called(const MediumDesc& desc, std::string_view name) {
  const Param* channels = desc.params.find("channels");
  if (!channels || channels->type != ParamType::string) return kNoChannel;
  const auto found = std::find(channels->strings.begin(), channels->strings.end(), name);
  return found == channels->strings.end() ? kNoChannel : static_cast<std::uint32_t>(found - channels->strings.begin());
}

float light_scale(const MediumDesc& desc) {
  const float scale = desc.params.real("Lescale", 1.f);
  if (!(scale >= 0.f && scale < kInfinity)) throw SceneError{desc.location, "Lescale of a medium must be finite and at least 0"};
  return scale;
}

// pbrt-v4: what varies with the place.
void set_channels(const MediumDesc& desc, const Medium& m, GridMedium& grid) {
  if (desc.type == "rgbgrid") {
    const float scale = desc.params.real("scale", 1.f);
    if (!(scale >= 0.f && scale < kInfinity)) throw SceneError{desc.location, "scale of a medium must be finite and at least 0"};
    grid.event = grid.blocking = Rgb(scale);
    grid.scattering = channel_called(desc, "sigma_s");
    grid.radiance = channel_called(desc, "Le");
    if (grid.scattering != 3 || (grid.radiance != kNoChannel && grid.radiance != 6))
      throw SceneError{desc.location, "the channels of the grid are not those of an rgbgrid"};
    grid.emission = Rgb(light_scale(desc) * kPhotometric);
    return;
  }
  grid.temperature = channel_called(desc, "temperature");
  grid.strength = channel_called(desc, "strength");
  const float scale = grid.strength == kNoChannel ? light_scale(desc) : 1.f;
  const Rgb light = scale * (grid.temperature == kNoChannel ? m.radiance : Rgb(kPhotometric));
  for (int c = 0; c < 3; ++c)
    if (m.sigma_t[c] > 0.f) grid.emission[c] = light[c] * m.sigma_a[c] / m.sigma_t[c];
  if (desc.type == "uniformgrid" && grid.strength == kNoChannel && !is_black(grid.emission)) {
    grid.one_strength = true;
    grid.world_to_medium = desc.medium_to_world.inverse();
    grid.low = desc.params.point3("p0", Vec3(0.f));
    grid.size = desc.params.point3("p1", Vec3(1.f)) - grid.low;
  }
  if (grid.temperature == kNoChannel) return;
  grid.temperature_offset = desc.params.real("temperatureoffset", 0.f);
  grid.temperature_scale = desc.params.real("temperaturescale", 1.f);
}

// Of a medium's coefficients; the densities have been taken out of the description.
GridMedium make_grid(const MediumDesc& desc, const Medium& m) {
  for (const char* name : {"nx", "ny", "nz"}) desc.params.integer(name, 1);
  if (const Param* channels = desc.params.find("channels")) channels->used = true;
  for (const char* name : {"temperatureoffset", "temperaturescale", "Lescale"}) desc.params.real(name, 1.f);  // perhaps for nothing
  const Vec3 diagonal = desc.params.point3("p1", Vec3(1.f)) - desc.params.point3("p0", Vec3(0.f));
  GridMedium grid;
  grid.g = m.g;
  grid.blocking = m.sigma_t;
  for (int c = 0; c < 3; ++c) {
    if (m.sigma_t[c] > 0.f) {
      grid.event[c] = m.sigma_t[c];
      grid.albedo[c] = m.sigma_s[c] / m.sigma_t[c];
    } else if (m.emission[c] > 0.f) {
      grid.event[c] = 1.f / glm::length(diagonal);
    }
  }
  // A channel that only another one stops is stopped with it.
  const float largest = std::max(grid.event.x, std::max(grid.event.y, grid.event.z));
  for (int c = 0; c < 3; ++c)
    if (grid.event[c] == 0.f && is_black(m.sigma_t)) grid.event[c] = largest;
  for (int c = 0; c < 3; ++c)
    if (grid.event[c] > 0.f) grid.emission[c] = m.emission[c] / grid.event[c];
  if (desc.params.has("channels") || !is_black(m.radiance)) set_channels(desc, m, grid);
  return grid;
}

// The table of black_body(): even in the logarithm of the temperature.
constexpr float kColdest = 100.f, kHottest = 40000.f;
constexpr std::size_t kTemperatures = 1024;
float temperature_place(float kelvin) {
  static const float per_octave = static_cast<float>(kTemperatures - 1) / portable::log2(kHottest / kColdest);
  return portable::log2(std::clamp(kelvin, kColdest, kHottest) / kColdest) * per_octave;
}
std::vector<Rgb> black_bodies() {
  std::vector<Rgb> out;
  const double steps = static_cast<double>(portable::log2(kHottest / kColdest)) / static_cast<double>(kTemperatures - 1);
  for (std::size_t i = 0; i < kTemperatures; ++i)
    // Channels below 0, of reds that RGB does not have, are 0.
    out.push_back(glm::max(Rgb(0.f), blackbody_to_rgb(static_cast<double>(kColdest) * portable::exp(static_cast<double>(i) * steps * 0.6931471805599453), Dialect::v3)));
  return out;
}

Medium make_medium(const MediumDesc& desc, Dialect dialect, Warnings& warnings) {
  Medium m;
  const bool v2 = dialect == Dialect::v2;
  Rgb sigma_a(0.f), sigma_s(0.f);
  float scale = 1;
  if (!v2) {
    sigma_a = coefficient(desc, "default.sigma_a", {.0011f, .0024f, .014f});
    sigma_s = coefficient(desc, "default.sigma_s", {2.55f, 3.21f, 3.77f});
    const std::string preset = desc.params.string("preset", "");
    if (!preset.empty() && !find_measured_medium(preset, dialect, sigma_a, sigma_s))
      warnings.add(desc.location, "there is no measured medium \"" + preset + "\": the default is used");
    scale = desc.params.real("scale", 1.f);
  }
  m.sigma_a = coefficient(desc, "sigma_a", sigma_a, scale);
  m.sigma_s = coefficient(desc, "sigma_s", sigma_s, scale);
  m.sigma_t = m.sigma_a + m.sigma_s;
  m.gray = m.sigma_t.x == m.sigma_t.y && m.sigma_t.x == m.sigma_t.z;
  if (desc.type == "heterogeneous" && !m.gray)
    warnings.add(desc.location, "sigma_a + sigma_s differs between colours, of which pbrt-v3 takes red's for all: here each has its own");
  m.g = desc.params.real("g", 0.f);
  if (!(m.g > -1.f && m.g < 1.f))
    throw SceneError{desc.location, "g of a medium must lie between -1 and 1, got " + std::to_string(m.g)};
  if (v2) {
    m.emission = coefficient(desc, "Le", Rgb(0.f));
    set_box(desc, m);
  } else {
    m.radiance = coefficient(desc, "emission", Rgb(0.f));
  }
  if (is_grid(desc, dialect)) return m;
  if (v2 && desc.type == "exponential") {
    set_exponential(desc, m);
  } else if (desc.type != "homogeneous") {
    warnings.add(desc.location, "the medium \"" + desc.type + "\" is not supported; expected " +
                                    (v2 ? "homogeneous, exponential or volumegrid"
                                         : "homogeneous, heterogeneous, uniformgrid, rgbgrid, nanovdb or cloud") +
                                    ": left out");
    return {};
  }
  if (!v2) m.radiance *= light_scale(desc);
  desc.params.report_unused((v2 ? "Volume \"" : "MakeNamedMedium \"") + desc.type + "\"", warnings);
  return m;
}

}  // namespace

std::unique_ptr<const Media> Media::build(const SceneDescription& scene, Warnings& warnings) {
  if (scene.media.empty()) return nullptr;
  auto out = std::make_unique<Media>();
  out->all_ = scene.dialect == Dialect::v2;
  for (const MediumDesc& desc : scene.media) {
    Medium medium = make_medium(desc, scene.dialect, warnings);
    if (is_grid(desc, scene.dialect)) {
      out->grids_.resize(scene.media.size());
      GridMedium& grid = out->grids_[out->media_.size()] = make_grid(desc, medium);
      const Rgb& e = grid.event;
      out->chromatic_grids_ = out->chromatic_grids_ || e.x != e.y || e.x != e.z || grid.scattering != kNoChannel;
      if (grid.temperature != kNoChannel && out->black_body_.empty()) out->black_body_ = black_bodies();
      desc.params.report_unused("the density grid", warnings);
      medium = {};
    }
    out->media_.push_back(medium);
  }
  return out;
}

Rgb Media::black_body(float kelvin) const {
  if (!(kelvin > kColdest)) return Rgb(0.f);  // and NaN
  const float at = temperature_place(kelvin);
  const auto low = std::min(static_cast<std::size_t>(at), kTemperatures - 2);
  const float part = at - static_cast<float>(low);
  return (1.f - part) * black_body_[low] + part * black_body_[low + 1];
}

GridCollision Media::collision(const GridMedium& grid, std::span<const float> values, const Vec3& p) const {
  GridCollision out{grid.albedo, grid.emission};
  if (grid.one_strength) {
    const Vec3 at = (grid.world_to_medium.point(p) - grid.low) / grid.size;
    for (int a = 0; a < 3; ++a) out.emission *= std::max(0.f, 1.f - std::fabs(at[a] - 0.5f));
  }
  if (values.empty()) return out;
  const auto rgb = [&](std::uint32_t first) { return Rgb(values[first], values[first + 1], values[first + 2]); };
  if (grid.scattering != kNoChannel) {
    const Rgb t = rgb(0), s = rgb(grid.scattering);
    const Rgb light = grid.radiance == kNoChannel ? Rgb(0.f) : grid.emission * rgb(grid.radiance);
    for (int c = 0; c < 3; ++c) {
      out.albedo[c] = t[c] > 0.f ? std::min(s[c] / t[c], 1.f) : 0.f;
      out.emission[c] = light[c] * (1.f - out.albedo[c]);
    }
    return out;
  }
  if (grid.temperature != kNoChannel)
    out.emission *= black_body((values[grid.temperature] - grid.temperature_offset) * grid.temperature_scale);
  if (grid.strength != kNoChannel) out.emission *= std::max(0.f, values[grid.strength]);
  return out;
}

Rgb Media::transmittance(std::uint16_t medium, const MediumRay& ray) const {
  return transmittance_to(active(medium), ray, static_cast<double>(ray.t_max));
}

MediumSample Media::sample(std::uint16_t medium, const MediumRay& ray, const MediumNumbers& numbers) const {
  MediumSample out;
  const std::span<const Medium> media = active(medium);
  if (media.empty()) return out;
  bool gray = true;
  for (const Medium& m : media) gray = gray && m.gray;
  const int channel = gray ? 0 : std::min(2, static_cast<int>(numbers.channel() * 3.f));
  auto nearest = static_cast<double>(ray.t_max);
  const Medium* hit = nullptr;
  for (std::size_t i = 0; i < media.size(); ++i) {
    const float sigma = media[i].sigma_t[channel];
    if (!(sigma > 0.f)) continue;
    const double depth = -portable::log(1.0 - static_cast<double>(numbers.distance(i)));
    const double t = Stretch(media[i], ray).inverse_depth(depth / static_cast<double>(sigma));
    if (t < nearest) {
      nearest = t;
      hit = &media[i];
    }
  }
  out.collides = hit != nullptr;
  out.t = static_cast<float>(nearest);
  if (gray) {
    if (hit) {
      out.weight = hit->sigma_s / hit->sigma_t.x;
      out.emitted = hit->radiance * (hit->sigma_a / hit->sigma_t.x);
    }
  } else {
    const Rgb passed = transmittance_to(media, ray, nearest);
    // The density of the medium cancels.
    const float pdf = mean(hit ? hit->sigma_t * passed : passed);
    out.weight = pdf > 0.f ? (hit ? hit->sigma_s * passed : passed) / pdf : Rgb(0.f);
    if (hit && pdf > 0.f) out.emitted = hit->radiance * hit->sigma_a * passed / pdf;
  }
  if (hit) out.g = hit->g;
  return out;
}

Rgb Media::unmarched(const MediumRay& ray, float step, const MediumNumbers& numbers) const {
  double start = static_cast<double>(kInfinity), end = 0;
  for (const Medium& m : media_) {
    if (is_black(m.sigma_t)) continue;  // a grid, for one
    const Stretch s(m, ray);
    if (s.empty()) continue;
    start = std::min(start, s.start());
    end = std::max(end, s.start() + s.length());
  }
  if (!(start < end)) return Rgb(1.f);
  const double steps = std::ceil((end - start) / static_cast<double>(step));
  const double last = end - (1 - static_cast<double>(numbers.march())) * (end - start) / steps;
  OpticalDepth depth;
  for (const Medium& m : media_) depth.add(m, Stretch(m, ray), end, last);
  return depth.inverse_transmittance();
}

Rgb Media::emitted(std::uint16_t medium, const MediumRay& ray, const MediumNumbers& numbers) const {
  Rgb sum(0.f);
  const std::span<const Medium> media = active(medium);
  for (std::size_t i = 0; i < media.size(); ++i) {
    if (is_black(media[i].emission)) continue;
    const Stretch stretch(media[i], ray);
    if (stretch.empty()) continue;
    const double t = stretch.start() + static_cast<double>(numbers.emission(i)) * stretch.length();
    sum += media[i].emission * transmittance_to(media, ray, t) * static_cast<float>(stretch.density(t) * stretch.length());
  }
  return sum;
}

}  // namespace cloudrenderer
