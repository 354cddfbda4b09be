// What a service removes from its folder, and what it never does.
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>

#include "base/error.h"
#include "cluster/temp_folder.h"
#include "net/listener.h"
#include "service/service.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

constexpr double kDay = 86400;
const Caller kAnn{"ann", false}, kBob{"bob", false};

class NoHosts : public FrameHosts {
 public:
  void order(const std::vector<FrameOrder>&) override {}
  std::map<std::uint64_t, ServiceHost> hosts() const override { return {}; }
};

void put(const std::string& path, const std::string& text) {
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path) << text;
}

class TidyService : public testing::Test {
 protected:
  std::string folder() const { return folder_.path() + "/data"; }
  // A job of the user as the store would have it.
  void keep_job(std::uint64_t id, JobState state, std::optional<double> ended, const std::string& scene = "scene", bool over_budget = false) {
    Job job;
    job.id = id;
    job.request.user = "ann";
    job.request.scene = scene;
    job.request.files = {"a.pbrt"};
    job.state = state;
    job.ended = ended;
    job.over_budget = over_budget;
    job.frames.resize(1);
    job.frames[0].file = "a.pbrt";
    job.frames[0].state = is_final(state) && !over_budget ? FrameState::done : FrameState::ready;
    job.frames[0].needs = FrameNeeds{};
    job.frames[0].usage = {10, 0, 0, 0, 5, 2, 1};
    fs::create_directories(folder());
    Store(folder() + "/service.db").save({&job}, {}, 1);
    put(folder() + "/jobs/" + std::to_string(id) + "/0000/picture.exr", "picture");
  }
  void keep_scene(const std::string& id, double used, const std::string& file) {
    fs::create_directories(folder());
    Store store(folder() + "/service.db");
    store.add_scene({id, "ann", R"({"files": [{"path": "a.pbrt", "sha256": ")" + file + R"(", "bytes": 3}]})", 3}, used);
    store.add_blob("ann", file, 3);
    put(folder() + "/scenes/" + id + "/a.pbrt", "abc");
    put(BlobStore(folder()).path(file), "abc");
    fs::permissions(folder() + "/scenes/" + id, fs::perms(0555));
  }
  std::string keep_split(const std::string& scene, std::size_t bytes, double days_ago) {
    const std::string path = folder() + "/splits/" + sha256(scene + "\n0\n\na.pbrt").substr(0, 40);
    put(path + "/parts", std::string(bytes, 'x'));
    fs::last_write_time(path, fs::file_time_type::clock::now() - std::chrono::seconds(static_cast<long>(days_ago * kDay)));
    return path;
  }
  std::unique_ptr<Service> serve(const KeepRules& rules) {
    ServiceConfig config;
    config.folder = folder();
    config.rules = rules;
    return std::make_unique<Service>(config, Users::only("secret"), std::nullopt, [](const std::string&) { return std::make_unique<NoHosts>(); });
  }
  bool there(const std::string& path) const { return fs::exists(folder() + "/" + path); }
  std::size_t in_trash() const { return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder() + "/trash"), fs::directory_iterator())); }

  const double now_ = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();

 private:
  const TemporaryFolder folder_;
};

TEST_F(TidyService, JobsGoWhenTheyHaveBeenKeptAndNotBefore) {
  keep_job(1, JobState::done, now_ - 8 * kDay);
  keep_job(2, JobState::failed, now_ - 6 * kDay);
  keep_job(3, JobState::paused, std::nullopt);
  keep_job(4, JobState::queued, std::nullopt);
  put(folder() + "/jobs/77/0000/log", "of a job whose removal was cut off");
  {
    const auto service = serve({7 * kDay, {}});
    service->step(now_);
    EXPECT_EQ(service->jobs(kAnn).size(), 3u);
    EXPECT_FALSE(there("jobs/1"));
    for (const char* kept : {"jobs/2", "jobs/3", "jobs/4"}) EXPECT_TRUE(there(kept)) << kept;
    EXPECT_FALSE(there("jobs/77"));
    service->step(now_ + 2 * kDay);
    EXPECT_FALSE(there("jobs/2"));
    EXPECT_TRUE(there("jobs/3"));
  }
  const auto service = serve({});
  service->step(now_ + 1000 * kDay);
  EXPECT_EQ(service->jobs(kAnn).size(), 2u) << "without --keep nothing goes";
}

TEST_F(TidyService, UsersRemoveTheirOwnJobsThatHaveEnded) {
  keep_job(1, JobState::done, now_);
  keep_job(2, JobState::paused, std::nullopt);
  const auto status_of = [&](Service& s, const Caller& caller, std::uint64_t id) {
    try {
      s.remove(caller, id);
      return 200;
    } catch (const ApiError& e) {
      return e.status;
    }
  };
  {
    const auto service = serve({});
    EXPECT_EQ(status_of(*service, kBob, 1), 404);
    EXPECT_EQ(status_of(*service, kAnn, 2), 409);
    EXPECT_EQ(status_of(*service, kAnn, 1), 200);
    EXPECT_EQ(status_of(*service, kAnn, 1), 404);
    EXPECT_FALSE(there("jobs/1"));
    service->cancel(kAnn, 2);
    EXPECT_EQ(status_of(*service, kAnn, 2), 200);
  }
  // What they have used is not forgotten with them, and their numbers are not given again.
  Scheduler scheduler({});
  Store store(folder() + "/service.db");
  EXPECT_TRUE(store.jobs().empty());
  scheduler.restore(store.accounts(), store.next_id());
  EXPECT_EQ(scheduler.usage().at("ann").cpu_s, 20);
  EXPECT_EQ(scheduler.usage().at("ann").cost, 4);
  EXPECT_EQ(scheduler.usage().at("ann").service_cpu_s, 2);
  scheduler.set_users({{"ann", {}}});
  JobRequest r;
  r.user = "ann";
  r.files = {"a"};
  EXPECT_EQ(*scheduler.submit(r, now_), 3u);
}

