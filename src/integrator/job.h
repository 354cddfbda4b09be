#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "base/log.h"
#include "base/random.h"
#include "film/film.h"
#include "scene/description.h"

namespace cloudrenderer {

enum class IntegratorKind : std::uint8_t { path, direct, ambient_occlusion };

// What participating media do. pbrt-v2's volume integrators: `emission` lets media shine and absorb, `single` gathers light
// that they scatter once, both along rays from the camera and from specular lobes. pbrt-v3's volpath: paths scatter in them.
enum class MediaTransport : std::uint8_t { none, emission, single, multiple };

// Whether every sample has a path from a light too: for light that comes from its light by specular surfaces, or for all light
// that what the camera sees has not directly.
enum class LightPaths : std::uint8_t { none, caustics, all };
const char* name(LightPaths paths);                          // off, caustics, all
std::optional<LightPaths> light_paths_of(const std::string& name);

// What the command line changes of the scene's own settings.
struct JobOverrides {
  std::optional<std::uint32_t> spp, max_depth;
  std::optional<std::uint32_t> width, height;
  std::optional<std::array<float, 4>> crop;  // x0 x1 y0 y1 in [0, 1], as pbrt's cropwindow
  std::optional<std::string> integrator;     // pbrt's name
  std::optional<LightPaths> light_paths;
  std::optional<std::uint32_t> samples_per_ray;  // none: 2, if it is worth it
  std::uint32_t seed = 0;
};

// Everything that fixes the picture besides the scene's geometry, materials and lights. Plain data, sent to all hosts.
struct JobSettings {
  FilmOptions film;
  std::uint32_t spp = 16;
  std::uint32_t footprint_spp = 0;  // that textures are filtered for; 0: spp
  // That share what the camera sees, where that can be (shared_rays.h): 1, 2, 4 or 8. share_if_worth: it is tried before (ShareTrial).
  std::uint32_t samples_per_ray = 1;
  bool share_if_worth = false;
  std::uint32_t seed = 0;
  SampleSequence::Kind sequence = SampleSequence::Kind::sobol;
  IntegratorKind integrator = IntegratorKind::path;
  MediaTransport media = MediaTransport::none;
  bool subsurface = true;  // light scatters below surfaces; else their boundaries alone are there
  float media_step = 1;  // that pbrt-v2 would march, see Media::unmarched
  // Vertices (0 is what the camera sees) below `light_vertices` gather light; emission that a specular chain finds
  // counts up to vertex `emission_vertex`.
  std::uint32_t light_vertices = 6;
  std::uint32_t emission_vertex = 5;
  LightPaths light_paths = LightPaths::none;
  bool regularize = false;  // paths see only wide microfacets once they have scattered by some (pbrt-v4), see Shading::lobes
  bool lit_behind_null = false;  // what a ray finds behind a surface without material counts in full (`path` of pbrt-v4)
  float ao_distance = kInfinity;
  bool ao_cosine = false;
  int k = 30;  // fixed point: units of 2^-k
  FilterLobes lobes;  // of the scene's filter
  bool features = false;  // paths tell what they see, see film/features.h
  int length_k = 32;      // of depths and positions, see feature_length_k()
};

// Whether samples may share camera rays. Media, paths from lights and limits go by the sample at the first vertex already.
bool may_share_rays(const JobSettings& job);

// Reads integrator, sampler and film with pbrt's meaning of their parameters in the scene's dialect (v2 and v3 count
// depth one apart). Throws SceneError / UsageError.
JobSettings job_settings(const SceneDescription& scene, const JobOverrides& overrides, Warnings& warnings);

}  // namespace cloudrenderer
