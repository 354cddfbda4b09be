#include "cluster/blob.h"

#include <chrono>
#include <filesystem>
#include <fstream>

#include "parts/split.h"
#include "wire/codec.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

// As many requests as fill a fast line while a chunk is being written.
constexpr std::size_t kAhead = 4;
constexpr auto kPatience = std::chrono::seconds(60);

std::string path_of(const std::string& folder, const wire::BlobRequest& r) {
  switch (r.kind()) {
    case wire::BLOB_MANIFEST:
      return folder + "/manifest.bin";
    case wire::BLOB_PART:
      return part_path(folder, r.index());
    case wire::BLOB_PROTOTYPE:
      return prototype_path(folder, r.index());
    case wire::BLOB_FILE: {
      const fs::path name(r.name());
      if (name.filename() != name || r.name().empty() || r.name() == "." || r.name() == "..")
        return {};
      return folder + "/files/" + r.name();
    }
    default:
      return {};
  }
}

}  // namespace

wire::BlobChunk BlobServer::answer(const wire::BlobRequest& r) const {
  wire::BlobChunk chunk;
  chunk.set_request(r.request());
  chunk.set_offset(r.offset());
  const std::string path = path_of(folder_, r);
  std::error_code error;
  const std::uint64_t total = path.empty() ? 0 : fs::file_size(path, error);
  std::ifstream in;
  if (!path.empty() && !error) in.open(path, std::ios::binary);
  if (!in.is_open()) {
    chunk.set_error("there is no such file in the split");
    return chunk;
  }
  chunk.set_total(total);
  if (r.offset() >= total) return chunk;
  const std::uint64_t bytes =
      std::min({std::uint64_t{r.bytes()}, std::uint64_t{wire::kMaxBlobChunk}, total - r.offset()});
  std::string data(bytes, '\0');
  in.seekg(static_cast<std::streamoff>(r.offset()));
  if (!in.read(data.data(), static_cast<std::streamsize>(bytes))) {
    chunk.set_error("the file cannot be read");
    return chunk;
  }
  chunk.set_data(std::move(data));
  return chunk;
}

void BlobFetcher::request(const Blob& blob, std::uint64_t offset) {
  wire::BlobRequest r;
  r.set_kind(blob.kind);
  r.set_index(blob.index);
  r.set_name(blob.name);
  r.set_offset(offset);
  r.set_bytes(static_cast<std::uint32_t>(wire::kMaxBlobChunk));
  {
    const std::lock_guard lock(mutex_);
    r.set_request(next_request_++);
    asked_[r.request()] = offset;
  }
  send_(std::move(r));
}

std::string BlobFetcher::fetch(const Blob& blob, const std::string& path, std::uint64_t largest) {
  {
    const std::lock_guard lock(mutex_);
    asked_.clear();
    chunks_.clear();
  }
  const std::string unfinished = path + ".unfinished";
  std::error_code ignored;
  fs::create_directories(fs::path(path).parent_path(), ignored);
  std::ofstream out(unfinished, std::ios::binary | std::ios::trunc);
  if (!out) return "cannot write " + unfinished;
  std::uint64_t total = 1, asked_to = wire::kMaxBlobChunk,
                written = 0;  // the total is known with the first chunk
  request(blob, 0);
  while (written < total) {
    wire::BlobChunk chunk;
    std::uint64_t offset = 0;
    {
      std::unique_lock lock(mutex_);
      if (!arrived_.wait_for(lock, kPatience,
                             [&] { return !chunks_.empty() || !failure_.empty(); }))
        return "the manager does not send what was asked for";
      if (!failure_.empty()) return failure_;
      auto node = chunks_.extract(chunks_.begin());
      chunk = std::move(node.mapped());
      offset = asked_.at(node.key());
      asked_.erase(node.key());
    }
    if (!chunk.error().empty()) return chunk.error();
    if (chunk.total() > largest || (written > 0 && chunk.total() != total))
      return "it has a wrong size";
    total = chunk.total();
    if (chunk.offset() != offset ||
        chunk.data().size() != std::min<std::uint64_t>(wire::kMaxBlobChunk, total - offset))
      return "a chunk has a wrong place or size";
    out.seekp(static_cast<std::streamoff>(offset));
    out.write(chunk.data().data(), static_cast<std::streamsize>(chunk.data().size()));
    written += chunk.data().size();
    while (asked_to < total && asked_to < written + kAhead * wire::kMaxBlobChunk) {
      request(blob, asked_to);
      asked_to += wire::kMaxBlobChunk;
    }
  }
  out.close();
  if (!out) return "cannot write " + unfinished;
  std::error_code error;
  fs::rename(unfinished, path, error);
  return error ? "cannot rename " + unfinished + ": " + error.message() : std::string();
}

void BlobFetcher::receive(wire::BlobChunk chunk) {
  const std::lock_guard lock(mutex_);
  if (!asked_.contains(chunk.request())) return;  // of a fetch that has failed
  chunks_[chunk.request()] = std::move(chunk);
  arrived_.notify_one();
}

void BlobFetcher::fail(const std::string& why) {
  const std::lock_guard lock(mutex_);
  if (failure_.empty()) failure_ = why;
  arrived_.notify_one();
}

}  // namespace cloudrenderer
