#include "shading/texture.h"

namespace cloudrenderer {
namespace {

// pbrt-v4: the first texture where the surface looks along the direction or against it.
template <class T>
class DirectionMix final : public Texture<T> {
 public:
  DirectionMix(const Textured<T>& along, const Textured<T>& across, const Vec3& direction)
      : along_(along), across_(across), direction_(direction) {}
  T eval(const TexturePoint& at) const override {
    const float t = std::fabs(glm::dot(at.n, direction_));
    return t * along_(at) + (1.f - t) * across_(at);
  }

 private:
  Textured<T> along_, across_;
  Vec3 direction_;
};

}  // namespace

template <class T>
MadeTexture<T> make_directionmix_texture(TextureInputs& in) {
  const Vec3 given = in.texture_to_world.vector(in.params.params().vector3("dir", {0, 1, 0}));
  const float length = glm::length(given);
  if (!(length > 0.f && length < kInfinity))
    throw SceneError(in.params.location(), "directionmix: dir must have a length above 0");
  return std::make_unique<DirectionMix<T>>(in.params.value<T>("tex1", 0.f),
                                           in.params.value<T>("tex2", 1.f), given / length);
}

template MadeTexture<float> make_directionmix_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_directionmix_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
