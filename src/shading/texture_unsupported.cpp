// Kinds that are known and not made (ptex): a constant in their place.
#include "shading/texture.h"

namespace cloudrenderer {

template <class T>
MadeTexture<T> make_unsupported_texture(TextureInputs& in) {
  in.params.warn("this kind of texture is not supported; using 0.5");
  for (const Param& p : in.params.params().all()) p.used = true;  // one warning is enough
  return T(0.5f);
}

template MadeTexture<float> make_unsupported_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_unsupported_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
