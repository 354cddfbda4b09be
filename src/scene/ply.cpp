#include "scene/ply.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <vector>

#include "scene/number.h"
#include "scene/ply_header.h"

namespace cloudrenderer {

namespace {

static_assert(std::endian::native == std::endian::little,
              "part files and PLY data are read in place");

// The numbers of an ASCII file, one after the other.
class AsciiBody {
 public:
  AsciiBody(const SourceText& text, const PlyHeader& header)
      : text_(text),
        p_(text.view().data() + header.bytes),
        end_(text.view().data() + text.view().size()),
        line_(header.lines + 1) {}

  [[noreturn]] void fail(const std::string& why) const {
    throw SceneError({text_.name(), line_, 1}, why);
  }

  float real(PlyType) {
    skip_blanks();
    float v;
    const char* const begin = p_;
    if (!parse_float(p_, end_, v) || (p_ != end_ && *p_ == '#')) {
      p_ = begin;
      if (!parse_non_finite(p_, end_, v)) return bad_number();
    }
    check_end();
    return v;
  }
  std::int64_t integer(PlyType) {
    skip_blanks();
    std::int64_t v = 0;
    if (p_ != end_ && *p_ == '+') ++p_;
    const auto [stop, error] = std::from_chars(p_, end_, v);
    if (error != std::errc{}) bad_number();
    p_ = stop;
    check_end();
    return v;
  }
  void skip(PlyType type, std::uint64_t n) {
    for (; n != 0; --n) real(type);
  }
  // A number needs a character and a blank.
  bool can_hold(std::uint64_t count, std::size_t numbers, std::size_t) const {
    return numbers == 0 || count <= (left() + 1) / 2 / numbers;
  }
  bool can_hold_list(std::uint64_t n, PlyType) const { return n <= (left() + 1) / 2; }

 private:
  std::uint64_t left() const { return static_cast<std::uint64_t>(end_ - p_); }
  void skip_blanks() {
    for (; p_ != end_ && (*p_ == ' ' || *p_ == '\n' || *p_ == '\t' || *p_ == '\r'); ++p_)
      line_ += *p_ == '\n';
    if (p_ == end_) fail("the PLY file ends too early");
  }
  void check_end() const {
    if (p_ != end_ && *p_ != ' ' && *p_ != '\n' && *p_ != '\t' && *p_ != '\r') bad_number();
  }
  // Exporters write what their language prints for a number that is none.
  float bad_number() const { fail("expected a number in the PLY file"); }

  const SourceText& text_;
  const char* p_;
  const char* end_;
  std::uint32_t line_;
};

// The numbers of a binary file.
template <bool kSwap>
class BinaryBody {
 public:
  BinaryBody(const SourceText& text, const PlyHeader& header)
      : text_(text),
        begin_(text.view().data()),
        p_(begin_ + header.bytes),
        end_(begin_ + text.view().size()) {}

  [[noreturn]] void fail(const std::string& why) const {
    throw SceneError({text_.name(), 0, 0}, why + " (at byte " + std::to_string(p_ - begin_) + ")");
  }
  float real(PlyType type) {
    switch (type) {
      case PlyType::float32:
        return take<float>();
      case PlyType::float64:
        return static_cast<float>(take<double>());
      default:
        return static_cast<float>(integer(type));
    }
  }
  std::int64_t integer(PlyType type) {
    switch (type) {
      case PlyType::int8:
        return take<std::int8_t>();
      case PlyType::uint8:
        return take<std::uint8_t>();
      case PlyType::int16:
        return take<std::int16_t>();
      case PlyType::uint16:
        return take<std::uint16_t>();
      case PlyType::int32:
        return take<std::int32_t>();
      case PlyType::uint32:
        return take<std::uint32_t>();
      default:
        fail("a whole number must not have a floating-point type");
    }
  }
  void skip(PlyType type, std::uint64_t n) { p_ += n * size_of(type); }  // after can_hold_list
  bool can_hold(std::uint64_t count, std::size_t, std::size_t bytes) const {
    return bytes == 0 || count <= left() / bytes;
  }
  bool can_hold_list(std::uint64_t n, PlyType type) const { return n <= left() / size_of(type); }

