#include "service/store.h"

#include <sqlite3.h>

#include <iterator>

#include "base/error.h"
#include "service/job_json.h"

namespace cloudrenderer {
namespace {

constexpr int kPatienceMs = 5000;

// What makes a store of each version from one of the version before. Never changed; new ones are added.
constexpr const char* kMigrations[] = {
    R"(
  CREATE TABLE IF NOT EXISTS jobs (id INTEGER PRIMARY KEY, user TEXT NOT NULL, state TEXT NOT NULL, data TEXT NOT NULL);
  CREATE TABLE IF NOT EXISTS blobs (user TEXT NOT NULL, sha256 TEXT NOT NULL, bytes INTEGER NOT NULL, PRIMARY KEY (user, sha256));
  CREATE TABLE IF NOT EXISTS scenes (id TEXT NOT NULL, user TEXT NOT NULL, manifest TEXT NOT NULL, bytes INTEGER NOT NULL,
                                     made REAL NOT NULL, PRIMARY KEY (user, id));
  CREATE TABLE IF NOT EXISTS events (time REAL NOT NULL, job INTEGER NOT NULL, text TEXT NOT NULL);
  CREATE TABLE IF NOT EXISTS meters (host INTEGER NOT NULL, job INTEGER NOT NULL, frame INTEGER NOT NULL, cpu_s REAL, memory_byte_s REAL,
                                     bytes REAL, host_s REAL, seen REAL NOT NULL, PRIMARY KEY (host, job, frame));
  CREATE TABLE IF NOT EXISTS identity (id TEXT NOT NULL);
  CREATE INDEX IF NOT EXISTS events_of_job ON events (job);
)",
    // What users have used lately, and in jobs that were removed; the number of the next job.
    R"(
  CREATE TABLE accounts (user TEXT PRIMARY KEY, past TEXT NOT NULL, used_lately REAL NOT NULL, at REAL NOT NULL);
  CREATE TABLE numbers (name TEXT PRIMARY KEY, value INTEGER NOT NULL);
)",
};
constexpr std::uint64_t kVersion = std::size(kMigrations);

}  // namespace

class Store::Statement {
 public:
  Statement(sqlite3* db, const char* sql) : db_(db) {
    if (sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr) != SQLITE_OK) fail();
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(const std::string& text) {
    sqlite3_bind_text(statement_, ++bound_, text.data(), static_cast<int>(text.size()), SQLITE_TRANSIENT);
    return *this;
  }
  Statement& bind(std::uint64_t number) {
    sqlite3_bind_int64(statement_, ++bound_, static_cast<sqlite3_int64>(number));
    return *this;
  }
  Statement& bind(double number) {
    sqlite3_bind_double(statement_, ++bound_, number);
    return *this;
  }
  bool row() {
    const int result = sqlite3_step(statement_);
    if (result != SQLITE_ROW && result != SQLITE_DONE) fail();
    return result == SQLITE_ROW;
  }
  void again() {
    sqlite3_reset(statement_);
    bound_ = 0;
  }
  std::string text(int column) const {
    const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    return {bytes ? bytes : "", static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))};
  }
  std::uint64_t number(int column) const { return static_cast<std::uint64_t>(sqlite3_column_int64(statement_, column)); }
  double real(int column) const { return sqlite3_column_double(statement_, column); }

 private:
  [[noreturn]] void fail() const { throw std::runtime_error(std::string("the service's store: ") + sqlite3_errmsg(db_)); }
  sqlite3* db_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

Store::Store(const std::string& path) {
  if (sqlite3_open(path.c_str(), &db_) != SQLITE_OK) {
    const std::string why = sqlite3_errmsg(db_);
    sqlite3_close(db_);
    throw UsageError("cannot open the service's store " + path + ": " + why);
  }
  sqlite3_busy_timeout(db_, kPatienceMs);
  try {
    run("PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL;");
    std::uint64_t version = 0;
    {
      Statement s(db_, "PRAGMA user_version");
      s.row();
      version = s.number(0);
    }
    if (version > kVersion)
      throw std::runtime_error("it is of version " + std::to_string(version) + ", this program knows " + std::to_string(kVersion));
    migrate(version);
  } catch (const std::exception& e) {
    sqlite3_close(db_);
    throw UsageError(path + ": " + e.what());
  }
}

