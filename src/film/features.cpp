#include "film/features.h"

#include <algorithm>
#include <cmath>

namespace cloudrenderer {

int feature_length_k(const Bounds3& scene) {
  const float size = scene.empty() ? 1.f : glm::length(scene.max - scene.min);
  if (!(size > 0.f && size < kInfinity)) return 32;
  return 32 - (std::ilogb(size) + 1);
}

void PixelFeatures::merge(const PixelFeatures& other) {
  for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += other.sum[i];
  samples += other.samples;
  hits += other.hits;
  for (std::size_t i = 0; i < ids.size(); ++i) ids[i] |= other.ids[i];  // only one of the two has sample 0
}

std::vector<ImageChannel> feature_channels(std::span<const PixelFeatures> pixels, FeatureLayer layer, int length_k) {
  const auto numbers = [&](const char* name, FeatureNumber number, std::size_t channel, std::uint32_t PixelFeatures::*count,
                           int k, float nothing) {
    std::vector<float> values;
    values.reserve(pixels.size());
    const double unit = fixed_units(-k);
    for (const PixelFeatures& p : pixels)
      values.push_back(p.*count == 0 ? nothing : static_cast<float>(static_cast<double>(p.sum[number + channel]) * unit / (p.*count)));
    return ImageChannel{name, std::move(values)};
  };
  const auto seen = [&](const char* name, FeatureNumber number, std::size_t channel) {
    return numbers(name, number, channel, &PixelFeatures::samples, kFeatureK, 0.f);
  };
  const auto met = [&](const char* name, FeatureNumber number, std::size_t channel, float nothing) {
    return numbers(name, number, channel, &PixelFeatures::hits, length_k, nothing);
  };
  const auto id = [&](const char* name, FeatureId which) {
    std::vector<std::uint32_t> values(pixels.size());
    std::ranges::transform(pixels, values.begin(), [&](const PixelFeatures& p) { return p.ids[which]; });
    return ImageChannel{name, std::move(values)};
  };
  switch (layer) {
    case FeatureLayer::albedo:
      return {seen("albedo.R", kAlbedo, 0), seen("albedo.G", kAlbedo, 1), seen("albedo.B", kAlbedo, 2)};
    case FeatureLayer::normal:
      return {seen("N.X", kNormal, 0), seen("N.Y", kNormal, 1), seen("N.Z", kNormal, 2)};
    case FeatureLayer::depth:
      return {met("Z", kDepth, 0, 1e10f)};
    case FeatureLayer::position:
      return {met("P.X", kPosition, 0, 0.f), met("P.Y", kPosition, 1, 0.f), met("P.Z", kPosition, 2, 0.f)};
    case FeatureLayer::ids:
      break;
  }
  return {id("id.shape", kShapeId), id("id.primitive", kPrimitiveId), id("id.material", kMaterialId)};
}

}  // namespace cloudrenderer
