#include "shading/texture_image.h"

#include <algorithm>
#include <cstring>

#include "base/lanes.h"
#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

// Gaussian weights exp(-2 r^2) - exp(-2) of the squared radius in [0, 1).
constexpr int kWeights = 128;
constexpr Ints8 kEight = {0, 1, 2, 3, 4, 5, 6, 7};
std::array<float, kWeights> make_weights() {
  std::array<float, kWeights> w{};
  const float edge = portable::exp(-2.f);
  for (std::size_t i = 0; i < kWeights; ++i)
    w[i] = portable::exp(-2.f * static_cast<float>(i) / (kWeights - 1)) - edge;
  return w;
}

// Red, green, blue and whatever follows.
using lanes::Color4;
Color4 all(float x) { return Color4{x, x, x, x}; }
Rgb rgb(Color4 c) { return {c[0], c[1], c[2]}; }

// Inside, or false for black. Positions are small integers: callers have bounded them.
bool wrap_index(int& i, int n, WrapMode wrap) {
  if (static_cast<unsigned>(i) < static_cast<unsigned>(n)) return true;
  if (wrap == WrapMode::black) return false;
  if (wrap == WrapMode::clamp) {
    i = i < 0 ? 0 : n - 1;
  } else {
    i %= n;
    if (i < 0) i += n;
  }
  return true;
}

// Moves st near the image, so that its texel index fits an integer. False when it is no number.
bool bring_near(Vec2& st, WrapMode wrap) {
  for (int i = 0; i < 2; ++i) {
    if (!std::isfinite(st[i])) return false;
    st[i] = wrap == WrapMode::repeat ? st[i] - std::floor(st[i]) : std::clamp(st[i], -1.f, 2.f);
  }
  return true;
}

}  // namespace

bool is_file_of(std::string_view path, std::initializer_list<std::string_view> endings) {
  const auto same = [](char end, char c) { return (c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c) == end; };
  return std::ranges::any_of(endings, [&](std::string_view end) {
    return end.size() <= path.size() && std::ranges::equal(end, path.substr(path.size() - end.size()), same);
  });
}

float ImageEncoding::decode(float x) const {
  if (invert) {
    ImageEncoding straight = *this;
    straight.invert = false;
    return std::max(0.f, 1.f - straight.decode(x));
  }
  if (srgb)
    return scale * (x <= 0.04045f ? x / 12.92f : portable::pow((x + 0.055f) / 1.055f, 2.4f));
  const float v = scale * x;
  return gamma == 1.f ? v : portable::pow(std::max(v, 0.f), gamma);
}

template <class Fn>
auto ImagePyramid::with_texels(const Level& level, Fn f) const {
  const std::byte* const base = texels_ + level.offset;
  const bool grey = channels_ == 1;
  switch (level.format) {
    case Format::byte: {
      const auto value = [this, base](std::size_t k) { return decode_[std::to_integer<std::size_t>(base[k])]; };
      if (grey) return f([value](std::size_t i) { return all(value(i)); });
      return f([value](std::size_t i) { return Color4{value(3 * i), value(3 * i + 1), value(3 * i + 2), 0}; });
    }
    case Format::half:
      if (grey) return f([base](std::size_t i) { return all(lanes::load_halves(base + 2 * i)[0]); });
      return f([base](std::size_t i) { return lanes::load_halves(base + 6 * i); });
    case Format::real:
      break;
  }
  const auto load = [](const std::byte* from) {
    Color4 c;
    std::memcpy(&c, from, sizeof c);
    return c;
  };
  if (grey) return f([base, load](std::size_t i) { return all(load(base + 4 * i)[0]); });
  return f([base, load](std::size_t i) { return load(base + 12 * i); });
}

Rgb ImagePyramid::top() const {
  return with_texels(levels_.back(), [](auto texel) { return rgb(texel(0)); });
}

