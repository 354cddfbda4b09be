#pragma once
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <span>
#include <string>
#include <thread>

#include "tasks/checkpoint.h"

namespace cloudrenderer {

// A file that grows, written and synced by a thread of its own: what is appended is in the file at
// once and on the disk a few seconds later. Locked against a second render.
class CheckpointFile {
 public:
  // Makes the file if there is none. Throws UsageError.
  explicit CheckpointFile(std::string path);
  ~CheckpointFile();
  CheckpointFile(const CheckpointFile&) = delete;
  CheckpointFile& operator=(const CheckpointFile&) = delete;

  const std::string& path() const { return path_; }
  std::uint64_t bytes() const { return bytes_; }  // with what waits to be written
  // Before the first append.
  void cut_off(std::uint64_t bytes);

  void append(Bytes bytes);
  // The whole content anew: the old one stays until the new one is on the disk.
  void replace(Bytes bytes);
  // "": all is well. After an error nothing is written any more.
  std::string error() const;
  // Until everything is on the disk, or there is an error.
  void close();

 private:
  struct Job {
    Bytes bytes;
    bool anew = false;
  };
  void work();
  void write(const Job& job);

  const std::string path_;
  int fd_ = -1;
  std::uint64_t bytes_ = 0;
  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::deque<Job> jobs_;
  std::string error_;
  bool closing_ = false;
  std::thread thread_;
};

// Writes a whole file through a temporary one beside it. Throws std::system_error.
void write_file_atomically(const std::string& path, std::span<const std::byte> bytes);

}  // namespace cloudrenderer
