#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using namespace manager_test;

TEST(ManagerCore, GoesFromGatheringToDone) {
  ManagerOptions o;
  o.min_hosts = 2;
  Cluster c(o);
  const HostId a = c.join();
  EXPECT_EQ(c.core.phase(), Phase::gathering);
  const HostId b = c.join();
  EXPECT_EQ(c.core.phase(), Phase::loading);
  c.report_loaded(a);
  c.report_loaded(b);
  EXPECT_EQ(c.core.phase(), Phase::rendering);
  EXPECT_EQ(c.maps[a].holdings_size(), 2);
  EXPECT_FALSE(c.tasks[a].empty());
  EXPECT_FALSE(c.tasks[b].empty());
  c.work();
  EXPECT_EQ(c.core.phase(), Phase::ending);
  EXPECT_EQ(c.ended.size(), 2u);
  c.finals();
  EXPECT_EQ(c.core.phase(), Phase::done);
  for (const PixelSums& p : c.core.film().sums()) {
    EXPECT_EQ(p.count, (std::array<std::uint32_t, 2>{8, 8}));
    EXPECT_TRUE(p.sum[1][2] == 24);
  }
  EXPECT_EQ(c.core.progress().paths_done, 64u * 64 * 16);
  EXPECT_EQ(c.core.take_gone().size(), 2u);
}

TEST(ManagerCore, DoesNotWaitForEverForFinalCounters) {
  Cluster c;
  c.report_loaded(c.join());
  c.work();
  EXPECT_EQ(c.core.phase(), Phase::ending);
  c.core.tick(c.now + 3.5);
  EXPECT_EQ(c.core.phase(), Phase::done);
}

TEST(ManagerCore, KeepsHostsBusyButNotMoreThanTheirCreditsTakeUp) {
  Cluster c({}, job(5, 512, 64));
  const HostId a = c.join();
  c.report_loaded(a);
  EXPECT_GE(c.outstanding_paths(a), 20000u);
  EXPECT_LE(c.outstanding_paths(a), 60000u);
}

TEST(ManagerCore, MakesTasksSmallerTowardsTheEnd) {
  Cluster c({}, job(5, 64, 64));
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  std::map<std::uint32_t, std::uint64_t> paths;  // in the order of handing out
  std::set<std::array<std::uint32_t, 3>> seen;
  const auto look = [&] {
    c.listen();
    for (const HostId h : {a, b})
      for (const auto& t : c.tasks[h]) {
        const auto& range = std::get<RendererRange>(t.payload);
        if (seen.insert({range.x0, range.y0, range.sample_begin}).second)  // not a second copy
          paths[range.task] = range.paths();
      }
  };
  for (look(); !c.tasks[a].empty() || !c.tasks[b].empty(); look()) c.work(1);
  EXPECT_EQ(c.core.phase(), Phase::ending);
  EXPECT_LE(paths.rbegin()->second * 8, paths.begin()->second);
}

TEST(ManagerCore, DropsARepeatedReply) {
  Cluster c;
  const HostId a = c.join();
  c.report_loaded(a);
  const auto t = c.tasks[a].at(0);
  c.do_task(a, t);
  const auto done = c.core.progress().paths_done;
  c.do_task(a, t);
  EXPECT_EQ(c.core.progress().paths_done, done);
  EXPECT_EQ(c.core.progress().dropped_messages, 1u);
}

TEST(ManagerCore, DropsAReplyOfSomeoneElse) {
  Cluster c;
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.do_task(b, c.tasks[a].at(0));
  EXPECT_EQ(c.core.progress().paths_done, 0u);
}

TEST(ManagerCore, GivesTheTasksOfALostHostToOthersUnderNewNumbers) {
  Cluster c;
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  std::set<std::uint32_t> old;
  for (const auto& t : c.tasks[b]) old.insert(std::get<RendererRange>(t.payload).task);
  const auto generation = c.maps[a].generation();
  c.gone.insert(b);
  c.core.host_lost(b, 1);
  c.listen();
  EXPECT_EQ(c.maps[a].generation(), generation + 1);
  EXPECT_EQ(c.maps[a].hosts_size(), 1);
  for (const auto& t : c.tasks[a])
    EXPECT_FALSE(old.contains(std::get<RendererRange>(t.payload).task));
  c.work();
  EXPECT_EQ(c.core.phase(), Phase::ending);
  for (const PixelSums& p : c.core.film().sums()) EXPECT_EQ(p.count[0] + p.count[1], 16u);
  EXPECT_TRUE(c.core.hosts().at(b).lost);
}

