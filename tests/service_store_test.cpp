// What outlives the service, and the JSON that it is kept as.
#include <gtest/gtest.h>

#include <sqlite3.h>

#include <filesystem>
#include <fstream>

#include "cluster/temp_folder.h"
#include "service/job_json.h"
#include "service/meter.h"
#include "service/prices.h"
#include "service/sha256.h"
#include "service/store.h"
#include "service/users.h"

namespace cloudrenderer {
namespace {

Job some_job(std::uint64_t id) {
  Job job;
  job.id = id;
  job.request = read_request(parse_json(R"({"scene": "s", "files": ["a.pbrt", "b/c.pbrt"], "name": "n\u00e4me", "priority": -3, "retries": 5,
    "timeout_s": 7.5, "budget": 2, "on_budget": "ask", "deadline": "2h", "options": {"spp": 16, "max_depth": 0, "seed": 4294967295, "resolution": [640, 480],
    "crop": [0, 0.5, 0.25, 1], "max_error": 0.01, "integrator": "path", "light_paths": "caustics", "dialect": "v3", "part_size": 1048576}})"), "ann");
  job.state = JobState::running;
  job.reason = "why";
  job.submitted = 1.5;
  job.deadline = job.request.deadline->at(job.submitted);
  job.started = 2.25;
  for (const std::string& file : job.request.files) {
    job.frames.emplace_back();
    job.frames.back().file = file;
  }
  job.frames[1].state = FrameState::failed;
  job.frames[1].needs = FrameNeeds{1, 2, 3, 4, 5, 6, 7};
  job.frames[1].usage = {1, 2, 3, 4, 5, 6};
  return job;
}

TEST(ServiceStore, KeepsJobsAsTheyAre) {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/db";
  Job changed = some_job(7);
  const Store::Meters meters{{{42, {7, 1}}, {1, 2, 3, 0, 5, 0}}};
  {
    Store store(path);
    const Job first = some_job(7), second = some_job(9);
    store.save({&first, &second}, {}, 10);
    changed.state = JobState::done;
    store.save({&changed}, meters, 11);
  }
  Store store(path);
  const std::string identity = store.identity();
  EXPECT_EQ(identity.size(), 16u);
  EXPECT_EQ(Store(path).identity(), identity);
  EXPECT_NE(Store(folder.path() + "/other").identity(), identity);
  const std::vector<Job> jobs = store.jobs();
  ASSERT_EQ(jobs.size(), 2u);
  EXPECT_EQ(dump(to_json(jobs[0])), dump(to_json(changed)));
  EXPECT_EQ(dump(to_json(jobs[1])), dump(to_json(some_job(9))));
  EXPECT_EQ(jobs[0].request.settings, changed.request.settings);
  ASSERT_EQ(store.meters().size(), 1u);
  EXPECT_EQ(store.meters().begin()->second.host_s, 5);
  store.forget_meters(12);
  EXPECT_TRUE(store.meters().empty());
}

TEST(ServiceStore, TakesWhatAnOlderServiceHasKept) {
  Json json = to_json(some_job(7));
  ASSERT_TRUE(json.erase("deadline_at"));
  ASSERT_TRUE(json["frames"][1]["needs"].erase("pixels") && json["frames"][1]["needs"].erase("spp"));
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/db";
  {
    Store store(path);
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
    char* sql = sqlite3_mprintf("INSERT INTO jobs VALUES (7, 'ann', 'running', %Q)", dump(json).c_str());
    EXPECT_EQ(sqlite3_exec(db, sql, nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_free(sql);
    sqlite3_close(db);
  }
  const std::vector<Job> jobs = Store(path).jobs();
  ASSERT_EQ(jobs.size(), 1u);
  EXPECT_FALSE(jobs[0].deadline);
  EXPECT_EQ(jobs[0].frames[1].needs->triangles, 5u);
  EXPECT_EQ(jobs[0].frames[1].needs->pixels, 0u);
}

TEST(ServiceStore, KeepsWhatUsersHaveUsed) {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/db";
  const Job job = some_job(7), other = some_job(8);
  {
    Store store(path);
    EXPECT_EQ(store.next_id(), 0u);
    store.save({&job, &other}, {}, {{"ann", {{1, 0, 0, 0, 0, 0, 7}, 2.5, 10}}}, 9, 10);
    store.add_event(1, 7, "one");
    store.remove_job(7, "ann", {{2, 0, 0, 0, 0, 0, 8}, 3.5, 11});
  }
  Store store(path);
  EXPECT_EQ(store.next_id(), 9u);
  EXPECT_EQ(store.jobs().size(), 1u);
  EXPECT_TRUE(store.events(7).empty());
  const UserAccount ann = store.accounts().at("ann");
  EXPECT_EQ(ann.past.cpu_s, 2);
  EXPECT_EQ(ann.past.service_cpu_s, 8);
  EXPECT_EQ(ann.used_lately, 3.5);
  EXPECT_EQ(ann.at, 11);
}

TEST(ServiceStore, KnowsWhatEachUserHas) {
  const TemporaryFolder folder;
  Store store(folder.path() + "/db");
  store.add_blob("ann", "x", 10);
  store.add_blob("ann", "x", 10);
  store.add_blob("ann", "y", 5);
  EXPECT_EQ(store.blob("ann", "x"), 10u);
  EXPECT_FALSE(store.blob("bob", "x"));
  EXPECT_EQ(store.bytes_of("ann"), 15u);
  EXPECT_EQ(store.bytes_of("bob"), 0u);
  store.add_scene({"s", "ann", "{}", 3}, 1);
  EXPECT_TRUE(store.scene("ann", "s"));
  EXPECT_FALSE(store.scene("bob", "s"));
  store.add_event(1, 5, "one");
  store.add_event(2, 6, "other");
  store.add_event(3, 5, "two");
  ASSERT_EQ(store.events(5).size(), 2u);
  EXPECT_EQ(store.events(5)[1].text, "two");
}

TEST(ServiceStore, RefusesWhatIsNoStore) {
  const TemporaryFolder folder;
  std::ofstream(folder.path() + "/db") << "this is not a data base, and long enough to be seen not to be one................................";
  EXPECT_THROW(Store(folder.path() + "/db"), UsageError);
}

TEST(ServiceJson, RequestsThatCannotBeAreRefused) {
  const auto refused = [](const std::string& text) {
    try {
      read_request(parse_json(text), "ann");
    } catch (const ApiError& e) {
      return e.status * 1000 + (e.what()[0] != '\0');
    }
    return 0;
  };
  EXPECT_EQ(refused(R"({"scene": "s", "files": ["a"]})"), 0);
  EXPECT_EQ(refused(""), 400001);
  EXPECT_EQ(refused("{\"scene\": \"\xff\"}"), 400001);
  EXPECT_EQ(refused(std::string(20, '[') + std::string(20, ']')), 400001);
  EXPECT_EQ(refused(std::string(100000, '[')), 400001);
  EXPECT_EQ(refused(R"({"scene": 1e999, "files": ["a"]})"), 400001);
  for (const char* text : {"[]", "null", "3", R"({"files": ["a"]})", R"({"scene": "s", "files": []})", R"({"scene": "s", "files": [1]})",
                           R"({"scene": "s", "files": "a"})", R"({"scene": "s", "files": ["a"], "else": 1})",
                           R"({"scene": "s", "files": ["a"], "priority": 11})", R"({"scene": "s", "files": ["a"], "priority": 1.5})",
                           R"({"scene": "s", "files": ["a"], "priority": 18446744073709551615})", R"({"scene": "s", "files": ["a"], "retries": -1})",
                           R"({"scene": "s", "files": ["a"], "timeout_s": 0})", R"({"scene": "s", "files": ["a"], "name": "a\nb"})",
                           R"({"scene": "s", "files": ["a"], "deadline": "soon"})", R"({"scene": "s", "files": ["a"], "deadline": 3600})",
                           R"({"scene": "s", "files": ["a"], "options": {"spp": 0}})", R"({"scene": "s", "files": ["a"], "options": {"spp": "4"}})",
                           R"({"scene": "s", "files": ["a"], "options": {"resolution": [0, 5]}})",
                           R"({"scene": "s", "files": ["a"], "options": {"resolution": [5]}})",
                           R"({"scene": "s", "files": ["a"], "options": {"crop": [0.5, 0.5, 0, 1]}})",
                           R"({"scene": "s", "files": ["a"], "options": {"crop": [0, 1, 0, "1"]}})",
                           R"({"scene": "s", "files": ["a"], "options": {"integrator": "--checkpoint"}})",
                           R"({"scene": "s", "files": ["a"], "options": {"light_paths": "some"}})",
                           R"({"scene": "s", "files": ["a"], "options": {"dialect": "v5"}})", R"({"scene": "s", "files": ["a"], "options": 3})"})
    EXPECT_EQ(refused(text), 422001) << text;
}

TEST(ServiceUsers, AreReadAgainWhenTheirFileChanges) {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/users";
  const std::string ann = R"({"name": "ann", "token_sha256": ")" + sha256("a") + R"(", "share": 2})";
  const std::string bob = R"({"name": "bob", "token_sha256": ")" + sha256("b") + R"(", "admin": true})";
  const auto put = [&](const std::string& text, int minute) {
    std::ofstream(path) << text;
    std::filesystem::last_write_time(path, std::filesystem::file_time_type::clock::now() - std::chrono::minutes(minute));
  };
  put(R"({"users": [)" + ann + "]}", 9);
  Users users = Users::from_file(path);
  ASSERT_TRUE(users.find("a"));
  EXPECT_EQ(users.find("a")->name, "ann");
  EXPECT_FALSE(users.find("b"));
  EXPECT_FALSE(users.find(""));
  EXPECT_EQ(users.limits().at("ann").share, 2);
  EXPECT_TRUE(users.changed_since_last_asked());
  EXPECT_FALSE(users.changed_since_last_asked());
  put(R"({"users": [)" + ann + ", " + bob + "]}", 8);
  EXPECT_EQ(users.refresh(), "");
  EXPECT_TRUE(users.find("b")->admin);
  put("{", 7);
  EXPECT_NE(users.refresh().find(path), std::string::npos);
  EXPECT_TRUE(users.find("a")) << "the old ones stay";
  for (const std::string& bad : {std::string(R"({"users": 3})"), R"({"users": [)" + ann + ", " + ann + "]}", R"({"users": [{"name": "a/b", "token_sha256": ")" + sha256("a") + "\"}]}",
                                 std::string(R"({"users": [{"name": "ann", "token_sha256": "a"}]})"), R"({"users": [)" + ann + R"(], "more": 1})"}) {
    put(bad, 6);
    EXPECT_THROW(Users::from_file(path), UsageError) << bad;
  }
}

TEST(ServicePrices, AreByKind) {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/prices";
  std::ofstream(path) << R"({"currency": "EUR", "kinds": {"small": 0.04, "big": 1}, "other": 0.1})";
  const PriceTable prices = PriceTable::read(path);
  EXPECT_EQ(prices.currency(), "EUR");
  EXPECT_EQ(prices.an_hour("small"), 0.04);
  EXPECT_EQ(prices.an_hour("unknown"), 0.1);
  for (const char* bad : {R"({"kinds": {"small": -1}})", R"({"kinds": {"big": {"threads": 8}}})", R"({"kinds": {"big": {"price": 1, "threads": 0}}})",
                          R"({"kinds": {"big": {"price": 1, "min": 3, "max": 2}}})", R"({"kinds": {"big": {"price": 1, "gpu": 2}}})"}) {
    std::ofstream(path) << bad;
    EXPECT_THROW(PriceTable::read(path), UsageError) << bad;
  }
  std::ofstream(path) << R"({"kinds": {"big": {"price": 2, "threads": 8, "memory_gib": 1.5, "speed": 1.25, "min": 1, "max": 4}, "small": 1}})";
  const PriceTable kinds = PriceTable::read(path);
  EXPECT_EQ(kinds.an_hour("big"), 2);
  const PriceTable::Kind& big = kinds.kinds().at("big");
  EXPECT_EQ(big.threads, 8u);
  EXPECT_EQ(big.memory, std::uint64_t{3} << 29);
  EXPECT_EQ(big.speed, 1.25);
  EXPECT_EQ(big.least, 1u);
  EXPECT_EQ(big.most, 4u);
  EXPECT_FALSE(kinds.kinds().at("small").most);
}

TEST(ServiceDeadline, IsADurationOrATime) {
  const auto at = [](const char* text) {
    const auto deadline = parse_deadline(text);
    return deadline ? deadline->at(1000) : -1;
  };
  EXPECT_EQ(at("90"), 1090);
  EXPECT_EQ(at("90s"), 1090);
  EXPECT_EQ(at("1.5h"), 6400);
  EXPECT_EQ(at("2m"), 1120);
  EXPECT_EQ(at("1d"), 87400);
  EXPECT_EQ(at("2026-03-01T18:00:00Z"), 1772388000);
  EXPECT_EQ(at("2026-03-01T18:00Z"), 1772388000);
  EXPECT_EQ(at("2026-03-01T19:30:00+01:30"), 1772388000);
  EXPECT_EQ(at("2026-03-01 15:00:00-0300"), 1772388000);
  EXPECT_EQ(at("2024-02-29T00:00:00Z"), 1709164800);
  for (const char* bad : {"", "s", "-5", "0", "0h", "1e3", "1w", "1h ", " 1h", "nan", "inf", "99999999d", "2026-02-29T00:00:00Z", "2026-13-01T00:00:00Z",
                          "2026-03-01T24:00:00Z", "2026-03-01T18:00:00", "2026-03-01", "2026-03-01T18:00:00Zx", "2026-03-01T18:00:00+1", "18:00"})
    EXPECT_EQ(at(bad), -1) << bad;
}

TEST(ServiceMeter, AHostsTimeIsSharedOutOnce) {
  const FrameRef a{1, 0}, b{2, 0}, c{2, 1};
  const auto shared = share_out({{a, {3, 10, 100, 0, 4, 0}}, {b, {1, 20, 200, 0, 4, 0}}, {c, {0, 30, 0, 0, 2, 0}}}, 7200);
  EXPECT_DOUBLE_EQ(shared.at(a).host_s, 3);
  EXPECT_DOUBLE_EQ(shared.at(b).host_s, 1);
  EXPECT_DOUBLE_EQ(shared.at(c).host_s, 0);
  EXPECT_DOUBLE_EQ(shared.at(a).cost, 6);
  EXPECT_DOUBLE_EQ(shared.at(a).cpu_s, 3);
  EXPECT_DOUBLE_EQ(shared.at(b).memory_byte_s, 20);
  const auto idle = share_out({{a, {0, 0, 0, 0, 3, 0}}, {b, {0, 0, 0, 0, 1, 0}}}, 0);
  EXPECT_DOUBLE_EQ(idle.at(a).host_s + idle.at(b).host_s, 3) << "time passes once";
  EXPECT_DOUBLE_EQ(idle.at(a).host_s, 2.25);
  EXPECT_TRUE(share_out({}, 1).empty());
}

}  // namespace
}  // namespace cloudrenderer
