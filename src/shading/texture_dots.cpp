#include "shading/texture_noise.h"

namespace cloudrenderer {
namespace {

// A dot in about half of the unit cells of (s, t), moved about within its cell. Not filtered, as in
// pbrt.
template <class T>
class DotsTexture final : public Texture<T> {
 public:
  DotsTexture(const TextureMapping& mapping, const Textured<T>& inside, const Textured<T>& outside)
      : mapping_(mapping), inside_(inside), outside_(outside) {}
  T eval(const TexturePoint& at) const override {
    constexpr float kRadius = 0.35f, kMostShift = 0.5f - kRadius;
    const Vec2 st = mapping_(at).st, cell = glm::floor(st + 0.5f);
    const auto random = [&](float s, float t) { return noise({cell.x + s, cell.y + t, 0.5f}); };
    if (random(0.5f, 0.5f) > 0.f) {
      const Vec2 center = cell + kMostShift * Vec2(random(1.5f, 2.8f), random(4.5f, 9.8f));
      const Vec2 d = st - center;
      if (glm::dot(d, d) < kRadius * kRadius) return inside_(at);
    }
    return outside_(at);
  }

 private:
  TextureMapping mapping_;
  Textured<T> inside_, outside_;
};

}  // namespace

template <class T>
MadeTexture<T> make_dots_texture(TextureInputs& in) {
  const Textured<T> inside = in.params.value<T>("inside", 1.f),
                    outside = in.params.value<T>("outside", 0.f);
  return std::make_unique<DotsTexture<T>>(TextureMapping(in), inside, outside);
}

template MadeTexture<float> make_dots_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_dots_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