TEST(ManagerCore, LosesASilentHost) {
  Cluster c;
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.now = 9;
  c.core.receive(a, wire::Status(), c.now);
  c.core.tick(11);
  EXPECT_EQ(c.core.take_gone(), (std::vector<HostId>{b}));
  EXPECT_EQ(c.core.progress().hosts, 1u);
}

TEST(ManagerCore, BlamesNobodyForTheSilenceWhileItWasAwayItself) {
  Cluster c;
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.core.tick(0.5);
  c.core.tick(60);  // it was stopped for a minute
  EXPECT_EQ(c.core.progress().hosts, 2u);
  for (double t = 60; t < 64; t += 0.5) {
    c.core.receive(a, wire::Status(), t);
    c.core.tick(t);
  }
  EXPECT_EQ(c.core.take_gone(), (std::vector<HostId>{b}));
}

TEST(ManagerCore, GoesOnAtOnceWhenOneHostLessThanCopiesIsLost) {
  ManagerOptions o;
  o.min_hosts = 6;
  o.replication = 3;
  Cluster c(o, job(13, 256, 64));
  std::vector<HostId> hosts;
  for (std::uint32_t i = 0; i < o.min_hosts; ++i) hosts.push_back(c.join(1000));
  for (const HostId h : hosts) c.report_loaded(h);
  ASSERT_EQ(c.core.phase(), Phase::rendering);
  ASSERT_LT(c.ordered[hosts[0]].size(), 12u) << "a host that has everything proves nothing";
  const auto before = c.ordered;
  for (const HostId h : {hosts[1], hosts[4]}) {
    c.core.host_lost(h, 1);
    c.gone.insert(h);
  }
  c.work(50);  // no host has reported a part since
  std::set<std::uint32_t> held;
  const HostId first = hosts[0];
  for (const auto& h : c.maps[first].holdings()) held.insert(h.parts().begin(), h.parts().end());
  EXPECT_EQ(held.size(), 12u);
  EXPECT_GT(c.core.progress().paths_done, 0u);
  // Meanwhile the lost copies are made again, where there is room.
  std::map<std::uint32_t, int> copies;
  for (const HostId h : {hosts[0], hosts[2], hosts[3], hosts[5]})
    for (const std::uint32_t p : c.ordered[h]) ++copies[p];
  for (std::uint32_t p = 1; p < 13; ++p) EXPECT_GE(copies[p], 3) << "part " << p;
  EXPECT_NE(before, c.ordered);
}

TEST(ManagerCore, MakesRoomForThePartsOfALeavingHostWithoutLosingAPath) {
  ManagerOptions o;
  o.min_hosts = 3;
  Cluster c(o, job(13, 256, 64));
  const HostId a = c.join(800), b = c.join(800), d = c.join(800);  // room for seven parts of twelve
  for (const HostId h : {a, b, d}) c.report_loaded(h);
  ASSERT_EQ(c.core.phase(), Phase::rendering);
  const auto status = [&](HostId h, std::uint64_t live) {
    wire::Status s;
    s.set_epoch(c.maps[h].epoch());
    s.set_live_paths(live);
    c.core.receive(h, s, c.now);
    c.listen();
  };
  const auto before = c.ordered;
  const auto generation = c.maps[a].generation();
  const HostId going = [&] {  // whose parts the others' room is too full for
    for (const HostId h : {a, b, d}) {
      std::set<std::uint32_t> others;
      for (const HostId x : {a, b, d})
        if (x != h) others.insert(c.ordered[x].begin(), c.ordered[x].end());
      if (others.size() < 12) return h;
    }
    return HostId(0);
  }();
  ASSERT_NE(going, HostId(0)) << "every two hosts hold everything";
  c.core.receive(going, wire::Leave(), c.now);
  c.listen();
  EXPECT_TRUE(c.maps[a].pause());
  EXPECT_EQ(c.maps[a].generation(), generation);
  status(a, 0);
  status(b, 5);
  status(d, 0);
  EXPECT_TRUE(c.maps[a].pause());
  status(b, 0);
  EXPECT_FALSE(c.maps[a].pause());
  EXPECT_GT(c.maps[a].drops_size(), 0);
  EXPECT_NE(c.ordered, before);
  std::set<std::uint32_t> others;
  for (const HostId h : {a, b, d})
    if (h != going) others.insert(c.ordered[h].begin(), c.ordered[h].end());
  EXPECT_EQ(others.size(), 12u);
}

