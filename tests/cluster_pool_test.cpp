// The state of a pool, and the gate of its hosts' compute threads.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <thread>

#include "cluster/compute_gate.h"
#include "cluster/meter.h"
#include "cluster/pool_core.h"
#include "cluster/usage.h"

namespace cloudrenderer {
namespace {

// A host whose threads take slots for turns of random length, in virtual time.
class GateRun {
 public:
  GateRun(unsigned slots, std::uint32_t seed) : core(slots), random_(seed) {}

  struct Job {
    GateCore::Job id;
    unsigned threads;
    double turn;  // mean seconds
    double used = 0;
  };
  std::size_t add(double weight, unsigned threads, double turn) {
    jobs.push_back({core.add(weight), threads, turn});
    for (unsigned i = 0; i < threads; ++i) core.want(jobs.back().id);
    return jobs.size() - 1;
  }
  // Everybody who is through with a turn wants the next one at once.
  void run(double seconds) {
    for (const double until = now + seconds; now < until;) {
      while (const auto id = core.next()) begin(*id);
      ASSERT_FALSE(ends_.empty());
      const auto [end, job] = *ends_.begin();
      const double turn = ends_.begin()->second.second;
      now = end;
      ends_.erase(ends_.begin());
      jobs[job.first].used += turn;
      core.done(jobs[job.first].id, turn);
      core.want(jobs[job.first].id);
    }
  }
  std::size_t running() const { return ends_.size(); }

  GateCore core;
  std::vector<Job> jobs;
  double now = 0;

