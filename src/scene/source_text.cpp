#include "scene/source_text.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <system_error>

#include "base/bulk_array.h"

namespace cloudrenderer {

namespace {

// A few kilobytes of gzip can stand for any amount of text: beyond this it is taken for an attack
// or an accident.
constexpr std::uint64_t kMaxInflated = std::uint64_t{1} << 38;

struct Descriptor {
  int fd;
  explicit Descriptor(int f) : fd(f) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd >= 0) close(fd);
  }
};

struct Mapping {
  void* data;
  std::size_t bytes;
  Mapping(void* d, std::size_t b) : data(d), bytes(b) {}
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;
  ~Mapping() { munmap(data, bytes); }
};

struct Inflater {
  z_stream stream{};
  Inflater() { ok = inflateInit2(&stream, 15 + 16) == Z_OK; }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
  ~Inflater() { inflateEnd(&stream); }
  bool ok = false;
};

// Inflates all members of a gzip file; returns the reason of a failure, or "".
std::string inflate_all(std::string_view packed, BulkWriter<char>& out) {
  Inflater inflater;
  if (!inflater.ok) return "zlib cannot start";
  z_stream& z = inflater.stream;
  std::array<char, std::size_t{1} << 16> buffer;
  std::uint64_t total = 0;
  bool member_done = false;
  while (true) {
    if (z.avail_in == 0) {
      if (packed.empty()) break;
      const std::size_t n = std::min<std::size_t>(packed.size(), std::size_t{1} << 30);
      // zlib does not write through next_in; its field is not const for old compilers' sake.
      z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
      z.avail_in = static_cast<uInt>(n);
      packed.remove_prefix(n);
    }
    if (member_done) {
      // gzip pads tapes with zero bytes; anything else starts another member.
      if (*z.next_in == 0) break;
      if (inflateReset(&z) != Z_OK) return "zlib cannot continue";
      member_done = false;
    }
    z.next_out = reinterpret_cast<Bytef*>(buffer.data());
    z.avail_out = static_cast<uInt>(buffer.size());
    const int status = inflate(&z, Z_NO_FLUSH);
    if (status != Z_OK && status != Z_STREAM_END && status != Z_BUF_ERROR)
      return std::string("damaged gzip data") + (z.msg ? std::string(": ") + z.msg : std::string());
    const std::size_t made = buffer.size() - z.avail_out;
    out.append({buffer.data(), made});
    total += made;
    if (total > kMaxInflated) return "the gzip data unpack to more than 256 GiB";
    if (status == Z_STREAM_END)
      member_done = true;
    else if (made == 0 && z.avail_in == 0 && packed.empty())
      break;
  }
  return member_done ? std::string() : "the gzip data end too early";
}

}  // namespace

Result<std::shared_ptr<const SourceText>> SourceText::open(const std::string& path) {
  using Opened = Result<std::shared_ptr<const SourceText>>;
  const auto failure = [&](const std::string& why) {
    return Opened::failure("cannot read '" + path + "': " + why);
  };
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.fd < 0) return failure(std::generic_category().message(errno));
  struct stat info {};
  if (fstat(file.fd, &info) != 0) return failure(std::generic_category().message(errno));
  if (!S_ISREG(info.st_mode)) return failure("not a regular file");

  auto text = std::make_shared<SourceText>();
  text->name_ = std::make_shared<const std::string>(path);
  if (info.st_size > 0) {
    const auto bytes = static_cast<std::size_t>(info.st_size);
    void* data = mmap(nullptr, bytes, PROT_READ, MAP_PRIVATE, file.fd, 0);
    if (data == MAP_FAILED) return failure(std::generic_category().message(errno));
    text->owner_ = std::make_shared<const Mapping>(data, bytes);
    madvise(data, bytes, MADV_SEQUENTIAL);
    text->view_ = {static_cast<const char*>(data), bytes};
  }
  if (text->view_.starts_with("\x1f\x8b")) {
    try {
      BulkWriter<char> inflated;
      if (const std::string why = inflate_all(text->view_, inflated); !why.empty())
        return failure(why);
      auto array = std::make_shared<const BulkArray<char>>(inflated.finish());
      text->view_ = {array->view().data(), array->size()};
      text->owner_ = std::move(array);
    } catch (const std::system_error& e) {
      return failure(e.what());
    }
  }
  return std::shared_ptr<const SourceText>(std::move(text));
}

std::shared_ptr<const SourceText> SourceText::from_string(std::string name, std::string text) {
  auto out = std::make_shared<SourceText>();
  out->name_ = std::make_shared<const std::string>(std::move(name));
  auto held = std::make_shared<const std::string>(std::move(text));
  out->view_ = *held;
  out->owner_ = std::move(held);
  return out;
}

}  // namespace cloudrenderer
