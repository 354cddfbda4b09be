#pragma once
#include "shading/texture.h"

namespace cloudrenderer {

// A place in texture space with its pixel footprint.
struct TextureCoordinates {
  Vec2 st{}, dstdx{}, dstdy{};
};

// pbrt's 2D mappings: uv, spherical, cylindrical and planar.
class TextureMapping {
 public:
  explicit TextureMapping(TextureInputs& inputs);
  TextureCoordinates operator()(const TexturePoint& at) const;

 private:
  enum class Kind { uv, spherical, cylindrical, planar };
  Vec2 around(const Vec3& world) const;  // spherical and cylindrical

  Kind kind_ = Kind::uv;
  Vec2 scale_{1}, delta_{0};
  bool by_height_ = false;  // cylindrical of pbrt-v4: t is z, before it the cosine
  Vec3 vs_{1, 0, 0}, vt_{0, 1, 0};
  Transform world_to_texture_;
};

// A place in the space of solid textures with its pixel footprint.
struct SolidCoordinates {
  Vec3 p{}, dpdx{}, dpdy{};
};

// The mapping of solid textures. pbrt-v2 and v3 apply the texture's own transform to world points
// here, not its inverse; the pictures depend on it.
class SolidMapping {
 public:
  explicit SolidMapping(const TextureInputs& inputs) : transform_(inputs.texture_to_world) {}
  SolidCoordinates operator()(const TexturePoint& at) const {
    return {transform_.point(at.p), transform_.vector(at.dpdx), transform_.vector(at.dpdy)};
  }

 private:
  Transform transform_;
};

}  // namespace cloudrenderer
