#pragma once
// What the fuzz targets share. A target is one LLVMFuzzerTestOneInput: libFuzzer drives it
// (CLOUDRENDERER_FUZZ), or replay_main.cpp in the ordinary build.
#include <google/protobuf/stubs/logging.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace cloudrenderer::fuzz {

using Input = std::span<const std::byte>;

// Not a line for every text that is no UTF-8 (as cli/log_setup.cpp has it).
inline const auto kLogBefore = google::protobuf::SetLogHandler(nullptr);

inline Input input(const std::uint8_t* data, std::size_t size) {
  return std::as_bytes(std::span(data, size));
}

// A promise of the code under test. Both drivers keep the input of a process that aborts.
inline void require(bool good, const char* promise) {
  if (good) return;
  std::fprintf(stderr, "broken: %s\n", promise);
  std::abort();
}

// A file that never touches a disk, for readers that want a path.
class MemoryFile {
 public:
  explicit MemoryFile(Input bytes) : fd_(memfd_create("fuzz", MFD_CLOEXEC)) {
    if (fd_ < 0 || write(fd_, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size()))
      throw std::runtime_error("no file in memory");
  }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  ~MemoryFile() { close(fd_); }
  std::string path() const { return "/proc/self/fd/" + std::to_string(fd_); }

 private:
  int fd_;
};

// The input as a sequence of pieces: an operation, two bytes of length, so many bytes (or what is
// left). So one input can be a whole conversation.
class Pieces {
 public:
  explicit Pieces(Input all) : rest_(all) {}
  bool next() {
    if (rest_.size() < 3) return false;
    operation = std::to_integer<unsigned>(rest_[0]);
    const std::size_t length =
        std::to_integer<std::size_t>(rest_[1]) | std::to_integer<std::size_t>(rest_[2]) << 8;
    rest_ = rest_.subspan(3);
    bytes = rest_.first(std::min(length, rest_.size()));
    rest_ = rest_.subspan(bytes.size());
    return true;
  }
  unsigned operation = 0;
  Input bytes;

 private:
  Input rest_;
};

}  // namespace cloudrenderer::fuzz
