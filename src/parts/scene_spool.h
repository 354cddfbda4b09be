#pragma once
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/log.h"
#include "parts/grid_spool.h"
#include "parts/spool.h"
#include "scene/description.h"

namespace cloudrenderer {

// Where an instance is: still, or moving, see MotionRecord.
struct Placing {
  Transform fixed;
  std::vector<MotionRecord> moves;

  Placing() = default;
  Placing(const Transform& t) : fixed(t) {}  // NOLINT: what stands still is a place
  Placing(const Transform& start, const std::optional<Motion>& motion, Dialect dialect);
  Affine fixed_in_double() const { return Affine(fixed.matrix()); }
  friend Placing operator*(const Placing& a, const Placing& b);
};
// The box of all that `box` covers while it moves.
Bounds3 world_box(const Placing& placing, const Bounds3& box);

// An ObjectBegin block as read.
struct PrototypeSpool {
  // An instance inside the block that was too large to be copied into it: instances of the block
  // become instances of this one too.
  struct Nested {
    std::uint32_t prototype = 0;
    Placing to_object;
    std::uint32_t first_shape = 0;  // local id of the nested prototype's local shape 0
  };
  bool is_shape = false;  // not an ObjectBegin block but a shape that moves, and so stands in a space of its own
  std::string name;
  std::vector<std::uint32_t> rows;
  std::vector<Nested> nested;
  std::uint32_t shape_count = 0;  // local ids given away
  Bounds3 box;                    // of the rows
  Bounds3 whole_box;              // and of all that is nested or was copied, whichever it was
  double bytes = 0;               // predicted, of the rows
};

// Receives a scene while it is parsed, builds the geometry of each shape, numbers it, and puts it
// into temporary files.
class SceneSpool : public SceneSink {
 public:
  // Objects inside objects are copied into the outer one as long as that is at most `flatten_bytes`
  // loaded.
  SceneSpool(const std::string& folder, double flatten_bytes, Warnings& warnings);

  void begin_object(ObjectId id, const std::string& name) override;
  void end_object(ObjectId id) override;
  void shape(ShapeDesc&& shape, const SceneDescription& scene) override;
  void instance(const InstanceDesc& instance, const SceneDescription& scene) override;

  void grid(GridDesc&& grid) override { grids_.add(grid, take_ids(nullptr, 1, grid.location)); }

  Spool& spool() { return spool_; }
  GridSpool& grids() { return grids_; }
  const std::vector<PrototypeSpool>& prototypes() const { return prototypes_; }
  // World instances; InstanceRecord::prototype counts in prototypes() here.
  SpoolArray<InstanceRecord>& instances() { return instances_; }
  SpoolArray<MotionRecord>& motions() { return motions_; }  // of the above, in their order
  // Of all shapes; the same for every split.
  const Bounds3& bounds() const { return bounds_; }
  const std::vector<AreaLightId>& shape_lights() const { return shape_lights_; }

 private:
  std::uint32_t take_ids(PrototypeSpool* owner, std::uint32_t count, const FileLocation& location);
  std::uint32_t texture_index(const ShapeDesc& shape, const char* name,
                              const SceneDescription& scene);
  PrototypeSpool* open_prototype();
  void add_row(PrototypeSpool& owner, std::uint32_t number, const ShapeRow& row);
  void add_instance(const Placing& placing, std::uint32_t prototype, std::uint32_t first_shape);
  void nest(PrototypeSpool& outer, std::uint32_t inner, const InstanceDesc& instance, const Placing& to_outer);

  double flatten_bytes_;
  Warnings& warnings_;
  Spool spool_;
  SpoolArray<InstanceRecord> instances_;
  SpoolArray<MotionRecord> motions_;
  GridSpool grids_;
  std::vector<PrototypeSpool> prototypes_;
  std::unordered_map<ObjectId, std::uint32_t> prototype_of_;
  std::vector<AreaLightId> shape_lights_;
  Bounds3 bounds_;
  std::unordered_map<std::string, std::uint32_t> texture_of_;  // grows with the scene's textures
  std::size_t textures_seen_ = 0;
  ObjectId open_;
  std::uint32_t next_shape_ = 0;
  bool warned_emissive_curve_ = false;
  std::set<std::string> warned_parameters_;
};

}  // namespace cloudrenderer
