#include "parts/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <system_error>

namespace cloudrenderer {
namespace {

constexpr std::size_t kBufferBytes = std::size_t{1} << 18;
// Files up to this size are read instead: a process may have some 65,000 mappings (vm.max_map_count), and a scene more
// objects of a few triangles.
constexpr std::size_t kSmallFile = std::size_t{1} << 16;
constexpr std::size_t kSpareBytes = 64;  // readable ones behind the file, as behind most mappings

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), what);
}

void write_all(int fd, const std::byte* data, std::size_t bytes) {
  while (bytes > 0) {
    const ssize_t n = ::write(fd, data, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail("temporary file of the split");
    data += n;
    bytes -= static_cast<std::size_t>(n);
  }
}

MappedFile read_small(int fd, std::size_t size, const std::string& path) {
  const std::shared_ptr<std::byte[]> data(new (std::align_val_t{64}) std::byte[size + kSpareBytes](),
                                          [](std::byte* p) { ::operator delete[](p, std::align_val_t{64}); });
  for (std::size_t done = 0; done < size;) {
    const ssize_t n = ::read(fd, data.get() + done, size - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      if (n == 0) errno = EIO;  // it has become shorter
      fail(path);
    }
    done += static_cast<std::size_t>(n);
  }
  return {{data.get(), size}, data};
}

}  // namespace

MappedFile map_file(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) fail(path);
  struct stat status {};
  if (::fstat(fd, &status) != 0 || !S_ISREG(status.st_mode)) {
    if (errno == 0) errno = EINVAL;
    const int error = errno;
    ::close(fd);
    errno = error;
    fail(path);
  }
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size == 0) {
    ::close(fd);
    return {};
  }
  if (size <= kSmallFile) {
    try {
      MappedFile file = read_small(fd, size, path);
      ::close(fd);
      return file;
    } catch (...) {
      ::close(fd);
      throw;
    }
  }
  void* data = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, fd, 0);
  const int error = errno;
  ::close(fd);
  errno = error;
  if (data == MAP_FAILED) fail(path);
  return {{static_cast<const std::byte*>(data), size},
          std::shared_ptr<const void>(
              data, [size](const void* p) { ::munmap(const_cast<void*>(p), size); })};
}

SpoolFile::SpoolFile(const std::string& folder) {
  std::string name = folder + "/spool-XXXXXX";
  fd_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd_ < 0) fail(name);
  ::unlink(name.c_str());
}

SpoolFile::~SpoolFile() {
  unmap();
  ::close(fd_);
}

void SpoolFile::append(const void* data, std::size_t bytes) {
  if (bytes == 0) return;
  if (!buffer_) buffer_ = std::make_unique<std::byte[]>(kBufferBytes);
  if (used_ + bytes > kBufferBytes) flush();
  if (bytes > kBufferBytes) {
    write_all(fd_, static_cast<const std::byte*>(data), bytes);
    written_ += bytes;
    return;
  }
  std::memcpy(buffer_.get() + used_, data, bytes);
  used_ += bytes;
}

void SpoolFile::flush() {
  write_all(fd_, buffer_.get(), used_);
  written_ += used_;
  used_ = 0;
}

std::span<std::byte> SpoolFile::map() {
  if (used_ > 0) flush();
  if (mapping_bytes_ != written_) {
    unmap();
    const auto size = static_cast<std::size_t>(written_);
    void* data = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0);
    if (data == MAP_FAILED) fail("temporary file of the split");
    mapping_ = data;
    mapping_bytes_ = size;
  }
  return {static_cast<std::byte*>(mapping_), mapping_bytes_};
}

void SpoolFile::clear() {
  unmap();
  used_ = 0;
  written_ = 0;
  if (::ftruncate(fd_, 0) != 0 || ::lseek(fd_, 0, SEEK_SET) != 0)
    fail("temporary file of the split");
}

void SpoolFile::unmap() {
  if (mapping_) ::munmap(mapping_, mapping_bytes_);
  mapping_ = nullptr;
  mapping_bytes_ = 0;
}

}  // namespace cloudrenderer