TEST(ManagerCore, LetsTheLastHostGoWithNobodyToHandOverTo) {
  Cluster c({}, job(5, 64, 64));
  const HostId a = c.join();
  c.report_loaded(a);
  c.core.receive(a, wire::Leave(), 1);
  c.work();  // what it has begun
  wire::Status idle;
  idle.set_idle(true);
  idle.set_epoch(c.maps[a].epoch());
  c.core.receive(a, idle, 2);
  c.listen();
  idle.set_epoch(c.maps[a].epoch());
  c.core.receive(a, idle, 3);
  c.listen();
  EXPECT_TRUE(c.ended.contains(a));
  EXPECT_EQ(c.core.phase(), Phase::rendering);
  const HostId b = c.join();
  c.report_loaded(b);
  c.work();
  EXPECT_EQ(c.core.phase(), Phase::ending);
}

TEST(ManagerCore, LoadsPartsWithoutAHolderElsewhere) {
  ManagerOptions o;
  o.min_hosts = 3;
  Cluster c(o, job(21));
  const HostId a = c.join(1300), b = c.join(1300), d = c.join(1300);
  for (const HostId h : {a, b, d}) c.report_loaded(h);
  ASSERT_EQ(c.core.phase(), Phase::rendering);
  const auto before = c.ordered;
  c.core.host_lost(b, 1);
  c.listen();
  std::set<std::uint32_t> held = c.ordered[a];
  held.insert(c.ordered[d].begin(), c.ordered[d].end());
  EXPECT_EQ(held.size(), 20u);
  EXPECT_NE(c.ordered[a].size() + c.ordered[d].size(), before.at(a).size() + before.at(d).size());
}

TEST(ManagerCore, PartsComeAndGoWhereTheRestCannotHoldTheScene) {
  Cluster c({}, job(21));
  const HostId a = c.join(2200), b = c.join(1300);
  c.report_loaded(a);
  c.report_loaded(b);
  ASSERT_EQ(c.core.phase(), Phase::rendering);
  EXPECT_EQ(c.maps[b].paged_size(), 0);
  c.core.host_lost(a, 1);
  c.report_loaded(b);
  EXPECT_EQ(c.core.phase(), Phase::rendering);
  // 1300: the main scene, room for a page, and eleven parts that stay.
  const int held = c.maps[b].holdings(0).parts_size();
  EXPECT_EQ(held, 11);
  EXPECT_EQ(c.maps[b].paged_size(), 20 - held);
  EXPECT_EQ(c.core.progress().paged_parts, 20u - 11u);
  // A new host takes what nobody holds; nothing in flight is lost by that.
  const auto generation = c.maps[b].generation();
  const HostId d = c.join(2200);
  c.report_loaded(d);
  EXPECT_EQ(c.maps[b].paged_size(), 0);
  EXPECT_EQ(c.maps[b].generation(), generation);
  EXPECT_EQ(c.core.progress().paged_parts, 0u);
}

TEST(ManagerCore, PagesNothingWithAHostThatCannot) {
  Cluster c({}, job(21));
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_fingerprint(1);
  h.set_memory(1300);
  h.set_threads(1);
  h.add_features("triangles");
  ASSERT_TRUE(c.core.join(h, 0));
  EXPECT_EQ(c.core.phase(), Phase::failed);
  EXPECT_NE(c.core.error().find("the parts need"), std::string::npos) << c.core.error();
}

TEST(ManagerCore, WaitsForMoreHostsWhereToldTo) {
  ManagerOptions o;
  o.wait_for_room_s = 100;
  Cluster c(o, job(21));
  const HostId a = c.join(150);  // not even one part at a time
  EXPECT_FALSE(c.core.finished());
  EXPECT_NE(c.core.waiting_for(), "");
  const HostId b = c.join(2500);
  c.report_loaded(a);
  c.report_loaded(b);
  EXPECT_EQ(c.core.phase(), Phase::rendering);
  EXPECT_EQ(c.core.waiting_for(), "");
}

