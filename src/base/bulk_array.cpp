#include "base/bulk_array.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <string>
#include <system_error>
#include <utility>

namespace cloudrenderer {

namespace {
[[noreturn]] void fail(const char* what) { throw std::system_error(errno, std::generic_category(), what); }

struct MappedFile {
  void* data = nullptr;
  std::size_t bytes = 0;
  MappedFile(void* d, std::size_t b) : data(d), bytes(b) {}
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  ~MappedFile() { munmap(data, bytes); }
};
}  // namespace

struct BulkStorage::State {
  std::vector<std::byte> memory;
  int file = -1;
  std::size_t written = 0;  // bytes in the file; memory holds what is not written yet

  ~State() {
    if (file >= 0) close(file);
  }
  void flush() {
    if (file < 0) {
      const char* folder = std::getenv("TMPDIR");
      std::string name = std::string(folder && *folder ? folder : "/tmp") + "/cloudrenderer-XXXXXX";
      file = mkstemp(name.data());
      if (file < 0) fail("cannot make a temporary file");
      unlink(name.c_str());
    }
    for (std::size_t done = 0; done < memory.size();) {
      const ssize_t n = write(file, memory.data() + done, memory.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) fail("cannot write a temporary file");
      done += static_cast<std::size_t>(n);
    }
    written += memory.size();
    memory.clear();
  }
};

BulkStorage::BulkStorage() : state_(std::make_unique<State>()) {}
BulkStorage::~BulkStorage() = default;
BulkStorage::BulkStorage(BulkStorage&&) noexcept = default;
BulkStorage& BulkStorage::operator=(BulkStorage&&) noexcept = default;

void BulkStorage::append(const void* data, std::size_t bytes) {
  const auto* p = static_cast<const std::byte*>(data);
  state_->memory.insert(state_->memory.end(), p, p + bytes);
  if (state_->memory.size() >= kSpillBytes) state_->flush();
}

std::size_t BulkStorage::bytes() const { return state_->written + state_->memory.size(); }

BulkStorage::Finished BulkStorage::finish() {
  Finished out;
  out.bytes = bytes();
  if (state_->file < 0) {
    auto held = std::make_shared<const std::vector<std::byte>>(std::move(state_->memory));
    out.data = held->data();
    out.owner = std::move(held);
  } else {
    state_->flush();
    void* p = mmap(nullptr, out.bytes, PROT_READ, MAP_SHARED, state_->file, 0);
    if (p == MAP_FAILED) fail("cannot map a temporary file");
    out.owner = std::make_shared<const MappedFile>(p, out.bytes);
    out.data = static_cast<const std::byte*>(p);
  }
  state_ = std::make_unique<State>();
  return out;
}

}  // namespace cloudrenderer