Rgb ImagePyramid::bilinear(int level, const Vec2& st, WrapMode wrap) const {
  const Level& l = levels_[static_cast<std::size_t>(level)];
  const float s = st.x * static_cast<float>(l.width) - 0.5f,
              t = st.y * static_cast<float>(l.height) - 0.5f;
  const float fs = std::floor(s), ft = std::floor(t), ds = s - fs, dt = t - ft;
  int x0 = static_cast<int>(fs), y0 = static_cast<int>(ft), x1 = x0 + 1, y1 = y0 + 1;
  const bool in_x0 = wrap_index(x0, l.width, wrap), in_x1 = wrap_index(x1, l.width, wrap);
  const bool in_y0 = wrap_index(y0, l.height, wrap), in_y1 = wrap_index(y1, l.height, wrap);
  return with_texels(l, [&](auto texel) {
    const auto at = [&](bool inside, int x, int y) {
      return inside ? texel(static_cast<std::size_t>(y) * static_cast<std::size_t>(l.width) + static_cast<std::size_t>(x)) : Color4{};
    };
    return rgb((1.f - dt) * ((1.f - ds) * at(in_x0 && in_y0, x0, y0) + ds * at(in_x1 && in_y0, x1, y0)) +
               dt * ((1.f - ds) * at(in_x0 && in_y1, x0, y1) + ds * at(in_x1 && in_y1, x1, y1)));
  });
}

void ImagePyramid::prefetch(Vec2 st, WrapMode wrap) const {
  if (!bring_near(st, wrap)) return;
  const Level& l = levels_.front();
  const auto size = static_cast<std::size_t>(channels_) * (l.format == Format::byte ? 1 : l.format == Format::half ? 2 : 4);
  int x = static_cast<int>(st.x * static_cast<float>(l.width) - 0.5f), y = static_cast<int>(st.y * static_cast<float>(l.height) - 0.5f);
  x = std::clamp(x, 0, l.width - 1);
  for (const int row : {y, y + 1}) {
    const auto first = static_cast<std::size_t>(std::clamp(row, 0, l.height - 1)) * static_cast<std::size_t>(l.width);
    __builtin_prefetch(texels_ + l.offset + (first + static_cast<std::size_t>(x)) * size);
  }
}

Rgb ImagePyramid::trilinear(const Vec2& st, float width, WrapMode wrap) const {
  const int last = level_count() - 1;
  const float size = static_cast<float>(std::max(levels_[0].width, levels_[0].height));
  const float lod = portable::log2(std::max(width * size, 1e-8f));
  if (!(lod > 0.f)) return bilinear(0, st, wrap);
  if (lod >= static_cast<float>(last)) return top();
  const int low = static_cast<int>(lod);
  const float f = lod - static_cast<float>(low);
  return (1.f - f) * bilinear(low, st, wrap) + f * bilinear(low + 1, st, wrap);
}

Rgb ImagePyramid::one_level(const Vec2& st, float width, const ImageFilter& filter) const {
  const float size = static_cast<float>(std::max(levels_[0].width, levels_[0].height));
  const float lod = portable::log2(std::max(width * size, 1e-8f));
  if (lod >= static_cast<float>(level_count() - 1)) return top();
  const int level = lod > 0.f ? static_cast<int>(lod) : 0;
  if (filter.kind == ImageFilter::Kind::bilinear) return bilinear(level, st, filter.wrap);
  // The middle of a texel is that texel alone.
  const Level& l = levels_[static_cast<std::size_t>(level)];
  const Vec2 texels(static_cast<float>(l.width), static_cast<float>(l.height));
  return bilinear(level, (glm::round(st * texels - 0.5f) + 0.5f) / texels, filter.wrap);
}

