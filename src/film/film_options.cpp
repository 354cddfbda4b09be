#include <algorithm>
#include <cmath>
#include <filesystem>

#include "film/camera.h"
#include "film/film.h"
#include "film/white_balance.h"

namespace cloudrenderer {
namespace {

constexpr int kMaxResolution = 1 << 16;

std::uint32_t resolution(const Entity& film, const char* name, int otherwise) {
  const int n = film.params.integer(name, otherwise);
  if (n < 1 || n > kMaxResolution)
    throw SceneError{film.location, std::string(name) + " must be between 1 and " +
                                        std::to_string(kMaxResolution) + ", got " +
                                        std::to_string(n)};
  return static_cast<std::uint32_t>(n);
}

// pbrt rounds both ends of the window up; a window without a pixel gets one.
void crop(std::uint32_t size, float from, float to, std::uint32_t& begin, std::uint32_t& end) {
  from = std::clamp(from, 0.f, 1.f);
  to = std::clamp(to, 0.f, 1.f);
  if (to < from) std::swap(from, to);
  begin =
      std::min(static_cast<std::uint32_t>(std::ceil(static_cast<float>(size) * from)), size - 1);
  end = std::clamp(static_cast<std::uint32_t>(std::ceil(static_cast<float>(size) * to)), begin + 1,
                   size);
}

Rgb shown(Rgb c, const FilmOptions& options) {
  if (options.balance) c = *options.balance * c;
  return options.keeps_negative ? c : glm::max(c, Rgb(0.f));
}

}  // namespace

FilmOptions film_options(const Entity& film, Dialect dialect, Warnings& warnings) {
  const bool v3 = dialect == Dialect::v3;
  const ParamSet& params = film.params;
  if (!film.type.empty() && film.type != "image")
    warnings.add(film.location, "film " + film.type + " is unknown, image is used");

  FilmOptions out;
  FilmFrame& f = out.frame;
  f.width = resolution(film, "xresolution", v3 ? 1280 : 640);
  f.height = resolution(film, "yresolution", v3 ? 720 : 480);
  if (std::uint64_t{f.width} * f.height >= std::uint64_t{1} << 32)
    throw SceneError{film.location, "the film must have fewer than 2^32 pixels"};

  float window[4] = {0, 1, 0, 1};
  if (const BulkArray<float> given = params.reals("cropwindow"); given.size() == 4) {
    std::copy(given.begin(), given.end(), window);
    for (const float w : window)
      if (!std::isfinite(w)) throw SceneError{film.location, "cropwindow must be finite"};
  } else if (!given.empty()) {
    warnings.add(film.location, "cropwindow must have 4 values, got " + std::to_string(given.size()) + ": ignored, as in pbrt");
  }
  crop(f.width, window[0], window[1], f.x0, f.x1);
  crop(f.height, window[2], window[3], f.y0, f.y1);

  out.filename = params.string("filename", "pbrt.exr");
  if (!is_image_name(out.filename)) {
    out.filename = std::filesystem::path(out.filename).replace_extension(".exr").string();
    warnings.add(film.location, "pictures are written as " + image_extensions() +
                                    ": the file name becomes " + out.filename);
  }
  if (v3) {
    out.scale = params.real("scale", 1.f);
    const auto limit = [&](const char* name) {
      const float v = params.real(name, kInfinity);
      if (v >= 0.f) return v;
      warnings.add(film.location, std::string(name) + " is below 0: ignored");
      return kInfinity;
    };
    out.max_sample_luminance = limit("maxsampleluminance");
    out.max_component = limit("maxcomponentvalue");
    if (const auto space = ColorSpace::find(params.string("colorspace", "srgb")); space && !space->is_working()) out.space = space;
    const std::array<float, 8> xy = out.space.value_or(ColorSpace()).chromaticities();
    const Vec2 white(xy[6], xy[7]);
    if (const float kelvin = params.real("whitebalance", 0.f); kelvin > 0.f) {
      if (kelvin >= 1000.f && kelvin <= 25000.f)
        out.balance = white_balance(kelvin, white);
      else
        warnings.add(film.location, "whitebalance must be between 1000 and 25000 kelvin: ignored");
    }
    out.keeps_negative = params.boolean("keepsnegative", false);
    film_diagonal(film);  // the camera reads it
  }
  params.boolean("display", false);
  params.report_unused("Film \"" + film.type + "\"", warnings);
  return out;
}

Image developed(const Film& film, const FilmOptions& options) {
  Image image = film.image(options.scale);
  for (Rgb& c : image.pixels) c = shown(c, options);
  image.space = options.space;
  if (options.space)
    for (const glm::mat3 to_space = options.space->from_working(); Rgb& c : image.pixels) c = to_space * c;
  return image;
}

Rgb developed(const Film& film, std::size_t pixel, const FilmOptions& options) { return shown(film.colour(pixel, options.scale), options); }

float sample_limit(const FilmOptions& film, const Rgb& radiance) {
  const float sign = luminance(radiance) < 0.f ? -1.f : 1.f;  // of the filter
  const Rgb c = radiance * sign;
  const float y_limit = luminance(c) > film.max_sample_luminance ? film.max_sample_luminance / luminance(c) : 1.f;
  // XYZ of linear sRGB (IEC 61966-2-1).
  const float x = 0.412391f * c.x + 0.357584f * c.y + 0.180481f * c.z, y = 0.212639f * c.x + 0.715169f * c.y + 0.072192f * c.z,
              z = 0.019331f * c.x + 0.119195f * c.y + 0.950532f * c.z;
  const float largest = std::max(x, std::max(y, z)) * film.scale;
  return std::min(y_limit, largest > film.max_component ? film.max_component / largest : 1.f);
}

}  // namespace cloudrenderer
