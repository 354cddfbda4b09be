// fbm, wrinkled and windy: one number, as a float or as a grey.
#include "shading/texture_noise.h"

namespace cloudrenderer {
namespace {

// Value: a function object of SolidCoordinates.
template <class T, class Value>
class NoiseTexture final : public Texture<T> {
 public:
  NoiseTexture(const SolidMapping& mapping, const Value& value)
      : mapping_(mapping), value_(value) {}
  T eval(const TexturePoint& at) const override { return T(value_(mapping_(at))); }

 private:
  SolidMapping mapping_;
  Value value_;
};

template <class T, class Value>
MadeTexture<T> make(TextureInputs& in, const Value& value) {
  return std::make_unique<NoiseTexture<T, Value>>(SolidMapping(in), value);
}

SolidCoordinates scaled(const SolidCoordinates& at, float factor) {
  return {factor * at.p, factor * at.dpdx, factor * at.dpdy};
}

}  // namespace

template <class T>
MadeTexture<T> make_fbm_texture(TextureInputs& in) {
  return make<T>(
      in, [octaves = read_octaves(in)](const SolidCoordinates& at) { return fbm(at, octaves); });
}

template <class T>
MadeTexture<T> make_wrinkled_texture(TextureInputs& in) {
  return make<T>(in, [octaves = read_octaves(in), dialect = in.params.dialect()](
                         const SolidCoordinates& at) { return turbulence(at, octaves, dialect); });
}

// Waves on water: small ones, higher where a wind of larger scale is strong.
template <class T>
MadeTexture<T> make_windy_texture(TextureInputs& in) {
  in.params.needs().footprint = true;
  return make<T>(in, [beyond = Octaves::beyond_of(in.params.dialect())](const SolidCoordinates& at) {
    const float wind = fbm(scaled(at, 0.1f), {0.5f, 3, beyond});
    return std::fabs(wind) * fbm(at, {0.5f, 6, beyond});
  });
}

template MadeTexture<float> make_fbm_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_fbm_texture<Rgb>(TextureInputs&);
template MadeTexture<float> make_wrinkled_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_wrinkled_texture<Rgb>(TextureInputs&);
template MadeTexture<float> make_windy_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_windy_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
