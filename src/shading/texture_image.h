#pragma once
// Images for textures: read once through OpenImageIO, kept as mip-map pyramids in few bytes a
// texel, filtered by our own code, so that a texel that is resident and one that is paged in give
// the same bits.
#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/bulk_array.h"
#include "base/log.h"
#include "cloudrenderer/math.h"

namespace cloudrenderer {

enum class WrapMode : std::uint8_t { repeat, black, clamp };

// How the numbers of a file become texture values: v = scale * decode(x) (pbrt-v3), v = (scale *
// x)^gamma (pbrt-v2).
struct ImageEncoding {
  float scale = 1, gamma = 1;
  bool srgb = false;       // decode sRGB, then scale; gamma is not used
  bool flip = false;       // the first row is at t = 1
  bool invert = false;     // pbrt-v4: one minus the value
  bool luminance = false;  // one value a texel
  bool mean = false;       // pbrt-v4: this value is the mean of the decoded channels
  bool masks = false;      // with it: or alpha, where the file has one that is not 1 everywhere
  bool primaries = false;  // pbrt-v4: colours are of the space that the file names
  auto operator<=>(const ImageEncoding&) const = default;

  float decode(float x) const;
};

// Whether the file's name has one of these endings, which are in lower case; it may be in capitals.
bool is_file_of(std::string_view path, std::initializer_list<std::string_view> endings);

// pbrt-v2's readers of these formats give the lowest row first, of others the highest.
inline bool is_upside_down_in_v2(std::string_view path) { return is_file_of(path, {".tga", ".pfm"}); }

struct ImageFilter {
  WrapMode wrap = WrapMode::repeat;
  enum class Kind : std::uint8_t { ellipse, trilinear, bilinear, point };  // the last two of one level
  Kind kind = Kind::ellipse;
  float widths = 1;  // of the footprint, that levels are chosen by: two in pbrt-v2 and v4
  float max_anisotropy = 8;
};

class ImagePyramid {
 public:
  static constexpr std::size_t kPadding = 16;  // bytes behind the last texel, which four values at once may read
  enum class Format : std::uint8_t { byte, half, real };
  struct Level {
    int width = 1, height = 1;
    Format format = Format::real;
    std::size_t offset = 0;  // into the texels
  };

  int width() const { return levels_.front().width; }
  int height() const { return levels_.front().height; }
  int level_count() const { return static_cast<int>(levels_.size()); }

  // Value at st, (0,0) being the corner of the first row, averaged over the ellipse spanned by the
  // two derivatives: elliptically weighted (Heckbert 1989), or trilinear. Zero derivatives:
  // bilinear on the finest level.
  Rgb lookup(const Vec2& st, const Vec2& dst0, const Vec2& dst1, const ImageFilter& filter) const;
  // Brings what a lookup without derivatives reads into the cache.
  void prefetch(Vec2 st, WrapMode wrap) const;

 private:
  friend class ImageStore;
  Rgb bilinear(int level, const Vec2& st, WrapMode wrap) const;
  Rgb trilinear(const Vec2& st, float width, WrapMode wrap) const;
  Rgb one_level(const Vec2& st, float width, const ImageFilter& filter) const;
  Rgb ellipse(int level, Vec2 st, Vec2 d0, Vec2 d1, WrapMode wrap) const;
  Rgb top() const;  // the only texel of the last level
  // Calls f with a function that has the texel of an index of the level, as Color4.
  template <class Fn>
  auto with_texels(const Level& level, Fn f) const;

  std::vector<Level> levels_;
  int channels_ = 3;
  const std::byte* texels_ = nullptr;
  std::vector<std::byte> resident_;  // or:
  BulkArray<std::byte> paged_;       // a mapped temporary file that the system may evict
  std::array<float, 256> decode_{};  // for bytes
};

// All images of a scene, each read once. Not thread-safe while images are added.
class ImageStore {
 public:
  // Without `read` files are only opened: what get() returns must not be looked up then.
  explicit ImageStore(std::uint64_t budget, bool read = true) : budget_(budget), read_(read) {}
  // Throws SceneError when the file cannot be read.
  const ImagePyramid* get(const std::string& path, const ImageEncoding& encoding,
                          const FileLocation& where);
  std::uint64_t bytes() const { return resident_; }  // of resident texels

 private:
  std::uint64_t budget_, resident_ = 0;
  bool read_;
  std::map<std::pair<std::string, ImageEncoding>, std::unique_ptr<ImagePyramid>> images_;
};

}  // namespace cloudrenderer
