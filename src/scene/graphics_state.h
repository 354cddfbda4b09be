#pragma once
#include <array>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "scene/color_space.h"
#include "scene/description.h"
#include "scene/transforms.h"

namespace cloudrenderer {

// A map that scopes share until one of them changes it.
template <class Value>
class ScopedMap {
 public:
  using Map = std::map<std::string, Value, std::less<>>;

  const Value* find(std::string_view name) const {
    const auto it = map_->find(name);
    return it == map_->end() ? nullptr : &it->second;
  }
  // `everywhere`: for all scopes that share the map, as pbrt-v4's names are.
  void set(const std::string& name, Value value, bool everywhere = false) {
    if (!everywhere && map_.use_count() > 1) map_ = std::make_shared<Map>(*map_);
    map_->insert_or_assign(name, std::move(value));
  }

 private:
  std::shared_ptr<Map> map_ = std::make_shared<Map>();
};

// A material as the file gives it; becomes a MaterialDesc when a shape uses it.
struct MaterialSource {
  Entity entity;
  Transform object_to_world;
  bool textures_resolved =
      false;      // v2 looks a material's textures up where a shape uses it, v3 where it is defined
  MaterialId id;  // in the description, once a shape has used it as it is
  // pbrt-v4: named, but not made yet; as whichever materials of the description shapes have used it meanwhile.
  bool expected = false;
  std::vector<MaterialId> interned = {};
};

// What a light is told about a shape that has it.
struct ShapeLight {
  int patches = 0;  // bilinear ones, each of which has the power that is given
  bool invisible = false, weighed = false;  // the shape is not seen; before pbrt-v4
  bool only_seen = false;  // in an object, before pbrt-v4
  auto operator<=>(const ShapeLight&) const = default;
};

struct AreaLightSource {
  Entity entity;
  // In the description, once shapes have used it: by how they change it.
  std::map<ShapeLight, AreaLightId> ids;
};

// What AttributeBegin saves and AttributeEnd brings back.
struct GraphicsState {
  bool reverse_orientation = false;
  std::shared_ptr<MaterialSource> material;
  std::string material_name;  // v2: NamedMaterial, looked up where a shape uses it
  std::shared_ptr<AreaLightSource> area_light;
  ScopedMap<std::string> float_textures, spectrum_textures;  // name in the file -> unique name
  ScopedMap<std::shared_ptr<MaterialSource>> named_materials;
  MediumId inside, outside;  // MediumInterface
  // pbrt-v4
  ColorSpace color_space;
  ScopedMap<ParamSet> attributes;  // by target
};

}  // namespace cloudrenderer
