// From a file to a pyramid.
#include <Imath/half.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <optional>

#include "images/images.h"
#include "scene/color_space.h"
#include "shading/texture_image.h"

namespace cloudrenderer {
namespace {

struct Pixels {
  int width = 0, height = 0, channels = 1;  // 1, 3 or 4
  std::optional<ColorSpace> space;  // that the file names
  bool bytes = false;
  std::vector<std::byte> byte;  // as stored in the file
  float unit(std::size_t i) const { return static_cast<float>(std::to_integer<int>(byte[i])) / 255.f; }
  std::vector<float> real;
  std::size_t row() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(channels);
  }
};

std::unique_ptr<ImageReader> open_texture(const std::string& path, const FileLocation& where) {
  std::string why;
  std::unique_ptr<ImageReader> file = open_image(path, true, why);  // colours as stored: pbrt ignores alpha
  if (!file) throw SceneError(where, "cannot read texture image \"" + path + "\": " + why);
  const ImageInfo& info = file->info();
  if (info.width <= 0 || info.height <= 0 || info.depth > 1)
    throw SceneError(where, "texture image \"" + path + "\" is not a 2D image");
  return file;
}

// Numbers of all levels behind the first.
std::size_t smaller_levels(int w, int h, int channels) {
  std::size_t sum = 0;
  while (w > 1 || h > 1) {
    w = std::max(1, w / 2);
    h = std::max(1, h / 2);
    sum += static_cast<std::size_t>(w) * static_cast<std::size_t>(h) * static_cast<std::size_t>(channels);
  }
  return sum;
}

Pixels read_pixels(const std::string& path, bool alpha, const FileLocation& where) {
  const auto file = open_texture(path, where);
  const ImageInfo& info = file->info();
  Pixels p;
  p.width = info.width;
  p.height = info.height;
  if (info.chromaticities) p.space = ColorSpace::find(*info.chromaticities);
  p.channels = alpha && info.alpha == 3 ? 4 : info.channels >= 3 ? 3 : 1;
  p.bytes = info.bytes;
  const std::size_t count = p.row() * static_cast<std::size_t>(p.height);
  std::string why;
  bool read = false;
  if (p.bytes) {
    p.byte.reserve(count + 2 * smaller_levels(p.width, p.height, p.channels) + ImagePyramid::kPadding);
    p.byte.resize(count);
    read = file->read(p.channels, reinterpret_cast<std::uint8_t*>(p.byte.data()), why);
  } else {
    p.real.resize(count);
    read = file->read(p.channels, p.real.data(), why);
  }
  if (!read) throw SceneError(where, "cannot read texture image \"" + path + "\": " + why);
  return p;
}

template <class T>
void flip_rows(std::vector<T>& v, std::size_t row) {
  const std::size_t rows = v.size() / row;
  for (std::size_t y = 0; y < rows / 2; ++y)
    std::swap_ranges(v.begin() + static_cast<std::ptrdiff_t>(y * row),
                     v.begin() + static_cast<std::ptrdiff_t>((y + 1) * row),
                     v.begin() + static_cast<std::ptrdiff_t>((rows - 1 - y) * row));
}

bool is_grey(const std::vector<std::byte>& v) {
  for (std::size_t i = 0; i + 2 < v.size(); i += 3)
    if (v[i] != v[i + 1] || v[i] != v[i + 2]) return false;
  return true;
}

// Colours to one value a texel; bytes stay bytes when they are grey.
void to_luminance(Pixels& p) {
  if (p.channels == 1) return;
  const std::size_t n = (p.bytes ? p.byte.size() : p.real.size()) / 3;
  p.channels = 1;
  if (p.bytes && is_grey(p.byte)) {
    for (std::size_t i = 0; i < n; ++i) p.byte[i] = p.byte[3 * i];
    p.byte.resize(n);
    return;
  }
  std::vector<float> out(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Rgb c = p.bytes ? Rgb(p.unit(3 * i), p.unit(3 * i + 1), p.unit(3 * i + 2))
                          : Rgb(p.real[3 * i], p.real[3 * i + 1], p.real[3 * i + 2]);
    out[i] = luminance(c);
  }
  p.real = std::move(out);
  p.byte = {};
  p.bytes = false;
}

// See ImageEncoding::mean. The values are decoded then.
bool to_mean(Pixels& p, const ImageEncoding& encoding) {
  if (p.channels == 1) return false;
  const auto channels = static_cast<std::size_t>(p.channels);
  const std::size_t n = (p.bytes ? p.byte.size() : p.real.size()) / channels;
  const auto value = [&](std::size_t i, std::size_t c) {
    return p.bytes ? p.unit(channels * i + c) : p.real[channels * i + c];
  };
  bool masked = false;
  for (std::size_t i = 0; channels == 4 && i < n; ++i) masked = masked || value(i, 3) != 1.f;
  std::vector<float> out(n);
  for (std::size_t i = 0; i < n; ++i) {
    const auto decoded = [&](std::size_t c) {
      const float v = value(i, c);
      return std::isfinite(v) ? encoding.decode(v) : 0.f;
    };
    out[i] = masked ? decoded(3) : (decoded(0) + decoded(1) + decoded(2)) * (1.f / 3.f);
  }
  p.channels = 1;
  p.real = std::move(out);
  p.byte = {};
  p.bytes = false;
  return true;
}

// The mean over the covered area: halves each side, rounding down, at least 1. row(y) gives a row of the larger level, valid
// until the one three rows further down is asked for.
template <class Row>
std::vector<float> shrink(Row row, int w, int h, int channels, int out_w, int out_h) {
  const auto ch = static_cast<std::size_t>(channels);
  const auto axis = [](int from,
                       int to) {  // for each output: first input and weights of up to three
    std::vector<std::pair<int, std::array<float, 3>>> taps;
    for (int i = 0; i < to; ++i) {
      const float a = static_cast<float>(i) * static_cast<float>(from) / static_cast<float>(to);
      const float b = static_cast<float>(i + 1) * static_cast<float>(from) / static_cast<float>(to);
      const int first = std::min(static_cast<int>(a), from - 1);
      std::array<float, 3> weight{};
      float sum = 0;
      for (int k = 0; k < 3 && first + k < from; ++k) {
        const float lo = std::max(a, static_cast<float>(first + k)),
                    hi = std::min(b, static_cast<float>(first + k + 1));
        sum += weight[static_cast<std::size_t>(k)] = std::max(0.f, hi - lo);
      }
      for (float& x : weight) x /= sum;
      taps.emplace_back(first, weight);
    }
    return taps;
  };
  const auto xs = axis(w, out_w), ys = axis(h, out_h);
  std::vector<float> out(static_cast<std::size_t>(out_w) * static_cast<std::size_t>(out_h) * ch,
                         0.f);
  std::size_t o = 0;
  for (const auto& [y0, wy] : ys) {
    std::array<const float*, 3> in{};
    for (std::size_t j = 0; j < 3; ++j)
      if (wy[j] != 0.f) in[j] = row(y0 + static_cast<int>(j));
    for (const auto& [x0, wx] : xs) {
      for (std::size_t j = 0; j < 3; ++j)
        for (std::size_t i = 0; i < 3; ++i) {
          const float weight = wy[j] * wx[i];
          if (weight == 0.f) continue;
          const float* const at = in[j] + (static_cast<std::size_t>(x0) + i) * ch;
          for (std::size_t c = 0; c < ch; ++c) out[o + c] += weight * at[c];
        }
      o += ch;
    }
  }
  return out;
}

// Rows of a picture of bytes as numbers, the last three of them kept.
class DecodedRows {
 public:
  DecodedRows(const std::byte* texels, std::size_t row, const std::array<float, 256>& decode) : texels_(texels), row_(row), decode_(decode) {
    for (std::vector<float>& r : rows_) r.resize(row);
  }
  const float* operator()(int y) {
    const auto slot = static_cast<std::size_t>(y % 3);
    std::vector<float>& out = rows_[slot];
    if (which_[slot] == y) return out.data();
    which_[slot] = y;
    const std::byte* const in = texels_ + static_cast<std::size_t>(y) * row_;
    for (std::size_t i = 0; i < row_; ++i) out[i] = decode_[std::to_integer<std::size_t>(in[i])];
    return out.data();
  }

