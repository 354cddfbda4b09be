#include "shading/texture_mapping.h"

namespace cloudrenderer {
namespace {

template <class T>
class BilerpTexture final : public Texture<T> {
 public:
  BilerpTexture(const TextureMapping& mapping, const T& v00, const T& v01, const T& v10,
                const T& v11)
      : mapping_(mapping), v00_(v00), v01_(v01), v10_(v10), v11_(v11) {}
  T eval(const TexturePoint& at) const override {
    const Vec2 st = mapping_(at).st;
    return (1.f - st.x) * ((1.f - st.y) * v00_ + st.y * v01_) +
           st.x * ((1.f - st.y) * v10_ + st.y * v11_);
  }

 private:
  TextureMapping mapping_;
  T v00_, v01_, v10_, v11_;
};

}  // namespace

template <class T>
MadeTexture<T> make_bilerp_texture(TextureInputs& in) {
  const auto corner = [&](std::string_view name, float otherwise) {
    return in.params.value<T>(name, otherwise).constant;
  };
  const T v00 = corner("v00", 0.f), v01 = corner("v01", 1.f), v10 = corner("v10", 0.f),
          v11 = corner("v11", 1.f);
  return std::make_unique<BilerpTexture<T>>(TextureMapping(in), v00, v01, v10, v11);
}

template MadeTexture<float> make_bilerp_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_bilerp_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
