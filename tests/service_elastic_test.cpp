// How many hosts would help, why, and which may go.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "service/elastic.h"

namespace cloudrenderer {
namespace {

constexpr double kNow = 1.7e9;
constexpr std::uint64_t kGiB = std::uint64_t{1} << 30;
constexpr double kNever = std::numeric_limits<double>::infinity();

ElasticJob job(std::uint64_t id, double work) {
  ElasticJob j;
  j.id = id;
  j.work = work;
  j.measured = true;
  return j;
}

ElasticJob dated(std::uint64_t id, double work, double seconds) {
  ElasticJob j = job(id, work);
  j.deadline = kNow + seconds;
  return j;
}

HostKind kind(const std::string& name, std::uint32_t threads, double price = 0, std::uint64_t memory = 0) {
  HostKind k;
  k.name = name;
  k.threads = threads;
  k.price = price;
  k.memory = memory;
  return k;
}

std::vector<ElasticHost> hosts(std::size_t n, const std::string& kind = "a", std::uint32_t threads = 2, std::uint64_t first_id = 1) {
  std::vector<ElasticHost> out(n);
  for (std::size_t i = 0; i < n; ++i) out[i] = {first_id + i, kind, threads, 0, 0, 0, 0};
  return out;
}

const std::vector<HostKind> kOneKind{kind("a", 2)};

HostsWanted wanted(const std::vector<ElasticJob>& jobs, const std::vector<ElasticHost>& there = {}, const std::vector<HostKind>& kinds = kOneKind,
                   const ElasticLimits& limits = {}) {
  return hosts_wanted(jobs, kinds, there, limits, kNow);
}

std::string reasons(const HostsWanted& w) {
  std::string all;
  for (const auto& r : w.reasons) all += r.text + "\n";
  return all;
}

std::uint32_t of(const HostsWanted& w, const std::string& name) { return std::ranges::find(w.kinds, name, &HostsWanted::Kind::name)->wanted; }

#define EXPECT_SAYS(w, text) EXPECT_NE(reasons(w).find(text), std::string::npos) << reasons(w)

TEST(ElasticForecast, JobsShareWhatIsThereByWeight) {
  std::vector<ElasticJob> jobs{job(1, 30), job(2, 30)};
  jobs[1].weight = 2;
  const auto ends = forecast(jobs, {{3, 0, 0}}, 4);
  EXPECT_DOUBLE_EQ(ends[1], 15);  // at 2 of 3
  EXPECT_DOUBLE_EQ(ends[0], 20);  // all is done when all work is
}

TEST(ElasticForecast, HostsThatComeLaterHelpLater) {
  EXPECT_DOUBLE_EQ(forecast({job(1, 100)}, {{1, 0, 0}, {4, 0, 50}}, 4)[0], 60);
  EXPECT_DOUBLE_EQ(forecast({job(1, 100)}, {{1, 0, 50}}, 4)[0], 150);
  EXPECT_DOUBLE_EQ(forecast({job(1, 0)}, {{1, 0, 0}}, 4)[0], 0);
}

TEST(ElasticForecast, NobodyWaitsForWhatCannotBe) {
  std::vector<ElasticJob> jobs{job(1, 10), job(2, 10)};
  jobs[0].least_memory = 8 * kGiB;
  const auto ends = forecast(jobs, {{1, 4 * kGiB, 0}}, 1);
  EXPECT_EQ(ends[0], kNever);
  EXPECT_DOUBLE_EQ(ends[1], 10) << "it does not stand behind the one that never begins";
  EXPECT_EQ(forecast(jobs, {}, 4)[1], kNever);
}

TEST(ElasticForecast, AJobUsesNoMoreThreadsThanItHasWorkFor) {
  std::vector<ElasticJob> jobs{job(1, 10), job(2, 70)};
  jobs[0].most_threads = 1;
  const auto ends = forecast(jobs, {{8, 0, 0}}, 4);
  EXPECT_DOUBLE_EQ(ends[0], 10);
  EXPECT_DOUBLE_EQ(ends[1], 10) << "what one leaves the other has";
}

TEST(ElasticForecast, OnlySoManyAreServedAtOnce) {
  const std::vector<ElasticJob> jobs{job(1, 10), job(2, 10), job(3, 10)};
  const auto ends = forecast(jobs, {{1, 0, 0}}, 2);
  EXPECT_DOUBLE_EQ(ends[0], 20);
  EXPECT_DOUBLE_EQ(ends[2], 30);
}

TEST(Elastic, NothingToDoWantsTheLeast) {
  const HostsWanted none = wanted({});
  EXPECT_EQ(none.wanted(), 0u);
  EXPECT_SAYS(none, "nothing to do");
  ElasticLimits limits;
  limits.least = 2;
  const HostsWanted two = wanted({}, hosts(5), kOneKind, limits);
  EXPECT_EQ(two.wanted(), 2u);
  EXPECT_EQ(two.there(), 5u);
  EXPECT_EQ(two.surplus.size(), 3u);
  EXPECT_SAYS(two, "2 hosts are kept always");
}

TEST(Elastic, ABurstGetsAsManyHostsAsAreWorthStarting) {
  // 240 s for each of the 2 threads of a host.
  EXPECT_EQ(wanted({job(1, 1)}).wanted(), 1u) << "a job needs a host, however small it is";
  EXPECT_EQ(wanted({job(1, 2 * 240 * 3)}).wanted(), 3u);
  EXPECT_EQ(wanted({job(1, 2 * 240), job(2, 2 * 240), job(3, 2 * 240)}).wanted(), 3u);
  ElasticLimits limits;
  limits.most = 6;
  const HostsWanted w = wanted({job(1, 1e6)}, hosts(1), kOneKind, limits);
  EXPECT_EQ(w.wanted(), 6u);
  EXPECT_SAYS(w, "job 1 has 1000000 s of processors to do: 83333 s for each thread of 6 hosts");
  EXPECT_SAYS(w, "no more than 6 hosts are allowed");
}

TEST(Elastic, WhoIsThereHelpsToTheEndOfTheWork) {
  EXPECT_EQ(wanted({job(1, 5)}, hosts(4)).wanted(), 4u) << "to start one would not be worth it, to end one neither";
  ElasticJob few = job(1, 5);
  few.most_threads = 3;
  EXPECT_EQ(wanted({few}, hosts(4)).wanted(), 2u) << "but a job of three pieces of work keeps only three threads busy";
  EXPECT_EQ(wanted({few}).wanted(), 1u);
  few.work = 1e6;
  EXPECT_EQ(wanted({few}).wanted(), 2u);
}

TEST(Elastic, ADeadlineWantsTheFewestThatMakeIt) {
  // 1800 s of work in 900 s (810 with the margin), of which 60 pass before a new host helps.
  const HostsWanted w = wanted({dated(7, 1800, 900)});
  EXPECT_EQ(w.wanted(), 2u);  // one: 60 + 900
  EXPECT_EQ(wanted({dated(7, 1800, 90000)}).wanted(), 1u);
  EXPECT_SAYS(wanted({dated(7, 1800, 90000)}), "job 7 cannot begin with 0 hosts");
  EXPECT_SAYS(wanted({dated(7, 1800, 90000)}, hosts(2)), "job 7 meets its deadline with 89100 s to spare with 1 host");
  EXPECT_EQ(wanted({dated(7, 1800, 300)}).wanted(), 5u);  // 60 + 1800 / 10 = 240 < 270
  const HostsWanted there = wanted({dated(7, 1800, 780)}, hosts(1));
  EXPECT_EQ(there.wanted(), 2u);
  EXPECT_SAYS(there, "job 7 misses its deadline by 120 s with 1 host\n");
  ASSERT_EQ(there.jobs.size(), 1u);
  EXPECT_EQ(there.jobs[0].ends, kNow + 900);
  EXPECT_EQ(there.jobs[0].ends_then, kNow + 60 + (1800 - 120) / 4);
  EXPECT_EQ(wanted({dated(7, 1800, 90000)}, hosts(4)).surplus.size(), 3u) << "in time is enough";
}

TEST(Elastic, ADeadlineThatCannotBeMetSaysSo) {
  ElasticLimits limits;
  limits.most = 3;
  const HostsWanted w = wanted({dated(7, 6000, 300)}, {}, kOneKind, limits);
  EXPECT_EQ(w.wanted(), 3u);
  EXPECT_SAYS(w, "job 7 misses its deadline by 760 s even with 3 hosts");
  EXPECT_SAYS(w, "no more than 3 hosts are allowed");
  // No more than have as much to do as their start takes.
  const HostsWanted past = wanted({dated(7, 1200, -5)});
  EXPECT_EQ(past.wanted(), 10u);
  EXPECT_SAYS(past, "job 7 misses its deadline by");
  EXPECT_EQ(wanted({dated(7, 100, -5)}, hosts(3)).wanted(), 3u);
}

TEST(Elastic, ADeadlineBehindOtherJobsWantsHostsForThemAll) {
  ElasticLimits limits;
  limits.jobs_at_once = 1;
  limits.worth_s = 1e6;
  const std::vector<ElasticJob> jobs{job(1, 1800), dated(2, 10, 600)};
  EXPECT_EQ(wanted(jobs, {}, kOneKind, limits).wanted(), 2u);
  EXPECT_EQ(wanted({jobs[1]}, {}, kOneKind, limits).wanted(), 1u);
}

TEST(Elastic, ABudgetBuysProcessorTime) {
  const std::vector<HostKind> priced{kind("a", 2, 7.2)};  // 0.001 for a second of a thread
  ElasticJob j = job(3, 2 * 240 * 10);
  EXPECT_EQ(wanted({j}, {}, priced).wanted(), 10u);
  j.money = 1.5;
  const HostsWanted w = wanted({j}, {}, priced);
  EXPECT_EQ(w.wanted(), 3u);
  EXPECT_SAYS(w, "the budget of job 3 pays for 1500 of the 4800 s of processors that it has left");
  j.money = 100;
  EXPECT_EQ(wanted({j}, {}, priced).wanted(), 10u);
  j.money = -1;
  EXPECT_EQ(wanted({j}, {}, priced).wanted(), 0u);
  EXPECT_EQ(wanted({j}, {}).wanted(), 10u) << "hosts cost nothing";
}

TEST(Elastic, ASceneThatDoesNotFitWantsHostsForItsMemory) {
  const std::vector<HostKind> kinds{kind("a", 2, 1, 4 * kGiB)};
  ElasticJob j = job(5, 1);
  j.main_bytes = kGiB / 2;
  j.bytes = j.main_bytes + 10 * kGiB;
  j.least_memory = kGiB;
  const HostsWanted w = wanted({j}, {}, kinds);
  EXPECT_EQ(w.wanted(), 3u);  // 3.5 GiB of parts each
  EXPECT_SAYS(w, "job 5 needs 3 hosts for its 10.5 GiB of parts");
  std::vector<ElasticHost> there = hosts(3);
  for (ElasticHost& h : there) h.memory = 4 * kGiB;
  EXPECT_EQ(wanted({j}, there, kinds).wanted(), 3u);
  j.memory_part = 0.25;  // of a host: 512 MiB beside the main scene, by what is needed at least
  EXPECT_EQ(wanted({j}, {}, kinds).wanted(), 20u);
  // A host that can hold its main scene and its largest part.
  j.memory_part = 1;
  j.least_memory = 6 * kGiB;
  EXPECT_EQ(wanted({j}, {}, kinds).wanted(), 0u);
  EXPECT_SAYS(wanted({j}, {}, kinds), "job 5 needs a host with 6144 MiB of memory; none that is allowed has it");
  const HostsWanted larger = wanted({j}, {}, {kinds[0], kind("big", 2, 3, 16 * kGiB)});
  EXPECT_EQ(of(larger, "big"), 1u);
  EXPECT_EQ(of(larger, "a"), 0u);
  EXPECT_SAYS(larger, "job 5 needs a host with 6144 MiB of memory");
}

TEST(Elastic, TheCheapestKindIsTakenAsFarAsItGoes) {
  std::vector<HostKind> kinds{kind("dear", 4, 4), kind("cheap", 2, 1), kind("fast", 2, 1.5)};
  kinds[1].most = 2;
  kinds[2].speed = 2;  // 0.375 for what costs 0.5 with the cheap one
  kinds[2].most = 1;
  const HostsWanted w = wanted({job(1, 240 * 16)}, {}, kinds);
  EXPECT_EQ(of(w, "fast"), 1u);
  EXPECT_EQ(of(w, "cheap"), 2u);
  EXPECT_EQ(of(w, "dear"), 2u);
  kinds[0].most = 0;
  const HostsWanted less = wanted({job(1, 240 * 16)}, {}, kinds);
  EXPECT_EQ(less.wanted(), 3u);
  EXPECT_SAYS(less, "no more of their kinds are allowed");
  kinds[0].least = 1;
  kinds[0].most = 1;
  EXPECT_EQ(of(wanted({}, {}, kinds), "dear"), 1u);
}

TEST(Elastic, WhoseLeavingCostsLeastMayGoFirst) {
  std::vector<ElasticHost> there = hosts(5);
  there[0].lone_parts = 1;
  there[1].frames = 1;
  there[2].loaded = 100;
  there[4].kind = "dear";
  const std::vector<HostKind> kinds{kind("a", 2, 1), kind("dear", 2, 2)};
  EXPECT_EQ(wanted({}, there, kinds).surplus, (std::vector<std::uint64_t>{5, 4, 3, 2, 1}));
  ElasticLimits limits;
  limits.least = 3;
  EXPECT_EQ(wanted({}, there, kinds, limits).surplus, (std::vector<std::uint64_t>{5, 4}));
}

TEST(Elastic, HostsOfKindsThatCannotBeHadAreUsedButNotAskedFor) {
  const HostsWanted w = wanted({job(1, 240 * 2 * 3)}, hosts(2, "old"));
  EXPECT_EQ(of(w, "old"), 2u);
  EXPECT_EQ(of(w, "a"), 1u);
  EXPECT_EQ(wanted({job(1, 1e6)}, hosts(2, "old"), {}).wanted(), 2u);
  EXPECT_EQ(wanted({job(1, 1e6)}, {}, {}).wanted(), 0u);
}

TEST(Elastic, KeepsToItsLimitsWhateverIsAsked) {
  std::mt19937_64 random(20);
  const auto number = [&](double most) { return std::uniform_real_distribution(0.0, most)(random); };
  const auto whole = [&](std::uint64_t most) { return std::uniform_int_distribution<std::uint64_t>(0, most)(random); };
  const auto any_work = [&]() { return std::array{0.0, -1.0, 1e-300, number(1e4), 1e300, kNever, std::nan("")}[whole(6)]; };
  for (int trial = 0; trial < 3000; ++trial) {
    SCOPED_TRACE(trial);
    ElasticLimits limits;
    limits.most = static_cast<std::uint32_t>(whole(30));
    limits.least = static_cast<std::uint32_t>(whole(5));
    limits.start_s = whole(3) == 0 ? 0 : number(100);
    limits.worth_s = whole(3) == 0 ? 0 : number(100);
    limits.jobs_at_once = static_cast<std::uint32_t>(1 + whole(4));
    std::vector<HostKind> kinds;
    for (std::uint64_t i = whole(3); i-- > 0;) {
      kinds.push_back(kind(std::string(1, static_cast<char>('a' + i)), static_cast<std::uint32_t>(whole(8)), whole(2) == 0 ? 0 : number(9), whole(8) * kGiB));
      kinds.back().speed = number(2);
      kinds.back().most = static_cast<std::uint32_t>(whole(20));
      kinds.back().least = static_cast<std::uint32_t>(whole(2));
    }
    std::vector<ElasticHost> there;
    for (std::uint64_t i = whole(12); i-- > 0;)
      there.push_back({i + 1, std::string(1, static_cast<char>('a' + whole(3))), static_cast<std::uint32_t>(whole(8)), whole(8) * kGiB, whole(1), whole(2), whole(100)});
    std::vector<ElasticJob> jobs;
    for (std::uint64_t i = whole(6); i-- > 0;) {
      jobs.push_back(job(i + 1, any_work()));
      jobs.back().weight = number(3) - 1;
      if (whole(1) == 0) jobs.back().deadline = kNow + any_work() * (whole(1) == 0 ? 1 : -1);
      if (whole(2) == 0) jobs.back().money = any_work();
      if (whole(1) == 0) jobs.back().most_threads = number(50);
      jobs.back().least_memory = whole(9) * kGiB;
      jobs.back().main_bytes = whole(4) * kGiB;
      jobs.back().bytes = whole(1) == 0 ? whole(40) * kGiB : std::numeric_limits<std::uint64_t>::max();
      jobs.back().memory_part = number(1);
    }
    const HostsWanted w = hosts_wanted(jobs, kinds, there, limits, kNow);
    EXPECT_LE(w.wanted(), limits.most);
    EXPECT_EQ(w.there(), there.size());
    std::map<std::string, std::uint32_t> kept;
    for (const ElasticHost& h : there) ++kept[h.kind];
    for (const std::uint64_t id : w.surplus) --kept[std::ranges::find(there, id, &ElasticHost::id)->kind];
    for (const auto& k : w.kinds) {
      EXPECT_LE(kept[k.name], k.wanted);
      const auto known = std::ranges::find(kinds, k.name, &HostKind::name);
      EXPECT_LE(k.wanted, known == kinds.end() ? there.size() : known->most);
    }
    EXPECT_FALSE(w.reasons.empty() && w.wanted() > 0);
    EXPECT_EQ(w.jobs.size(), jobs.size());
    for (const auto& f : w.jobs) EXPECT_FALSE(f.ends && !(*f.ends >= kNow)) << *f.ends;
  }
}

TEST(Elastic, ThousandsOfJobsAreNoWork) {
  std::vector<ElasticJob> jobs;
  for (std::uint64_t i = 0; i < 5000; ++i) jobs.push_back(i % 2 == 0 ? job(i, 100) : dated(i, 100, 1e5));
  ElasticLimits limits;
  limits.most = 10000;
  const HostsWanted w = wanted(jobs, hosts(1000), kOneKind, limits);
  EXPECT_GT(w.wanted(), 500u);
  EXPECT_LE(w.wanted(), 1042u);
}

HostsWanted said(std::uint32_t n, const std::vector<ElasticHost>& there) {
  HostsWanted w;
  w.kinds.push_back({"a", n, static_cast<std::uint32_t>(there.size()), 0});
  for (std::size_t i = n; i < there.size(); ++i) w.surplus.push_back(there[i].id);
  return w;
}

TEST(SteadyHosts, LetsHostsGoOnlyWhenTheyHaveBeenIdleForLong) {
  ElasticLimits limits;
  limits.idle_s = 100;
  SteadyHosts steady(limits);
  const auto settle = [&](std::uint32_t n, std::size_t there, double at) { return steady.settle(said(n, hosts(there)), hosts(there), at); };
  EXPECT_EQ(settle(1, 1, 0).wanted(), 1u);
  EXPECT_EQ(settle(6, 1, 10).wanted(), 6u) << "up at once";
  EXPECT_EQ(settle(6, 6, 20).wanted(), 6u);
  const HostsWanted kept = settle(1, 6, 30);
  EXPECT_EQ(kept.wanted(), 6u);
  EXPECT_TRUE(kept.surplus.empty());
  EXPECT_SAYS(kept, "5 more are kept until 100 s after they were last wanted");
  EXPECT_EQ(settle(4, 6, 60).wanted(), 6u);
  EXPECT_EQ(settle(1, 6, 119).wanted(), 6u);
  const HostsWanted less = settle(1, 6, 121);
  EXPECT_EQ(less.wanted(), 4u) << "four were wanted since";
  EXPECT_EQ(less.surplus, (std::vector<std::uint64_t>{2, 3}));
  EXPECT_EQ(settle(1, 4, 161).wanted(), 1u);
  EXPECT_EQ(settle(0, 1, 162).wanted(), 1u);
  EXPECT_EQ(settle(0, 1, 263).wanted(), 0u);
}

TEST(SteadyHosts, BeginsWithWhatIsThereAndKeepsUpNothingThatHasNotCome) {
  ElasticLimits limits;
  limits.idle_s = 100;
  SteadyHosts steady(limits);
  const auto settle = [&](std::uint32_t n, std::size_t there, double at) { return steady.settle(said(n, hosts(there)), hosts(there), at).wanted(); };
  EXPECT_EQ(settle(0, 0, 0), 0u);
  EXPECT_EQ(settle(0, 3, 1), 3u) << "they come back to a service that was started again, which ends none at once";
  EXPECT_EQ(settle(9, 3, 10), 9u);
  EXPECT_EQ(settle(2, 4, 20), 4u) << "the other five were never there";
  EXPECT_EQ(settle(2, 4, 5), 4u) << "a clock that goes back does no harm";
  EXPECT_EQ(settle(2, 4, 106), 2u);
}

}  // namespace
}  // namespace cloudrenderer