Store::~Store() { sqlite3_close(db_); }

void Store::run(const std::string& sql) {
  char* message = nullptr;
  if (sqlite3_exec(db_, sql.c_str(), nullptr, nullptr, &message) == SQLITE_OK) return;
  const std::string why = message ? message : "";
  sqlite3_free(message);
  throw std::runtime_error("the service's store: " + why);
}

void Store::migrate(std::uint64_t from) {
  for (std::uint64_t version = from; version < kVersion; ++version) {
    run("BEGIN IMMEDIATE");
    try {
      run(kMigrations[version]);
      run("PRAGMA user_version = " + std::to_string(version + 1));
    } catch (...) {
      run("ROLLBACK");
      throw;
    }
    run("COMMIT");
  }
}

void Store::put(const std::string& user, const UserAccount& a) {
  Statement(db_, "INSERT OR REPLACE INTO accounts (user, past, used_lately, at) VALUES (?, ?, ?, ?)")
      .bind(user)
      .bind(dump(to_json(a.past)))
      .bind(a.used_lately)
      .bind(a.at)
      .row();
}

void Store::save(const std::vector<const Job*>& jobs, const Meters& meters, const Accounts& accounts, std::uint64_t next_id, double now) {
  if (jobs.empty() && meters.empty()) return;
  run("BEGIN IMMEDIATE");
  try {
    Statement s(db_, "INSERT OR REPLACE INTO jobs (id, user, state, data) VALUES (?, ?, ?, ?)");
    for (const Job* job : jobs) {
      s.bind(job->id).bind(job->request.user).bind(std::string(name(job->state))).bind(dump(to_json(*job)));
      s.row();
      s.again();
    }
    Statement m(db_, "INSERT OR REPLACE INTO meters VALUES (?, ?, ?, ?, ?, ?, ?, ?)");
    for (const auto& [key, u] : meters) {
      m.bind(key.first).bind(key.second.job).bind(std::uint64_t{key.second.frame});
      m.bind(u.cpu_s).bind(u.memory_byte_s).bind(u.bytes).bind(u.host_s).bind(now);
      m.row();
      m.again();
    }
    for (const auto& [user, account] : accounts) put(user, account);
    if (next_id != 0) Statement(db_, "INSERT OR REPLACE INTO numbers VALUES ('next job', ?)").bind(next_id).row();
  } catch (...) {
    run("ROLLBACK");
    throw;
  }
  run("COMMIT");
}

std::vector<Job> Store::jobs() {
  std::vector<Job> out;
  for (Statement s(db_, "SELECT data FROM jobs ORDER BY id"); s.row();) out.push_back(job_from_json(Json::parse(s.text(0))));
  return out;
}

Store::Accounts Store::accounts() {
  Accounts out;
  for (Statement s(db_, "SELECT user, past, used_lately, at FROM accounts"); s.row();)
    out[s.text(0)] = {usage_from_json(Json::parse(s.text(1))), s.real(2), s.real(3)};
  return out;
}

std::uint64_t Store::next_id() {
  Statement s(db_, "SELECT value FROM numbers WHERE name = 'next job'");
  return s.row() ? s.number(0) : 0;
}

void Store::remove_job(std::uint64_t id, const std::string& user, const UserAccount& account) {
  run("BEGIN IMMEDIATE");
  try {
    Statement(db_, "DELETE FROM jobs WHERE id = ?").bind(id).row();
    Statement(db_, "DELETE FROM events WHERE job = ?").bind(id).row();
    put(user, account);
  } catch (...) {
    run("ROLLBACK");
    throw;
  }
  run("COMMIT");
}

std::string Store::identity() {
  run("INSERT INTO identity SELECT lower(hex(randomblob(8))) WHERE NOT EXISTS (SELECT 1 FROM identity)");
  Statement s(db_, "SELECT id FROM identity");
  s.row();
  return s.text(0);
}

