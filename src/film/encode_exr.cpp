#include "film/encode_exr.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>
#include <cstdint>

namespace cloudrenderer {
namespace {

class MemoryStream : public Imf::OStream {
 public:
  MemoryStream() : OStream("a picture in memory") {}
  void write(const char bytes[], int n) override {
    const auto end = at_ + static_cast<std::size_t>(n);
    if (out.size() < end) out.resize(end);
    std::copy_n(bytes, n, out.begin() + static_cast<std::ptrdiff_t>(at_));
    at_ = end;
  }
  std::uint64_t tellp() override { return at_; }
  void seekp(std::uint64_t at) override { at_ = at; }

  std::vector<unsigned char> out;

 private:
  std::size_t at_ = 0;
};

}  // namespace

std::vector<unsigned char> encode_exr(const Image& image, const FilmFrame& frame, const ImageHeader& words,
                                      std::span<const ImageChannel> channels) {
  const auto box = [](std::uint32_t x, std::uint32_t y, std::uint32_t width, std::uint32_t height) {
    return Imath::Box2i({static_cast<int>(x), static_cast<int>(y)}, {static_cast<int>(x + width) - 1, static_cast<int>(y + height) - 1});
  };
  const Imath::Box2i window = box(frame.x0, frame.y0, image.width, image.height);
  Imf::Header header(box(0, 0, frame.width, frame.height), window);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [key, value] : words.words) header.insert(key, Imf::StringAttribute(value));
  for (const auto& [key, m] : words.matrices)
    header.insert(key, Imf::M44fAttribute(Imath::M44f(m[0][0], m[0][1], m[0][2], m[0][3], m[1][0], m[1][1], m[1][2], m[1][3], m[2][0],
                                                      m[2][1], m[2][2], m[2][3], m[3][0], m[3][1], m[3][2], m[3][3])));
  if (image.space) {
    const std::array<float, 8>& xy = image.space->chromaticities();
    Imf::addChromaticities(header, Imf::Chromaticities({xy[0], xy[1]}, {xy[2], xy[3]}, {xy[4], xy[5]}, {xy[6], xy[7]}));
  }
  Imf::FrameBuffer pixels;
  const auto add = [&](const std::string& name, Imf::PixelType type, const void* first, std::size_t stride) {
    header.channels().insert(name, Imf::Channel(type));
    pixels.insert(name, Imf::Slice::Make(type, first, window, stride, stride * image.width));
  };
  for (int i = 0; i < 3; ++i) add(std::string(1, "RGB"[i]), Imf::FLOAT, &image.pixels[0][i], sizeof(Rgb));
  for (const ImageChannel& c : channels)
    std::visit([&](const auto& values) { add(c.name, c.values.index() == 0 ? Imf::FLOAT : Imf::UINT, values.data(), sizeof values[0]); }, c.values);

  MemoryStream stream;
  {
    Imf::OutputFile file(stream, header, 0);
    file.setFrameBuffer(pixels);
    file.writePixels(static_cast<int>(image.height));
  }
  return std::move(stream.out);
}

}  // namespace cloudrenderer
