#include "cluster/checkpoint_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
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

std::string temporary_name(const std::string& path) { return path + ".new"; }

// An open file with these bytes that has taken the place of `path`, locked.
int put_in_place(const std::string& path, std::span<const std::byte> bytes) {
  const std::string temporary = temporary_name(path);
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
  open_locked();
  unlink(temporary_name(path_).c_str());  // of a render that was killed
  thread_ = std::thread([this] { work(); });
}

// Whoever had the lock may have put a new file in place between our opening and our locking: then
// it is the new one that counts.
void CheckpointFile::open_locked() {
  const auto fail = [this](const std::string& why) {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
    throw UsageError("cannot write the checkpoint " + path_ + ": " + why);
  };
  for (;;) {
    fd_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (fd_ < 0) fail(strerror(errno));
    struct stat status {};
    if (flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
      fail("another render is using it");
    if (fstat(fd_, &status) != 0 || !S_ISREG(status.st_mode)) fail("it is no ordinary file");
    bytes_ = static_cast<std::uint64_t>(status.st_size);
    identity_ = {status.st_dev, status.st_ino};
    if (identity(path_) == identity_) return;
    ::close(std::exchange(fd_, -1));
  }
}

std::optional<CheckpointFile::Identity> CheckpointFile::identity(int fd) {
  struct stat status {};
  if (fstat(fd, &status) != 0) return std::nullopt;
  return Identity{status.st_dev, status.st_ino};
}

std::optional<CheckpointFile::Identity> CheckpointFile::identity(const std::string& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return std::nullopt;
  return Identity{status.st_dev, status.st_ino};
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
  replacing_ = true;
  wake_.notify_one();
}

CheckpointFile::Place CheckpointFile::place() const {
  const std::lock_guard lock(mutex_);
  if (replacing_ || !error_.empty()) return Place::here;
  const auto there = identity(path_);
  if (!there) return errno == ENOENT || errno == ENOTDIR ? Place::gone : Place::here;
  return *there == identity_ ? Place::here : Place::taken;
}

void CheckpointFile::fail(const std::string& why) {
  const std::lock_guard lock(mutex_);
  if (error_.empty()) error_ = "cannot write the checkpoint " + path_ + ": " + why;
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
    if (const auto id = identity(fd_)) identity_ = *id;
    replacing_ = std::any_of(jobs_.begin(), jobs_.end(), [](const Job& j) { return j.anew; });
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

std::string write_beside(const std::string& path, std::span<const std::byte> bytes) {
  std::string other = path + "~";
  for (int n = 2; std::filesystem::exists(other); ++n) other = path + "~" + std::to_string(n);
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool in_use = fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  if (fd >= 0) ::close(fd);
  if (!in_use && std::filesystem::exists(path)) std::filesystem::rename(path, other);
  const std::string name = in_use ? other : path;
  ::close(put_in_place(name, bytes));
  return name;
}

}  // namespace cloudrenderer
