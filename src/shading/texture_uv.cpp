#include "shading/texture_mapping.h"

namespace cloudrenderer {
namespace {

class UvTexture final : public Texture<Rgb> {
 public:
  explicit UvTexture(const TextureMapping& mapping) : mapping_(mapping) {}
  Rgb eval(const TexturePoint& at) const override {
    const Vec2 st = mapping_(at).st;
    return {st.x - std::floor(st.x), st.y - std::floor(st.y), 0.f};
  }

 private:
  TextureMapping mapping_;
};

}  // namespace

template <>
MadeTexture<Rgb> make_uv_texture<Rgb>(TextureInputs& in) {
  return std::make_unique<UvTexture>(TextureMapping(in));
}

template <>
MadeTexture<float> make_uv_texture<float>(TextureInputs& in) {
  in.params.warn("the uv texture has colours, it is no float texture; using 0");
  return 0.f;
}

}  // namespace cloudrenderer
