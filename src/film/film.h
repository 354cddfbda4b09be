#pragma once
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "base/error.h"
#include "base/log.h"
#include "cloudrenderer/math.h"
#include "scene/color_space.h"
#include "scene/description.h"

namespace cloudrenderer {

__extension__ typedef __int128 Int128;

// Radiance in fixed point: units of 2^-k, k fixed per job. Sums do not depend on their order.
using Fixed3 = std::array<std::int64_t, 3>;

// Rounds a contribution once to fixed point. Out-of-range values are clamped to +-2^62 and
// `clamped` is set. The input is finite.
// `units`: fixed_units(k).
inline std::int64_t quantise(float c, double units, bool& clamped) {
  constexpr double kLimit = 0x1p62;
  double v = static_cast<double>(c) * units;  // exact: only the exponent changes
  if (!(std::fabs(v) <= kLimit)) {
    v = v < 0 ? -kLimit : kLimit;
    clamped = true;
  }
  return std::llrint(v);  // ties to even: the default mode, which nothing here changes
}
inline Fixed3 quantise(const Rgb& c, double units, bool& clamped) {
  return {quantise(c.x, units, clamped), quantise(c.y, units, clamped), quantise(c.z, units, clamped)};
}
// 2^k
double fixed_units(int k);

// Of a pixel filter, over its whole integral: the integral of what is above zero, and of what is below, both without sign.
// Samples of negative lobes (mitchell, sinc) are summed apart, and the pixel is `above` times the mean of the ones minus
// `below` times the mean of the others: of constant radiance it is that radiance, however the samples fall.
struct FilterLobes {
  double above = 1, below = 0;
  std::size_t sums_per_pixel() const { return below > 0 ? 2 : 1; }
  friend bool operator==(const FilterLobes&, const FilterLobes&) = default;
};

// What a pixel, or one kind of its filter's lobes, has got so far; half h holds the samples s with (s & 1) == h.
struct PixelSums {
  std::array<std::array<Int128, 3>, 2> sum{};
  std::array<std::uint32_t, 2> count{};
  void add(const Fixed3& v, std::uint32_t sample);
  void merge(const PixelSums& other);
};

// What paths from lights have brought to a pixel; half h holds those of samples s with (s & 1) == h.
struct Splat {
  std::uint32_t pixel = 0;  // y * full width + x
  std::array<std::array<Int128, 3>, 2> sum{};
  void add(const Fixed3& v, std::uint32_t sample);
  void merge(const Splat& other);
};

// The pixels that are rendered: the film's resolution and crop window, [x0, x1) x [y0, y1).
struct FilmFrame {
  std::uint32_t width = 0, height = 0;  // full resolution
  std::uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  std::uint32_t crop_width() const { return x1 - x0; }
  std::uint32_t crop_height() const { return y1 - y0; }
  std::uint64_t pixels() const { return std::uint64_t{crop_width()} * crop_height(); }
  friend bool operator==(const FilmFrame&, const FilmFrame&) = default;
};

struct FilmOptions {
  FilmFrame frame;
  std::string filename;                    // of the scene's Film directive
  float scale = 1;                         // v3 "scale"
  float max_sample_luminance = kInfinity;  // v3 "maxsampleluminance"
  float max_component = kInfinity;         // v4 "maxcomponentvalue": of XYZ times scale
  bool keeps_negative = false;             // v4; before it pixels are not below 0, which filters can make them
  std::optional<glm::mat3> balance;        // v4 "whitebalance": of the colours that are shown
  std::optional<ColorSpace> space;         // v4: of the picture's numbers; none: linear sRGB, which screens always get
};
// Reads `Film` with pbrt's rounding of crop windows (ceil). Throws SceneError.
FilmOptions film_options(const Entity& film, Dialect dialect, Warnings& warnings);

inline bool limits_samples(const FilmOptions& film) { return film.max_sample_luminance < kInfinity || film.max_component < kInfinity; }
// What a sample's radiance, all of it, is to be multiplied with because of these limits: at most 1. Negative radiance (of filters with
// negative lobes) is limited as much.
float sample_limit(const FilmOptions& film, const Rgb& radiance);

// A picture, linear RGB, row by row.
struct Image {
  std::uint32_t width = 0, height = 0;
  std::vector<Rgb> pixels;
  std::optional<ColorSpace> space = std::nullopt;  // none: sRGB
};

class Film;
// The picture that the scene's film asks for, and one of its pixels for a screen.
Image developed(const Film& film, const FilmOptions& options);
Rgb developed(const Film& film, std::size_t pixel, const FilmOptions& options);

// The whole film on the manager. Not thread-safe.
class Film {
 public:
  Film(const FilmFrame& frame, int k, const FilterLobes& lobes = {})
      : frame_(frame), k_(k), lobes_(lobes), sums_(frame.pixels() * lobes.sums_per_pixel()) {}
  const FilmFrame& frame() const { return frame_; }
  int k() const { return k_; }
  std::size_t sums_per_pixel() const { return lobes_.sums_per_pixel(); }
  // Whether pixel y * full width + x lies in the crop window.
  static bool holds(const FilmFrame& frame, std::uint32_t pixel) {
    const std::uint32_t x = pixel % frame.width, y = pixel / frame.width;
    return x >= frame.x0 && x < frame.x1 && y >= frame.y0 && y < frame.y1;
  }
  // Light of paths from lights; the pixel lies in the crop window.
  void add(const Splat& splat);
  // That so many samples, even and odd, have a path from a light too: their light is shared by all of the picture's samples.
  void count_light_paths(const std::array<std::uint64_t, 2>& samples) {
    for (std::size_t h = 0; h < 2; ++h) light_paths_[h] += samples[h];
  }
  // Of all pixels in their order, or empty where no light has come that way.
  std::span<const Splat> splats() const { return splats_; }
  // Full-resolution coordinates inside the crop window. Of samples in negative lobes, where the filter has some.
  PixelSums& at(std::uint32_t x, std::uint32_t y, bool negative = false) {
    return sums_[(std::size_t{y - frame_.y0} * frame_.crop_width() + (x - frame_.x0)) * sums_per_pixel() + (negative ? 1 : 0)];
  }
  // Row by row, sums_per_pixel() of each pixel: positive lobes first.
  std::span<PixelSums> sums() { return sums_; }
  std::span<const PixelSums> sums() const { return sums_; }
  // By the number of a pixel, row by row.
  std::uint32_t samples(std::size_t pixel) const { return samples(pixel, 0) + samples(pixel, 1); }
  std::uint32_t samples(std::size_t pixel, std::size_t half) const {
    if (sums_per_pixel() == 1) return sums_[pixel].count[half];
    return sums_[2 * pixel].count[half] + sums_[2 * pixel + 1].count[half];
  }
  // Times `unit`, radiance in one unit of fixed point. The pixel, or half, has samples.
  double mean(std::size_t pixel, std::size_t channel, double unit) const {
    const double seen = mean_by(pixel, unit, [channel](const PixelSums& s) { return s.sum[0][channel] + s.sum[1][channel]; },
                                [](const PixelSums& s) { return s.count[0] + s.count[1]; });
    if (splats_.empty()) return seen;
    const auto& sum = splats_[pixel].sum;
    return seen + brought(sum[0][channel] + sum[1][channel], light_paths_[0] + light_paths_[1], unit);
  }
  double mean(std::size_t pixel, std::size_t channel, double unit, std::size_t half) const {
    const double seen = mean_by(pixel, unit, [=](const PixelSums& s) { return s.sum[half][channel]; },
                                [half](const PixelSums& s) { return s.count[half]; });
    return splats_.empty() ? seen : seen + brought(splats_[pixel].sum[half][channel], light_paths_[half], unit);
  }
  Rgb colour(std::size_t pixel, float scale) const;  // as in image()
  Image image(float scale) const;  // mean * scale, rounded once; black where there are no samples
  // Estimated relMSE of image(): mean over pixels and channels of ((a-b)^2/4) / (m^2 + 0.01), a and
  // b the means of the two halves, m the median of the pixel's and its four neighbours' means, or
  // the smaller of a and b, or a fiftieth of the brightest neighbour (the edge of a light), whatever
  // is most: the true value that the error is relative to has no fireflies, the
  // pixel's mean has. Pixels without both halves are left out; 0 if there is none.
  //
  // [low, high] holds the true relMSE of this picture in at least 90 of 100 runs (tests/image:
  // confidence_test.py). With D = (a-b)/2 and S = (a+b)/2 - mu the estimate of a pixel is too large by
  // D^2 - S^2 = -(a-mu)(b-mu), whose variance is 4 s^4 for halves of variance 2 s^2 each, and E[D^4] is 3 s^4 or more:
  // so the variance is at most 4/3 of the mean of squared estimates, with fireflies too, which both D
  // and S have. What the error is relative to is uncertain as well: the interval covers that of a
  // second choice of m. For a thousand pixels or more; what no sample has found yet is in no estimate.
  struct ErrorEstimate {
    double relmse = 0, low = 0, high = 0;
    double trimmed = 0;  // without the worst 0.1 % of the pixels
  };
  enum class Looks { once, until_good };  // with until_good wider: the picture ends at the first good estimate
  ErrorEstimate estimated_error(float scale, Looks looks = Looks::once) const;
  double estimated_relmse(float scale) const { return estimated_error(scale).relmse; }
  std::vector<double> pixel_errors(float scale) const;  // of which relmse is the mean; -1: left out

