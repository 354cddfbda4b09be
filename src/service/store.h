#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/scheduler.h"

struct sqlite3;
struct sqlite3_stmt;

namespace cloudrenderer {

struct SceneRecord {
  std::string id, user, manifest;  // the manifest as JSON
  std::uint64_t bytes = 0;
  double used = 0;  // when it was uploaded, for the last time
};

// What outlives the service: jobs, scenes, who has uploaded what. SQLite with a write-ahead log; one thread at a time.
class Store {
 public:
  explicit Store(const std::string& path);  // throws UsageError: it is of a newer version, or no store
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  // Of this store among all, for good.
  std::string identity();

  // What has been counted of a frame's use of a host.
  using Meters = std::map<std::pair<std::uint64_t, FrameRef>, Usage>;
  // All or none, so that nothing is counted twice.
  void save(const std::vector<const Job*>& jobs, const Meters& meters, double now) { save(jobs, meters, {}, 0, now); }
  using Accounts = std::map<std::string, UserAccount>;
  void save(const std::vector<const Job*>& jobs, const Meters& meters, const Accounts& accounts, std::uint64_t next_id, double now);
  std::vector<Job> jobs();
  Accounts accounts();
  std::uint64_t next_id();  // 0: none is known
  // With its events, and its use into the sums of the user, all or none.
  void remove_job(std::uint64_t id, const std::string& user, const UserAccount& account);
  Meters meters();
  void forget_meters(double before);  // of hosts that have said nothing since

  void add_blob(const std::string& user, const std::string& sha256, std::uint64_t bytes);
  std::optional<std::uint64_t> blob(const std::string& user, const std::string& sha256);  // its bytes, if the user has it
  std::uint64_t bytes_of(const std::string& user);

  void add_scene(const SceneRecord& scene, double now);
  std::optional<SceneRecord> scene(const std::string& user, const std::string& id);
  std::vector<SceneRecord> scenes(const std::string& user);
  std::vector<SceneRecord> all_scenes();
  void remove_scene(const std::string& user, const std::string& id);
  bool remove_blob(const std::string& user, const std::string& sha256);  // true: nobody has it any more
  bool has_blob(const std::string& sha256);                              // anybody

  void add_event(double now, std::uint64_t job, const std::string& text);
  struct Event {
    double time = 0;
    std::string text;
  };
  std::vector<Event> events(std::uint64_t job);  // the last thousand, oldest first

 private:
  class Statement;
  void run(const std::string& sql);
  void migrate(std::uint64_t from);
  void put(const std::string& user, const UserAccount& account);

  sqlite3* db_ = nullptr;
};

}  // namespace cloudrenderer
