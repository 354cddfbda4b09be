#include "shading/open_image.h"

#include <algorithm>
#include <array>
#include <string_view>

namespace cloudrenderer {

std::unique_ptr<OIIO::ImageInput> open_image_file(const std::string& path, const OIIO::ImageSpec* config, std::string& why) {
  static constexpr auto kNotPictures = std::to_array<std::string_view>({"FFmpeg movie", "null", "openvdb", "term"});
  auto file = OIIO::ImageInput::open(path, config);
  if (!file) {
    why = OIIO::geterror();
  } else if (std::ranges::find(kNotPictures, file->format_name()) != kNotPictures.end()) {
    why = std::string("it is no picture but of the kind '") + file->format_name() + "'";
    file.reset();
  }
  return file;
}

}  // namespace cloudrenderer
