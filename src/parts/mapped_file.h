#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace cloudrenderer {

// A read-only mapping of a whole file (of small ones a copy); the owner keeps it alive. Throws std::system_error.
struct MappedFile {
  std::span<const std::byte> bytes;
  std::shared_ptr<const void> owner;
};
MappedFile map_file(const std::string& path);

// A temporary file without a name in `folder`: written by appending, read (and changed) through a
// shared mapping, so that its pages belong to the file and not to the memory of the process. One
// thread.
class SpoolFile {
 public:
  explicit SpoolFile(const std::string& folder);
  ~SpoolFile();
  SpoolFile(const SpoolFile&) = delete;
  SpoolFile& operator=(const SpoolFile&) = delete;

  void append(const void* data, std::size_t bytes);
  std::uint64_t bytes() const { return written_ + used_; }
  // All that was appended so far; valid until the next call of map() or clear().
  std::span<std::byte> map();
  void clear();

 private:
  void flush();
  void unmap();

  int fd_ = -1;
  std::uint64_t written_ = 0;
  std::size_t used_ = 0;  // bytes in buffer_
  std::unique_ptr<std::byte[]> buffer_;
  void* mapping_ = nullptr;
  std::size_t mapping_bytes_ = 0;
};

// The same for values of one type.
template <class T>
class SpoolArray {
 public:
  explicit SpoolArray(const std::string& folder) : file_(folder) {}
  void push_back(const T& v) { file_.append(&v, sizeof(T)); }
  void append(std::span<const T> values) { file_.append(values.data(), values.size_bytes()); }
  std::uint64_t size() const { return file_.bytes() / sizeof(T); }
  std::span<T> map() {
    const std::span<std::byte> bytes = file_.map();
    return {reinterpret_cast<T*>(bytes.data()), bytes.size() / sizeof(T)};
  }
  void clear() { file_.clear(); }

 private:
  SpoolFile file_;
};

}  // namespace cloudrenderer
