#pragma once
#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "cloudrenderer/math.h"
#include "film/features.h"

namespace cloudrenderer {

// The nearest hit found so far by hosts that a segment has visited; ordered by (t, shape, primitive).
struct BestHit {
  float t = kInfinity;
  std::uint32_t shape = 0xffffffffu;
  std::uint32_t primitive = 0xffffffffu;
};

enum SegmentFlag : std::uint16_t {
  kSpecularBounce = 1,  // made by a specular lobe or the camera: emission counts in full
  kAnyNonSpecular = 2,  // the path has scattered diffusely or glossily before
  kCameraRay = 4,       // straight from the camera: neighbours are coherent
  kMainTested = 8,      // the main scene (part 0), which every host holds, has been tested for this ray
  kLastRay = 16,        // only what this ray finds emitting still counts: the path ends at its hit
  kInside = 32,         // a step of a walk inside of a subsurface material, see InteriorMedium below
  kInsideScattered = 64,  // the walk has changed its direction
  kInsideReversed = 128,  // the walk began on the back of a surface
  // In jobs with features: what PathFeatures said of this path already.
  kHitTold = 256,
  kSurfaceTold = 512,
  // In jobs with light paths: the sample's path has ended at the camera's side and goes on from a light (light_paths.cpp).
  kLightPath = 1024,
  kLightScattered = 2048,  // its light came to a surface that scattered it by a lobe that is not specular
  kSharesRay = 4096,   // the sample shares its camera ray with others (shared_rays.h), from there on to the path's end
  kHoldsGroup = 8192,  // stands for all that do, until its first vertex
};

// One ray of one path with all that the path carries on: exactly what travels between hosts. Plain data.
// A path is a pure function of (job, pixel, sample); two copies of it are equal to the bit wherever they run.
struct PathSegment {
  Vec3 origin;
  Vec3 direction;                    // unit
  Vec3 throughput;
  float previous_pdf = 0;            // solid angle density of the bounce that made this ray
  Fixed3 radiance{};                 // gathered so far, units of 2^-k
  Vec3 previous_normal;              // shading normal where the ray started: for the light choice's density (MIS)
  BestHit best;                      // of hosts visited for this segment; at first t is where the ray ends
  std::uint64_t tested = 0;          // bit i: candidate i along the ray has been tested (see PartMap)
  std::uint32_t task = 0;            // renderer task that the path belongs to (job-wide number)
  std::uint32_t pixel = 0;           // y * full width + x
  std::uint32_t sample = 0;
  std::uint16_t owner = 0;           // host that owns the renderer task
  std::uint16_t vertex = 0;          // surfaces scattered at so far
  std::uint16_t flags = 0;
  std::uint16_t window = 0;          // `tested` speaks of candidates 64 * window + i along the ray
  std::uint16_t passed = 0;          // null surfaces passed so far
  std::uint16_t medium = 0;          // that the ray starts in, see Media
  // Footprint, when the scene needs it. Where light passes null surfaces, after a bounce that was not specular: minus the
  // way since the bounce.
  float cone_width = 0, cone_spread = 0;

  // In jobs with light paths cone_spread is something else behind the first bounce that was not specular, and on paths from
  // lights: how many times likelier a path from a light is to be this path than one from the camera, as far as it is known. And
  // on paths from lights previous_pdf is the square of how many times likelier a light sample is than one from the camera.
  bool has_light_ratio() const { return (flags & (kAnyNonSpecular | kLightPath)) != 0; }
  float& light_ratio() { return cone_spread; }
  float light_ratio() const { return cone_spread; }

  // Where the path scattered last, for the densities of lights; null surfaces lie between.
  Vec3 scattered_at() const { return cone_width < 0.f ? origin + direction * cone_width : origin; }

  // With kInside no light is sampled, so that previous_pdf and previous_normal have no use: they hold the medium of the
  // walk (InteriorMedium::pack), and `passed` counts its steps.
  std::array<std::uint32_t, 4> inside() const {
    const auto bits = [](float x) { return std::bit_cast<std::uint32_t>(x); };
    return {bits(previous_pdf), bits(previous_normal.x), bits(previous_normal.y), bits(previous_normal.z)};
  }
  void set_inside(const std::array<std::uint32_t, 4>& packed) {
    const auto number = [&](std::size_t i) { return std::bit_cast<float>(packed[i]); };
    previous_pdf = number(0);
    previous_normal = {number(1), number(2), number(3)};
  }
};

// The end of a path, sent to the owner of its renderer task.
struct PathEnd {
  std::uint32_t task = 0, pixel = 0, sample = 0;
  std::uint16_t owner = 0;
  std::uint16_t flags = 0;  // PathEndFlag
  Fixed3 radiance{};
  // What the sample's path from a light has brought to a pixel of the film (y * full width + x); none: nothing.
  std::uint32_t target = 0xffffffffu;
  Fixed3 splat{};
};
// The last two in jobs with features: no PathFeatures will say this of the path.
enum PathEndFlag : std::uint16_t { kEndInvalid = 1, kEndClamped = 2, kEndWithoutHit = 4, kEndWithoutSurface = 8 };

// What a path has seen, sent to the owner of its renderer task from where it was seen, so that nothing of it travels with
// the path. Mostly one a path; two where a mirror or smooth glass comes first.
struct PathFeatures {
  std::uint32_t task = 0, pixel = 0, sample = 0;
  std::uint16_t owner = 0;
  std::uint16_t flags = 0;  // kTellsHit: depth, position and ids count; kTellsSurface: albedo and normal
  FeatureIds ids{};
  FeatureValues values{};
};
enum PathFeaturesFlag : std::uint16_t { kTellsHit = 1, kTellsSurface = 2 };

// Of several paths, on its way to one owner.
struct EndBatch {
  std::vector<PathEnd> ends;
  std::vector<PathFeatures> features;
  bool empty() const { return ends.empty() && features.empty(); }
  std::size_t size() const { return ends.size() + features.size(); }
};

// A question to another host: is anything of what you hold between the ends of this ray? 28 bytes.
struct OcclusionRay {
  Vec3 origin;
  Vec3 direction;  // unit
  float t_max = 0;
};

// A tile x sample range of the film: the unit of work that the manager hands out.
struct RendererRange {
  std::uint32_t task = 0;
  std::uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;    // full-resolution pixels
  std::uint32_t sample_begin = 0, sample_end = 0;
  bool shares = false;  // its samples share camera rays (shared_rays.h)
  bool trial = false;   // the manager's: the sums are not for the picture, see ShareTrial
  std::uint64_t pixels() const { return std::uint64_t{x1 - x0} * (y1 - y0); }
  std::uint64_t paths() const { return pixels() * (sample_end - sample_begin); }
};

}  // namespace cloudrenderer