 private:
  void begin(GateCore::Job id) {
    for (std::size_t i = 0; i < jobs.size(); ++i) {
      if (jobs[i].id != id) continue;
      const double turn = jobs[i].turn * std::uniform_real_distribution<>(0.5, 1.5)(random_);
      ends_.emplace(now + turn, std::pair(i, turn));
    }
  }
  std::mt19937 random_;
  std::multimap<double, std::pair<std::size_t, double>> ends_;
};

TEST(GateCore, SharesFollowWeightsWhateverTheTurnsAre) {
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    const unsigned slots = 1 + random() % 8;
    GateRun run(slots, seed);
    double weights = 0;
    std::vector<double> weight;
    for (int i = 0; i < 3; ++i) {
      weight.push_back(static_cast<double>(1 + random() % 3));
      weights += weight.back();
      run.add(weight.back(), slots, 0.01 * static_cast<double>(1 + random() % 9));
    }
    run.run(60);
    double used = 0;
    for (const auto& j : run.jobs) used += j.used;
    EXPECT_NEAR(used, 60 * slots, 2);
    for (std::size_t i = 0; i < 3; ++i)
      EXPECT_NEAR(run.jobs[i].used / used, weight[i] / weights, 0.02) << i;
  }
}

TEST(GateCore, KeepsAllSlotsBusyWhileSomebodyWaits) {
  GateRun run(4, 1);
  run.add(1000, 1, 0.05);  // as important as it is, it has one thread
  run.add(1, 8, 0.05);
  run.run(10);
  EXPECT_NEAR(run.jobs[0].used, 10, 0.2);
  EXPECT_NEAR(run.jobs[1].used, 30, 0.5);
}

TEST(GateCore, WhoWasIdleHasSavedNothingUp) {
  GateRun run(2, 2);
  const std::size_t early = run.add(1, 2, 0.02);
  const GateCore::Job sleeper = run.core.add(1);  // wants nothing yet
  run.run(30);
  run.jobs.push_back({sleeper, 2, 0.02});
  run.core.want(sleeper);
  run.core.want(sleeper);
  const double before = run.jobs[early].used;
  run.run(10);
  EXPECT_NEAR(run.jobs[early].used - before, 10, 0.4);
  EXPECT_NEAR(run.jobs[1].used, 10, 0.4);
}

TEST(GateCore, AShortWaitBetweenTurnsCostsNoShare) {
  // Of one slot: the heavy job's thread is away for a moment after every turn.
  GateCore core(1);
  const auto heavy = core.add(3), light = core.add(1);
  double used[2] = {};
  core.want(heavy);
  core.want(light);
  for (int i = 0; i < 40000; ++i) {
    const auto job = core.next();
    ASSERT_TRUE(job);
    used[*job == light] += 0.01;
    core.done(*job, 0.01);
    if (*job == light) {
      core.want(light);
      continue;
    }
    const auto other = core.next();  // meanwhile
    if (other) {
      used[1] += 0.002;
      core.done(*other, 0.002);
      core.want(light);
    }
    core.want(heavy);
  }
  EXPECT_GT(used[0] / used[1], 2.7);
}

TEST(GateCore, LoadingIsUse) {
  GateRun run(1, 3);
  run.add(1, 1, 0.01);
  run.add(1, 1, 0.01);
  run.core.charge(run.jobs[0].id, 4);
  run.run(10);
  EXPECT_NEAR(run.jobs[1].used - run.jobs[0].used, 4, 0.1);
}

TEST(GateCore, AJobThatComesBeginsWithTheOthers) {
  GateRun run(1, 4);
  run.add(1, 1, 0.01);
  run.run(20);
  run.add(1, 1, 0.01);
  run.run(2);
  EXPECT_NEAR(run.jobs[1].used, 1, 0.05);
  run.core.set_weight(run.jobs[1].id, 3);
  const double before = run.jobs[1].used;
  run.run(10);
  EXPECT_NEAR(run.jobs[1].used - before, 7.5, 0.2);
}

TEST(ComputeGate, GivesNoMoreSlotsThanThereAre) {
  ComputeGate gate(2);
  const auto a = gate.add(1), b = gate.add(2);
  std::atomic<int> inside = 0, most = 0, turns = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < 6; ++t)
    threads.emplace_back([&, t] {
      ComputeGate::Slot slot(gate, t % 2 ? a : b);
      for (int i = 0; i < 200; ++i) {
        slot.take();
        const int now = ++inside;
        for (int seen = most; now > seen && !most.compare_exchange_weak(seen, now);) {
        }
        ++turns;
        --inside;
        if (i % 7 == 0) slot.give_back();
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(turns, 1200);
  EXPECT_LE(most, 2);
  gate.remove(a);
  gate.remove(b);
}

void spin(double seconds) {
  for (const double end = thread_cpu_seconds() + seconds; thread_cpu_seconds() < end;) {
  }
}

TEST(Meter, CountsEveryThreadForItsAccountAndForeignOnesForWhoLoads) {
  Meter meter;
  Meter::Account a, b;
  const Meter::Thread own(meter, nullptr);
  std::thread([&] {
    const Meter::Thread metered(meter, &a);
    spin(0.05);
  }).join();
  EXPECT_NEAR(meter.cpu_s(a), 0.05, 0.02);
  std::thread([&] { spin(0.03); }).join();  // nobody loads: of the process
  std::thread([&] {
    const Meter::Thread metered(meter, &b);
    const Meter::Loading loading(meter, b);
    std::thread([] { spin(0.05); }).join();  // a library's
    spin(0.02);
  }).join();
  EXPECT_NEAR(meter.cpu_s(b), 0.07, 0.02);
  EXPECT_NEAR(meter.cpu_s(a), 0.05, 0.02);
}

wire::Hello hello(std::uint64_t incarnation) {
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_incarnation(incarnation);
  h.set_name("host " + std::to_string(incarnation));
  h.set_kind("small");
  h.set_threads(4);
  h.set_memory(1 << 30);
  h.set_fingerprint(99);
  return h;
}

PoolCore::Options options() {
  PoolCore::Options o;
  o.incarnation = 7;
  o.fingerprint = 99;
  return o;
}

wire::PoolStatus status(const std::string& job, double cpu_s, std::uint64_t memory = 0) {
  wire::PoolStatus s;
  s.set_cpu_s(cpu_s);
  wire::PoolUse* u = s.add_jobs();
  u->set_job(job);
  u->set_cpu_s(cpu_s);
  u->set_memory_used(memory);
  u->set_working(true);
  return s;
}

std::vector<PoolOrder> orders(const std::string& job, double weight = 1) {
  return {{job, Address::parse("127.0.0.1:77"), weight, 5}};
}

// The last orders of each host in what the core has to say.
std::map<std::uint64_t, wire::PoolOrders> sent_orders(PoolCore& core) {
  std::map<std::uint64_t, wire::PoolOrders> sent;
  for (auto& [to, m] : core.take_outbox())
    if (const auto* o = std::get_if<wire::PoolOrders>(&m)) sent[to] = *o;
  return sent;
}

TEST(PoolCore, EveryHostGetsTheOrdersThatThereAre) {
  PoolCore core(options());
  core.order(orders("a", 2));
  ASSERT_TRUE(core.join(hello(11), 1));
  const auto outbox = core.take_outbox();
  ASSERT_EQ(outbox.size(), 2u);
  EXPECT_EQ(std::get<wire::PoolWelcome>(outbox[0].second).incarnation(), 7u);
  const auto& first = std::get<wire::PoolOrders>(outbox[1].second).jobs(0);
  EXPECT_EQ(first.job(), "a");
  EXPECT_EQ(first.manager(), "127.0.0.1:77");
  EXPECT_EQ(first.weight(), 2);
  EXPECT_EQ(first.memory(), 5u);
  ASSERT_TRUE(core.join(hello(12), 2));
  core.take_outbox();
  core.order(orders("b"));
  EXPECT_EQ(sent_orders(core).size(), 2u);
  core.order(orders("b"));  // nothing new
  EXPECT_TRUE(sent_orders(core).empty());
  core.order(12, {});
  EXPECT_EQ(sent_orders(core).at(12).jobs_size(), 0);
  core.order(orders("b"));
  EXPECT_EQ(sent_orders(core).at(12).jobs_size(), 1);
  EXPECT_EQ(core.hosts().at(11).kind, "small");
  EXPECT_EQ(core.hosts().at(11).threads, 4u);
}

TEST(PoolCore, RefusesWhoCannotBelongHere) {
  PoolCore core(options());
  const auto refused = [&](auto change) {
    wire::Hello h = hello(11);
    change(h);
    return !core.join(h, 0);
  };
  EXPECT_TRUE(refused([](auto& h) { h.set_protocol(1); }));
  EXPECT_TRUE(refused([](auto& h) { h.set_incarnation(std::uint64_t{1} << 32); }));
  EXPECT_TRUE(refused([](auto& h) { h.set_threads(0); }));
  EXPECT_TRUE(refused([](auto& h) { h.set_threads(1 << 20); }));
  EXPECT_TRUE(refused([](auto& h) { h.set_memory(~std::uint64_t{0}); }));
  EXPECT_TRUE(refused([](auto& h) { h.set_fingerprint(98); }));
  EXPECT_TRUE(core.hosts().empty());
  PoolCore::Options o = options();
  o.allow_inexact = true;
  PoolCore tolerant(o);
  wire::Hello h = hello(11);
  h.set_fingerprint(0);
  EXPECT_TRUE(tolerant.join(h, 0));
}

TEST(PoolCore, RepeatedAndLateWordsOfUseDoNoHarm) {
  PoolCore core(options());
  core.order(orders("a"));
  ASSERT_TRUE(core.join(hello(11), 0));
  ASSERT_TRUE(core.join(hello(12), 0));
  core.receive(11, status("a", 3, 100), 1);
  core.receive(11, status("a", 5, 200), 2);
  core.receive(11, status("a", 5, 200), 3);
  core.receive(11, status("a", 4, 50), 4);
  core.receive(12, status("a", 2), 4);
  core.receive(99, status("a", 1000), 4);  // nobody
  EXPECT_EQ(core.usage().at("a").cpu_s, 7);
  EXPECT_EQ(core.usage().at("a").memory_used, 50u);
}

TEST(PoolCore, WhoIsSilentHasLeftAndMayComeBack) {
  PoolCore core(options());
  ASSERT_TRUE(core.join(hello(11), 0));
  ASSERT_TRUE(core.join(hello(12), 0));
  for (double t = 0.5; t < 5; t += 0.5) {
    core.receive(12, status("a", t), t);
    core.tick(t);
  }
  EXPECT_EQ(core.take_gone(), std::vector<std::uint64_t>{11});
  EXPECT_TRUE(core.hosts().at(11).left_s);
  EXPECT_FALSE(core.hosts().at(12).left_s);
  core.take_outbox();
  EXPECT_TRUE(core.join(hello(11), 6));
  EXPECT_FALSE(core.hosts().at(11).left_s);
  EXPECT_EQ(core.hosts().at(11).joined_s, 0);
  EXPECT_EQ(core.take_outbox().size(), 2u);
}

TEST(PoolCore, ItsOwnAbsenceIsNobodysSilence) {
  PoolCore core(options());
  ASSERT_TRUE(core.join(hello(11), 0));
  core.tick(0.5);
  core.tick(100);
  EXPECT_TRUE(core.take_gone().empty());
}

TEST(PoolCore, WhoLeavesIsGoneWithItsConnection) {
  PoolCore core(options());
  ASSERT_TRUE(core.join(hello(11), 0));
  core.receive(11, status("a", 2, 9), 1);
  core.receive(11, wire::Leave(), 1);
  EXPECT_TRUE(core.hosts().at(11).leaving);
  core.connection_ended(11, 2);
  EXPECT_EQ(core.hosts().at(11).left_s, 2);
  EXPECT_EQ(core.hosts().at(11).jobs.at("a").memory_used, 0u);
  EXPECT_FALSE(core.hosts().at(11).jobs.at("a").working);
}

TEST(PoolCore, HostsWithoutEndLeaveTheirSumsBehind) {
  PoolCore core(options());
  core.order(orders("a"));
  for (std::uint64_t i = 1; i <= 3000; ++i) {
    ASSERT_TRUE(core.join(hello(i), 0));
    core.receive(i, status("a", 1), 0);
    core.receive(i, wire::Leave(), 0);
    core.connection_ended(i, 0);
    core.take_outbox();
  }
  EXPECT_EQ(core.usage().at("a").cpu_s, 3000);
  EXPECT_LE(core.hosts().size(), 1100u);
}

TEST(PoolCore, AHostCannotInventJobsWithoutEnd) {
  PoolCore core(options());
  core.order(orders("real"));
  ASSERT_TRUE(core.join(hello(11), 0));
  for (int i = 0; i < 10000; ++i) core.receive(11, status("job " + std::to_string(i), 1), 0);
  core.receive(11, status("real", 5), 0);
  EXPECT_LE(core.hosts().at(11).jobs.size(), 5000u);
  EXPECT_EQ(core.usage().at("real").cpu_s, 5);
}

}  // namespace
}  // namespace cloudrenderer
