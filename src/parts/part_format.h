#pragma once
// The layout of a part file; README.md says the same in words.
#include <array>
#include <bit>
#include <cstdint>

#include "parts/part.h"

namespace cloudrenderer::part_format {

inline constexpr std::array<char, 8> kMagic = {'C', 'L', 'R', 'P', 'A', 'R', 'T', '\0'};
inline constexpr std::uint32_t kVersion = 1;
inline constexpr std::uint64_t kAlignment = 64;
inline constexpr std::uint64_t kPadding = 16;  // readable bytes behind the positions
// Coordinates beyond this are no geometry: Embree's own limit is a little higher.
inline constexpr float kLargest = 1e18f;

enum Section : std::uint32_t {
  kPositions,
  kNormals,
  kUvs,
  kTriangles,
  kPrimitiveIds,
  kChunks,
  kQuadrics,
  kInstances,
  kBaseSections,
  // Sections that few parts have: a file's table ends with the last one that is not empty.
  kCurvePoints = kBaseSections,
  kCurveNormals,
  kCurves,
  kCurveSegments,
  kCurveGroups,
  kMotions,
  kBricks,
  kDensities,
  kSectionCount
};
inline constexpr std::array<std::uint32_t, kSectionCount> kElementBytes = {12, 12, 8,  12, 4,  56,  204,
                                                                           136, 12, 12, 28, 4, 160, 144, 216, 4};

struct Header {
  std::array<char, 8> magic = kMagic;
  std::uint32_t version = kVersion;
  std::uint32_t section_count = kBaseSections;
  std::uint64_t file_bytes = 0;
  std::uint64_t checksum = 0;  // xxh3-64 of the file behind this header
  std::array<std::uint32_t, 8> reserved{};
};
struct SectionEntry {
  std::uint32_t section = 0, element_bytes = 0;
  std::uint64_t offset = 0, count = 0;
};

// Files hold the memory image of these types.
static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(Header) == 64 && sizeof(SectionEntry) == 24);
static_assert(sizeof(Vec3) == 12 && sizeof(Vec2) == 8 && sizeof(Triangle) == 12);
static_assert(sizeof(MeshChunk) == 56 && sizeof(QuadricRecord) == 204);
static_assert(sizeof(InstanceRecord) == 136 && sizeof(CurveRecord) == 28 && sizeof(CurveGroup) == 160);
static_assert(sizeof(MotionRecord) == 144 && sizeof(BrickRecord) == 216);

constexpr std::uint64_t align_up(std::uint64_t n) {
  return (n + kAlignment - 1) / kAlignment * kAlignment;
}

}  // namespace cloudrenderer::part_format
