#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include "base/portable_math.h"
#include "film/encode_exr.h"
#include "film/encode_image.h"
#include "images/images.h"

namespace cloudrenderer {
namespace {

constexpr auto kExtensions = std::to_array<std::string_view>({".exr", ".pfm", ".png", ".tga"});

[[noreturn]] void fail(const std::string& what, const std::string& path, const std::string& why) {
  throw std::runtime_error("cannot " + what + " " + path + ": " + why);
}

std::string reason(int error) { return std::generic_category().message(error); }

float to_srgb(float v) {
  if (!(v > 0.f)) return 0.f;
  return v <= 0.0031308f ? 12.92f * v
                         : 1.055f * portable::pow(std::min(v, 1.f), 1.f / 2.4f) - 0.055f;
}

float from_srgb(float v) {
  return v <= 0.04045f ? v / 12.92f : portable::pow((v + 0.055f) / 1.055f, 2.4f);
}

// Portable float map: rows from the bottom up, the scale's sign names the byte order. OpenImageIO 2.4 does not write it.
std::vector<unsigned char> pfm(const Image& image) {
  static_assert(std::endian::native == std::endian::little && sizeof(Rgb) == 3 * sizeof(float));
  const std::string header = "PF\n" + std::to_string(image.width) + " " + std::to_string(image.height) + "\n-1\n";
  std::vector<unsigned char> out(header.begin(), header.end());
  for (std::size_t y = image.height; y-- > 0;) {
    const auto row = std::as_bytes(std::span(image.pixels).subspan(y * image.width, image.width));
    const auto* const bytes = reinterpret_cast<const unsigned char*>(row.data());
    out.insert(out.end(), bytes, bytes + row.size());
  }
  return out;
}

// A reader of `path` sees the old file or the new one, never a half.
void write_file(const std::string& path, std::span<const unsigned char> bytes) {
  const std::string temporary = path + ".tmp" + std::to_string(::getpid());
  const int fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) fail("write", path, reason(errno));
  int error = 0;
  while (!bytes.empty() && error == 0) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n >= 0)
      bytes = bytes.subspan(static_cast<std::size_t>(n));
    else if (errno != EINTR)
      error = errno;
  }
  if (::close(fd) != 0 && error == 0) error = errno;
  if (error == 0 && std::rename(temporary.c_str(), path.c_str()) != 0) error = errno;
  if (error != 0) {
    ::unlink(temporary.c_str());
    fail("write", path, reason(error));
  }
}

}  // namespace

std::vector<unsigned char> encode_image(const std::string& path, const Image& image, const FilmFrame& frame,
                                        const ImageHeader& header, std::span<const ImageChannel> channels) {
  if (image.width != frame.crop_width() || image.height != frame.crop_height() ||
      image.pixels.size() != frame.pixels() || image.pixels.empty())
    fail("write", path, "the picture does not have the film's size");
  const std::string extension = std::filesystem::path(path).extension().string();
  // In memory, so that every failure of the disk is seen and named by write_file().
  if (extension == ".exr") {
    try {
      return encode_exr(image, frame, header, channels);
    } catch (const std::exception& e) {
      fail("write", path, e.what());
    }
  }
  if (extension == ".png" || extension == ".tga") {
    std::vector<unsigned char> bytes, file;
    bytes.reserve(image.pixels.size() * 3);
    for (const Rgb& c : image.pixels)
      for (int i = 0; i < 3; ++i)
        bytes.push_back(static_cast<unsigned char>(to_srgb(c[i]) * 255.f + 0.5f));
    if (std::string why; !encode_bytes(path, static_cast<int>(image.width), static_cast<int>(image.height), bytes.data(), file, why))
      fail("write", path, why);
    return file;
  }
  if (extension == ".pfm") return pfm(image);
  fail("write", path, "the file name must end in " + image_extensions());
}

void write_image(const std::string& path, const Image& image, const FilmFrame& frame,
                 const ImageHeader& header, std::span<const ImageChannel> channels) {
  write_file(path, encode_image(path, image, frame, header, channels));
}

bool is_image_name(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  return std::ranges::find(kExtensions, extension) != kExtensions.end();
}

std::string image_extensions() {
  std::string out(kExtensions[0]);
  for (std::size_t i = 1; i < kExtensions.size(); ++i) {
    out += i + 1 < kExtensions.size() ? ", " : " or ";
    out += kExtensions[i];
  }
  return out;
}

Image read_image(const std::string& path) {
  // OpenImageIO's own message for a missing file is about formats.
  if (std::error_code error; !std::filesystem::exists(path, error))
    fail("read", path, error ? error.message() : reason(ENOENT));
  std::string why;
  const auto input = open_image(path, false, why);
  if (!input) fail("read", path, why);
  const ImageInfo& info = input->info();
  const int channels = info.channels;
  if (info.width < 1 || info.height < 1 || info.depth != 1 || channels < 1)
    fail("read", path, "it holds no picture");

  const auto width = static_cast<std::size_t>(info.width), height = static_cast<std::size_t>(info.height);
  std::vector<float> values(width * height * static_cast<std::size_t>(channels));
  if (!input->read(channels, values.data(), why)) fail("read", path, why);
  const bool srgb = !info.is_float && info.color_space != "Linear";

  Image out{static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height),
            std::vector<Rgb>(width * height)};
  for (std::size_t p = 0; p < out.pixels.size(); ++p)
    for (int i = 0; i < 3; ++i) {
      const float v = values[p * static_cast<std::size_t>(channels) +
                             static_cast<std::size_t>(info.rgb[static_cast<std::size_t>(i)])];
      out.pixels[p][i] = srgb ? from_srgb(v) : v;
    }
  return out;
}

}  // namespace cloudrenderer
