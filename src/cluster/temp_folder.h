#pragma once
#include <string>

namespace cloudrenderer {

// A new private folder under TMPDIR (or /tmp), removed with all that is in it when this goes.
class TemporaryFolder {
 public:
  TemporaryFolder();  // throws std::system_error
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace cloudrenderer
