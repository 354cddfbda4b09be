#pragma once
// Files of a split over the wire, in chunks: the manager serves, workers fetch.
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "wire/messages.h"

namespace cloudrenderer {

// Answers requests from a split folder; nothing outside of it can be named. Any thread.
class BlobServer {
 public:
  explicit BlobServer(std::string folder) : folder_(std::move(folder)) {}
  wire::BlobChunk answer(const wire::BlobRequest& request) const;

 private:
  std::string folder_;
};

// Fetches blobs into files. fetch() blocks and is called by one thread; receive() and fail() by the
// I/O thread.
class BlobFetcher {
 public:
  explicit BlobFetcher(std::function<void(wire::Message)> send) : send_(std::move(send)) {}

  struct Blob {
    wire::BlobKind kind = wire::BLOB_PART;
    std::uint32_t index = 0;  // of a part or prototype
    std::string name;         // of a file
  };
  // "" or why there is no such file at `path` now. More than `largest` bytes are refused.
  std::string fetch(const Blob& blob, const std::string& path, std::uint64_t largest);

  void receive(wire::BlobChunk chunk);
  void fail(const std::string& why);  // all fetches, now and later

 private:
  void request(const Blob& blob, std::uint64_t offset);

  std::function<void(wire::Message)> send_;
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::uint64_t next_request_ = 1;
  std::map<std::uint64_t, std::uint64_t> asked_;     // request -> offset
  std::map<std::uint64_t, wire::BlobChunk> chunks_;  // by request, not yet written
  std::string failure_;
};

}  // namespace cloudrenderer
