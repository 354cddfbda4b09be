#include "service/users.h"

#include <algorithm>
#include <fstream>
#include <sstream>

#include "base/error.h"
#include "service/job_json.h"
#include "service/sha256.h"
#include "web/http_server.h"

namespace cloudrenderer {
namespace {

constexpr double kLargest = 1e15;

bool is_user_name(const std::string& name) {
  const auto good = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_'; };
  return !name.empty() && name.size() <= 64 && std::ranges::all_of(name, good);
}

}  // namespace

Users::Users(Users&& o) noexcept : path_(std::move(o.path_)), read_(o.read_), entries_(std::move(o.entries_)), changed_(o.changed_) {}

Users::Entries Users::read(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw UsageError("cannot read the users' file " + path);
  std::ostringstream text;
  text << file.rdbuf();
  Entries out;
  try {
    const Json json = parse_json(text.str());
    Fields top(json, "");
    const Json* users = top.any("users");
    top.finish();
    if (!users || !users->is_array()) throw ApiError(422, "users must be a list");
    for (const Json& user : *users) {
      Fields f(user, "a user");
      const std::string name = f.text("name", 64).value_or("");
      Entry e;
      e.token_sha256 = f.text("token_sha256", 64).value_or("");
      e.admin = f.boolean("admin").value_or(false);
      e.limits.share = f.number("share", 1e-6, 1e6).value_or(1);
      e.limits.priority_limit = static_cast<int>(f.integer("priority_limit", Scheduler::kLowestPriority, Scheduler::kHighestPriority).value_or(0));
      e.limits.budget = f.number("budget", 0, kLargest);
      e.limits.jobs = static_cast<std::uint32_t>(f.whole("jobs", 0, 1'000'000).value_or(1000));
      f.finish();
      if (!is_user_name(name)) throw ApiError(422, "the name of a user must be 1 to 64 letters, digits, - and _, got '" + name + "'");
      if (!is_sha256(e.token_sha256)) throw ApiError(422, "token_sha256 of " + name + " must be 64 small hexadecimal digits (sha256sum of the token)");
      for (const auto& [other, o] : out)
        if (o.token_sha256 == e.token_sha256) throw ApiError(422, name + " and " + other + " have the same token");
      if (!out.emplace(name, e).second) throw ApiError(422, "the user " + name + " is there twice");
    }
  } catch (const ApiError& e) {
    throw UsageError("the users' file " + path + ": " + e.what());
  }
  return out;
}

Users Users::from_file(const std::string& path) {
  Users users;
  users.path_ = path;
  std::error_code ignored;
  users.read_ = std::filesystem::last_write_time(path, ignored);
  users.entries_ = read(path);
  return users;
}

Users Users::only(const std::string& token) {
  Users users;
  Entry e;
  e.token_sha256 = sha256(token);
  e.admin = true;
  e.limits.priority_limit = Scheduler::kHighestPriority;
  users.entries_["owner"] = e;
  return users;
}

std::optional<Caller> Users::find(const std::string& token) const {
  const std::string hash = sha256(token);
  const std::lock_guard lock(mutex_);
  for (const auto& [name, e] : entries_)
    if (same_secret(e.token_sha256, hash)) return Caller{name, e.admin};
  return std::nullopt;
}

std::map<std::string, UserLimits> Users::limits() const {
  const std::lock_guard lock(mutex_);
  std::map<std::string, UserLimits> out;
  for (const auto& [name, e] : entries_) out[name] = e.limits;
  return out;
}

std::string Users::refresh() {
  if (path_.empty()) return "";
  std::error_code gone;
  const auto written = std::filesystem::last_write_time(path_, gone);
  if (gone || written == read_) return "";
  read_ = written;
  try {
    Entries entries = read(path_);
    const std::lock_guard lock(mutex_);
    entries_ = std::move(entries);
    changed_ = true;
  } catch (const UsageError& e) {
    return e.what();
  }
  return "";
}

bool Users::changed_since_last_asked() { return std::exchange(changed_, false); }

}  // namespace cloudrenderer
