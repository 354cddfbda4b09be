// The module: all that names OpenImageIO.
#include "images/image_module.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <string_view>

namespace cloudrenderer {
namespace {

class OpenedImage : public ImageReader {
 public:
  explicit OpenedImage(std::unique_ptr<OIIO::ImageInput> input) : input_(std::move(input)) {
    const OIIO::ImageSpec& spec = input_->spec();
    info_.width = spec.width;
    info_.height = spec.height;
    info_.depth = spec.depth;
    info_.channels = spec.nchannels;
    for (std::size_t i = 0; i < 3; ++i) {
      const int named = spec.channelindex(std::string(1, "RGB"[i]));
      info_.rgb[i] = named >= 0 ? named : spec.nchannels >= 3 ? static_cast<int>(i) : 0;
    }
    info_.bytes = spec.format == OIIO::TypeDesc::UINT8;
    info_.is_float = spec.format.is_floating_point();
    info_.color_space = spec.get_string_attribute("oiio:ColorSpace");
    info_.alpha = spec.alpha_channel;
    if (std::array<float, 8> xy{}; spec.getattribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), xy.data()))
      info_.chromaticities = xy;
  }
  bool read(int channels, std::uint8_t* pixels, std::string& why) override { return read(channels, OIIO::TypeDesc::UINT8, pixels, why); }
  bool read(int channels, float* pixels, std::string& why) override { return read(channels, OIIO::TypeDesc::FLOAT, pixels, why); }

 private:
  bool read(int channels, OIIO::TypeDesc type, void* pixels, std::string& why) {
    if (input_->read_image(0, 0, 0, channels, type, pixels)) return true;
    why = input_->geterror();
    return false;
  }
  std::unique_ptr<OIIO::ImageInput> input_;
};

std::unique_ptr<ImageReader> open(const std::string& path, bool as_stored, std::string& why) {
  static constexpr auto kNotPictures = std::to_array<std::string_view>({"FFmpeg movie", "null", "openvdb", "term"});
  if (std::error_code unknown; std::filesystem::exists(path, unknown) && !std::filesystem::is_regular_file(path, unknown)) {
    why = "not a regular file";
    return nullptr;
  }
  OIIO::ImageSpec config;
  if (as_stored) config.attribute("oiio:UnassociatedAlpha", 1);
  auto file = OIIO::ImageInput::open(path, &config);
  if (!file) {
    why = OIIO::geterror();
    return nullptr;
  }
  if (std::ranges::find(kNotPictures, file->format_name()) != kNotPictures.end()) {
    why = std::string("it is no picture but of the kind '") + file->format_name() + "'";
    return nullptr;
  }
  return std::make_unique<OpenedImage>(std::move(file));
}

bool encode(const std::string& path, int width, int height, const std::uint8_t* rgb, std::vector<unsigned char>& file, std::string& why) {
  const auto output = OIIO::ImageOutput::create(path);
  if (!output) {
    why = OIIO::geterror();
    return false;
  }
  OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:ColorSpace", "sRGB");
  OIIO::Filesystem::IOVecOutput memory;
  output->set_ioproxy(&memory);
  if (!output->open(path, spec) || !output->write_image(OIIO::TypeDesc::UINT8, rgb) || !output->close()) {
    why = output->geterror();
    return false;
  }
  file = memory.buffer();
  return true;
}

}  // namespace
}  // namespace cloudrenderer

extern "C" {
[[gnu::visibility("default")]] extern const cloudrenderer::ImageModule cloudrenderer_image_module;
const cloudrenderer::ImageModule cloudrenderer_image_module{&cloudrenderer::open, &cloudrenderer::encode};
}