Rgb ImagePyramid::ellipse(int level, Vec2 st, Vec2 d0, Vec2 d1, WrapMode wrap) const {
  if (level >= level_count()) return top();
  static const std::array<float, kWeights> kWeight = make_weights();
  const Level& l = levels_[static_cast<std::size_t>(level)];
  const Vec2 size(static_cast<float>(l.width), static_cast<float>(l.height));
  const Vec2 middle = st * size - 0.5f;
  d0 *= size;
  d1 *= size;
  // Implicit ellipse a s^2 + b s t + c t^2 < f, widened by one texel so that it never misses all
  // centres.
  const float a = d0.y * d0.y + d1.y * d1.y + 1.f, b = -2.f * (d0.x * d0.y + d1.x * d1.y);
  const float c = d0.x * d0.x + d1.x * d1.x + 1.f;
  const float f = a * c - 0.25f * b * b;
  if (!(f > 0.f) || !std::isfinite(f)) return bilinear(level, st, wrap);
  const float inverse = 1.f / f, half_s = std::sqrt(c), half_t = std::sqrt(a);
  const int s0 = static_cast<int>(std::ceil(middle.x - half_s)),
            s1 = static_cast<int>(std::floor(middle.x + half_s));
  const int t0 = static_cast<int>(std::ceil(middle.y - half_t)),
            t1 = static_cast<int>(std::floor(middle.y + half_t));
  Color4 sum{};
  float weights = 0.f;
  const bool wraps = s0 < 0 || s1 >= l.width;
  with_texels(l, [&](auto texel) {
    for (int t = t0; t <= t1; ++t) {
      const float y = static_cast<float>(t) - middle.y;
      int row = t;
      const bool black = !wrap_index(row, l.height, wrap);
      const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(l.width);
      for (int left = s0; left <= s1; left += static_cast<int>(kLanes)) {
        const Float8 x = lanes::to_float(left + kEight) - middle.x, r2 = ((a * x + b * y) * x + c * y * y) * inverse;
        // The last weight is 0: no branch that nobody can foresee.
        const Float8 w8 = lanes::lookup(kWeight.data(), lanes::to_int(lanes::select(r2 < 1.f, r2 * kWeights, Float8(kWeights - 1))));
        const int right = std::min(s1, left + static_cast<int>(kLanes) - 1);
        for (int k = left; k <= right; ++k) {
          const float w = w8.v[k - left];
          weights += w;
          int column = k;
          if (black || (wraps && !wrap_index(column, l.width, wrap))) continue;
          sum += w * texel(first + static_cast<std::size_t>(column));
        }
      }
    }
  });
  return weights > 0.f ? rgb(sum) / weights : bilinear(level, st, wrap);
}

Rgb ImagePyramid::lookup(const Vec2& st_in, const Vec2& dst0, const Vec2& dst1,
                         const ImageFilter& filter) const {
  Vec2 st = st_in, major = dst0, minor = dst1;
  if (!bring_near(st, filter.wrap)) return Rgb(0.f);
  const auto bounded = [](Vec2& d) {
    if (!std::isfinite(d.x) || !std::isfinite(d.y)) d = Vec2(0.f);
    d = glm::clamp(d, Vec2(-1e4f), Vec2(1e4f));
  };
  bounded(major);
  bounded(minor);
  if (filter.kind != ImageFilter::Kind::ellipse) {
    const Vec2 m = glm::max(glm::abs(major), glm::abs(minor));
    const float width = filter.widths * std::max(m.x, m.y);
    return filter.kind == ImageFilter::Kind::trilinear ? trilinear(st, width, filter.wrap) : one_level(st, width, filter);
  }
  if (glm::dot(major, major) < glm::dot(minor, minor)) std::swap(major, minor);
  const float longest = glm::length(major);
  float shortest = glm::length(minor);
  if (shortest * filter.max_anisotropy < longest && shortest > 0.f) {
    const float widen = longest / (shortest * filter.max_anisotropy);
    minor *= widen;
    shortest *= widen;
  }
  if (shortest == 0.f) return bilinear(0, st, filter.wrap);
  const float size = static_cast<float>(std::max(levels_[0].width, levels_[0].height));
  const float lod = std::max(0.f, portable::log2(std::max(shortest * size, 1e-8f)));
  if (lod >= static_cast<float>(level_count() - 1)) return top();
  const int low = static_cast<int>(lod);
  const float f = lod - static_cast<float>(low);
  if (f == 0.f) return ellipse(low, st, major, minor, filter.wrap);
  return (1.f - f) * ellipse(low, st, major, minor, filter.wrap) +
         f * ellipse(low + 1, st, major, minor, filter.wrap);
}

}  // namespace cloudrenderer
