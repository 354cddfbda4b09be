#include "shading/texture.h"

namespace cloudrenderer {
namespace {

template <class T>
class MixTexture final : public Texture<T> {
 public:
  MixTexture(const Textured<T>& a, const Textured<T>& b, const TexturedFloat& amount)
      : a_(a), b_(b), amount_(amount) {}
  T eval(const TexturePoint& at) const override {
    const float t = amount_(at);
    return (1.f - t) * a_(at) + t * b_(at);
  }

 private:
  Textured<T> a_, b_;
  TexturedFloat amount_;
};

}  // namespace

template <class T>
MadeTexture<T> make_mix_texture(TextureInputs& in) {
  const Textured<T> a = in.params.value<T>("tex1", 0.f), b = in.params.value<T>("tex2", 1.f);
  const TexturedFloat amount = in.params.real("amount", 0.5f);
  if (!a.texture && !b.texture && !amount.texture)
    return (1.f - amount.constant) * a.constant + amount.constant * b.constant;
  return std::make_unique<MixTexture<T>>(a, b, amount);
}

template MadeTexture<float> make_mix_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_mix_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
