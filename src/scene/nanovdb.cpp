#include "scene/nanovdb.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>

#define PNANOVDB_C
#define PNANOVDB_BUF_BOUNDS_CHECK  // what is beyond the end reads as 0
#include <nanovdb/PNanoVDB.h>

namespace cloudrenderer {
namespace {

constexpr std::uint64_t kMagic = 0x304244566f6e614eu;  // "NanoVDB0"
constexpr std::uint32_t kMajor = 32;
constexpr std::uint32_t kMostTiles = 4096;  // of the root, each of 4096^3 samples
constexpr int kLongestAxis = 1 << 20;
constexpr std::uint64_t kMostBlocks = std::uint64_t{1} << 24;  // of 16^3 samples in the box of all
constexpr int kLeaf = 8;                                        // samples along an edge of a leaf

// In front of a file's grids, and of each one's bytes: see nanovdb/util/IO.h.
struct FileHeader {
  std::uint64_t magic;
  std::uint32_t version;
  std::uint16_t grids, codec;
};
struct GridHeader {
  std::uint64_t grid_bytes, file_bytes, name_key, voxels;
  std::uint32_t type, kind;
  std::array<double, 6> world_box;
  std::array<std::int32_t, 6> index_box;
  std::array<double, 3> voxel_size;
  std::uint32_t name_bytes;
  std::array<std::uint32_t, 4> nodes;
  std::array<std::uint32_t, 3> tiles;
  std::uint16_t codec, padding;
  std::uint32_t version;
};
static_assert(sizeof(FileHeader) == 16 && sizeof(GridHeader) == 176);
enum class Codec : std::uint16_t { none, zip, blosc };

template <class T>
bool take(std::istream& in, T& out) {
  in.read(reinterpret_cast<char*>(&out), sizeof out);
  return in.good();
}

constexpr std::size_t kChunk = std::size_t{1} << 20;

// The bytes of a grid; false: the file ends before, or is no zip.
bool copy_plain(std::istream& in, std::uint64_t bytes, BulkWriter<char>& out) {
  std::vector<char> chunk(kChunk);
  while (bytes != 0) {
    const std::size_t n = static_cast<std::size_t>(std::min<std::uint64_t>(bytes, kChunk));
    in.read(chunk.data(), static_cast<std::streamsize>(n));
    if (!in.good()) return false;
    out.append(std::span<const char>(chunk.data(), n));
    bytes -= n;
  }
  return true;
}

bool copy_zipped(std::istream& in, std::uint64_t packed, std::uint64_t bytes, BulkWriter<char>& out) {
  std::vector<char> from(kChunk), to(kChunk);
  z_stream z{};
  if (inflateInit(&z) != Z_OK) return false;
  int state = Z_OK;
  while (state == Z_OK && bytes != 0) {
    if (z.avail_in == 0 && packed != 0) {
      const std::size_t n = static_cast<std::size_t>(std::min<std::uint64_t>(packed, kChunk));
      in.read(from.data(), static_cast<std::streamsize>(n));
      if (!in.good()) break;
      packed -= n;
      z.next_in = reinterpret_cast<Bytef*>(from.data());
      z.avail_in = static_cast<uInt>(n);
    }
    z.next_out = reinterpret_cast<Bytef*>(to.data());
    z.avail_out = static_cast<uInt>(std::min<std::uint64_t>(kChunk, bytes));
    const uInt room = z.avail_out;
    state = inflate(&z, Z_NO_FLUSH);
    const std::size_t made = room - z.avail_out;
    out.append(std::span<const char>(to.data(), made));
    bytes -= made;
    if (made == 0 && z.avail_in == 0 && packed == 0) break;
  }
  inflateEnd(&z);
  return bytes == 0;
}

pnanovdb_buf_t buffer(std::span<const std::uint32_t> words) {
  return pnanovdb_make_buf(const_cast<std::uint32_t*>(words.data()), words.size());  // only read
}
pnanovdb_root_handle_t root_of(pnanovdb_buf_t buf) {
  const pnanovdb_grid_handle_t grid{pnanovdb_address_null()};
  return pnanovdb_tree_get_root(buf, pnanovdb_grid_get_tree(buf, grid));
}
glm::ivec3 to_vec(const pnanovdb_coord_t& c) { return {c.x, c.y, c.z}; }

}  // namespace

std::optional<NanoVdb::Grid> NanoVdb::find(const std::string& path, const std::string& name, const FileLocation& where) {
  const auto fail = [&](const std::string& why) { return SceneError(where, path + ": " + why); };
  if (std::error_code unknown; std::filesystem::exists(path, unknown) && !std::filesystem::is_regular_file(path, unknown)) throw fail("not a regular file");
  std::ifstream in(path, std::ios::binary);
  if (!in) throw fail("cannot be opened");
  FileHeader header;
  while (take(in, header)) {
    if (header.magic != kMagic) throw fail("is no NanoVDB file");
    if (header.version >> 21u != kMajor)
      throw fail("has version " + std::to_string(header.version >> 21u) + " of the NanoVDB format, not " + std::to_string(kMajor) +
                 "; convert it again (nanovdb_convert)");
    std::vector<std::pair<GridHeader, std::string>> grids(header.grids);
    for (auto& [g, called] : grids) {
      if (!take(in, g) || g.name_bytes > 4096) throw fail("ends too early");
      called.resize(g.name_bytes);
      in.read(called.data(), static_cast<std::streamsize>(called.size()));
      if (!in.good()) throw fail("ends too early");
      called.resize(std::strlen(called.c_str()));
    }
    for (const auto& [g, called] : grids) {
      if (called != name) {
        if (g.file_bytes > static_cast<std::uint64_t>(std::numeric_limits<std::streamoff>::max())) throw fail("ends too early");
        in.seekg(static_cast<std::streamoff>(g.file_bytes), std::ios::cur);
        continue;
      }
      if (g.type != PNANOVDB_GRID_TYPE_FLOAT) throw fail("its grid \"" + name + "\" is not of floats");
      BulkWriter<char> bytes;
      bool whole = false;
      if (static_cast<Codec>(g.codec) == Codec::none) {
        whole = copy_plain(in, g.grid_bytes, bytes);
      } else if (static_cast<Codec>(g.codec) == Codec::zip) {
        std::uint64_t packed = 0;
        // A few kilobytes of zip can stand for any amount: grids of floats become a tenth at best.
        if (take(in, packed) && g.grid_bytes / 256 > packed + (std::uint64_t{1} << 20))
          throw fail("its grid \"" + name + "\" would be more than 256 times as large as its zip");
        whole = in.good() && copy_zipped(in, packed, g.grid_bytes, bytes);
      } else {
        throw fail("is compressed with Blosc; plain and zipped files can be read (nanovdb_convert without -b)");
      }
      if (!whole) throw fail("its grid \"" + name + "\" is cut off or broken");
      Grid out;
      const BulkArray<char> held = bytes.finish();
      out.words = BulkArray<std::uint32_t>(
          std::make_shared<BulkArray<char>>(held),
          {reinterpret_cast<const std::uint32_t*>(held.view().data()), held.size() / sizeof(std::uint32_t)});
      const pnanovdb_buf_t buf = buffer(out.words.view());
      const pnanovdb_grid_handle_t grid{pnanovdb_address_null()};
      if (pnanovdb_grid_get_grid_type(buf, grid) != PNANOVDB_GRID_TYPE_FLOAT ||
          pnanovdb_root_get_tile_count(buf, root_of(buf)) > kMostTiles)
        throw fail("its grid \"" + name + "\" is broken");
      const pnanovdb_map_handle_t map = pnanovdb_grid_get_map(buf, grid);
      Mat4 m(1.f);
      for (unsigned row = 0; row < 3; ++row) {
        for (unsigned column = 0; column < 3; ++column)
          m[static_cast<int>(column)][static_cast<int>(row)] =
              static_cast<float>(pnanovdb_map_get_matd(buf, map, 3 * row + column));
        m[3][static_cast<int>(row)] = static_cast<float>(pnanovdb_map_get_vecd(buf, map, row));
      }
      out.index_to_world = Transform(m);
      if (!out.index_to_world.is_invertible()) throw fail("the transformation of its grid \"" + name + "\" cannot be inverted");
      out.low = to_vec(pnanovdb_root_get_bbox_min(buf, root_of(buf)));
      out.high = to_vec(pnanovdb_root_get_bbox_max(buf, root_of(buf)));
      return out;
    }
  }
  return std::nullopt;
}

std::shared_ptr<const NanoVdb> NanoVdb::open(const std::string& path, const std::vector<std::string>& names,
                                             const FileLocation& where) {
  auto out = std::make_shared<NanoVdb>();
  for (const std::string& name : names) {
    std::optional<Grid> grid = find(path, name, where);
    out->channel_of_.push_back(grid ? static_cast<int>(out->grids_.size()) : -1);
    if (!grid && out->grids_.empty()) throw SceneError(where, path + ": has no grid \"" + name + "\"");
    if (grid) out->grids_.push_back(std::move(*grid));
  }
  const Grid& main = out->grids_.front();
  std::uint64_t blocks = 1;
  for (int a = 0; a < 3; ++a) {
    const std::int64_t n = std::int64_t{main.high[a]} - main.low[a] + 1;
    if (n < 1) throw SceneError(where, path + ": its grid \"" + names.front() + "\" is empty");
    if (n > kLongestAxis || std::abs(std::int64_t{main.low[a]}) > kLongestAxis)
      throw SceneError(where, path + ": its grid \"" + names.front() + "\" is too big");
    out->size_[a] = static_cast<std::uint32_t>(n);
    blocks *= static_cast<std::uint64_t>(n) / 16 + 1;
  }
  if (blocks > kMostBlocks) throw SceneError(where, path + ": its grid \"" + names.front() + "\" is too big");
  out->first_ = main.low;
  out->index_to_world_ = main.index_to_world;
  for (const Grid& g : out->grids_) out->aligned_.push_back(g.index_to_world.matrix() == main.index_to_world.matrix());
  return out;
}

// Leaf by leaf.
void NanoVdb::read_blocks(const Grid& grid, const glm::ivec3& begin, const glm::ivec3& end, float* out) {
  const pnanovdb_buf_t buf = buffer(grid.words.view());
  const pnanovdb_root_handle_t root = root_of(buf);
  const glm::ivec3 size = end - begin;
  const auto leaf_of = [](const glm::ivec3& v) { return v & ~(kLeaf - 1); };
  for (int bz = leaf_of(begin).z; bz < end.z; bz += kLeaf)
    for (int by = leaf_of(begin).y; by < end.y; by += kLeaf)
      for (int bx = leaf_of(begin).x; bx < end.x; bx += kLeaf) {
        const glm::ivec3 block(bx, by, bz), low = glm::max(block, begin), high = glm::min(block + kLeaf, end);
        pnanovdb_coord_t at{low.x, low.y, low.z};
        pnanovdb_uint32_t level = 0;
        const pnanovdb_address_t first =
            pnanovdb_root_get_value_address_and_level(PNANOVDB_GRID_TYPE_FLOAT, buf, root, &at, &level);
        const std::uint64_t leaf = first.byte_offset - sizeof(float) * pnanovdb_leaf_coord_to_offset(&at);
        const float all = pnanovdb_read_float(buf, first);
        for (int z = low.z; z < high.z; ++z)
          for (int y = low.y; y < high.y; ++y) {
            float* row = out + (static_cast<std::size_t>(z - begin.z) * static_cast<std::size_t>(size.y) + static_cast<std::size_t>(y - begin.y)) *
                                   static_cast<std::size_t>(size.x);
            for (int x = low.x; x < high.x; ++x) {
              float v = all;
              if (level == 0) {
                pnanovdb_coord_t c{x, y, z};
                v = pnanovdb_read_float(buf, {leaf + sizeof(float) * pnanovdb_leaf_coord_to_offset(&c)});
              }
              row[x - begin.x] = std::isfinite(v) ? v : 0.f;
            }
          }
      }
}

float NanoVdb::value(const Grid& grid, const glm::ivec3& at) {
  float out;
  read_blocks(grid, at, at + 1, &out);
  return out;
}

void NanoVdb::read(std::uint32_t channel, const glm::ivec3& begin, const glm::ivec3& end, float* out) const {
  const Grid& grid = grids_[channel];
  if (aligned_[channel]) return read_blocks(grid, first_ + begin, first_ + end, out);
  const Transform to_index = grid.index_to_world.inverse();
  for (int z = begin.z; z < end.z; ++z)
    for (int y = begin.y; y < end.y; ++y)
      for (int x = begin.x; x < end.x; ++x) {
        const Vec3 p = to_index.point(index_to_world_.point(Vec3(first_ + glm::ivec3(x, y, z))));
        float sum = 0;
        if (is_finite(p) && glm::all(glm::lessThan(glm::abs(p), Vec3(2.f * kLongestAxis)))) {
          const Vec3 low = glm::floor(p), part = p - low;
          for (int corner = 0; corner < 8; ++corner) {
            const glm::ivec3 c(corner & 1, corner >> 1 & 1, corner >> 2);
            const float weight = (c.x ? part.x : 1 - part.x) * (c.y ? part.y : 1 - part.y) * (c.z ? part.z : 1 - part.z);
            if (weight != 0.f) sum += weight * value(grid, glm::ivec3(low) + c);
          }
        }
        *out++ = sum;
      }
}

}  // namespace cloudrenderer