TEST(ManagerCore, LetsAHostJoinInTheMiddle) {
  Cluster c;
  const HostId a = c.join();
  c.report_loaded(a);
  const auto epoch = c.maps[a].epoch();
  c.work(1);
  const HostId b = c.join();
  c.listen();
  EXPECT_EQ(c.maps[a].epoch(), epoch);
  c.report_loaded(b);
  EXPECT_EQ(c.maps[a].epoch(), epoch + 1);
  EXPECT_EQ(c.maps[a].generation(), c.maps[b].generation());
  EXPECT_EQ(c.maps[b].hosts_size(), 2);
}

TEST(ManagerCore, LetsAHostGoWhenItsWorkIsDone) {
  Cluster c({}, job(5, 256, 64));
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.core.receive(b, wire::Leave(), 1);
  c.listen();
  EXPECT_EQ(c.maps[a].holdings_size(), 1);
  const auto generation = c.maps[a].generation();
  c.work(200);
  EXPECT_FALSE(c.ended.contains(b));
  while (!c.tasks[b].empty()) {
    const auto t = c.tasks[b].front();
    c.tasks[b].erase(c.tasks[b].begin());
    c.do_task(b, t);
  }
  wire::Status idle;
  idle.set_idle(true);
  idle.set_epoch(c.maps[b].epoch());
  c.core.receive(b, idle, 2);
  c.listen();
  EXPECT_TRUE(c.ended.contains(b));
  EXPECT_EQ(c.maps[a].hosts_size(), 1);
  EXPECT_EQ(c.maps[a].generation(), generation);
  EXPECT_FALSE(c.core.hosts().at(b).lost);
}

TEST(ManagerCore, RefusesHostsThatDoNotFit) {
  ManagerOptions o;
  Cluster c(o);
  wire::Hello h;
  h.set_threads(1);
  h.set_protocol(99);
  EXPECT_FALSE(c.core.join(h, 0));
  h.set_protocol(wire::kProtocolVersion);
  h.set_memory(50);
  EXPECT_FALSE(c.core.join(h, 0));
  h.set_memory(10000);
  h.set_fingerprint(5);
  EXPECT_TRUE(c.core.join(h, 0));
  h.set_fingerprint(6);
  EXPECT_FALSE(c.core.join(h, 0));
  EXPECT_TRUE(c.core.bit_exact());
  h.set_allow_inexact(true);
  EXPECT_TRUE(c.core.join(h, 0));
  EXPECT_FALSE(c.core.bit_exact());
}

TEST(ManagerCore, RefusesHostsWithNumbersThatNoHostHas) {
  Cluster c;
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_fingerprint(1);
  h.set_threads(4);
  h.set_memory(std::uint64_t{1} << 60);
  EXPECT_NE(c.core.join(h, 0).error().find("1048576 TiB"), std::string::npos);
  h.set_memory(10000);
  for (const std::uint32_t threads : {0u, 1000000u}) {
    h.set_threads(threads);
    EXPECT_NE(c.core.join(h, 0).error().find(std::to_string(threads) + " threads"),
              std::string::npos);
  }
  h.set_threads(4);
  h.set_path_credits(~std::uint64_t{0});
  EXPECT_TRUE(c.core.join(h, 0));
}

TEST(ManagerCore, GivesUpAHostWhoseSumsCannotBe) {
  for (const std::uint32_t even : {0u, 5u}) {  // too few samples, too many
    ManagerOptions o;
    o.min_hosts = 2;
    Cluster c(o, job(1));
    const HostId a = c.join(), b = c.join();
    c.report_loaded(a);
    c.report_loaded(b);
    const auto& range = std::get<RendererRange>(c.tasks[a].at(0).payload);
    wire::RendererReply r;
    r.task = range.task;
    r.sums.resize(std::size_t{range.x1 - range.x0} * (range.y1 - range.y0));
    for (PixelSums& p : r.sums) p.count = {even, 0};
    c.core.receive(a, wire::Reply{c.tasks[a][0].id, 1, std::move(r)}, c.now);
    EXPECT_EQ(c.core.take_gone(), std::vector<HostId>{a});
    c.gone.insert(a);
    c.work();
    c.finals();
    EXPECT_EQ(c.core.phase(), Phase::done);
    for (std::uint32_t y = 0; y < 64; ++y)
      for (std::uint32_t x = 0; x < 64; ++x)
        ASSERT_EQ(c.core.film().at(x, y).count, (std::array<std::uint32_t, 2>{8, 8}));
  }
}

