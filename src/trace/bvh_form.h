#pragma once
#include <cstdint>

namespace cloudrenderer {

// The most that Embree may use of what the processor has (its max_isa). Hosts of a cluster may differ in it: hits do not.
inline constexpr const char* kEmbreeIsa = "avx512";

// How a part's BVH is built. The hits are the same to the bit in both (Embree's compact scenes test triangles in
// another way: they are no third one).
enum class BvhForm : std::uint8_t {
  fast,  // to be traced as fast as possible
  // Built in a third of the time, traced at half the speed, a third larger: for parts that come and go.
  passing,
};

}  // namespace cloudrenderer
