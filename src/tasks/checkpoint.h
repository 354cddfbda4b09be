#pragma once
// The journal of a render: a header that names the job, then a record for every renderer task whose
// sums have reached the film. Bytes to values and back; no files.
//
// All numbers are little-endian. The header:
//   8 bytes "crckpt\r\n", u32 version, u32 bytes of the header, u64 split, u64 fingerprint,
//   u64 seed, u32 width, height, x0, y0, x1, y1, i32 k, u32 tile, u32 integrator, light_vertices,
//   emission_vertex, sequence, ao_cosine, f32 ao_distance, u32 footprint_spp, u32 flags (1: features; 2: negative lobes; 4, 8: LightPaths;
//   16, 32: MediaTransport; 64: no light scatters below surfaces; 128: regularized; 256, 512: the logarithm to base 2 of the
//   samples that share a camera ray, of the first run; 1024: if it is worth it),
//   u64 XXH3-64 of all that is before it
// A record:
//   u32 "tile", u32 bytes of its body, u64 XXH3-64 of the body, seeded with the header's checksum
//   plus the body's bytes
// and its body:
//   u32 x0, y0, x1, y1 (a tile of the film: whole, or what the frame leaves of it), u32 number of
//   sample ranges, u8 flags (1: not bit-exact; 2: counts follow), u8 width of a sum in bytes,
//   u16 0, u64 invalid samples, u64 clamped samples, the ranges (u32 begin, end), then row by row
//   for every pixel: with flag 2 the samples counted (u32 even, odd), and six sums in two's
//   complement (even R G B, odd R G B), where the filter has negative lobes all this for samples in positive ones and
//   then for those in negative ones. Without flag 2 every sample of the ranges is counted. With features, for every pixel:
//   u32 hits, u32 ids (shape, primitive, material), and ten sums of 16 bytes (film/features.h). With light paths: u32 number
//   of splats, for each u32 pixel (y * full width + x) and six sums of the body's width, in the order of a pixel's.
// A record of a decision (adaptive sampling), before the samples that it asks for:
//   u32 "goal", u32 bytes, u64 checksum as above, then for every tile of the film, row by row, u32: samples
//   that each of its pixels has when the round is complete
// Records of one tile have no sample in common. The journal ends at the first record that is cut
// off, damaged or impossible; what is behind is not looked at.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "film/features.h"
#include "integrator/job.h"
#include "tasks/sample_set.h"

namespace cloudrenderer {

// What all samples of a checkpoint have in common.
struct CheckpointJob {
  std::uint64_t split = 0;        // Manifest::content_hash
  std::uint64_t fingerprint = 0;  // of the hosts; 0: there was none yet
  std::uint64_t seed = 0;
  FilmFrame frame;
  int k = 0;
  std::uint32_t tile = 0;  // pixels
  IntegratorKind integrator = IntegratorKind::path;
  std::uint32_t light_vertices = 0, emission_vertex = 0;
  SampleSequence::Kind sequence = SampleSequence::Kind::sobol;
  bool ao_cosine = false;
  float ao_distance = 0;
  std::uint32_t footprint_spp = 0;  // that textures are filtered for: of the first run
  bool features = false;
  bool negative_lobes = false;  // of the filter: samples in them are summed apart
  LightPaths light_paths = LightPaths::none;
  MediaTransport media = MediaTransport::none;
  bool subsurface = true;
  bool regularize = false;
  std::uint32_t samples_per_ray = 1;  // of the first run
  bool share_if_worth = false;
  friend bool operator==(const CheckpointJob&, const CheckpointJob&) = default;
};
// Tile and fingerprint are the cluster's, and left out.
CheckpointJob checkpoint_job(std::uint64_t split, const JobSettings& settings);

// "seed 3, this render has seed 0": the first field, but for tile and fingerprint, in which `now`
// differs from what was `made`; none: `now` can go on.
std::optional<std::string> difference(const CheckpointJob& made, const CheckpointJob& now);

// Some samples of all pixels of a tile.
struct TileSums {
  std::uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  std::vector<SampleRange> samples;  // ascending, apart
  std::uint64_t invalid = 0, clamped = 0;
  bool exact = true;            // no host with other arithmetic took part
  std::vector<PixelSums> sums;  // as Film::sums()
  std::vector<PixelFeatures> features{};  // row by row, in jobs with features
  // In jobs with light paths: light brought to pixels, here or elsewhere. What a tile's first record has of it need not be
  // of the tile's own samples, but all records together have that of all samples.
  bool light_paths = false;
  std::vector<Splat> splats{};
};

using Bytes = std::vector<std::byte>;
Bytes encode_header(const CheckpointJob& job);
// Appends to `out`. `header_checksum`: of encode_header().
void encode_record(const TileSums& tile, std::uint64_t header_checksum, Bytes& out);
void encode_goals(std::span<const std::uint32_t> goals, std::uint64_t header_checksum, Bytes& out);
std::uint64_t header_checksum(std::span<const std::byte> header);

inline constexpr std::size_t kCheckpointHeaderBytes = 112;

// None: the bytes end inside the header, so nothing was recorded. An error for what is no
// checkpoint, or has a header that cannot be trusted.
Result<std::optional<CheckpointJob>> read_header(std::span<const std::byte> bytes);

// Reads record after record behind a good header.
class CheckpointReader {
 public:
  CheckpointReader(std::span<const std::byte> bytes, const CheckpointJob& job);
  std::optional<TileSums> next();                     // none: the end, clean or not
  std::size_t position() const { return position_; }  // behind the last good record
  // Of the last decision that has been read; empty: none.
  const std::vector<std::uint32_t>& goals() const { return goals_; }

 private:
  std::optional<TileSums> decode(std::span<const std::byte> body) const;
  bool decode_goals(std::span<const std::byte> body);

  std::span<const std::byte> bytes_;
  CheckpointJob job_;
  std::uint64_t seed_;
  std::size_t position_ = kCheckpointHeaderBytes;
  std::vector<std::uint32_t> goals_;
};

}  // namespace cloudrenderer
