#pragma once
// The materials: each file makes one kind (or a family), and the table in material.cpp names it.
#include <algorithm>
#include <memory>
#include <span>
#include <string_view>

#include "shading/bsdf_lobes.h"
#include "shading/material.h"
#include "shading/subsurface.h"
#include "shading/texture.h"

namespace cloudrenderer {

// Where a material puts its lobes: into a Bsdf, times a factor (mixed materials).
class LobeSink {
 public:
  explicit LobeSink(Bsdf& bsdf, const Rgb& factor = Rgb(1.f))
      : bsdf_(bsdf), factor_(factor), scaled_(factor != Rgb(1.f)) {}
  void add(Lobe lobe);
  LobeSink scaled(const Rgb& s) const { return LobeSink(bsdf_, factor_ * s); }

 private:
  Bsdf& bsdf_;
  Rgb factor_;
  bool scaled_;
};

class MeasuredStore;

// A material whose lobes depend on the point. One without textures is asked once, when the scene is
// built.
class Material {
 public:
  virtual ~Material() = default;
  virtual void add_lobes(const TexturePoint& at, LobeSink& out) const = 0;
  // Materials with a medium inside, into which light goes that their lobes transmit. False: none, here.
  virtual bool has_subsurface() const { return false; }
  virtual bool subsurface(const TexturePoint&, SubsurfacePoint&) const { return false; }
  // Which other material stands for this one here; null: none does.
  virtual const struct MaterialRecord* chosen(const TexturePoint&) const { return nullptr; }
};

// A material with what Shading must know of it.
struct MaterialRecord {
  std::unique_ptr<Material> material;  // null: the null material
  std::vector<Lobe> lobes;             // when not textured
  std::vector<LobeOf<Float8>> lobes8;  // the same in all lanes, if the material has a kind (Shading::kind)
  std::optional<SubsurfacePoint> subsurface;  // what there is inside, when not textured
  bool has_subsurface = false;
  bool textured = false;
  bool tangents = false;  // depends on the direction of the tangents
  bool has_bump = false;
  TexturedRgb normal_map;  // pbrt-v4
  bool has_normal_map = false;
  bool bends() const { return has_bump || has_normal_map; }
  bool chooses = false;    // Material::chosen() is not null
  bool estimated = false;  // some lobe may be without a formula: see Bsdf::set_salt
  TexturedFloat bump;
  TextureNeeds needs;
  int depth = 1;  // of mixes
  int lobes_at_most = 0;
  std::uint32_t kind = 0;  // see Shading::kind
};

struct MaterialInputs {
  TexturedParams& params;
  std::span<const MaterialRecord> all;  // the materials: what this one mixes is made
  MeasuredStore& measured;
  bool tangents = false;                    // set by the maker
  bool estimated = false;                   // set by the maker
  int depth = 1;                            // set by the maker of mixes
  int lobes = 0;                            // set by the maker of mixes
  const MaterialRecord* base = nullptr;     // whose bump map counts, set by the maker of mixes
  bool chooses = false;                     // set by the maker of mixes
};

struct MaterialKind {
  std::string_view name;
  std::unique_ptr<Material> (*make)(MaterialInputs&);
  int lobes;         // at most, on its own
  bool bump = true;  // has a "bumpmap"
};

std::unique_ptr<Material> make_matte(MaterialInputs&);
std::unique_ptr<Material> make_plastic(MaterialInputs&);
std::unique_ptr<Material> make_metal(MaterialInputs&);
std::unique_ptr<Material> make_shinymetal(MaterialInputs&);
std::unique_ptr<Material> make_mirror(MaterialInputs&);
std::unique_ptr<Material> make_glass(MaterialInputs&);
std::unique_ptr<Material> make_uber(MaterialInputs&);
std::unique_ptr<Material> make_substrate(MaterialInputs&);
std::unique_ptr<Material> make_translucent(MaterialInputs&);
std::unique_ptr<Material> make_coatedconductor(MaterialInputs&);
std::unique_ptr<Material> make_coateddiffuse(MaterialInputs&);
std::unique_ptr<Material> make_thindielectric(MaterialInputs&);
std::unique_ptr<Material> make_measured(MaterialInputs&);
std::unique_ptr<Material> make_mix(MaterialInputs&);
std::unique_ptr<Material> make_disney(MaterialInputs&);
std::unique_ptr<Material> make_fourier(MaterialInputs&);
std::unique_ptr<Material> make_hair(MaterialInputs&);
std::unique_ptr<Material> make_subsurface(MaterialInputs&);
std::unique_ptr<Material> make_kdsubsurface(MaterialInputs&);

// pbrt-v4 lets diffuse surfaces reflect all at most, and a mix be of one at most.
inline Rgb most_reflected(MaterialInputs& in) { return Rgb(in.params.params().boolean("atmostone", false) ? 1.f : kInfinity); }
// No colour may be negative.
inline Rgb positive(const Rgb& c) { return glm::max(c, Rgb(0.f)); }

// The roughness parameters of a microfacet material: Blinn exponents in pbrt-v2, Trowbridge-Reitz
// widths in pbrt-v3 (there with "remaproughness").
class Roughness {
 public:
  static Roughness one(MaterialInputs& in, float otherwise);  // "roughness"
  // "roughness", in v3 overridden by "uroughness" and "vroughness"; pbrt's materials differ in
  // whether v follows u.
  enum class V { keeps_roughness, follows_u };
  static Roughness overridden(MaterialInputs& in, float otherwise, V v);
  // "uroughness", "vroughness" after a prefix
  static Roughness two_axes(MaterialInputs& in, float otherwise, std::string_view prefix = "");

  bool smooth(const TexturePoint& at) const {
    if (widens(at)) return false;
    const float widest = std::max(u_(at), v_(at));
    return v4_ ? widest < (root_ ? 1e-6f : 1e-3f) : widest == 0.f && u_(at) == v_(at);
  }
  bool is_v4() const { return v4_; }
  bsdf::Microfacets operator()(const TexturePoint& at) const;

 private:
  Roughness(MaterialInputs& in, const TexturedFloat& u, const TexturedFloat& v);
  bool widens(const TexturePoint& at) const { return v4_ && at.regularized; }

  TexturedFloat u_, v_;
  Dialect dialect_;
  bool v4_, root_;  // root: pbrt-v4's map of a roughness to a width
  bool remap_, isotropic_;
};

// A conductor's "eta" and "k" after a prefix, by default copper's, or what has the "reflectance" of pbrt-v4.
class ConductorInputs {
 public:
  explicit ConductorInputs(MaterialInputs& in, std::string_view prefix = "");
  struct Index {
    Rgb eta, k;
  };
  Index operator()(const TexturePoint& at) const;

 private:
  TexturedRgb eta_, k_;
  std::optional<TexturedRgb> reflectance_;
};

// Builds all materials. Throws SceneError for what makes no picture.
std::vector<MaterialRecord> build_materials(const SceneDescription& scene,
                                            const TextureSet& textures, MeasuredStore& measured,
                                            Warnings& warnings);

}  // namespace cloudrenderer
