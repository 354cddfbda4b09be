#include "shading/texture_mapping.h"

namespace cloudrenderer {
namespace {

// Integral from 0 to x of the function that is 0 on even unit intervals and 1 on odd ones.
float odd_integral(float x) {
  const float half = 0.5f * x, whole = std::floor(half);
  return whole + 2.f * std::max(half - whole - 0.5f, 0.f);
}

bool is_even(float sum_of_floors) {
  const float half = 0.5f * sum_of_floors;
  return half == std::floor(half);
}

template <class T>
class Checkerboard2D final : public Texture<T> {
 public:
  Checkerboard2D(const TextureMapping& mapping, const Textured<T>& even, const Textured<T>& odd,
                 bool filter)
      : mapping_(mapping), even_(even), odd_(odd), filter_(filter) {}

  T eval(const TexturePoint& at) const override {
    const TextureCoordinates c = mapping_(at);
    const Vec2 low = glm::floor(c.st);
    const bool even = is_even(low.x + low.y);
    if (filter_) {
      // A box of twice the largest derivative, integrated exactly.
      const Vec2 d = glm::max(glm::abs(c.dstdx), glm::abs(c.dstdy));
      const Vec2 from = c.st - d, to = c.st + d;
      if (glm::floor(from) != low || glm::floor(to) != low) {
        float odd = 0.5f;
        if (d.x <= 1.f && d.y <= 1.f) {
          const float s = share(from.x, to.x), t = share(from.y, to.y);
          odd = s + t - 2.f * s * t;
        }
        return (1.f - odd) * even_(at) + odd * odd_(at);
      }
    }
    return even ? even_(at) : odd_(at);
  }

 private:
  static float share(float from, float to) {
    if (to > from) return (odd_integral(to) - odd_integral(from)) / (to - from);
    return is_even(std::floor(from)) ? 0.f : 1.f;
  }

  TextureMapping mapping_;
  Textured<T> even_, odd_;
  bool filter_;
};

// The mean of the function that is 1 on even unit intervals and -1 on odd ones, weighed with a triangle that reaches from x - r
// to x + r: by its second integral, but where one border alone is in reach, in whose differences little would be left.
float mean_in_tent(float x, float r) {
  const float low = std::floor(x), sign = is_even(low) ? 1.f : -1.f;
  if (std::floor(x - r) == low && std::floor(x + r) == low) return sign;
  if (!(r < 1e6f)) return 0.f;
  if (r <= 0.5f) {
    const float beyond = std::max(0.f, 1.f - std::min(x - low, low + 1.f - x) / r);  // the other interval has half of its square
    return sign * (1.f - beyond * beyond);
  }
  const auto integral = [](float at) {
    const float half = 0.5f * at, y = half - std::floor(half) - 0.5f;
    return half + y * (1.f - 2.f * std::fabs(y));
  };
  const float in_period = x - 2.f * std::floor(0.5f * x);
  return (integral(in_period + r) - 2.f * integral(in_period) + integral(in_period - r)) / (r * r);
}

// pbrt-v4's: a triangle three times as wide as the largest derivative on each axis.
template <class T, class Mapping>
class CheckerboardTent final : public Texture<T> {
 public:
  CheckerboardTent(const Mapping& mapping, const Textured<T>& even, const Textured<T>& odd) : mapping_(mapping), even_(even), odd_(odd) {}
  T eval(const TexturePoint& at) const override {
    const float mean = mean_at(mapping_(at));
    if (mean == 1.f) return even_(at);
    if (mean == -1.f) return odd_(at);
    return (0.5f + 0.5f * mean) * even_(at) + (0.5f - 0.5f * mean) * odd_(at);
  }

 private:
  static float reach(float dx, float dy) { return 1.5f * std::max(std::fabs(dx), std::fabs(dy)); }
  static float mean_at(const TextureCoordinates& c) {
    return mean_in_tent(c.st.x, reach(c.dstdx.x, c.dstdy.x)) * mean_in_tent(c.st.y, reach(c.dstdx.y, c.dstdy.y));
  }
  static float mean_at(const SolidCoordinates& c) {
    float mean = 1;
    for (int i = 0; i < 3; ++i) mean *= mean_in_tent(c.p[i], reach(c.dpdx[i], c.dpdy[i]));
    return mean;
  }

  Mapping mapping_;
  Textured<T> even_, odd_;
};

template <class T>
class Checkerboard3D final : public Texture<T> {
 public:
  Checkerboard3D(const SolidMapping& mapping, const Textured<T>& even, const Textured<T>& odd)
      : mapping_(mapping), even_(even), odd_(odd) {}
  T eval(const TexturePoint& at) const override {
    const Vec3 low = glm::floor(mapping_(at).p);
    return is_even(low.x + low.y + low.z) ? even_(at) : odd_(at);
  }

 private:
  SolidMapping mapping_;
  Textured<T> even_, odd_;
};

}  // namespace

template <class T>
MadeTexture<T> make_checkerboard_texture(TextureInputs& in) {
  const Textured<T> even = in.params.value<T>("tex1", 1.f), odd = in.params.value<T>("tex2", 0.f);
  const int dimension = in.params.params().integer("dimension", 2);
  if (dimension != 2 && dimension != 3)
    throw SceneError(in.params.location(), "checkerboard dimension must be 2 or 3");
  if (in.params.params().boolean("tent", false)) {
    in.params.needs().footprint = true;
    if (dimension == 2) return std::make_unique<CheckerboardTent<T, TextureMapping>>(TextureMapping(in), even, odd);
    return std::make_unique<CheckerboardTent<T, SolidMapping>>(SolidMapping(in), even, odd);
  }
  if (dimension == 3) return std::make_unique<Checkerboard3D<T>>(SolidMapping(in), even, odd);
  const std::string mode = in.params.params().string("aamode", "closedform");
  if (mode != "none" && mode != "closedform")
    in.params.warn("unknown aamode \"" + mode + "\"; using closedform");
  const bool filter = mode != "none";
  if (filter) in.params.needs().footprint = true;
  return std::make_unique<Checkerboard2D<T>>(TextureMapping(in), even, odd, filter);
}

template MadeTexture<float> make_checkerboard_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_checkerboard_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
