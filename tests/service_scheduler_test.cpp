// Which frame is split, started and stopped when.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "service/scheduler.h"

namespace cloudrenderer {
namespace {

using What = Scheduler::Action::What;
using How = FrameEnd::How;
constexpr std::uint64_t kGiB = std::uint64_t{1} << 30;

class Farm {
 public:
  explicit Farm(Scheduler::Options options = {}, std::map<std::string, UserLimits> users = {{"ann", {}}, {"bob", {}}, {"cy", {}}})
      : scheduler(options) {
    for (auto& [name, limits] : users) limits.priority_limit = Scheduler::kHighestPriority;
    scheduler.set_users(users);
    scheduler.set_hosts({4 * kGiB, 2 * kGiB});
  }
  std::uint64_t submit(const std::string& user, std::size_t frames = 1, int priority = 0) {
    JobRequest r;
    r.user = user;
    r.priority = priority;
    for (std::size_t i = 0; i < frames; ++i) r.files.push_back("f" + std::to_string(i));
    return submit(r);
  }
  std::uint64_t submit(const JobRequest& r) {
    const auto id = scheduler.submit(r, now);
    EXPECT_TRUE(id) << id.error();
    return *id;
  }
  // Splits end at once; what else is to be done is remembered.
  void step(double seconds = 0) {
    now += seconds;
    for (bool again = true; again;) {
      again = false;
      scheduler.tick(now);
      for (const auto& a : scheduler.take_actions()) {
        if (a.what == What::split) {
          scheduler.split_ended(a.frame, {How::done, ""}, needs, now);
          again = true;
        } else if (a.what == What::start) {
          running.insert(a.frame);
          again = true;
        } else {
          ended.push_back(a);
        }
      }
    }
  }
  void end(FrameRef ref, How how = How::done, const std::string& why = "") {
    ASSERT_EQ(running.erase(ref), 1u);
    scheduler.frame_ended(ref, {how, why}, now);
  }
  const Job& job(std::uint64_t id) { return *scheduler.find(id); }
  std::size_t running_of(const std::string& user) {
    return static_cast<std::size_t>(std::ranges::count_if(running, [&](FrameRef r) { return job(r.job).request.user == user; }));
  }

