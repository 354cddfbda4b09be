#pragma once
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "service/scheduler.h"

namespace cloudrenderer {

// Who asks.
struct Caller {
  std::string name;
  bool admin = false;  // sees and changes everybody's jobs
};

// The users of a service: of a file that is read again when it changes, or one who has the cluster's token. Any thread.
//   {"users": [{"name": "ann", "token_sha256": "...", "share": 2, "priority_limit": 5, "budget": 10, "jobs": 100, "admin": false}]}
class Users {
 public:
  // Throws UsageError that names the file.
  static Users from_file(const std::string& path);
  static Users only(const std::string& token);  // "owner", who may do all
  Users(Users&& other) noexcept;

  std::optional<Caller> find(const std::string& token) const;
  std::map<std::string, UserLimits> limits() const;
  // Reads the file again if it is another one; what is wrong with it then, "" if nothing. The old users stay.
  std::string refresh();
  bool changed_since_last_asked();

 private:
  struct Entry {
    std::string token_sha256;
    bool admin = false;
    UserLimits limits;
  };
  using Entries = std::map<std::string, Entry>;
  Users() = default;
  static Entries read(const std::string& path);

  std::string path_;
  std::filesystem::file_time_type read_{};
  Entries entries_;
  bool changed_ = true;
  mutable std::mutex mutex_;
};

}  // namespace cloudrenderer
