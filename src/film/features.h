#pragma once
// What a pixel shows beside its radiance, for denoisers and compositing. Summed like radiance: in fixed point, so that
// the order cannot be seen. Only in jobs that ask for it (JobSettings::features).
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "film/film.h"

namespace cloudrenderer {

// Albedo and normal (world space, towards the viewer) are those of the first surface that is not a perfect mirror or
// smooth glass, found through these, as Open Image Denoise advises. Depth (z of camera space) and position (world
// space) are those of the first surface or collision in a medium.
enum FeatureNumber : std::size_t { kAlbedo = 0, kNormal = 3, kDepth = 6, kPosition = 7, kFeatureNumbers = 10 };
using FeatureValues = std::array<std::int64_t, kFeatureNumbers>;
// Numbers of the first surface, from 1 on; 0: nothing, or a medium.
enum FeatureId : std::size_t { kShapeId = 0, kPrimitiveId = 1, kMaterialId = 2, kFeatureIds = 3 };
using FeatureIds = std::array<std::uint32_t, kFeatureIds>;

inline constexpr int kFeatureK = 30;  // albedo and normals are in units of 2^-30
// Depths and positions in units of 2^-k, which are 2^-32 of the scene's size or less.
int feature_length_k(const Bounds3& scene);

struct PixelFeatures {
  std::array<Int128, kFeatureNumbers> sum{};
  std::uint32_t samples = 0;  // all, those that are not finite included
  std::uint32_t hits = 0;     // of these: that saw anything
  FeatureIds ids{};           // of sample 0
  void merge(const PixelFeatures& other);
  friend bool operator==(const PixelFeatures&, const PixelFeatures&) = default;
};

enum class FeatureLayer { albedo, normal, depth, position, ids };
// albedo.R, .G, .B and N.X, .Y, .Z: means over all samples, of which those that see nothing count as 0, so that edges
// are smooth as the picture's. Z and P.X, .Y, .Z: means over those that see something; where there are none 1e10, as
// Blender has it, and 0. id.shape, id.primitive, id.material: whole numbers.
std::vector<ImageChannel> feature_channels(std::span<const PixelFeatures> pixels, FeatureLayer layer, int length_k);

}  // namespace cloudrenderer
