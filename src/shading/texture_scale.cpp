#include "shading/texture.h"

namespace cloudrenderer {
namespace {

template <class T>
class ScaleTexture final : public Texture<T> {
 public:
  ScaleTexture(const Textured<T>& a, const Textured<T>& b) : a_(a), b_(b) {}
  T eval(const TexturePoint& at) const override { return a_(at) * b_(at); }

 private:
  Textured<T> a_, b_;
};

// pbrt-v4's: a texture times a number or a float texture.
template <class T>
class ScaledByFloat final : public Texture<T> {
 public:
  ScaledByFloat(const Textured<T>& a, const TexturedFloat& b) : a_(a), b_(b) {}
  T eval(const TexturePoint& at) const override { return a_(at) * b_(at); }

 private:
  Textured<T> a_;
  TexturedFloat b_;
};

}  // namespace

template <class T>
MadeTexture<T> make_scale_texture(TextureInputs& in) {
  if (const ParamSet& p = in.params.params(); p.has("tex") || p.has("scale")) {
    const Textured<T> a = in.params.value<T>("tex", 1.f);
    const TexturedFloat b = in.params.real("scale", 1.f);
    if (!a.texture && !b.texture) return a.constant * b.constant;
    return std::make_unique<ScaledByFloat<T>>(a, b);
  }
  const Textured<T> a = in.params.value<T>("tex1", 1.f), b = in.params.value<T>("tex2", 1.f);
  if (!a.texture && !b.texture) return a.constant * b.constant;
  return std::make_unique<ScaleTexture<T>>(a, b);
}

template MadeTexture<float> make_scale_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_scale_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
