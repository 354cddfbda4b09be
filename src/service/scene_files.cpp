#include "service/scene_files.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestPath = 1024, kLongestName = 255, kDeepestPath = 64, kMostFiles = 100'000;
constexpr std::uint64_t kLargestFile = std::uint64_t{1} << 40;

[[noreturn]] void throw_errno(const std::string& what) { throw std::runtime_error(what + ": " + std::strerror(errno)); }

}  // namespace

std::string path_fault(const std::string& path) {
  if (path.empty()) return "is empty";
  if (path.size() > kLongestPath) return fmt::format("is longer than {} bytes", kLongestPath);
  if (path.front() == '/') return "must be relative to the scene's folder";
  std::size_t depth = 0;
  for (std::size_t at = 0; at <= path.size();) {
    const std::size_t end = std::min(path.find('/', at), path.size());
    const std::string name = path.substr(at, end - at);
    if (name.empty()) return "has an empty name in it";
    if (name == "." || name == "..") return "may not have '" + name + "' in it";
    if (name.size() > kLongestName) return fmt::format("has a name of more than {} bytes", kLongestName);
    if (++depth > kDeepestPath) return fmt::format("is deeper than {} folders", kDeepestPath);
    at = end + 1;
  }
  const auto bad = [](char c) { return static_cast<unsigned char>(c) < 32 || c == 127 || c == '\\'; };
  if (std::ranges::any_of(path, bad)) return "may not have control characters and backslashes in it";
  return "";
}

SceneManifest read_manifest(const Json& body) {
  Fields f(body, "");
  const Json* files = f.any("files");
  f.finish();
  if (!files || !files->is_array() || files->empty() || files->size() > kMostFiles)
    throw ApiError(422, fmt::format("files must be a list of 1 to {} files", kMostFiles));
  SceneManifest out;
  for (const Json& json : *files) {
    Fields file(json, "a file");
    const Json* path = file.any("path");
    const auto hash = file.text("sha256", 64);
    const auto bytes = file.whole("bytes", 0, kLargestFile);
    file.finish();
    if (!path || !path->is_string() || !hash || !bytes) throw ApiError(422, "a file needs path, sha256 and bytes");
    const std::string name = *path;
    if (const std::string fault = path_fault(name); !fault.empty()) throw ApiError(422, "the path '" + name.substr(0, 200) + "' " + fault);
    if (!is_sha256(*hash)) throw ApiError(422, "the sha256 of '" + name + "' must be 64 small hexadecimal digits");
    if (!out.emplace(name, SceneFile{*hash, *bytes}).second) throw ApiError(422, "the path '" + name + "' is there twice");
  }
  for (const auto& [path, file] : out)
    for (std::size_t slash = path.find('/'); slash != std::string::npos; slash = path.find('/', slash + 1))
      if (out.contains(path.substr(0, slash)))
        throw ApiError(422, "'" + path.substr(0, slash) + "' is a file and the folder of '" + path + "'");
  return out;
}

Json to_json(const SceneManifest& manifest) {
  Json files = Json::array();
  for (const auto& [path, file] : manifest) files.push_back({{"path", path}, {"sha256", file.sha256}, {"bytes", file.bytes}});
  return {{"files", std::move(files)}};
}

BlobStore::BlobStore(const std::string& folder) : folder_(folder) {
  fs::create_directories(folder + "/blobs");
  fs::create_directories(folder + "/uploads");
}

std::string BlobStore::path(const std::string& sha256) const { return folder_ + "/blobs/" + sha256.substr(0, 2) + "/" + sha256; }

std::string BlobStore::partial(const std::string& user, const std::string& sha256) const {
  return folder_ + "/uploads/" + user + "." + sha256;
}

std::uint64_t BlobStore::offset(const std::string& user, const std::string& sha256) const {
  std::error_code none;
  const std::uintmax_t bytes = fs::file_size(partial(user, sha256), none);
  return none ? 0 : bytes;
}

std::unique_ptr<BlobStore::Upload> BlobStore::upload(const std::string& user, const std::string& sha256, std::uint64_t offset,
                                                     std::uint64_t total) {
  const std::string file = partial(user, sha256);
  const std::lock_guard lock(mutex_);
  if (busy_.contains(file)) throw ApiError(409, "another connection uploads this file", {{"offset", this->offset(user, sha256)}});
  const std::uint64_t there = this->offset(user, sha256);
  if (offset != there) throw ApiError(409, fmt::format("{} bytes are there; go on behind them", there), {{"offset", there}});
  std::unique_ptr<Upload> out(new Upload(*this, user, sha256, offset, total));
  busy_.insert(file);
  return out;
}

BlobStore::Upload::Upload(BlobStore& store, std::string user, std::string sha256, std::uint64_t offset, std::uint64_t total)
    : store_(store), user_(std::move(user)), sha256_(std::move(sha256)), offset_(offset), total_(total) {
  const std::string file = store_.partial(user_, sha256_);
  fd_ = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  if (fd_ < 0) throw_errno("cannot write " + file);
}

BlobStore::Upload::~Upload() {
  ::close(fd_);
  const std::lock_guard lock(store_.mutex_);
  store_.busy_.erase(store_.partial(user_, sha256_));
}

void BlobStore::Upload::add(std::string_view bytes) {
  if (bytes.size() > total_ - offset_) throw ApiError(422, fmt::format("more than the {} bytes that were announced have come", total_));
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) throw_errno("cannot write an upload");
    offset_ += static_cast<std::uint64_t>(n);
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
}

bool BlobStore::Upload::finish() {
  if (offset_ < total_) return false;
  const std::string from = store_.partial(user_, sha256_), to = store_.path(sha256_);
  if (fsync(fd_) != 0) throw_errno("cannot write an upload");
  if (const std::string is = sha256_of_file(from); is != sha256_) {
    fs::remove(from);
    throw ApiError(422, "the bytes that came have the SHA-256 " + is + "; upload the file again", {{"offset", 0}});
  }
  fs::create_directories(fs::path(to).parent_path());
  fchmod(fd_, 0444);
  fs::rename(from, to);  // over the same content of others
  return true;
}

void BlobStore::forget_uploads(double before) {
  const std::lock_guard lock(mutex_);
  for (const auto& entry : fs::directory_iterator(folder_ + "/uploads")) {
    std::error_code gone;
    const auto written = std::chrono::file_clock::to_sys(entry.last_write_time(gone)).time_since_epoch();
    if (!gone && !busy_.contains(entry.path()) && std::chrono::duration<double>(written).count() < before) fs::remove(entry.path(), gone);
  }
}

void BlobStore::materialise(const SceneManifest& manifest, const std::string& folder) const {
  const std::string unfinished = folder + ".tmp";
  fs::remove_all(unfinished);
  fs::create_directories(unfinished);
  for (const auto& [name, file] : manifest) {
    const fs::path target = fs::path(unfinished) / name;
    fs::create_directories(target.parent_path());
    std::error_code failed;
    fs::create_hard_link(path(file.sha256), target, failed);
    if (failed) fs::copy_file(path(file.sha256), target);
  }
  for (const auto& entry : fs::recursive_directory_iterator(unfinished))
    if (entry.is_directory()) fs::permissions(entry.path(), fs::perms(0555));
  fs::permissions(unfinished, fs::perms(0555));
  fs::rename(unfinished, folder);
}

}  // namespace cloudrenderer
