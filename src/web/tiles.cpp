#include "web/tiles.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace cloudrenderer {
namespace {

constexpr int kBias = 15, kMantissaBits = 9, kLargestExponent = 31;
constexpr float kLargest = 65408.f;  // 511/512 * 2^16

std::string with_pixels(std::vector<std::uint32_t> words, std::span<const Rgb> pixels) {
  words.reserve(words.size() + pixels.size());
  for (const Rgb& c : pixels) words.push_back(pack_rgb9e5(c));
  std::string bytes(words.size() * sizeof(std::uint32_t), '\0');
  std::memcpy(bytes.data(), words.data(), bytes.size());
  return bytes;
}

std::uint64_t pixels_of(const RendererRange& r) { return std::uint64_t{r.x1 - r.x0} * (r.y1 - r.y0); }

}  // namespace

std::uint32_t pack_rgb9e5(const Rgb& colour) {
  const auto within = [](float x) { return x > 0.f ? std::min(x, kLargest) : 0.f; };
  const Rgb c(within(colour.x), within(colour.y), within(colour.z));
  const float largest = std::max({c.x, c.y, c.z});
  if (largest == 0.f) return 0;
  int exponent = std::max(-kBias - 1, std::ilogb(largest)) + 1 + kBias;
  const auto mantissa = [&](float x) {
    return static_cast<std::uint32_t>(std::lround(std::ldexp(x, kMantissaBits + kBias - exponent)));
  };
  if (mantissa(largest) == 1u << kMantissaBits) ++exponent;  // rounded up to the next power of two
  return mantissa(c.x) | mantissa(c.y) << 9 | mantissa(c.z) << 18 | static_cast<std::uint32_t>(exponent) << 27;
}

Rgb unpack_rgb9e5(std::uint32_t bits) {
  const float unit = std::ldexp(1.f, static_cast<int>(bits >> 27) - kBias - kMantissaBits);
  const auto channel = [&](unsigned shift) { return static_cast<float>(bits >> shift & 0x1ffu) * unit; };
  return {channel(0), channel(9), channel(18)};
}

void append_frame(std::string& to, FrameKind kind, const std::string& body) {
  const auto n = static_cast<std::uint32_t>(body.size() + 1);
  for (int byte = 0; byte < 4; ++byte) to.push_back(static_cast<char>(n >> (8 * byte) & 0xffu));
  to.push_back(static_cast<char>(kind));
  to += body;
}

std::string encode_tile(const TileBox& box, std::span<const Rgb> pixels) {
  return with_pixels({box.x0, box.y0, box.x1 - box.x0, box.y1 - box.y0, box.samples}, pixels);
}

std::string encode_coarse(const ManagerCore& core, const FilmOptions& options, std::size_t most) {
  const Film& film = core.film();
  const std::uint32_t w = film.frame().crop_width(), h = film.frame().crop_height();
  const auto size = [](std::uint32_t n, std::uint32_t by) { return (n + by - 1) / by; };
  std::uint32_t step = 1;
  while (std::uint64_t{size(w, step)} * size(h, step) > most) ++step;
  std::vector<Rgb> pixels;
  for (std::uint32_t y = 0; y < h; y += step)
    for (std::uint32_t x = 0; x < w; x += step) {
      const std::size_t row = std::min(y + step / 2, h - 1);
      pixels.push_back(developed(film, row * w + std::min(x + step / 2, w - 1), options));
    }
  return with_pixels({step, size(w, step), size(h, step)}, pixels);
}

namespace {

// Light of paths from lights changes all tiles: they are news again with every quarter more samples, and at the end.
std::uint64_t age_of_light(const ManagerCore& core) {
  if (core.film().splats().empty()) return 0;
  const ManagerCore::Progress p = core.progress();
  const auto log2 = static_cast<unsigned>(std::bit_width(p.paths_done));
  if (p.paths_done == p.paths_total || log2 < 3) return 1000;
  return 4 * log2 + (p.paths_done >> (log2 - 3) & 3u);
}

}  // namespace

std::vector<std::size_t> TileWatch::choose(const ManagerCore& core, std::uint64_t pixels) {
  chosen_.resize(core.tiles());
  const std::uint64_t age = age_of_light(core);
  struct Candidate {
    std::size_t tile;
    Chosen now;
    double growth;
  };
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < chosen_.size(); ++i) {
    const Chosen now{core.tile_samples(i), age};
    if (now.samples == 0 || now == chosen_[i]) continue;
    const auto before = static_cast<double>(chosen_[i].samples);
    candidates.push_back({i, now, chosen_[i].samples ? static_cast<double>(now.samples) / before : kInfinity});
  }
  std::stable_sort(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) { return a.growth > b.growth; });
  std::vector<std::size_t> out;
  std::uint64_t sum = 0;
  for (const Candidate& c : candidates) {
    sum += pixels_of(core.tile_range(c.tile));
    if (sum > pixels && !out.empty()) break;
    out.push_back(c.tile);
    chosen_[c.tile] = c.now;
  }
  return out;
}

std::vector<Rgb> tile_pixels(const ManagerCore& core, const RendererRange& tile, const FilmOptions& options) {
  const Film& film = core.film();
  const FilmFrame& frame = film.frame();
  std::vector<Rgb> out;
  out.reserve(pixels_of(tile));
  for (std::uint32_t y = tile.y0; y < tile.y1; ++y) {
    const std::size_t row = std::size_t{y - frame.y0} * frame.crop_width() - frame.x0;
    for (std::uint32_t x = tile.x0; x < tile.x1; ++x) out.push_back(developed(film, row + x, options));
  }
  return out;
}

std::string TileBoard::encode(const ManagerCore& core, std::size_t tile, const FilmOptions& options) {
  const RendererRange r = core.tile_range(tile);
  const FilmFrame& frame = core.film().frame();
  return encode_tile({r.x0 - frame.x0, r.y0 - frame.y0, r.x1 - frame.x0, r.y1 - frame.y0, static_cast<std::uint32_t>(core.tile_samples(tile))},
                     tile_pixels(core, r, options));
}

void TileBoard::put(std::size_t tile, std::string bytes) {
  if (tiles_.size() <= tile) tiles_.resize(tile + 1);
  tiles_[tile] = {std::make_shared<const std::string>(std::move(bytes)), ++version_};
}

std::vector<TileBoard::Bytes> TileBoard::next(Viewer& viewer, std::size_t budget) const {
  viewer.versions.resize(tiles_.size());
  std::vector<std::size_t> news;
  for (std::size_t i = 0; i < tiles_.size(); ++i)
    if (tiles_[i].version > viewer.versions[i]) news.push_back(i);
  std::sort(news.begin(), news.end(), [&](std::size_t a, std::size_t b) { return tiles_[a].version < tiles_[b].version; });
  std::vector<Bytes> out;
  std::size_t sum = 0;
  for (const std::size_t i : news) {
    sum += tiles_[i].bytes->size();
    if (sum > budget && !out.empty()) break;
    out.push_back(tiles_[i].bytes);
    viewer.versions[i] = tiles_[i].version;
  }
  return out;
}

}  // namespace cloudrenderer