Store::Meters Store::meters() {
  Meters out;
  for (Statement s(db_, "SELECT host, job, frame, cpu_s, memory_byte_s, bytes, host_s FROM meters"); s.row();)
    out[{s.number(0), {s.number(1), static_cast<std::uint32_t>(s.number(2))}}] = {s.real(3), s.real(4), s.real(5), 0, s.real(6), 0};
  return out;
}

void Store::forget_meters(double before) { Statement(db_, "DELETE FROM meters WHERE seen < ?").bind(before).row(); }

void Store::add_blob(const std::string& user, const std::string& sha256, std::uint64_t bytes) {
  Statement(db_, "INSERT OR IGNORE INTO blobs (user, sha256, bytes) VALUES (?, ?, ?)").bind(user).bind(sha256).bind(bytes).row();
}

std::optional<std::uint64_t> Store::blob(const std::string& user, const std::string& sha256) {
  Statement s(db_, "SELECT bytes FROM blobs WHERE user = ? AND sha256 = ?");
  if (!s.bind(user).bind(sha256).row()) return std::nullopt;
  return s.number(0);
}

std::uint64_t Store::bytes_of(const std::string& user) {
  Statement s(db_, "SELECT total(bytes) FROM blobs WHERE user = ?");
  s.bind(user).row();
  return static_cast<std::uint64_t>(s.real(0));
}

void Store::add_scene(const SceneRecord& scene, double now) {
  Statement(db_, "INSERT OR REPLACE INTO scenes (id, user, manifest, bytes, made) VALUES (?, ?, ?, ?, ?)")
      .bind(scene.id)
      .bind(scene.user)
      .bind(scene.manifest)
      .bind(scene.bytes)
      .bind(now)
      .row();
}

std::optional<SceneRecord> Store::scene(const std::string& user, const std::string& id) {
  Statement s(db_, "SELECT manifest, bytes, made FROM scenes WHERE user = ? AND id = ?");
  if (!s.bind(user).bind(id).row()) return std::nullopt;
  return SceneRecord{id, user, s.text(0), s.number(1), s.real(2)};
}

std::vector<SceneRecord> Store::scenes(const std::string& user) {
  std::vector<SceneRecord> out;
  Statement s(db_, "SELECT id, manifest, bytes, made FROM scenes WHERE user = ? ORDER BY made DESC LIMIT 1000");
  for (s.bind(user); s.row();) out.push_back({s.text(0), user, s.text(1), s.number(2), s.real(3)});
  return out;
}

std::vector<SceneRecord> Store::all_scenes() {
  std::vector<SceneRecord> out;
  for (Statement s(db_, "SELECT id, user, manifest, bytes, made FROM scenes"); s.row();)
    out.push_back({s.text(0), s.text(1), s.text(2), s.number(3), s.real(4)});
  return out;
}

void Store::remove_scene(const std::string& user, const std::string& id) {
  Statement(db_, "DELETE FROM scenes WHERE user = ? AND id = ?").bind(user).bind(id).row();
}

bool Store::remove_blob(const std::string& user, const std::string& sha256) {
  Statement(db_, "DELETE FROM blobs WHERE user = ? AND sha256 = ?").bind(user).bind(sha256).row();
  return !has_blob(sha256);
}

bool Store::has_blob(const std::string& sha256) {
  Statement s(db_, "SELECT 1 FROM blobs WHERE sha256 = ? LIMIT 1");
  return s.bind(sha256).row();
}

void Store::add_event(double now, std::uint64_t job, const std::string& text) {
  Statement(db_, "INSERT INTO events (time, job, text) VALUES (?, ?, ?)").bind(now).bind(job).bind(text).row();
}

std::vector<Store::Event> Store::events(std::uint64_t job) {
  std::vector<Event> out;
  Statement s(db_, "SELECT time, text FROM (SELECT rowid AS n, time, text FROM events WHERE job = ? ORDER BY n DESC LIMIT 1000) ORDER BY n");
  for (s.bind(job); s.row();) out.push_back({s.real(0), s.text(1)});
  return out;
}

}  // namespace cloudrenderer
