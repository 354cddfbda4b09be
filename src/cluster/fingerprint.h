#pragma once
#include <cstdint>

namespace cloudrenderer {

// What our lanes use: for people, the fingerprint decides.
#ifdef __aarch64__
inline constexpr const char* kInstructionSet = "neon";
#else
inline constexpr const char* kInstructionSet = "avx2";
#endif

// A hash of what this build and machine compute for fixed inputs: our functions over a table, and
// Embree's answers to fixed rays. Hosts with the same number give the same picture to the bit.
std::uint64_t numeric_fingerprint();

}  // namespace cloudrenderer
