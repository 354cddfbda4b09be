#pragma once
#include <optional>
#include <set>
#include <string>
#include <unordered_map>

#include "base/log.h"
#include "scene/description.h"
#include "scene/graphics_state.h"

namespace cloudrenderer {

// Turns directives into entries of a SceneDescription: gives textures unique names, materials and
// area lights numbers.
class SceneBuilder {
 public:
  SceneBuilder(Dialect dialect, std::string source, Warnings& warnings);

  SceneDescription& scene() { return scene_; }

  void add_texture(GraphicsState& state, const std::string& name, bool is_float, Entity entity,
                   const DMat4& ctm);
  // pbrt-v4: an alpha between 0 and 1 lets a part of the rays pass. Numbers become textures.
  void mask_by_chance(GraphicsState& state, Entity& shape);
  // In pbrt-v3 meshes with a "shadowalpha" of 0 throw no shadow.
  void lift_shadow(GraphicsState& state, Entity& shape);
  // Before pbrt-v4 an alpha of 0 hides a mesh from rays, but not, where it is a lamp, from light samples.
  void hide_lamp(GraphicsState& state, Entity& shape);
  // pbrt-v4: the picture that a material names becomes a texture, and a parameter that names this.
  void take_normal_map(GraphicsState& state, Entity& material);
  void add_light(const GraphicsState& state, Entity entity, const DMat4& ctm);
  // Either gives back the grid of the medium, if it has one.
  std::optional<GridDesc> add_volume(Entity entity, const DMat4& ctm);
  std::optional<GridDesc> add_named_medium(const std::string& name, Entity entity, const DMat4& ctm);
  // None, with a warning, for a name that no medium has (in pbrt-v4: has until now); "" is vacuum.
  MediumId find_medium(const std::string& name, const FileLocation& where);
  std::shared_ptr<MaterialSource> make_material(const GraphicsState& state, Entity entity,
                                                const DMat4& ctm, bool is_named);
  // scene_builder_later.cpp: of pbrt-v4. A material that is used before it is made.
  std::shared_ptr<MaterialSource> expect_material(GraphicsState& state, const std::string& name, const FileLocation& where);
  // MakeNamedMaterial: also where the name was used before.
  void define_material(GraphicsState& state, const std::string& name, std::shared_ptr<MaterialSource> made);
  // When all is read: what names refer to that came later, with warnings for those that nothing has.
  void finish(const GraphicsState& state);

  // Fills material and area_light of a shape from the state, and gives its texture parameters their
  // unique names.
  void finish_shape(const GraphicsState& state, ShapeDesc& shape);
  // A texture-valued parameter gets the unique name of what it names in this scope; an unknown one
  // is dropped, unless it may come later.
  ParamSet resolve_textures(const GraphicsState& state, const Entity& entity,
                            std::optional<bool> is_float, bool may_come_later = false);

  // A warning that is not repeated for every place where it applies.
  void warn_once(const FileLocation& where, const std::string& message);

 private:
  // Integrators that know media let shadow rays pass surfaces without a material, media or not: they get a vacuum.
  void let_shadows_pass();
  void limit_albedos();
  bool is_zero_texture(const GraphicsState& state, const Param& mask) const;
  void check_room_for_media(const FileLocation& where) const;
  std::optional<GridDesc> put_medium(MediumId id, Entity entity, const DMat4& ctm);
  MaterialId material_of(const GraphicsState& state, const ShapeDesc& shape);
  MaterialId intern(const GraphicsState& state, MaterialSource& source, const ParamSet& overrides);
  const std::string* find_texture(const GraphicsState& state, const std::string& name, bool wants_float) const;
  void warn_no_texture(const GraphicsState& state, const Param& p, const std::string& name);
  static std::string later_texture(const std::string& name, bool wants_float);
  void fulfil(MaterialSource& expected, const MaterialSource& made);

  SceneDescription scene_;
  const char* default_name() const { return is_v4_ ? "diffuse" : "matte"; }

  bool is_v4_;
  Warnings& warnings_;
  std::set<std::string> warned_;
  std::set<std::string> texture_names_;                         // that are taken
  std::unordered_map<std::string, unsigned> texture_counters_;  // redefinitions of a name so far
  std::unordered_map<std::string, MaterialId> material_ids_;  // by all that distinguishes materials
  std::unordered_map<std::string, MediumId> media_;  // v3, by name
  std::shared_ptr<MaterialSource> default_material_;
  std::vector<std::pair<std::string, std::shared_ptr<MaterialSource>>> expected_;  // by name
};

}  // namespace cloudrenderer
