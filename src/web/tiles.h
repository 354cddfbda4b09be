#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "tasks/manager_core.h"

namespace cloudrenderer {

// A colour in 32 bits: three mantissas of 9 bits (red lowest) and a common exponent of 5 bits above them, as in OpenGL's
// EXT_texture_shared_exponent: 2^-24 to 65408, negative numbers and NaN as 0.
std::uint32_t pack_rgb9e5(const Rgb& c);
Rgb unpack_rgb9e5(std::uint32_t bits);

// A frame of the stream to viewers: a length (32 bits, little-endian, of what follows it), a kind, the body.
enum class FrameKind : char { job = 1, tile = 2, coarse = 3 };
void append_frame(std::string& to, FrameKind kind, const std::string& body);

// Pixels of a picture, [x0, x1) x [y0, y1) from its corner on, that have `samples` together.
struct TileBox {
  std::uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0, samples = 0;
};
// x, y, width, height, samples: 32 bits each, little-endian; then the pixels as pack_rgb9e5 gives them.
std::string encode_tile(const TileBox& box, std::span<const Rgb> pixels);
// All of the picture in at most `most` pixels, for those who have nothing yet: step, width, height (32 bits each,
// little-endian), then the pixels at the middle of squares of `step` pixels.
std::string encode_coarse(const ManagerCore& core, const FilmOptions& options, std::size_t most);

// Looks which tiles of a growing picture are worth sending. A value of the render's thread.
class TileWatch {
 public:
  // Tiles that have new samples, the most changed first (by the ratio of samples to those of the last time; a tile that
  // was never chosen before all others), of at most `pixels` pixels together, but one at least; they count as chosen.
  std::vector<std::size_t> choose(const ManagerCore& core, std::uint64_t pixels);

 private:
  struct Chosen {
    std::uint64_t samples = 0, age_of_light = 0;
    friend bool operator==(const Chosen&, const Chosen&) = default;
  };
  std::vector<Chosen> chosen_;  // as they were when chosen last
};

// The pixels of a tile, row by row, black where there is no sample yet.
std::vector<Rgb> tile_pixels(const ManagerCore& core, const RendererRange& tile, const FilmOptions& options);

// The tiles as viewers get them, the last state of each. Not thread-safe.
class TileBoard {
 public:
  using Bytes = std::shared_ptr<const std::string>;
  static std::string encode(const ManagerCore& core, std::size_t tile, const FilmOptions& options);  // as encode_tile

  void put(std::size_t tile, std::string bytes);
  // What a viewer has seen.
  struct Viewer {
    std::vector<std::uint64_t> versions;
  };
  // What it should see next, the oldest news first, of at most `budget` bytes, but one at least.
  std::vector<Bytes> next(Viewer& viewer, std::size_t budget) const;

 private:
  struct Entry {
    Bytes bytes;
    std::uint64_t version = 0;
  };
  std::vector<Entry> tiles_;
  std::uint64_t version_ = 0;
};

}  // namespace cloudrenderer