 private:
  std::uint64_t left() const { return static_cast<std::uint64_t>(end_ - p_); }
  template <class T>
  T take() {
    if (left() < sizeof(T)) fail("the PLY file ends too early");
    std::array<char, sizeof(T)> bytes;
    std::memcpy(bytes.data(), p_, sizeof(T));
    p_ += sizeof(T);
    if constexpr (kSwap) std::reverse(bytes.begin(), bytes.end());
    return std::bit_cast<T>(bytes);
  }

  const SourceText& text_;
  const char* begin_;
  const char* p_;
  const char* end_;
};

// Where a vertex property goes: 0-2 position, 3-5 normal, from 6 on uvs by pbrt's names, of which the first ones count,
// behind them nowhere.
constexpr std::size_t kFirstUv = 6, kNowhere = 14;
std::size_t slot_of(const std::string& name) {
  struct Row {
    std::string_view name;
    std::size_t slot;
  };
  static constexpr auto kRows = std::to_array<Row>({{"x", 0},
                                                    {"y", 1},
                                                    {"z", 2},
                                                    {"nx", 3},
                                                    {"ny", 4},
                                                    {"nz", 5},
                                                    {"u", 6},
                                                    {"v", 7},
                                                    {"s", 8},
                                                    {"t", 9},
                                                    {"texture_u", 10},
                                                    {"texture_v", 11},
                                                    {"texture_s", 12},
                                                    {"texture_t", 13}});
  for (const Row& row : kRows)
    if (row.name == name) return row.slot;
  return kNowhere;
}

template <class Body>
class BodyReader {
 public:
  BodyReader(const SourceText& text, const PlyHeader& header)
      : header_(header), body_(text, header) {}

  PlyMesh read() {
    bool has_vertices = false, has_faces = false;
    for (const PlyElement& e : header_.elements) {
      std::size_t bytes = 0;
      for (const PlyProperty& p : e.properties) bytes += size_of(p.is_list ? p.count_type : p.type);
      if (!body_.can_hold(e.count, e.properties.size(), bytes))
        body_.fail("the PLY file is too short for " + std::to_string(e.count) + " elements \"" +
                   e.name + "\"");
      if (e.name == "vertex" && !has_vertices) {
        has_vertices = true;
        read_vertices(e);
      } else if (e.name == "face" && !has_faces) {
        has_faces = true;
        read_faces(e);
      } else if (!has_vertices || !has_faces) {  // what comes behind both does not matter
        for (std::uint64_t i = 0; i < (e.properties.empty() ? 0 : e.count); ++i)
          for (const PlyProperty& p : e.properties) skip(p);
      }
    }
    if (!has_vertices || !has_faces)
      body_.fail(std::string("the PLY file has no element \"") +
                 (has_vertices ? "face" : "vertex") + "\"");
    PlyMesh mesh;
    mesh.positions = positions_.finish();
    if (has_normals_) mesh.normals = normals_.finish();
    if (has_uvs_) mesh.uvs = uvs_.finish();
    mesh.triangles = triangles_.finish();
    mesh.faces = faces_.finish();
    mesh.polygons = polygons_;
    if (!mesh.triangles.empty() && largest_index_ >= mesh.positions.size())
      body_.fail("a face has vertex " + std::to_string(largest_index_) + ", but there are only " +
                 std::to_string(mesh.positions.size()));
    return mesh;
  }

 private:
  void skip(const PlyProperty& p) {
    if (p.is_list)
      body_.skip(p.type, list_length(p));
    else
      body_.real(p.type);
  }

  std::uint64_t list_length(const PlyProperty& p) {
    const std::int64_t n = body_.integer(p.count_type);
    if (n < 0 || !body_.can_hold_list(static_cast<std::uint64_t>(n), p.type))
      body_.fail("a list of " + std::to_string(n) + " values does not fit the PLY file");
    return static_cast<std::uint64_t>(n);
  }