 private:
  template <class Sum, class Count>
  double mean_by(std::size_t pixel, double unit, Sum sum, Count count) const {
    const auto one = [&](const PixelSums& s) { return static_cast<double>(sum(s)) * unit / static_cast<double>(count(s)); };
    if (sums_per_pixel() == 1) return one(sums_[pixel]);
    const PixelSums &above = sums_[2 * pixel], &below = sums_[2 * pixel + 1];
    // A kind of lobes without samples is taken as the other one.
    if (count(above) == 0) return one(below);
    return count(below) == 0 ? one(above) : lobes_.above * one(above) - lobes_.below * one(below);
  }

  // Each path from a light brings what it would to one pixel of a picture of its own.
  double brought(const Int128& sum, std::uint64_t paths, double unit) const {
    if (paths == 0) return 0;
    return static_cast<double>(sum) * unit * (static_cast<double>(frame_.pixels()) / static_cast<double>(paths));
  }

  FilmFrame frame_;
  int k_;
  FilterLobes lobes_;
  std::vector<PixelSums> sums_;
  std::vector<Splat> splats_;
  std::array<std::uint64_t, 2> light_paths_{};
};

// What an EXR carries beside R G B: a channel, row by row; 32 bit float, or 32 bit whole numbers.
struct ImageChannel {
  std::string name;  // "normal.X"
  std::variant<std::vector<float>, std::vector<std::uint32_t>> values;
};
// error.R, G, B: standard deviation of the pixel's mean, |a-b|/2; error.relmse: pixel_errors().
std::vector<ImageChannel> error_layer(const Film& film, float scale);
ImageChannel samples_layer(const Film& film);  // "samples": how many the pixel has got

// For the header of an EXR: words, and matrices by OpenEXR's convention (vectors are rows, row after
// row), which is glm's order of numbers.
struct ImageHeader {
  std::map<std::string, std::string> words;
  std::map<std::string, Mat4> matrices;
};

// Writes .exr (32 bit float; data and display window from the frame), .pfm (the same floats without a
// header's words), .png or .tga (sRGB, 8 bit), by file name; header and channels are for .exr only.
// Writes to a temporary name and renames. Throws std::runtime_error with the reason.
void write_image(const std::string& path, const Image& image, const FilmFrame& frame,
                 const ImageHeader& header = {}, std::span<const ImageChannel> channels = {});
bool is_image_name(const std::string& path);  // ends as write_image wants it
std::string image_extensions();               // ".exr, ... or .tga": for messages
// Reads R, G, B of an image file as linear floats. Throws std::runtime_error.
Image read_image(const std::string& path);

struct ImageDifference {
  double mse = 0, relmse = 0, relmse_trimmed = 0, psnr = 0, largest = 0;
  std::array<double, 3>
      mean_ratio{};  // a / b per channel, pixels that are saturated outliers in b left out
  bool identical = false;
};
// a against reference b. psnr is for a peak of 1, infinite for equal pictures; `identical` means
// the same bits. Throws std::runtime_error for different sizes or NaN/infinity in either; pixels
// that are not finite in the reference can be left out instead (pictures of other programs hold
// such).
ImageDifference compare_images(const Image& a, const Image& b,
                               bool ignore_nonfinite_reference = false);

}  // namespace cloudrenderer
