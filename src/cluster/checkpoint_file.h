#pragma once
#include <sys/types.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
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
  // Whether the name still leads to the file. Where it leads nowhere, what is appended is lost
  // unless replace() makes the file anew; where it leads to another file, that one is not ours.
  enum class Place { here, gone, taken };
  Place place() const;
  void fail(const std::string& why);  // an error that the owner has found
  // "": all is well. After an error nothing is written any more.
  std::string error() const;
  // Until everything is on the disk, or there is an error.
  void close();

 private:
  struct Job {
    Bytes bytes;
    bool anew = false;
  };
  struct Identity {  // of a file, whatever its name
    dev_t device = 0;
    ino_t inode = 0;
    friend bool operator==(const Identity&, const Identity&) = default;
  };
  static std::optional<Identity> identity(int fd);
  static std::optional<Identity> identity(const std::string& path);
  void open_locked();
  void work();
  void write(const Job& job);

  const std::string path_;
  int fd_ = -1;
  std::uint64_t bytes_ = 0;
  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::deque<Job> jobs_;
  std::string error_;
  Identity identity_;
  bool replacing_ = false;  // the name may lead to the new file already
  bool closing_ = false;
  std::thread thread_;
};

// Writes a whole file of this name through a temporary one beside it; what had the name gets
// another one, and if a running render holds it, the new file gets one. Returns the new file's.
// Throws std::system_error.
std::string write_beside(const std::string& path, std::span<const std::byte> bytes);

}  // namespace cloudrenderer
