// What jobs have left to do, and what is known of hosts.
#include <gtest/gtest.h>

#include "service/elastic_input.h"
#include "service/frame_progress.h"

namespace cloudrenderer {
namespace {

Job job(std::uint64_t id, const std::string& scene, std::size_t frames = 1) {
  Job j;
  j.id = id;
  j.state = JobState::queued;
  j.request.user = "ann";
  j.request.scene = scene;
  j.frames.resize(frames);
  for (JobFrame& f : j.frames) {
    f.state = FrameState::ready;
    f.needs = FrameNeeds{100, 200, 1000, 5, 50, 10'000, 100};  // a million paths
  }
  return j;
}

std::vector<ElasticJob> left(const std::vector<Job>& jobs, const ProgressOf& progress = {}, const std::map<std::string, UserLimits>& limits = {{"ann", {}}}) {
  std::map<std::uint64_t, Job> by_id;
  for (const Job& j : jobs) by_id[j.id] = j;
  return elastic_jobs(by_id, progress, limits, 4);
}

TEST(ElasticInput, PathsFollowFromTheSceneAndTheJobsSettings) {
  FrameNeeds needs{0, 0, 0, 0, 0, 10'000, 100};
  RenderSettings s;
  EXPECT_EQ(paths_of(s, needs), 1e6);
  s.spp = 4;
  EXPECT_EQ(paths_of(s, needs), 4e4);
  s.width = 20;
  s.height = 10;
  s.crop = {0, 0.5, 0.25, 0.75};
  EXPECT_EQ(paths_of(s, needs), 200);
  needs.pixels = 0;
  EXPECT_FALSE(paths_of(s, needs));
}

TEST(ElasticInput, WorkIsWhatIsLeftTimesWhatAPathHasCost) {
  Job runs = job(1, "s", 2), same = job(2, "s"), other = job(3, "t");
  runs.state = JobState::running;
  runs.frames[0].state = FrameState::running;
  runs.frames[0].usage.cpu_s = 4;
  const ProgressOf progress{{{1, 0}, {400'000, 1'000'000, {}}}};  // 10 us each
  const auto jobs = left({other, same, runs}, progress);
  ASSERT_EQ(jobs.size(), 3u);
  EXPECT_EQ(jobs[0].id, 1u) << "what runs is served first";
  EXPECT_NEAR(jobs[0].work, 6 + 10, 1e-9);
  EXPECT_TRUE(jobs[0].measured);
  EXPECT_NEAR(jobs[1].work, 10, 1e-9) << "the same scene";
  EXPECT_TRUE(jobs[1].measured);
  EXPECT_NEAR(jobs[2].work, 10, 1e-9) << "nothing better is known of another one";
  EXPECT_FALSE(jobs[2].measured);
  EXPECT_NEAR(jobs[2].most_threads, 1e6 / 16384, 1e-9);
  EXPECT_EQ(jobs[2].least_memory, 300u);
  EXPECT_EQ(jobs[2].bytes, 1000u);
  EXPECT_EQ(jobs[2].main_bytes, 100u);
  EXPECT_EQ(jobs[2].memory_part, 0.25);
}

TEST(ElasticInput, BeforeAnythingIsMeasuredItIsAGuess) {
  EXPECT_NEAR(left({job(1, "s")})[0].work, 2, 1e-9);
  Job begun = job(1, "s");
  begun.frames[0].state = FrameState::running;
  begun.frames[0].usage.cpu_s = 4;
  const auto jobs = left({begun}, {{{1, 0}, {1000, 1'000'000, {}}}});
  EXPECT_FALSE(jobs[0].measured) << "what it cost so far was loading";
  EXPECT_NEAR(jobs[0].work, 2, 0.01);
  Job unsplit = job(2, "s", 2);
  unsplit.frames[1].needs.reset();
  EXPECT_NEAR(left({unsplit})[0].work, 4, 1e-9) << "its frames are alike";
  unsplit.frames[0].needs.reset();
  EXPECT_GT(left({unsplit})[0].work, 0);
}

TEST(ElasticInput, JobsThatHaveEndedOrWaitForMoneyWantNothing) {
  std::vector<Job> jobs;
  for (const JobState state : {JobState::paused, JobState::done, JobState::failed, JobState::cancelled}) {
    jobs.push_back(job(jobs.size() + 1, "s"));
    jobs.back().state = state;
  }
  EXPECT_TRUE(left(jobs).empty());
}

TEST(ElasticInput, BudgetsAreTheJobsAndTheUsers) {
  Job a = job(1, "s"), b = job(2, "s");
  a.request.budget = 10;
  a.frames[0].usage.cost = 4;
  b.frames[0].usage.cost = 5;
  b.request.priority = 1;
  auto jobs = left({a, b});
  EXPECT_EQ(jobs[0].id, 2u) << "by priority";
  EXPECT_FALSE(jobs[0].money);
  EXPECT_EQ(jobs[0].weight, 2);
  EXPECT_EQ(jobs[1].money, 6);
  UserLimits limits;
  limits.budget = 11;
  limits.share = 3;
  jobs = left({a, b}, {}, {{"ann", limits}});
  EXPECT_EQ(jobs[0].money, 2) << "of the user's 11, 9 are spent";
  EXPECT_EQ(jobs[1].money, 2);
  EXPECT_EQ(jobs[0].weight, 6);
}

TEST(ElasticInput, HostsHoldWhatNobodyElseHolds) {
  const Json window = Json::parse(R"({"phase": "rendering", "estimated_relmse": 0.5, "paths_done": 5, "paths_total": 9, "hosts": [
    {"name": "a", "left_s": null, "parts": [0, 1, 2]}, {"name": "b", "left_s": null, "parts": [0, 2, 3, 4]}, {"name": "c", "left_s": 3.5, "parts": [1]}]})");
  const FrameProgress progress = frame_progress(window);
  EXPECT_EQ(progress.paths_total, 9);
  EXPECT_EQ(progress.phase, "rendering");
  EXPECT_EQ(progress.estimated_relmse, 0.5);
  EXPECT_EQ(progress.hosts, 2u);
  EXPECT_EQ(progress.lone_parts, (std::map<std::string, std::uint64_t>{{"a", 1}, {"b", 2}}));
  std::map<std::uint64_t, ServiceHost> hosts;
  hosts[7].name = "b";
  hosts[7].working = 3;
  hosts[8].name = "gone";
  hosts[8].here = false;
  const auto there = elastic_hosts(hosts, {{{1, 0}, progress}, {{1, 1}, progress}});
  ASSERT_EQ(there.size(), 1u);
  EXPECT_EQ(there[0].id, 7u);
  EXPECT_EQ(there[0].lone_parts, 4u);
  EXPECT_EQ(there[0].frames, 3u);
}

TEST(ElasticInput, KindsAreLearnedFromHosts) {
  std::map<std::string, HostKind> seen;
  EXPECT_EQ(host_kinds({}, {}, seen).size(), 1u) << "of any kind";
  std::map<std::uint64_t, ServiceHost> hosts;
  hosts[7].kind = "small";
  hosts[7].threads = 4;
  hosts[7].memory = 99;
  host_kinds({}, hosts, seen);
  const auto kinds = host_kinds({}, {}, seen);
  ASSERT_EQ(kinds.size(), 1u) << "known, though it has left";
  EXPECT_EQ(kinds[0].name, "small");
  EXPECT_EQ(kinds[0].threads, 4u);
  EXPECT_EQ(kinds[0].memory, 99u);
}

}  // namespace
}  // namespace cloudrenderer