TEST(ManagerCore, EndsWithAReasonWhenNoHostCanStart) {
  Cluster c;
  const HostId a = c.join();
  wire::LoadReport r;
  r.set_job(1);
  r.set_error("the manifest is of another version");
  c.core.receive(a, r, 0);
  EXPECT_EQ(c.core.phase(), Phase::failed);
  EXPECT_NE(c.core.error().find("another version"), std::string::npos);
}

TEST(ManagerCore, GivesToOthersWhatAHostDeclines) {
  ManagerOptions o;
  o.min_hosts = 2;
  JobSpec spec = job();
  Cluster c(o, spec);
  std::uint64_t all = 0;
  for (const PlacementPart& p : spec.parts) all += p.bytes;
  const std::uint64_t room = spec.parts[0].bytes + (all - spec.parts[0].bytes) * 3 / 4;
  const HostId a = c.join(room), b = c.join(room);
  c.listen();
  // A part that only one of them was to have.
  std::uint32_t part = 1;
  while (part < spec.parts.size() && (!c.ordered[a].contains(part) || c.ordered[b].contains(part)))
    ++part;
  ASSERT_LT(part, spec.parts.size());
  c.ordered[a].erase(part);
  wire::LoadReport r;
  r.set_job(1);
  r.set_bytes_used(spec.parts[0].bytes);
  for (const std::uint32_t p : c.ordered[a]) r.add_loaded(p);
  r.add_declined(part);
  c.core.receive(a, r, 0);
  c.listen();
  EXPECT_FALSE(c.ordered[a].contains(part));
  EXPECT_TRUE(c.ordered[b].contains(part));
  c.report_loaded(b);
  EXPECT_EQ(c.core.phase(), Phase::rendering);
}

TEST(ManagerCore, PagesWhatNobodyHasRoomFor) {
  Cluster c;
  const HostId a = c.join();
  c.listen();
  wire::LoadReport r;
  r.set_job(1);
  for (const std::uint32_t p : c.ordered[a]) r.add_declined(p);
  c.core.receive(a, r, 0);
  c.listen();
  EXPECT_EQ(c.core.phase(), Phase::rendering);
  EXPECT_EQ(c.core.progress().paged_parts, 4u);
  // The host finds no room for one part alone.
  wire::LoadReport none;
  none.set_job(1);
  none.set_error("there is no room for part 3");
  c.core.receive(a, none, 1);
  EXPECT_EQ(c.core.phase(), Phase::failed);
  EXPECT_NE(c.core.error().find("no room for part 3"), std::string::npos);
}

TEST(ManagerCore, StopsWithWhatIsOnTheWay) {
  Cluster c({}, job(5, 256, 64));
  const HostId a = c.join();
  c.report_loaded(a);
  c.core.stop(1);
  c.work();
  EXPECT_EQ(c.core.phase(), Phase::ending);
  EXPECT_GT(c.core.progress().paths_done, 0u);
  EXPECT_LT(c.core.progress().paths_done, c.core.progress().paths_total);
}

TEST(ManagerCore, HoldsRoundsUntilTheDriverDecides) {
  ManagerOptions o;
  o.hold_rounds = true;
  o.round_samples = 4;
  Cluster c(o);
  c.report_loaded(c.join());
  c.work();
  ASSERT_TRUE(c.core.round_complete());
  EXPECT_EQ(c.core.complete_samples(), 4u);
  for (const PixelSums& p : c.core.film().sums()) EXPECT_EQ(p.count[0] + p.count[1], 4u);
  c.core.next_round(1);
  c.work();
  EXPECT_EQ(c.core.complete_samples(), 8u);
  c.core.stop(1);
  EXPECT_EQ(c.core.phase(), Phase::ending);
}

}  // namespace
}  // namespace cloudrenderer
