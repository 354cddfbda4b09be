// A part file whose magic, length and checksum are right, read and walked through.
#include <xxhash.h>

#include <algorithm>
#include <memory>

#include "fuzz/fuzz.h"
#include "parts/check.h"
#include "parts/part_format.h"

using namespace cloudrenderer;

namespace {

std::shared_ptr<std::byte> aligned_copy(fuzz::Input bytes) {
  std::shared_ptr<std::byte> block(
      new (std::align_val_t{64}) std::byte[bytes.size() + 1],
      [](std::byte* p) { ::operator delete[](p, std::align_val_t{64}); });
  std::memcpy(block.get(), bytes.data(), bytes.size());
  return block;
}

void seal(std::byte* file, std::size_t size) {
  part_format::Header header;
  std::memcpy(&header, file, sizeof header);
  header.magic = part_format::kMagic;
  header.version = part_format::kVersion;
  header.section_count = std::clamp<std::uint32_t>(header.section_count, part_format::kBaseSections, part_format::kSectionCount);
  header.file_bytes = size;
  header.reserved = {};
  header.checksum = XXH3_64bits(file + sizeof header, size - sizeof header);
  std::memcpy(file, &header, sizeof header);
}

// Everything that a host looks at before it builds.
void walk(const Part& part) {
  double sum = 0;
  for (std::uint32_t t = 0; t < part.triangles.size(); ++t) {
    const MeshChunk& c = part.chunk_of(t);
    sum += part.source_primitive(c, t);
    for (int i = 0; i < 3; ++i) {
      const std::uint32_t v = part.triangles[t][i];
      sum += static_cast<double>(part.positions[v].x);
      if (c.first_normal != kNone)
        sum += static_cast<double>(part.normals[c.first_normal + v - c.first_vertex].x);
      if (c.first_uv != kNone)
        sum += static_cast<double>(part.uvs[c.first_uv + v - c.first_vertex].x);
    }
  }
  fuzz::require(sum == sum, "no vertex is a NaN");
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::Input bytes = fuzz::input(data, size);
  const std::shared_ptr<std::byte> file = aligned_copy(bytes);
  (void)read_part({file.get(), size}, file);
  if (size < sizeof(part_format::Header)) return 0;
  seal(file.get(), size);
  const Result<Part> part = read_part({file.get(), size}, file);
  if (!part) return 0;
  walk(*part);
  Manifest manifest;
  manifest.scene.materials.resize(2);
  (void)find_bad_reference(*part, manifest);
  return 0;
}
