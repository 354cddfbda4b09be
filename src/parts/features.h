#pragma once
// What a host must be able to intersect to hold a part. The names are those of Hello.features.
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace cloudrenderer {

inline constexpr const char* kFeatureTriangles = "triangles";
inline constexpr const char* kFeatureQuadrics = "quadrics";
inline constexpr const char* kFeatureCurves = "curves";
inline constexpr const char* kFeatureBricks = "bricks";
inline constexpr const char* kFeatureInstances = "instances";
inline constexpr const char* kFeatureAlpha = "alpha";
inline constexpr const char* kFeatureMotion = "motion";

// A bit each, in PartInfo::features and the manifest. A part has at least one; 0 means "not told".
enum PartFeature : std::uint32_t {
  kHasTriangles = 1,
  kHasQuadrics = 2,
  kHasCurves = 4,
  kHasBricks = 8,
  kHasInstances = 16,
  kHasAlpha = 32,
  kHasMotion = 64,
};
inline constexpr std::array<std::pair<std::uint32_t, const char*>, 7> kPartFeatures{{
    {kHasTriangles, kFeatureTriangles},
    {kHasQuadrics, kFeatureQuadrics},
    {kHasCurves, kFeatureCurves},
    {kHasBricks, kFeatureBricks},
    {kHasInstances, kFeatureInstances},
    {kHasAlpha, kFeatureAlpha},
    {kHasMotion, kFeatureMotion},
}};

// Of splits that do not tell (0) every part may have anything.
inline std::vector<std::string> feature_names(std::uint32_t features) {
  std::vector<std::string> names;
  for (const auto& [bit, name] : kPartFeatures)
    if (features == 0 || (features & bit)) names.emplace_back(name);
  return names;
}

}  // namespace cloudrenderer
