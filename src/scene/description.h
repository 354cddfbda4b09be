#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/id.h"
#include "scene/params.h"
#include "scene/voxels.h"

namespace cloudrenderer {

// pbrt-v2 and pbrt-v3 use the same names for different models; see "What pbrt means". v4 is a
// spelling only: what is read from it is described in v3's words.
enum class Dialect : std::uint8_t { v2, v3, v4 };

// A directive with its type name and parameters: `Camera "perspective" ...`.
struct Entity {
  std::string type;
  ParamSet params;
  FileLocation location;
};

// Where something that moves is at the end (ActiveTransform); its own transformation holds at and before `start_time`,
// this one at and after `end_time` (TransformTimes). In between as AnimatedTransform says.
struct Motion {
  Transform end;
  float start_time = 0, end_time = 1;
};

struct CameraDesc : Entity {
  Transform world_to_camera;
  MediumId medium;  // that it stands in (v3)
  std::optional<Motion> motion;  // of world_to_camera; what is interpolated is its inverse
};
// When the camera's shutter opens and closes, in the units of TransformTimes.
struct Shutter {
  float open = 0, close = 1;
};
Shutter shutter_of(const CameraDesc& camera);

// Textures have unique names: one that redefines a name in the scene gets a new one ("name#2"), and
// parameters that refer to it carry the unique name. A texture refers only to textures before it in
// the list.
struct TextureDesc : Entity {
  std::string name;
  bool is_float = false;  // else spectrum
  Transform texture_to_world;
};

// Materials of the scene, without duplicates. For v2, parameters of a shape that override the
// material's (pbrt-v2 looks there first) have been merged. In a `mix` material the parameters
// "namedmaterial1/2" are strings that hold the decimal index of the mixed materials in this list,
// which stand before it. type "" or "none": v3's null material (the surface is passed through).
struct MaterialDesc : Entity {
  Transform object_to_world;  // for 3D texture mappings of nothing else; kept for completeness
  // v3: what lies on the sides of surfaces of this material. As in pbrt-v3, a surface with the same on both sides leaves
  // a ray in the medium that it is in; then both are none here.
  MediumId inside, outside;
  bool is_interface() const { return inside != outside; }
};

// v2: a `Volume`; all of them add up. v3: a `MakeNamedMedium`, by whose number surfaces and the camera refer to it.
struct MediumDesc : Entity {
  Transform medium_to_world;
};

struct LightDesc : Entity {
  Transform light_to_world;
};

// The main scene without its geometry: plain values, nothing built. It is what `Split` stores and
// what every host gets. Relative file names in parameters have been made absolute by the parser (or
// relative to the split folder).
struct SceneDescription {
  Dialect dialect = Dialect::v2;  // v2 or v3
  std::string source;  // the file name as given
  CameraDesc camera;
  float transform_start = 0, transform_end = 1;  // TransformTimes: of all that moves
  Entity film, sampler, filter,
      integrator;  // types in pbrt's words; defaults of the dialect when absent
  // v2's `Renderer`, `VolumeIntegrator`, `Accelerator`, when given (only the volume integrator is more
  // than a warning).
  std::optional<Entity> renderer, volume_integrator;
  std::vector<TextureDesc> textures;
  std::vector<MaterialDesc> materials;
  std::vector<LightDesc> lights;    // LightSource directives
  std::vector<Entity> area_lights;  // AreaLightSource directives that a shape uses
  std::vector<MediumDesc> media;
};

// A shape as read; geometry is not built yet. Valid until the sink's call returns, unless moved
// from.
struct ShapeDesc : Entity {
  Transform object_to_world;
  std::optional<Motion> motion;  // of object_to_world
  bool reverse_orientation = false;
  MaterialId material;     // index into SceneDescription::materials
  AreaLightId area_light;  // none: does not emit
  ObjectId object;         // none: stands in the world; else belongs to that prototype
};

struct InstanceDesc {
  ObjectId object;
  // World from the space in which the object's shapes are given: the CTM at ObjectInstance. (Shapes
  // inside an object carry the CTM of their place in the ObjectBegin block as object_to_world, as
  // in pbrt.)
  Transform instance_to_world;
  FileLocation location{};
  std::optional<Motion> motion = {};  // of instance_to_world
};

// The densities of a grid medium: they go where geometry goes, and the description's medium is left without them.
struct GridDesc {
  MediumId medium;
  GridLayout layout;
  std::shared_ptr<const Voxels> voxels;
  Transform medium_to_world;  // of the layout's space
  FileLocation location;
};
bool is_grid(const MediumDesc& medium, Dialect dialect);
// How many numbers its samples have.
std::uint32_t grid_channels(const MediumDesc& medium);
// The grid of such a medium, taken out of its parameters. Throws SceneError.
std::optional<GridDesc> take_grid(MediumDesc& medium, MediumId id, Dialect dialect);

// Receives the geometry of a scene while it is read, in file order; nothing is kept by the parser,
// so that a scene of any size streams through. `scene` grows while reading: materials and area
// lights a call names are already in it.
class SceneSink {
 public:
  virtual ~SceneSink() = default;
  virtual void begin_object(ObjectId, const std::string& name) = 0;
  virtual void end_object(ObjectId) = 0;
  virtual void shape(ShapeDesc&& shape, const SceneDescription& scene) = 0;
  virtual void instance(const InstanceDesc& instance, const SceneDescription& scene) = 0;
  virtual void grid(GridDesc&&) {}
};

class LanguageUse;

struct ParseOptions {
  std::optional<Dialect> dialect;  // forced by --dialect
  LanguageUse* use = nullptr;      // counts what the scene uses
  std::string confine;             // the only folder that its files may be in, links resolved; "": any
  std::set<std::string>* files = nullptr;  // collects the absolute names of all files that it names, its own too
};

// Reads a .pbrt file (v2 or v3 spelling, gzip allowed) with its includes. Throws SceneError for
// what cannot be rendered; everything merely odd goes to `warnings`.
SceneDescription parse_scene(const std::string& path, const ParseOptions& options, SceneSink& sink,
                             Warnings& warnings);

}  // namespace cloudrenderer
