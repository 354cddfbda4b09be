// Many hosts work in teams, each of which holds the whole scene.
#include <gtest/gtest.h>

#include "tasks_manager_util.h"

namespace cloudrenderer::manager_test {
namespace {

// Six hosts in two teams of three. A host has room for three of the four parts of 100 bytes beside the main scene.
struct Teams : testing::Test {
  static ManagerOptions options() {
    ManagerOptions o;
    o.min_hosts = 6;
    o.team_hosts = 3;
    o.newcomers_wait_s = 2;
    return o;
  }
  void SetUp() override {
    for (int i = 0; i < 6; ++i) hosts.push_back(c.join(400));
    for (const HostId h : hosts) c.report_loaded(h);
    ASSERT_EQ(c.core.phase(), Phase::rendering);
    ASSERT_EQ(c.core.progress().teams, 2u);
  }
  std::set<std::uint32_t> mates(HostId h) {
    std::set<std::uint32_t> out;
    for (const auto& e : c.maps[h].hosts()) out.insert(e.host());
    return out;
  }
  std::set<std::uint32_t> held_in_map(HostId h) {
    std::set<std::uint32_t> out;
    for (const auto& holding : c.maps[h].holdings()) out.insert(holding.parts().begin(), holding.parts().end());
    return out;
  }
  // The team of the first host, and the others.
  std::pair<std::vector<HostId>, std::vector<HostId>> both() {
    std::pair<std::vector<HostId>, std::vector<HostId>> out;
    for (const HostId h : hosts) (mates(hosts[0]).contains(h.value) ? out.first : out.second).push_back(h);
    return out;
  }
  void lose(HostId h) {
    c.gone.insert(h);
    c.core.host_lost(h, c.now);
    c.listen();
  }
  void end() {
    c.work();
    c.finals();
    EXPECT_EQ(c.core.phase(), Phase::done);
    EXPECT_EQ(c.core.progress().paths_done, c.core.progress().paths_total);
  }
  Cluster c{options()};
  std::vector<HostId> hosts;
};

TEST_F(Teams, KnowOnlyEachOtherAndHoldEverything) {
  const auto [one, two] = both();
  ASSERT_EQ(one.size(), 3u);
  for (const HostId h : hosts) {
    EXPECT_EQ(mates(h).size(), 3u);
    EXPECT_TRUE(mates(h).contains(h.value));
    EXPECT_EQ(held_in_map(h), (std::set<std::uint32_t>{1, 2, 3, 4}));
    EXPECT_FALSE(c.tasks[h].empty());
  }
  for (const HostId h : two) EXPECT_EQ(mates(h), mates(two[0]));
  end();
}

TEST_F(Teams, ALostHostCostsItsOwnTeamOnly) {
  const auto [one, two] = both();
  const auto before = c.maps[two[0]].epoch();
  lose(one[0]);
  EXPECT_GT(c.maps[one[1]].generation(), 1u);
  EXPECT_EQ(mates(one[1]).size(), 2u);
  EXPECT_EQ(c.maps[two[0]].epoch(), before);
  EXPECT_EQ(c.core.progress().teams, 2u);
  end();
}

TEST_F(Teams, WhatIsLeftOfATeamThatCannotHoldTheSceneGoesToTheOther) {
  const auto [one, two] = both();
  lose(one[0]);
  lose(one[1]);
  EXPECT_EQ(c.core.progress().teams, 1u);
  EXPECT_EQ(c.core.progress().teams_ended, 1u);
  // All begin anew what was under way: numbers that each of them has not heard before.
  for (const HostId h : {one[2], two[0], two[1], two[2]}) {
    EXPECT_EQ(mates(h).size(), 4u);
    EXPECT_EQ(c.maps[h].generation(), c.maps[two[0]].generation());
    EXPECT_EQ(held_in_map(h), (std::set<std::uint32_t>{1, 2, 3, 4}));
  }
  EXPECT_GT(c.maps[two[0]].generation(), 2u);
  EXPECT_FALSE(c.tasks[one[2]].empty()) << "its tasks are still its own";
  end();
}

TEST_F(Teams, NewcomersWaitUntilTheyAreEnoughForATeam) {
  for (int i = 0; i < 6; ++i) c.join(400);  // to the teams that there are
  EXPECT_EQ(c.core.progress().teams, 2u);
  std::vector<HostId> late;
  for (int i = 0; i < 2; ++i) late.push_back(c.join(400));
  c.core.tick(c.now += 0.3);
  c.listen();
  for (const HostId h : late) EXPECT_TRUE(c.ordered[h].empty());
  late.push_back(c.join(400));
  c.core.tick(c.now += 0.3);
  for (const HostId h : late) c.report_loaded(h);
  EXPECT_EQ(c.core.progress().teams, 3u);
  for (const HostId h : late) {
    EXPECT_EQ(mates(h).size(), 3u);
    EXPECT_FALSE(c.tasks[h].empty());
  }
}

TEST_F(Teams, NewcomersThatStayFewGoToTheOthersAndCostNothing) {
  for (int i = 0; i < 6; ++i) c.join(400);
  const HostId late = c.join(400);
  for (int i = 0; i < 10; ++i) {
    c.now += 0.3;
    for (const auto& [id, report] : c.core.hosts()) c.core.receive(id, wire::Status{}, c.now);
    c.core.tick(c.now);
  }
  c.report_loaded(late);
  EXPECT_EQ(c.core.progress().teams, 2u);
  EXPECT_EQ(c.core.progress().teams_ended, 0u);
  EXPECT_TRUE(mates(late).contains(late.value));
  EXPECT_EQ(c.core.progress().generation, 1u);
}

TEST(ManagerTeams, AreAsLargeAsTheSceneNeeds) {
  ManagerOptions o;
  o.min_hosts = 12;
  o.team_hosts = 2;
  Cluster c(o);
  for (int i = 0; i < 12; ++i) c.join(200);  // one part each: a team that holds the scene twice has eight
  c.listen();
  EXPECT_EQ(c.core.progress().teams, 1u);
}

}  // namespace
}  // namespace cloudrenderer::manager_test
