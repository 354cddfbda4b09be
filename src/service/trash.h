#pragma once
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>

namespace cloudrenderer {

// What is thrown away is gone at once, as far as anybody can see, and deleted by a thread of its own: a large split
// takes seconds, in which users want answers. What a killed service has left of it is deleted by the next one.
class Trash {
 public:
  explicit Trash(std::string folder);  // on the file system of what will be thrown away
  ~Trash();
  Trash(const Trash&) = delete;
  Trash& operator=(const Trash&) = delete;

  void take(const std::string& path);  // nothing, if there is nothing
  void wait_until_empty();

 private:
  void empty();

  const std::string folder_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t taken_ = 0;
  bool pending_ = true, busy_ = false;
  std::atomic<bool> ending_ = false;
  std::thread thread_;
};

}  // namespace cloudrenderer
