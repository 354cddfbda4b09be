#pragma once
// What a simulation knows of a scene and of what computing it costs: the "model" of a report (docs/simulation.md).
#include <cstdint>
#include <string>
#include <vector>

#include "film/film.h"
#include "tasks/placement.h"

namespace cloudrenderer::sim {

// A vertex of a path that was traced for this purpose: the parts whose boxes its ray entered before its hit, front to back.
struct PathVertex {
  static constexpr std::uint32_t kNone = 0xffffffffu;
  std::vector<std::uint32_t> parts;
  std::uint32_t hit = kNone;  // 0: the main scene
  bool shadow = false;        // a shadow ray was cast
  std::vector<std::uint32_t> shadow_parts;  // that it entered; none where the main scene blocks it
  std::uint32_t blocker = kNone;
};
using PathSample = std::vector<PathVertex>;

// Paths of a grid of cells over the film, in rows, `per_cell` of each.
struct PathSamples {
  std::uint32_t columns = 1, rows = 1, per_cell = 1;
  std::vector<PathSample> paths;
};

struct ModelPart {
  PlacementPart placement;
  std::uint64_t file_bytes = 0, triangles = 0;
};

// Processor seconds of one thread.
struct ComputeCosts {
  double camera = 0;     // a camera ray
  double trace = 0;      // a ray
  double shade = 0;      // a vertex
  double occlusion = 0;  // a shadow ray
  double path = 0;       // what else a path costs: queues, ends, sums
  double triangle = 4e-7;   // loading it, its BVH included
  double message = 60e-6;   // between two hosts, both ends
  double message_byte = 0.45e-9;
  double move = 6e-7;       // a segment or a shadow ray that moves: sorted out, packed, unpacked, its parts looked up again
};

struct SceneModel {
  std::string name;
  std::uint32_t width = 0, height = 0, spp = 0;
  std::uint32_t samples_per_ray = 1;  // that shared what the camera saw (integrator/shared_rays.h)
  std::uint32_t columns = 0;  // of segments on the wire (wire::ColumnSet)
  std::uint64_t manifest_bytes = 0;
  std::vector<ModelPart> parts;  // [0] the main scene
  std::vector<std::uint64_t> prototype_bytes;
  PathSamples samples;
  ComputeCosts costs;

  std::uint64_t triangles() const;
  // The same land with more triangles, evenly: parts keep their number, neighbours and visits, and grow.
  void scale_triangles(double factor);
};

// Throws UsageError: what is missing in the text of a report, and what to do about it.
SceneModel read_model(const std::string& json, const std::string& file);

}  // namespace cloudrenderer::sim