  void read_vertices(const PlyElement& e) {
    if (e.count > 0xffffffffu) body_.fail("more than 2^32 vertices in a PLY file");
    std::vector<std::size_t> slots;
    std::array<bool, kNowhere + 1> given{};
    for (const PlyProperty& p : e.properties) {
      slots.push_back(p.is_list ? kNowhere : slot_of(p.name));
      given[slots.back()] = true;
    }
    if (!given[0] || !given[1] || !given[2])
      body_.fail("the vertices of the PLY file have no x, y, z");
    has_normals_ = given[3] && given[4] && given[5];
    std::size_t uv = kFirstUv;
    while (uv < kNowhere && !(given[uv] && given[uv + 1])) uv += 2;
    has_uvs_ = uv < kNowhere;
    for (std::uint64_t i = 0; i < e.count; ++i) {
      std::array<float, kNowhere + 1> v{};
      for (std::size_t j = 0; j < slots.size(); ++j) {
        if (slots[j] == kNowhere)
          skip(e.properties[j]);
        else
          v[slots[j]] = body_.real(e.properties[j].type);
      }
      const Vec3 p{v[0], v[1], v[2]}, n{v[3], v[4], v[5]};
      if (!is_finite(p))
        body_.fail("vertex " + std::to_string(i) + " of the PLY file is not finite");
      positions_.push_back(p);
      if (has_normals_) normals_.push_back(is_finite(n) ? n : Vec3(0.f));
      if (has_uvs_)
        uvs_.push_back({std::isfinite(v[uv]) ? v[uv] : 0.f, std::isfinite(v[uv + 1]) ? v[uv + 1] : 0.f});
    }
  }

  void read_faces(const PlyElement& e) {
    if (e.count > 0xffffffffu) body_.fail("more than 2^32 faces in a PLY file");
    const auto is_corners = [](const PlyProperty& p) {
      return p.is_list && (p.name == "vertex_indices" || p.name == "vertex_index");
    };
    if (std::none_of(e.properties.begin(), e.properties.end(), is_corners))
      body_.fail("the faces of the PLY file have no list vertex_indices");
    std::vector<std::uint32_t> corners;
    for (std::uint64_t face = 0; face < e.count; ++face) {
      corners.clear();
      for (const PlyProperty& p : e.properties) {
        if (!is_corners(p)) {
          skip(p);
          continue;
        }
        const std::uint64_t n = list_length(p);
        for (std::uint64_t i = 0; i < n; ++i) {
          const std::int64_t index = body_.integer(p.type);
          if (index < 0 || index > 0xffffffff)
            body_.fail("face " + std::to_string(face) + " has the vertex number " +
                       std::to_string(index));
          corners.push_back(static_cast<std::uint32_t>(index));
        }
      }
      if (corners.size() > 4) ++polygons_;
      for (std::size_t i = 2; i < corners.size(); ++i) {
        // A quad's second triangle begins with its last corner, as pbrt-v3's does: uvs that are not given follow.
        const bool last = corners.size() == 4 && i == 3;
        triangles_.push_back(last ? glm::u32vec3{corners[3], corners[0], corners[2]} : glm::u32vec3{corners[0], corners[i - 1], corners[i]});
        faces_.push_back(static_cast<std::uint32_t>(face));
      }
      for (const std::uint32_t c : corners) largest_index_ = std::max(largest_index_, c);
    }
  }

  const PlyHeader& header_;
  Body body_;
  BulkWriter<Vec3> positions_, normals_;
  BulkWriter<Vec2> uvs_;
  BulkWriter<glm::u32vec3> triangles_;
  BulkWriter<std::uint32_t> faces_;
  bool has_normals_ = false, has_uvs_ = false;
  std::uint32_t largest_index_ = 0;
  std::uint64_t polygons_ = 0;
};

}  // namespace

PlyMesh read_ply(const std::string& path, const FileLocation& location) {
  const auto text = SourceText::open(path);
  if (!text) throw SceneError(location, text.error());
  const PlyHeader header = read_ply_header(**text);
  switch (header.format) {
    case PlyFormat::ascii:
      return BodyReader<AsciiBody>(**text, header).read();
    case PlyFormat::little_endian:
      return BodyReader<BinaryBody<false>>(**text, header).read();
    default:
      return BodyReader<BinaryBody<true>>(**text, header).read();
  }
}

}  // namespace cloudrenderer
