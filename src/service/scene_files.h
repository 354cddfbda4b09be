#pragma once
// Scenes of users: folders made of files that were uploaded one by one.
#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "service/job_json.h"
#include "service/sha256.h"

namespace cloudrenderer {

struct SceneFile {
  std::string sha256;
  std::uint64_t bytes = 0;
};
using SceneManifest = std::map<std::string, SceneFile>;  // by path below the scene's folder

// "" or what is wrong with a path below a scene's folder: it must be relative, without "." and "..", control
// characters, backslashes and empty names.
std::string path_fault(const std::string& path);
// {"files": [{"path", "sha256", "bytes"}]}. Refuses paths as above, twice the same, and files that are folders of others.
SceneManifest read_manifest(const Json& body);
Json to_json(const SceneManifest& manifest);

// Files by content, and what of others has come so far. Any thread.
class BlobStore {
 public:
  explicit BlobStore(const std::string& folder);  // blobs/ and uploads/ in it

  // How much of the user's upload is there.
  std::uint64_t offset(const std::string& user, const std::string& sha256) const;

  // Bytes of one upload, from `offset` on, which must be where it ends. At most one at a time goes on with a file.
  class Upload {
   public:
    ~Upload();
    Upload(const Upload&) = delete;
    Upload& operator=(const Upload&) = delete;
    void add(std::string_view bytes);  // throws ApiError: more than announced; std::runtime_error: the disk
    std::uint64_t offset() const { return offset_; }
    // When all is there: true, and the file is stored under its content. Throws ApiError 422 when that is another;
    // the upload begins anew then.
    bool finish();

   private:
    friend class BlobStore;
    Upload(BlobStore& store, std::string user, std::string sha256, std::uint64_t offset, std::uint64_t total);
    BlobStore& store_;
    const std::string user_, sha256_;
    std::uint64_t offset_;
    const std::uint64_t total_;
    int fd_ = -1;
  };
  // Throws ApiError 409 with the offset that is wanted, or since another connection is at it.
  std::unique_ptr<Upload> upload(const std::string& user, const std::string& sha256, std::uint64_t offset, std::uint64_t total);

  std::string path(const std::string& sha256) const;
  void forget_uploads(double before);  // Unix time: those of which nothing has come since
  // A folder of hard links to the files (copies where the system has no more links), read-only.
  void materialise(const SceneManifest& manifest, const std::string& folder) const;

 private:
  std::string partial(const std::string& user, const std::string& sha256) const;

  const std::string folder_;
  std::mutex mutex_;
  std::set<std::string> busy_;  // partial files that somebody writes
};

}  // namespace cloudrenderer