TEST_F(TidyService, ScenesWithoutJobsGoWithFilesThatNoOtherHas) {
  keep_scene("used", now_ - 99 * kDay, std::string(64, 'a'));
  keep_scene("old", now_ - 99 * kDay, std::string(64, 'b'));
  keep_scene("old-too", now_ - 99 * kDay, std::string(64, 'a'));  // the file of another one that stays
  keep_scene("young", now_ - 1800, std::string(64, 'c'));
  keep_job(1, JobState::queued, std::nullopt, "used");
  put(folder() + "/uploads/ann.old", "ab");
  fs::last_write_time(folder() + "/uploads/ann.old", fs::file_time_type::clock::now() - std::chrono::hours(50));
  put(folder() + "/uploads/ann.new", "ab");
  const auto service = serve({60.0, {}});
  service->step(now_);
  for (const char* kept : {"scenes/used/a.pbrt", "scenes/young/a.pbrt", "uploads/ann.new"}) EXPECT_TRUE(there(kept)) << kept;
  for (const char* gone : {"scenes/old", "scenes/old-too", "uploads/ann.old"}) EXPECT_FALSE(there(gone)) << gone;
  EXPECT_EQ(service->scenes(kAnn).size(), 2u);
  EXPECT_EQ(service->blob(kAnn, std::string(64, 'a')).at("complete"), true);
  EXPECT_EQ(service->blob(kAnn, std::string(64, 'b')).at("complete"), false);
  const BlobStore blobs(folder());
  EXPECT_TRUE(fs::exists(blobs.path(std::string(64, 'a'))));
  EXPECT_FALSE(fs::exists(blobs.path(std::string(64, 'b'))));
  service->step(now_ + 3700);
  EXPECT_FALSE(there("scenes/young"));
  EXPECT_TRUE(there("scenes/used/a.pbrt"));
}

TEST_F(TidyService, SplitsThatNoJobNeedsGoWhenTheDiskIsFull) {
  for (const auto& [id, scene, state, over] : {std::tuple{1, "running", JobState::running, false}, {2, "paused", JobState::paused, true},
                                               {3, "resumable", JobState::failed, true}, {4, "done", JobState::done, false}})
    keep_job(static_cast<std::uint64_t>(id), state, is_final(state) ? std::optional(now_) : std::nullopt, scene, over);
  std::map<std::string, std::string> splits;
  double days_ago = 9;
  for (const char* scene : {"running", "paused", "resumable", "oldest", "done", "newest"}) splits[scene] = keep_split(scene, 10000, days_ago--);
  put(folder() + "/splits/left-behind.tmp/parts", "x");
  const auto rest = [&](std::uint64_t disk) {
    const auto service = serve({{}, disk});
    service->step(now_);
    std::string out;
    for (const auto& [scene, path] : splits) out += fs::exists(path) ? scene + " " : "";
    return out;
  };
  EXPECT_EQ(rest(70000), "done newest oldest paused resumable running ");
  EXPECT_FALSE(there("splits/left-behind.tmp"));
  EXPECT_EQ(rest(55000), "done newest paused resumable running ");
  EXPECT_EQ(rest(1), "paused resumable running ");
}

TEST_F(TidyService, WhatIsThrownAwayIsDeleted) {
  fs::create_directories(folder());
  put(folder() + "/a/b/c", "x");
  put(folder() + "/trash/of-an-earlier-service/x", "x");
  fs::permissions(folder() + "/a/b", fs::perms(0555));
  fs::permissions(folder() + "/a", fs::perms(0555));
  Trash trash(folder() + "/trash");
  trash.take(folder() + "/a");
  EXPECT_FALSE(there("a"));
  trash.take(folder() + "/nothing");
  trash.wait_until_empty();
  EXPECT_EQ(in_trash(), 0u);
}

TEST(ServicePorts, ARangeIsUsedUpAndSaysSo) {
  asio::io_context io;
  const Listener other(io, {"127.0.0.1", 0}, [](std::unique_ptr<Stream>) {});
  const std::uint16_t port = other.address().port;
  const auto none = [](std::uint16_t) { return false; };
  EXPECT_FALSE(free_port({port, port}, "127.0.0.1", none)) << "somebody listens there";
  const auto found = free_port({port, static_cast<std::uint16_t>(std::min(65535, port + 20))}, "127.0.0.1", none);
  ASSERT_TRUE(found);
  EXPECT_GT(*found, port);
  EXPECT_FALSE(free_port({*found, *found}, "127.0.0.1", [&](std::uint16_t p) { return p == *found; }));
}

}  // namespace
}  // namespace cloudrenderer
