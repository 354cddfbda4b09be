#include "service/trash.h"

#include <filesystem>

#include "base/log.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

// Scenes are read-only folders, out of which only root could delete.
void remove_tree(const fs::path& path) {
  std::error_code failed;
  if (fs::is_directory(fs::symlink_status(path, failed))) {
    fs::permissions(path, fs::perms::owner_all, failed);
    for (fs::recursive_directory_iterator it(path, failed), end; it != end; it.increment(failed))
      if (it->is_directory(failed) && !it->is_symlink(failed)) fs::permissions(it->path(), fs::perms::owner_all, failed);
  }
  fs::remove_all(path, failed);
  if (failed) spdlog::warn("cannot delete {}: {}", path.string(), failed.message());
}

}  // namespace

Trash::Trash(std::string folder) : folder_(std::move(folder)) {
  fs::create_directories(folder_);
  thread_ = std::thread([this] { empty(); });
}

Trash::~Trash() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Trash::take(const std::string& path) {
  std::error_code failed;
  const fs::path from(path);
  if (!fs::exists(fs::symlink_status(from, failed))) return;
  // A read-only folder cannot be moved into another one: its ".." would change.
  if (fs::is_directory(fs::symlink_status(from, failed))) fs::permissions(from, fs::perms::owner_all, failed);
  {
    const std::lock_guard lock(mutex_);
    std::string to;
    do {
      to = folder_ + "/" + std::to_string(++taken_);
    } while (fs::exists(fs::symlink_status(to, failed)));  // of an earlier service
    fs::rename(from, to, failed);
    pending_ = true;
  }
  if (failed) spdlog::warn("cannot throw {} away: {}", path, failed.message());
  changed_.notify_all();
}

void Trash::wait_until_empty() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return !pending_ && !busy_; });
}

void Trash::empty() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return pending_ || ending_; });
    if (ending_) return;  // the next service goes on
    pending_ = false;
    busy_ = true;
    lock.unlock();
    std::error_code gone;
    for (fs::directory_iterator it(folder_, gone), end; !gone && !ending_ && it != end; it.increment(gone)) remove_tree(it->path());
    lock.lock();
    busy_ = false;
    changed_.notify_all();
  }
}

}  // namespace cloudrenderer
