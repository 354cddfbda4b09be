#include "images/images.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <system_error>

#include "base/error.h"
#include "images/image_module.h"

extern "C" {
extern const unsigned char cloudrenderer_image_module_begin[], cloudrenderer_image_module_end[];
}

namespace cloudrenderer {
namespace {

struct Loaded {
  const ImageModule* module = nullptr;
  std::string why;  // there is none
};

std::atomic<std::uint64_t> largest{~std::uint64_t{0}};

std::string reason() { return std::generic_category().message(errno); }

bool write_all(int fd, std::span<const unsigned char> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

// From a file that has no name in any folder; where the system does not let such be run, from one that has it no longer.
Loaded load() {
  const std::span bytes(cloudrenderer_image_module_begin, cloudrenderer_image_module_end);
  std::string why;
  for (const bool in_memory : {true, false}) {
    std::error_code error;
    std::string path = (std::filesystem::temp_directory_path(error) / "cloudrenderer-images-XXXXXX").string();
    const int fd = in_memory ? ::memfd_create("cloudrenderer-images", MFD_CLOEXEC) : ::mkostemp(path.data(), O_CLOEXEC);
    if (fd < 0) {
      why = reason();
      continue;
    }
    void* handle = nullptr;
    if (!write_all(fd, bytes)) {
      why = reason();
    } else {
      handle = ::dlopen(("/proc/self/fd/" + std::to_string(fd)).c_str(), RTLD_NOW | RTLD_LOCAL);
      if (!handle) why = ::dlerror();
    }
    ::close(fd);
    if (!in_memory) ::unlink(path.c_str());
    if (handle) return {static_cast<const ImageModule*>(::dlsym(handle, kImageModuleSymbol)), {}};
  }
  return {nullptr, "OpenImageIO cannot be loaded: " + why};
}

const Loaded& loaded() {
  static const Loaded once = load();
  return once;
}

}  // namespace

void limit_images(std::uint64_t bytes) { largest = std::max(bytes, std::uint64_t{512} << 20); }

std::unique_ptr<ImageReader> open_image(const std::string& path, bool as_stored, std::string& why) {
  if (!loaded().module) {
    why = loaded().why;
    return nullptr;
  }
  auto image = loaded().module->open(path, as_stored, why);
  if (!image) return nullptr;
  const ImageInfo& i = image->info();
  const double bytes = 1.0 * i.width * i.height * i.depth * i.channels * (i.bytes ? 5 : 8);
  const std::uint64_t most = largest;
  if (bytes <= static_cast<double>(most)) return image;
  throw ClusterError("to read the " + std::to_string(i.width) + " x " + std::to_string(i.height) + " pixels of " + path + " takes " +
        std::to_string(static_cast<std::uint64_t>(bytes) >> 20) + " MiB, and this host may use " + std::to_string(most >> 20) + " MiB");
}

bool encode_bytes(const std::string& path, int width, int height, const std::uint8_t* rgb, std::vector<unsigned char>& file,
                  std::string& why) {
  if (loaded().module) return loaded().module->encode(path, width, height, rgb, file, why);
  why = loaded().why;
  return false;
}

}  // namespace cloudrenderer
