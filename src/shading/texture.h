#pragma once
// Textures: values of type float or Rgb over a surface. A parameter of a material is a Textured<T>:
// a constant, or a texture. Constants cost no call.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/log.h"
#include "scene/description.h"
#include "shading/material.h"

namespace cloudrenderer {

// Where a texture is evaluated, with the footprint of a pixel.
struct TexturePoint {
  Vec3 p{}, n{};
  Vec2 uv{};
  Vec3 dpdx{}, dpdy{};  // zero: no filtering
  Vec2 duvdx{}, duvdy{};
  bool regularized = false;  // narrow microfacets are widened, see Shading::lobes

  TexturePoint() = default;
  TexturePoint(const SurfacePoint& point, const Footprint& footprint)
      : p(point.p), n(point.ng), uv(point.uv), dpdx(footprint.dpdx), dpdy(footprint.dpdy), duvdx(footprint.duvdx), duvdy(footprint.duvdy) {}
};

template <class T>
class Texture {
 public:
  virtual ~Texture() = default;
  virtual T eval(const TexturePoint& at) const = 0;
};

// A texture that looks into a large table.
class TableTexture {
 public:
  virtual ~TableTexture() = default;
  // Brings what eval() reads at a point without footprint into the cache.
  virtual void prefetch(const TexturePoint& at) const = 0;
};

// What a texture, or a material, needs of the point at which it is evaluated.
struct TextureNeeds {
  bool uv = false, footprint = false;
  int depth = 0;  // longest chain of textures
  std::vector<const TableTexture*> tables;
  TextureNeeds& operator|=(const TextureNeeds& n) {
    uv = uv || n.uv;
    footprint = footprint || n.footprint;
    depth = std::max(depth, n.depth);
    for (const TableTexture* t : n.tables)
      if (std::find(tables.begin(), tables.end(), t) == tables.end()) tables.push_back(t);
    return *this;
  }
};

template <class T>
struct Textured {
  T constant{};
  const Texture<T>* texture = nullptr;  // owned by the TextureSet

  T operator()(const TexturePoint& at) const { return texture ? texture->eval(at) : constant; }
};
using TexturedFloat = Textured<float>;
using TexturedRgb = Textured<Rgb>;

// The textures of a scene, by their unique names. Only those are built that a material refers to
// (also through other textures), and float textures that nothing refers to, since shapes may use
// them as alpha masks.
class TextureSet {
 public:
  // Without `read_images` these are only opened, and the textures are not for evaluation.
  TextureSet(const SceneDescription& scene, std::uint64_t budget, Warnings& warnings,
             bool read_images = true);
  ~TextureSet();
  TextureSet(const TextureSet&) = delete;
  TextureSet& operator=(const TextureSet&) = delete;

  // The texture of this name; a warning and nothing when there is no such texture of this type.
  bool find(std::string_view name, TexturedFloat& out, TextureNeeds& needs,
            const FileLocation& where, Warnings& warnings) const;
  bool find(std::string_view name, TexturedRgb& out, TextureNeeds& needs, const FileLocation& where,
            Warnings& warnings) const;
  // By index into SceneDescription::textures; null when it is no float texture.
  const TexturedFloat* float_texture(std::uint32_t index) const;
  bool by_chance(std::uint32_t index) const;  // it says "bool chance"
  std::uint64_t bytes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Reads the parameters of one texture or material that may be textures, and notes what they need.
class TexturedParams {
 public:
  TexturedParams(const ParamSet& params, const TextureSet& textures, Dialect dialect,
                 const FileLocation& location, Warnings& warnings)
      : params_(params),
        textures_(textures),
        dialect_(dialect),
        location_(location),
        warnings_(warnings) {}

  TexturedFloat real(std::string_view name, float otherwise);
  TexturedRgb rgb(std::string_view name, const Rgb& otherwise);
  template <class T>
  Textured<T> value(std::string_view name, float otherwise);
  // False when the parameter is absent.
  bool optional_real(std::string_view name, TexturedFloat& out);
  bool optional_rgb(std::string_view name, TexturedRgb& out);

  const ParamSet& params() const { return params_; }
  Dialect dialect() const { return dialect_; }
  const FileLocation& location() const { return location_; }
  void warn(const std::string& message) const { warnings_.add(location_, message); }
  bool textured() const { return textured_; }  // some parameter is no constant
  const TextureNeeds& needs() const { return needs_; }
  TextureNeeds& needs() { return needs_; }
  void set_textured() { textured_ = true; }

 private:
  template <class T>
  bool find(std::string_view name, Textured<T>& out);

  const ParamSet& params_;
  const TextureSet& textures_;
  Dialect dialect_;
  FileLocation location_;
  Warnings& warnings_;
  TextureNeeds needs_;
  bool textured_ = false;
};

template <>
inline TexturedFloat TexturedParams::value<float>(std::string_view name, float otherwise) {
  return real(name, otherwise);
}
template <>
inline TexturedRgb TexturedParams::value<Rgb>(std::string_view name, float otherwise) {
  return rgb(name, Rgb(otherwise));
}

class ImageStore;

// What a texture's maker gets beside its parameters.
struct TextureInputs {
  TexturedParams& params;
  const Transform& texture_to_world;
  ImageStore& images;
};

// A texture, or the constant it turned out to be.
template <class T>
using MadeTexture = std::variant<T, std::unique_ptr<Texture<T>>>;

// One row of the table of texture kinds (texture.cpp).
struct TextureKind {
  std::string_view name;
  MadeTexture<float> (*make_float)(TextureInputs&);
  MadeTexture<Rgb> (*make_rgb)(TextureInputs&);
};

// The makers: one file a kind.
template <class T>
MadeTexture<T> make_constant_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_scale_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_mix_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_bilerp_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_imagemap_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_checkerboard_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_uv_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_directionmix_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_dots_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_fbm_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_wrinkled_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_windy_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_marble_texture(TextureInputs&);
template <class T>
MadeTexture<T> make_unsupported_texture(TextureInputs&);

}  // namespace cloudrenderer
