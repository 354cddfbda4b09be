#include "shading/texture_image.h"

#include <Imath/half.h>

#include <cstring>

#include "base/portable_math.h"

namespace cloudrenderer {
namespace {

// Gaussian weights exp(-2 r^2) - exp(-2) of the squared radius in [0, 1).
constexpr int kWeights = 128;
std::array<float, kWeights> make_weights() {
  std::array<float, kWeights> w{};
  const float edge = portable::exp(-2.f);
  for (std::size_t i = 0; i < kWeights; ++i)
    w[i] = portable::exp(-2.f * static_cast<float>(i) / (kWeights - 1)) - edge;
  return w;
}

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

Rgb ImagePyramid::fetch(const Level& level, std::size_t index) const {
  const std::size_t i = index * static_cast<std::size_t>(channels_);
  const std::byte* base = texels_ + level.offset;
  const auto value = [&](std::size_t k) {
    switch (level.format) {
      case Format::byte:
        return decode_[std::to_integer<std::size_t>(base[k])];
      case Format::half: {
        std::uint16_t bits;
        std::memcpy(&bits, base + 2 * k, sizeof bits);
        Imath::half h;
        h.setBits(bits);
        return static_cast<float>(h);
      }
      case Format::real:
        break;
    }
    float v;
    std::memcpy(&v, base + 4 * k, sizeof v);
    return v;
  };
  if (channels_ == 1) return Rgb(value(i));
  return {value(i), value(i + 1), value(i + 2)};
}

Rgb ImagePyramid::texel(int level, int x, int y, WrapMode wrap) const {
  const Level& l = levels_[static_cast<std::size_t>(level)];
  if (!wrap_index(x, l.width, wrap) || !wrap_index(y, l.height, wrap)) return Rgb(0.f);
  return fetch(l, static_cast<std::size_t>(y) * static_cast<std::size_t>(l.width) +
                      static_cast<std::size_t>(x));
}

Rgb ImagePyramid::bilinear(int level, const Vec2& st, WrapMode wrap) const {
  const Level& l = levels_[static_cast<std::size_t>(level)];
  const float s = st.x * static_cast<float>(l.width) - 0.5f,
              t = st.y * static_cast<float>(l.height) - 0.5f;
  const float fs = std::floor(s), ft = std::floor(t), ds = s - fs, dt = t - ft;
  const int x = static_cast<int>(fs), y = static_cast<int>(ft);
  return (1.f - dt) * ((1.f - ds) * texel(level, x, y, wrap) + ds * texel(level, x + 1, y, wrap)) +
         dt * ((1.f - ds) * texel(level, x, y + 1, wrap) + ds * texel(level, x + 1, y + 1, wrap));
}

Rgb ImagePyramid::trilinear(const Vec2& st, float width, WrapMode wrap) const {
  const int last = level_count() - 1;
  const float size = static_cast<float>(std::max(levels_[0].width, levels_[0].height));
  const float lod = portable::log2(std::max(width * size, 1e-8f));
  if (!(lod > 0.f)) return bilinear(0, st, wrap);
  if (lod >= static_cast<float>(last)) return texel(last, 0, 0, wrap);
  const int low = static_cast<int>(lod);
  const float f = lod - static_cast<float>(low);
  return (1.f - f) * bilinear(low, st, wrap) + f * bilinear(low + 1, st, wrap);
}

Rgb ImagePyramid::ellipse(int level, Vec2 st, Vec2 d0, Vec2 d1, WrapMode wrap) const {
  if (level >= level_count()) return texel(level_count() - 1, 0, 0, wrap);
  static const std::array<float, kWeights> kWeight = make_weights();
  const Level& l = levels_[static_cast<std::size_t>(level)];
  const Vec2 size(static_cast<float>(l.width), static_cast<float>(l.height));
  const Vec2 middle = st * size - 0.5f;
  d0 *= size;
  d1 *= size;
  // Implicit ellipse A s^2 + B s t + C t^2 < 1, widened by one texel so that it never misses all
  // centres.
  float a = d0.y * d0.y + d1.y * d1.y + 1.f, b = -2.f * (d0.x * d0.y + d1.x * d1.y);
  float c = d0.x * d0.x + d1.x * d1.x + 1.f;
  const float f = a * c - 0.25f * b * b;
  if (!(f > 0.f) || !std::isfinite(f)) return bilinear(level, st, wrap);
  a /= f;
  b /= f;
  c /= f;
  const float det = 4.f * a * c - b * b, half_s = 2.f * std::sqrt(c / det),
              half_t = 2.f * std::sqrt(a / det);
  const int s0 = static_cast<int>(std::ceil(middle.x - half_s)),
            s1 = static_cast<int>(std::floor(middle.x + half_s));
  const int t0 = static_cast<int>(std::ceil(middle.y - half_t)),
            t1 = static_cast<int>(std::floor(middle.y + half_t));
  Rgb sum(0.f);
  float weights = 0.f;
  for (int t = t0; t <= t1; ++t) {
    const float y = static_cast<float>(t) - middle.y;
    for (int s = s0; s <= s1; ++s) {
      const float x = static_cast<float>(s) - middle.x, r2 = a * x * x + b * x * y + c * y * y;
      if (!(r2 < 1.f)) continue;
      const float w = kWeight[static_cast<std::size_t>(r2 * kWeights)];
      sum += w * texel(level, s, t, wrap);
      weights += w;
    }
  }
  return weights > 0.f ? sum / weights : bilinear(level, st, wrap);
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
  if (filter.trilinear) {
    const Vec2 m = glm::max(glm::abs(major), glm::abs(minor));
    return trilinear(st, std::max(m.x, m.y), filter.wrap);
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
  if (lod >= static_cast<float>(level_count() - 1))
    return texel(level_count() - 1, 0, 0, filter.wrap);
  const int low = static_cast<int>(lod);
  const float f = lod - static_cast<float>(low);
  if (f == 0.f) return ellipse(low, st, major, minor, filter.wrap);
  return (1.f - f) * ellipse(low, st, major, minor, filter.wrap) +
         f * ellipse(low + 1, st, major, minor, filter.wrap);
}

}  // namespace cloudrenderer
