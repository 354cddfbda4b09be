#pragma once
// Picture files of every kind that OpenImageIO reads and writes. Debian's OpenImageIO brings 243 libraries with it (OpenCV,
// GDAL, databases), a third of a second to load. So it is in a module that the program carries along and loads when the
// first picture is opened: hosts without textures never do. All functions may be called by any thread.
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace cloudrenderer {

struct ImageInfo {
  int width = 0, height = 0, depth = 1, channels = 0;
  std::array<int, 3> rgb{};  // the channels that are named R, G, B; without names the first three, or the first (grey)
  bool bytes = false;                  // eight bits a channel
  bool is_float = false;               // values of any size; else 0 to 1
  std::string color_space;             // that the file names, or none
  std::optional<std::array<float, 8>> chromaticities;  // x, y of red, green, blue and white, of files that name them
  int alpha = -1;                      // the channel of that name, or none
};

class ImageReader {
 public:
  virtual ~ImageReader() = default;
  const ImageInfo& info() const { return info_; }
  // The first `channels` of each pixel, rows from the top. False: `why` says what is wrong with the file.
  virtual bool read(int channels, std::uint8_t* pixels, std::string& why) = 0;
  virtual bool read(int channels, float* pixels, std::string& why) = 0;

 protected:
  ImageInfo info_;
};

// Null with the reason in `why`. Takes pictures only: OpenImageIO also reads movies, among them play lists that name
// further files, and makes up pictures of any size from a name. Colours come multiplied by alpha, or `as_stored`.
std::unique_ptr<ImageReader> open_image(const std::string& path, bool as_stored, std::string& why);

// From now on open_image() throws ClusterError for what takes more than this to read and turn into texels (eight bytes a channel and
// pixel, five of files with eight bits; but always half a gigabyte), so that no scene can exhaust a host with a small file.
void limit_images(std::uint64_t bytes);

// A file of sRGB bytes in memory, three a pixel; of the format that `path` ends with. False: `why` says why not.
bool encode_bytes(const std::string& path, int width, int height, const std::uint8_t* rgb, std::vector<unsigned char>& file,
                  std::string& why);

}  // namespace cloudrenderer