  Scheduler scheduler;
  double now = 1000;
  FrameNeeds needs{kGiB / 8, kGiB / 8, kGiB, 9, 1000};
  std::set<FrameRef> running;
  std::vector<Scheduler::Action> ended;
};

TEST(Scheduler, RendersAFrameFromSubmissionToPicture) {
  Farm farm;
  const auto id = farm.submit("ann");
  EXPECT_EQ(farm.job(id).state, JobState::checking);
  farm.step();
  EXPECT_EQ(farm.job(id).state, JobState::running);
  farm.end({id, 0});
  EXPECT_EQ(farm.job(id).state, JobState::done);
  EXPECT_FALSE(farm.scheduler.cancel(id, farm.now));
}

TEST(Scheduler, WaitsForHosts) {
  Farm farm;
  farm.scheduler.set_hosts({});
  const auto id = farm.submit("ann");
  farm.step();
  EXPECT_EQ(farm.job(id).state, JobState::queued);
  EXPECT_TRUE(farm.running.empty());
  farm.scheduler.set_hosts({kGiB});
  farm.step();
  EXPECT_EQ(farm.running.size(), 1u);
}

TEST(Scheduler, AJobThatCannotFitSaysSoWithNumbers) {
  Farm farm;
  farm.needs = {3 * kGiB, 2 * kGiB, 9 * kGiB, 5, 1};
  const auto id = farm.submit("ann");
  farm.step();
  EXPECT_EQ(farm.job(id).state, JobState::failed);
  EXPECT_NE(farm.job(id).reason.find("the main scene takes 3072 MiB, its largest part 2048 MiB"), std::string::npos) << farm.job(id).reason;
  EXPECT_NE(farm.job(id).reason.find("the largest of 2 hosts has 4096 MiB"), std::string::npos) << farm.job(id).reason;
}

TEST(Scheduler, WaitsForALargerHostThatCanBeHad) {
  Farm farm;
  farm.scheduler.set_largest_to_come(8 * kGiB);
  farm.needs = {3 * kGiB, 2 * kGiB, 9 * kGiB, 5, 1};
  const auto id = farm.submit("ann");
  farm.step();
  EXPECT_EQ(farm.job(id).state, JobState::queued);
  EXPECT_NE(farm.job(id).frames[0].reason.find("waits for a host with 5120 MiB"), std::string::npos) << farm.job(id).frames[0].reason;
  farm.scheduler.set_hosts({4 * kGiB, 8 * kGiB});
  farm.step();
  EXPECT_EQ(farm.job(id).state, JobState::running);
}

TEST(Scheduler, MemoryLimitsHowManyFramesRun) {
  Farm farm;
  farm.needs = {kGiB, kGiB, 9 * kGiB, 5, 1};  // half of the larger host
  for (const char* user : {"ann", "bob", "cy"}) farm.submit(user);
  farm.step();
  EXPECT_EQ(farm.running.size(), 2u);
  for (const auto& [ref, portion] : farm.scheduler.portions()) EXPECT_EQ(portion.memory, 0.5);
}

TEST(Scheduler, WhoHasLessOfTheirShareIsNext) {
  Farm farm({}, {{"ann", {}}, {"bob", {}}, {"cy", {2, 0, {}, 1000}}});
  for (int i = 0; i < 4; ++i)
    for (const char* user : {"ann", "bob", "cy"}) farm.submit(user);
  farm.step();
  EXPECT_EQ(farm.running_of("ann"), 1u);
  EXPECT_EQ(farm.running_of("bob"), 1u);
  EXPECT_EQ(farm.running_of("cy"), 2u);
  double ann = 0, cy = 0;
  for (const auto& [ref, portion] : farm.scheduler.portions()) {
    if (farm.job(ref.job).request.user == "ann") ann += portion.weight;
    if (farm.job(ref.job).request.user == "cy") cy += portion.weight;
  }
  EXPECT_DOUBLE_EQ(cy, 2 * ann);
}

TEST(Scheduler, APartGoesToFramesThatHostsWorkForAlready) {
  Farm farm({}, {{"ann", {}}, {"bob", {}}});
  const auto ann = farm.submit("ann", 2), bob = farm.submit("bob");
  farm.step();
  ASSERT_EQ(farm.running.size(), 3u);
  EXPECT_EQ(farm.scheduler.portions().at({ann, 0}).weight, 0.5);
  const std::set<FrameRef> at_work{{ann, 1}, {bob, 0}};
  const auto portions = farm.scheduler.portions(&at_work);
  EXPECT_EQ(portions.size(), 2u);
  EXPECT_EQ(portions.at({ann, 1}).weight, portions.at({bob, 0}).weight) << "the frame that is only starting takes nothing";
}

TEST(Scheduler, WhoHasUsedLeastLatelyIsNextAlsoAfterARestart) {
  Farm farm({.slots = 1, .half_life_s = 100});
  const auto first = farm.submit("ann");
  farm.step();
  farm.scheduler.used({first, 0}, {50, 0, 0, 0, 0, 0});
  farm.end({first, 0});
  farm.step();
  Farm next({.slots = 1, .half_life_s = 100});
  next.scheduler.restore(farm.scheduler.accounts(), farm.scheduler.next_id());
  next.now = farm.now + 100;
  next.submit("ann");
  const auto bob = next.submit("bob");
  next.step();
  EXPECT_TRUE(next.running.contains({bob, 0}));
  EXPECT_NEAR(next.scheduler.accounts().at("ann").used_lately, 25, 1e-9);
  EXPECT_GT(bob, first);
}

TEST(Scheduler, PriorityGoesFirstAndHasItsLimit) {
  Farm farm({.slots = 1});
  farm.scheduler.set_users({{"ann", {1, 2, {}, 1000}}, {"bob", {1, 0, {}, 3}}});
  const auto low = farm.submit("bob"), high = farm.submit("ann", 1, 2);
  farm.step();
  EXPECT_TRUE(farm.running.contains({high, 0}));
  JobRequest r;
  r.user = "bob";
  r.priority = 1;
  EXPECT_NE(farm.scheduler.submit(r, farm.now).error().find("priority of 0 at most"), std::string::npos);
  r.priority = 0;
  r.files = {"a"};
  farm.submit(r);
  farm.submit(r);
  EXPECT_NE(farm.scheduler.submit(r, farm.now).error().find("3 jobs"), std::string::npos);
  farm.end({high, 0});
  farm.step();
  EXPECT_TRUE(farm.running.contains({low, 0}));
}

TEST(Scheduler, APriorityCanBeChangedWhileTheJobRunsOrWaits) {
  Farm farm({.slots = 2});
  const auto first = farm.submit("ann"), second = farm.submit("bob"), third = farm.submit("cy");
  farm.step();
  const auto weight = [&](std::uint64_t job) { return farm.scheduler.portions().at({job, 0}).weight; };
  EXPECT_DOUBLE_EQ(weight(first), weight(second));
  EXPECT_EQ(farm.scheduler.set_priority(first, 2, "ann"), std::nullopt);
  EXPECT_DOUBLE_EQ(weight(first), 4 * weight(second));
  EXPECT_TRUE(farm.scheduler.take_changed().contains(first)) << "it is to be kept";
  const auto fourth = farm.submit("bob");
  EXPECT_EQ(farm.scheduler.set_priority(fourth, 1, "bob"), std::nullopt);
  farm.step();  // splits it
  farm.end({second, 0});
  farm.step();
  EXPECT_TRUE(farm.running.contains({fourth, 0}));
  EXPECT_FALSE(farm.running.contains({third, 0}));
  EXPECT_NE(farm.scheduler.set_priority(third, Scheduler::kHighestPriority + 1, "cy"), std::nullopt);
  EXPECT_NE(farm.scheduler.set_priority(third, Scheduler::kLowestPriority - 1, "cy"), std::nullopt);
  EXPECT_EQ(farm.job(third).request.priority, 0);
}

TEST(Scheduler, OfAUsersJobsTheOneWithTheNearestDeadlineIsNext) {
  Farm farm({.slots = 1});
  const auto with_deadline = [&](const std::string& user, double seconds) {
    JobRequest r;
    r.user = user;
    r.files = {"f"};
    r.deadline = Deadline{seconds, true, ""};
    return farm.submit(r);
  };
  const auto running = farm.submit("cy");
  farm.step();
  const auto none = farm.submit("ann"), late = with_deadline("ann", 500), near = with_deadline("ann", 50),
             other = with_deadline("bob", 1), urgent = farm.submit("ann", 1, 1);
  farm.step();
  std::vector<std::uint64_t> order;
  for (std::uint64_t last = running; farm.running.size() == 1;) {
    farm.end({last, 0});
    farm.step(1);
    if (farm.running.empty()) break;
    order.push_back(last = farm.running.begin()->job);
  }
  // bob's comes after ann's, who was there before: a deadline is no turn.
  EXPECT_EQ(order, (std::vector{urgent, near, late, none, other}));
}

TEST(Scheduler, OthersMakeRoomForWhoHasNothingRunning) {
  Farm farm({.slots = 2, .patience_s = 30});
  const auto a = farm.submit("ann", 2);
  farm.step();
  ASSERT_EQ(farm.running.size(), 2u);
  const auto b = farm.submit("bob");
  farm.step(1);
  farm.step(20);
  EXPECT_TRUE(farm.ended.empty());
  farm.step(15);
  ASSERT_EQ(farm.ended.size(), 1u);
  EXPECT_EQ(farm.ended[0], (Scheduler::Action{What::stop, {a, 1}}));
  farm.end({a, 1}, How::interrupted);
  farm.step();
  EXPECT_TRUE(farm.running.contains({b, 0}));
  EXPECT_EQ(farm.job(a).frames[1].state, FrameState::ready);
  EXPECT_EQ(farm.job(a).frames[1].attempts, 0u) << "it was not its fault";
  farm.end({b, 0});
  farm.step();
  EXPECT_TRUE(farm.running.contains({a, 1}));
}

TEST(Scheduler, FramesAreTriedAgainLaterAndNotForEver) {
  Farm farm({.retry_after_s = 2});
  JobRequest r;
  r.user = "ann";
  r.files = {"a"};
  r.retries = 2;
  const auto id = farm.submit(r);
  for (int attempt = 0; attempt < 3; ++attempt) {
    farm.step(0.1);
    if (attempt > 0) {
      EXPECT_TRUE(farm.running.empty()) << "at once";
    }
    farm.step(10);
    ASSERT_EQ(farm.running.size(), 1u);
    farm.end({id, 0}, How::failed, "signal 9");
  }
  EXPECT_EQ(farm.job(id).state, JobState::failed);
  EXPECT_EQ(farm.job(id).reason, "signal 9");
}

TEST(Scheduler, WhatIsHopelessIsNotTriedAgainAndOthersGoOn) {
  Farm farm;
  const auto id = farm.submit("ann", 3);
  farm.step();
  farm.end({id, 0}, How::hopeless, "a.pbrt:1:1: error: what");
  farm.step();
  farm.end({id, 1});
  farm.step();
  EXPECT_EQ(farm.job(id).state, JobState::running);
  farm.end({id, 2});
  EXPECT_EQ(farm.job(id).state, JobState::failed);
  EXPECT_EQ(farm.job(id).reason, "1 of 3 frames have failed; f0: a.pbrt:1:1: error: what");
}

TEST(Scheduler, TimeOutsKillAndCountAsTries) {
  Farm farm;
  JobRequest r;
  r.user = "ann";
  r.files = {"a"};
  r.retries = 0;
  r.timeout_s = 5;
  const auto id = farm.submit(r);
  farm.step();
  farm.step(6);
  ASSERT_EQ(farm.ended.size(), 1u);
  EXPECT_EQ(farm.ended[0].what, What::kill);
  farm.end({id, 0}, How::failed, "signal 9");
  EXPECT_EQ(farm.job(id).reason, "it took longer than 5 s");
}

TEST(Scheduler, CancelStopsAllFrames) {
  Farm farm;
  const auto id = farm.submit("ann", 5);
  farm.step();
  ASSERT_EQ(farm.running.size(), 2u);
  EXPECT_TRUE(farm.scheduler.cancel(id, farm.now));
  farm.step();
  EXPECT_EQ(farm.ended.size(), 2u);
  farm.end({id, 0}, How::interrupted);
  farm.end({id, 1}, How::failed, "killed");
  farm.step();
  EXPECT_TRUE(farm.running.empty());
  EXPECT_EQ(farm.job(id).state, JobState::cancelled);
  for (const JobFrame& f : farm.job(id).frames) EXPECT_EQ(f.state, FrameState::cancelled);
}

TEST(Scheduler, BudgetsStopOrAskAndCanBeRaised) {
  for (const bool ask : {false, true}) {
    Farm farm;
    JobRequest r;
    r.user = "ann";
    r.files = {"a", "b"};
    r.budget = 10;
    r.ask = ask;
    const auto id = farm.submit(r);
    farm.step();
    farm.scheduler.used({id, 0}, {1, 0, 0, 0, 1, 9});
    farm.step();
    EXPECT_TRUE(farm.ended.empty());
    farm.scheduler.used({id, 1}, {1, 0, 0, 0, 1, 2});
    farm.step();
    EXPECT_EQ(farm.ended.size(), 2u);
    EXPECT_EQ(farm.job(id).state, ask ? JobState::paused : JobState::failed);
    EXPECT_NE(farm.job(id).reason.find("budget of 10"), std::string::npos);
    farm.end({id, 0}, How::interrupted);
    farm.end({id, 1}, How::interrupted);
    farm.step(1);
    EXPECT_TRUE(farm.running.empty());
    EXPECT_TRUE(farm.scheduler.resume(id, 20.0));
    farm.step(1);
    EXPECT_EQ(farm.running.size(), 2u);
    farm.end({id, 0});
    farm.end({id, 1});
    EXPECT_EQ(farm.job(id).state, JobState::done);
    EXPECT_FALSE(farm.scheduler.resume(id, 30.0));
  }
}

TEST(Scheduler, ARestartGoesOnWhereItWas) {
  Farm farm;
  const auto id = farm.submit("ann", 3);
  farm.step();
  farm.end({id, 0});
  farm.step();
  Farm next;
  next.scheduler.restore(farm.job(id));
  EXPECT_EQ(next.job(id).state, JobState::queued);
  EXPECT_EQ(next.job(id).frames[1].attempts, 0u);
  next.step();
  EXPECT_TRUE(next.running.contains({id, 1}));
  EXPECT_FALSE(next.running.contains({id, 0}));
  EXPECT_GT(next.submit("bob"), id);
}

// Users with jobs of any length, priorities, failures and hosts that come and go: all jobs end, no more frames run than
// there is memory for, and each user's processor time is near the share.
TEST(Scheduler, SharesAreFairOverTime) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
    Farm farm({.slots = 4}, {{"ann", {}}, {"bob", {}}, {"cy", {2, 0, {}, 1000}}});
    std::map<FrameRef, double> left;  // processor seconds of frames
    std::map<std::string, double> used;
    std::map<std::string, std::vector<std::uint64_t>> jobs;
    double checked = 0;
    for (const char* user : {"ann", "bob", "cy"})
      for (int i = 0; i < 12; ++i) jobs[user].push_back(farm.submit(user, 1 + random() % 3));
    for (int t = 0; t < 20000; ++t) {
      farm.step(1);
      const auto portions = farm.scheduler.portions();
      double sum = 0;
      std::uint32_t slots = 0;
      for (const auto& [ref, p] : portions) sum += p.weight, slots += static_cast<std::uint32_t>(std::lround(4 * p.memory));
      ASSERT_LE(slots, 4u);
      const auto open = [&](const std::string& user) {
        return std::ranges::any_of(jobs[user], [&](std::uint64_t id) { return !is_final(farm.job(id).state); });
      };
      const bool all = open("ann") && open("bob") && open("cy");
      if (all) ++checked;
      for (const auto& [ref, p] : portions) {
        if (!farm.running.contains(ref)) continue;
        const double cpu = p.weight / sum;
        const auto [work, is_new] = left.try_emplace(ref, uniform(5, 60));
        farm.scheduler.used(ref, {cpu, 0, 0, 0, cpu, 0});
        if (all) used[farm.job(ref.job).request.user] += cpu;
        work->second -= cpu;
        if (work->second <= 0) farm.end(ref, random() % 10 == 0 ? How::failed : How::done, "chance");
      }
      for (const auto& stopped : farm.ended)
        if (farm.running.contains(stopped.frame)) farm.end(stopped.frame, How::interrupted);
      farm.ended.clear();
    }
    for (const auto& [user, ids] : jobs)
      for (const std::uint64_t id : ids) EXPECT_TRUE(is_final(farm.job(id).state)) << user;
    ASSERT_GT(checked, 300);
    EXPECT_NEAR(used["ann"] / checked, 0.25, 0.025);
    EXPECT_NEAR(used["bob"] / checked, 0.25, 0.025);
    EXPECT_NEAR(used["cy"] / checked, 0.5, 0.05);
  }
}

}  // namespace
}  // namespace cloudrenderer
