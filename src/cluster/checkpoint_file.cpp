#include "cluster/checkpoint_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "base/error.h"

namespace cloudrenderer {
namespace {

using SteadyClock = std::chrono::steady_clock;
constexpr auto kSyncEvery = std::chrono::seconds(2);

void write_all(int fd, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw std::system_error(errno, std::generic_category());
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
}

void check(int result) {
  if (result < 0) throw std::system_error(errno, std::generic_category());
}

// The name of a file is on the disk only when its folder is. Not every file system can do it.
void sync_folder(const std::string& path) {
  const std::string folder = std::filesystem::absolute(path).parent_path().string();
  const int fd = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  (void)fsync(fd);
  ::close(fd);
}

// An open file with these bytes that has taken the place of `path`, locked.
int put_in_place(const std::string& path, std::span<const std::byte> bytes) {
  const std::string temporary = path + ".new";
  const int fd = open(temporary.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  check(fd);
  try {
    (void)flock(fd, LOCK_EX | LOCK_NB);  // nobody else has it; some file systems cannot
    write_all(fd, bytes);
    check(fdatasync(fd));
    check(rename(temporary.c_str(), path.c_str()));
  } catch (...) {
    ::close(fd);
    unlink(temporary.c_str());
    throw;
  }
  sync_folder(path);
  return fd;
}

}  // namespace

CheckpointFile::CheckpointFile(std::string path) : path_(std::move(path)) {
  fd_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd_ < 0) throw UsageError("cannot write the checkpoint " + path_ + ": " + strerror(errno));
  struct stat status {};
  std::string why;
  if (flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    why = "another render is using it";
  else if (fstat(fd_, &status) != 0 || !S_ISREG(status.st_mode))
    why = "it is no ordinary file";
  if (!why.empty()) {
    ::close(fd_);
    throw UsageError("cannot write the checkpoint " + path_ + ": " + why);
  }
  bytes_ = static_cast<std::uint64_t>(status.st_size);
  thread_ = std::thread([this] { work(); });
}

CheckpointFile::~CheckpointFile() {
  close();
  if (fd_ >= 0) ::close(fd_);
}

void CheckpointFile::cut_off(std::uint64_t bytes) {
  if (ftruncate(fd_, static_cast<off_t>(bytes)) != 0)
    throw ClusterError("cannot write the checkpoint " + path_ + ": " + strerror(errno));
  bytes_ = bytes;
}

void CheckpointFile::append(Bytes bytes) {
  bytes_ += bytes.size();
  const std::lock_guard lock(mutex_);
  jobs_.push_back({std::move(bytes), false});
  wake_.notify_one();
}

void CheckpointFile::replace(Bytes bytes) {
  bytes_ = bytes.size();
  const std::lock_guard lock(mutex_);
  jobs_.clear();  // the new content has what they have
  jobs_.push_back({std::move(bytes), true});
  wake_.notify_one();
}

std::string CheckpointFile::error() const {
  const std::lock_guard lock(mutex_);
  return error_;
}

void CheckpointFile::close() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
    wake_.notify_one();
  }
  if (thread_.joinable()) thread_.join();
}

void CheckpointFile::work() {
  bool unsynced = false;
  auto synced = SteadyClock::now();
  std::unique_lock lock(mutex_);
  for (;;) {
    const auto something = [this] { return !jobs_.empty() || closing_; };
    if (unsynced)
      wake_.wait_until(lock, synced + kSyncEvery, something);
    else
      wake_.wait(lock, something);
    std::deque<Job> jobs = std::exchange(jobs_, {});
    const bool last = closing_;
    if (!error_.empty()) jobs.clear();
    if (!unsynced) synced = SteadyClock::now();  // the time of the oldest byte that is not
    lock.unlock();
    std::string error;
    try {
      for (const Job& job : jobs) write(job);
      unsynced = unsynced || !jobs.empty();
      if (unsynced && (last || SteadyClock::now() >= synced + kSyncEvery)) {
        check(fdatasync(fd_));
        unsynced = false;
      }
    } catch (const std::system_error& e) {
      error = "cannot write the checkpoint " + path_ + ": " + e.code().message();
      unsynced = false;
    }
    lock.lock();
    if (error_.empty()) error_ = error;
    if (last && jobs_.empty()) return;
  }
}

void CheckpointFile::write(const Job& job) {
  if (job.anew) {
    const int fd = put_in_place(path_, job.bytes);
    ::close(std::exchange(fd_, fd));
    return;
  }
  check(static_cast<int>(std::min<off_t>(0, lseek(fd_, 0, SEEK_END))));
  write_all(fd_, job.bytes);
}

void write_file_atomically(const std::string& path, std::span<const std::byte> bytes) {
  ::close(put_in_place(path, bytes));
}

}  // namespace cloudrenderer
