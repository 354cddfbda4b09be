#include <array>

#include "base/portable_math.h"
#include "shading/texture_noise.h"

namespace cloudrenderer {
namespace {

// Layers along y, disturbed by noise. The colours are those of pbrt: Bezier curves between
// neighbouring fours of a list, times 1.5.
class MarbleTexture final : public Texture<Rgb> {
 public:
  MarbleTexture(const SolidMapping& mapping, const Octaves& octaves, float scale, float variation)
      : mapping_(mapping), octaves_(octaves), scale_(scale), variation_(variation) {}
  Rgb eval(const TexturePoint& at) const override {
    SolidCoordinates c = mapping_(at);
    c = {scale_ * c.p, scale_ * c.dpdx, scale_ * c.dpdy};
    return color(0.5f + 0.5f * portable::sin(c.p.y + variation_ * fbm(c, octaves_)));
  }

 private:
  // t: 0 to 1
  static Rgb color(float t) {
    constexpr int kColors = 9, kCurves = kColors - 3;
    static const std::array<Rgb, kColors> colors{
        Rgb(0.58f, 0.58f, 0.6f), Rgb(0.58f, 0.58f, 0.6f), Rgb(0.58f, 0.58f, 0.6f),
        Rgb(0.5f, 0.5f, 0.5f),   Rgb(0.6f, 0.59f, 0.58f), Rgb(0.58f, 0.58f, 0.6f),
        Rgb(0.58f, 0.58f, 0.6f), Rgb(0.2f, 0.2f, 0.33f),  Rgb(0.58f, 0.58f, 0.6f)};
    const float place = t * kCurves;
    const int first = std::clamp(static_cast<int>(place), 0, kCurves - 1);
    const float b = place - static_cast<float>(first), a = 1.f - b;
    const Rgb* c = &colors[static_cast<std::size_t>(first)];
    return 1.5f * (a * a * (a * c[0] + 3.f * b * c[1]) + b * b * (3.f * a * c[2] + b * c[3]));
  }

  SolidMapping mapping_;
  Octaves octaves_;
  float scale_, variation_;
};

}  // namespace

template <>
MadeTexture<Rgb> make_marble_texture<Rgb>(TextureInputs& in) {
  const ParamSet& p = in.params.params();
  const Octaves octaves = read_octaves(in);
  const float scale = p.real("scale", 1.f), variation = p.real("variation", 0.2f);
  return std::make_unique<MarbleTexture>(SolidMapping(in), octaves, scale, variation);
}

template <>
MadeTexture<float> make_marble_texture<float>(TextureInputs& in) {
  in.params.warn("the marble texture has colours, it is no float texture; using 0");
  for (const Param& p : in.params.params().all()) p.used = true;  // one warning is enough
  return 0.f;
}

}  // namespace cloudrenderer
