#pragma once
// Participating media: what happens to light between surfaces.
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "base/log.h"
#include "base/random.h"
#include "cloudrenderer/math.h"
#include "scene/description.h"

namespace cloudrenderer {

// A stretch of a ray, from its origin.
struct MediumRay {
  Vec3 origin;
  Vec3 direction;  // unit
  float t_max = kInfinity;
};

// The random numbers of one stretch of a path.
struct MediumNumbers {
  SampleSequence sequence;
  std::uint32_t first = 0;
  float channel() const { return sequence.get_2d(first).x; }
  float march() const { return sequence.get_2d(first).y; }
  float distance(std::size_t medium) const { return pair(medium).x; }
  float emission(std::size_t medium) const { return pair(medium).y; }

 private:
  Vec2 pair(std::size_t medium) const { return sequence.get_2d(first + 1 + static_cast<std::uint32_t>(medium)); }
};

// What a stretch of a path came to.
struct MediumSample {
  bool collides = false;  // scatters or is absorbed at t; else it passes
  float t = 0;
  float g = 0;            // of the medium that it collided with
  Rgb weight{1};          // times this the throughput goes on, scattered or passed
  Rgb emitted{0};         // where it collides: light of the medium, times the throughput before
};

// A homogeneous medium, or a density that decreases exponentially with the height; all of space, or a box.
struct Medium {
  Rgb sigma_a{0}, sigma_s{0}, sigma_t{0}, emission{0};
  Rgb radiance{0};  // pbrt-v4: what the absorbing part emits, taken along by paths that collide
  float g = 0;
  bool gray = true;  // sigma_t is the same in all channels
  bool bounded = false;
  Transform world_to_medium;  // of what follows
  Vec3 low{}, high{};
  bool exponential = false;  // density a exp(-b height), height over `low` along `up`
  float a = 1, b = 0;
  Vec3 up{0, 1, 0};
};

// A medium whose density is a grid: bricks of it stand in parts. Where it shines but does not attenuate, rays stop
// nevertheless, by `event`, to take the light along.
struct GridMedium {
  Rgb albedo{0};           // sigma_s / sigma_t
  Rgb event{0}, blocking{0};  // collisions a unit of length and density: see CollisionRate; blocking is sigma_t
  Rgb emission{0};         // at an event: of the medium over `event`
  float g = 0;
  // What differs from point to point, by channels of the bricks' samples (kNoChannel: none); pbrt-v4 only.
  std::uint32_t strength = kNoChannel;     // times the emission
  // Without such a channel pbrt-v4 has a grid of one sample: 1 in the middle of the box, half of it at each side.
  bool one_strength = false;
  Transform world_to_medium;
  Vec3 low{0}, size{1};  // of the box
  std::uint32_t temperature = kNoChannel;  // emission is that of a black body
  float temperature_offset = 0, temperature_scale = 1;
  std::uint32_t scattering = kNoChannel;   // red of sigma_s, green and blue follow; sigma_t are the first three
  std::uint32_t radiance = kNoChannel;     // red of what the absorbing part emits, as above
  bool varies() const { return strength != kNoChannel || temperature != kNoChannel || scattering != kNoChannel; }
};

// What happens where a path has collided with a grid.
struct GridCollision {
  Rgb albedo{0}, emission{0};
};

// The media of a scene. Path segments name the one that they are in by 1 + its number, 0 is vacuum. In scenes of
// pbrt-v2 all regions are everywhere, and the number says nothing. Immutable, any thread.
//
// Collisions with several media at one place are independent (Poisson processes): the first one counts. Where the
// channels differ one is chosen for the distance, and the weight is that of all three choices together (single-sample
// multiple importance sampling, as in Pharr, Jakob and Humphreys, "Physically Based Rendering", 3rd ed., section 15.2).
class Media {
 public:
  // Null if the scene has none. Throws SceneError.
  static std::unique_ptr<const Media> build(const SceneDescription& scene, Warnings& warnings);
  // Throws and warns as build() does.
  static void check(const SceneDescription& scene, Warnings& warnings) { build(scene, warnings); }

  // By medium, those of no grid black; empty: the scene has none.
  std::span<const GridMedium> grids() const { return grids_; }
  // At a point of the world, in a grid whose samples there, channel by channel, are `values`; empty where the grid does not vary.
  GridCollision collision(const GridMedium& grid, std::span<const float> values, const Vec3& p) const;
  // Rates differ between the channels: a path is of one channel then.
  bool chromatic_grids() const { return chromatic_grids_; }

  Rgb transmittance(std::uint16_t medium, const MediumRay& ray) const;
  MediumSample sample(std::uint16_t medium, const MediumRay& ray, const MediumNumbers& numbers) const;
  // pbrt-v2 marches along a ray in steps of this length or less, and attenuates what lies behind its media up to the last
  // of its places only, a random part of a step before their end. This is how much more light that lets through: pictures
  // are as bright as pbrt's with it.
  Rgb unmarched(const MediumRay& ray, float step, const MediumNumbers& numbers) const;
  // Light that the media along the ray emit towards its origin: an estimate.
  Rgb emitted(std::uint16_t medium, const MediumRay& ray, const MediumNumbers& numbers) const;

 private:
  std::span<const Medium> active(std::uint16_t medium) const {
    if (all_) return media_;
    return medium == 0 || medium > media_.size() ? std::span<const Medium>() : std::span(media_).subspan(medium - 1u, 1);
  }

  // Radiance of a black body in kelvin, as pbrt-v4 has it.
  Rgb black_body(float kelvin) const;

  std::vector<Medium> media_;
  std::vector<GridMedium> grids_;
  std::vector<Rgb> black_body_;  // see black_body(); empty where no grid has a temperature
  bool chromatic_grids_ = false;
  bool all_ = false;  // everywhere: pbrt-v2
};

// Coefficients per millimetre of what pbrt calls by name: sigma_a and reduced sigma_s. False: no such name.
bool find_measured_medium(std::string_view name, Dialect dialect, Rgb& sigma_a, Rgb& sigma_s);

}  // namespace cloudrenderer
