#include "shading/texture.h"

namespace cloudrenderer {

template <class T>
MadeTexture<T> make_constant_texture(TextureInputs& in) {
  return in.params.value<T>("value", 1.f).constant;
}

template MadeTexture<float> make_constant_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_constant_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