 private:
  const std::byte* texels_;
  std::size_t row_;
  const std::array<float, 256>& decode_;
  std::array<std::vector<float>, 3> rows_;
  std::array<int, 3> which_{-1, -1, -1};
};

bool fits_half(float x) { return std::fabs(x) <= 65504.f; }

void append(std::vector<std::byte>& out, const std::vector<float>& v, bool half) {
  const std::size_t at = out.size();
  out.resize(at + v.size() * (half ? 2 : 4));
  if (!half) {
    std::memcpy(out.data() + at, v.data(), v.size() * 4);
    return;
  }
  for (std::size_t i = 0; i < v.size(); ++i) {
    const std::uint16_t bits = Imath::half(v[i]).bits();
    std::memcpy(out.data() + at + 2 * i, &bits, 2);
  }
}

}  // namespace

const ImagePyramid* ImageStore::get(const std::string& path, const ImageEncoding& encoding,
                                    const FileLocation& where) {
  auto& slot = images_[{path, encoding}];
  if (slot) return slot.get();
  if (!read_) {
    open_texture(path, where);
    slot = std::make_unique<ImagePyramid>();
    return slot.get();
  }
  Pixels p = read_pixels(path, encoding.mean && encoding.masks, where);
  const bool decoded = encoding.mean && to_mean(p, encoding);
  if (encoding.luminance) to_luminance(p);
  if (encoding.primaries && p.channels == 3 && !p.bytes && p.space && !p.space->is_working())
    for (std::size_t i = 0; i + 2 < p.real.size(); i += 3) {
      const Rgb c = p.space->to_working({p.real[i], p.real[i + 1], p.real[i + 2]});
      for (int k = 0; k < 3; ++k) p.real[i + static_cast<std::size_t>(k)] = c[k];
    }
  if (encoding.flip) p.bytes ? flip_rows(p.byte, p.row()) : flip_rows(p.real, p.row());

  auto pyramid = std::make_unique<ImagePyramid>();
  pyramid->channels_ = p.channels;
  std::vector<std::byte>& texels = pyramid->resident_;
  const std::size_t behind = smaller_levels(p.width, p.height, p.channels);
  int w = p.width, h = p.height;
  std::vector<float> level;  // that is finished last; of bytes from the second on
  bool half = true;
  if (p.bytes) {
    for (std::size_t i = 0; i < 256; ++i) pyramid->decode_[i] = encoding.decode(static_cast<float>(i) / 255.f);
    for (const std::byte b : p.byte) half = half && fits_half(pyramid->decode_[std::to_integer<std::size_t>(b)]);
    texels = std::move(p.byte);
    texels.reserve(texels.size() + behind * (half ? 2 : 4) + ImagePyramid::kPadding);
  } else {
    level = std::move(p.real);
    for (float& x : level) x = decoded ? x : std::isfinite(x) ? encoding.decode(x) : 0.f;
    half = std::ranges::all_of(level, fits_half);
    texels.reserve((level.size() + behind) * (half ? 2 : 4) + ImagePyramid::kPadding);
  }
  // Means of values that fit do fit.
  const auto format = half ? ImagePyramid::Format::half : ImagePyramid::Format::real;
  pyramid->levels_.push_back({w, h, p.bytes ? ImagePyramid::Format::byte : format, 0});
  if (!p.bytes) append(texels, level, half);
  while (w > 1 || h > 1) {
    const int next_w = std::max(1, w / 2), next_h = std::max(1, h / 2);
    const std::size_t row = static_cast<std::size_t>(w) * static_cast<std::size_t>(p.channels);
    if (level.empty())
      level = shrink(DecodedRows(texels.data(), row, pyramid->decode_), w, h, p.channels, next_w, next_h);
    else
      level = shrink([&](int y) { return level.data() + static_cast<std::size_t>(y) * row; }, w, h, p.channels, next_w, next_h);
    w = next_w;
    h = next_h;
    pyramid->levels_.push_back({w, h, format, texels.size()});
    append(texels, level, half);
  }
  texels.resize(texels.size() + ImagePyramid::kPadding);
  if (resident_ + texels.size() <= budget_) {
    texels.shrink_to_fit();
    resident_ += texels.size();
    pyramid->texels_ = texels.data();
  } else {
    BulkWriter<std::byte> writer;
    writer.append(texels);
    pyramid->paged_ = writer.finish();
    pyramid->texels_ = pyramid->paged_.view().data();
    texels = {};
  }
  slot = std::move(pyramid);
  return slot.get();
}

}  // namespace cloudrenderer
