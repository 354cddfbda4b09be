// How often rays come to parts is said, and decides what hosts are told to load.
#include <gtest/gtest.h>

#include <numeric>

#include "tasks_manager_util.h"
#include "tasks_support.h"

namespace cloudrenderer::manager_test {
namespace {

// A status that says how often rays came to parts.
wire::Status visited(const std::vector<std::uint64_t>& by_part, double load_s = 0) {
  wire::Status s;
  for (std::uint32_t p = 0; p < by_part.size(); ++p) {
    s.add_visited(p);
    s.add_rays(by_part[p]);
  }
  s.set_load_s(load_s);
  return s;
}

// The order in which a host was told to load parts since the last call.
std::vector<std::uint32_t> told_to_load(Cluster& c, HostId host) {
  std::vector<std::uint32_t> order;
  for (const auto& [to, m] : c.core.take_outbox())
    if (const auto* load = std::get_if<wire::LoadParts>(&m); load && to == host)
      order.insert(order.end(), load->parts().begin(), load->parts().end());
  return order;
}

// Two hosts, each with two of four parts of 100 bytes, and the main scene of 100.
struct Counted : testing::Test {
  void SetUp() override {
    for (const HostId h : {c.join(300), c.join(300)}) hosts.push_back(h);
    for (const HostId h : hosts) c.report_loaded(h);
    ASSERT_EQ(c.ordered[hosts[0]].size(), 2u);
    ASSERT_EQ(c.ordered[hosts[1]].size(), 2u);
  }
  static ManagerOptions options() {
    ManagerOptions o;
    o.min_hosts = 2;
    return o;
  }
  Cluster c{options()};
  std::vector<HostId> hosts;
};

TEST_F(Counted, ANewHostGetsThePartsThatRaysVisitMost) {
  c.core.receive(hosts[0], visited({0, 10, 20'000'000, 0, 10}), c.now);
  c.core.receive(hosts[1], visited({0, 0, 10, 30'000'000, 0}), c.now);
  c.listen();
  const HostId late = c.join(300);
  EXPECT_EQ(told_to_load(c, late), (std::vector<std::uint32_t>{3, 2}));
}

TEST_F(Counted, WhatRelievesTheBusiestHostIsLoadedFirst) {
  const std::vector<std::uint64_t> alike(5, 1'000'000);
  for (const std::size_t busy : {0, 1}) {
    c.core.receive(hosts[busy], visited(alike, 20), c.now);
    c.core.receive(hosts[1 - busy], visited(alike, 0.01), c.now);
    c.listen();
    const HostId late = c.join(500);
    const auto order = told_to_load(c, late);
    ASSERT_EQ(order.size(), 4u);
    EXPECT_EQ(std::set(order.begin(), order.begin() + 2), c.ordered[hosts[busy]]);
    c.core.host_lost(late, c.now);
    c.listen();
  }
}

TEST_F(Counted, ALostHostHasCountedToo) {
  c.core.receive(hosts[0], visited({0, 10, 10, 20'000'000, 10}), c.now);
  c.core.receive(hosts[1], visited({0, 10, 10, 10, 10}), c.now);
  c.listen();
  const HostId late = c.join(500);
  c.report_loaded(late);
  c.core.host_lost(hosts[0], c.now);
  c.listen();
  EXPECT_EQ(told_to_load(c, c.join(200)), std::vector<std::uint32_t>{3});
}

TEST_F(Counted, VisitsOfPartsThatThereAreNotAreIgnored) {
  c.core.receive(hosts[0], visited({0, 0, 0, 0, 0, 1'000'000'000}), c.now);
  c.core.receive(hosts[0], visited({1'000'000'000}), c.now);
  EXPECT_FALSE(c.core.finished());
}

TEST(WorkerCore, SaysHowOftenRaysCameToItsParts) {
  TestHost h(1);
  std::vector<std::uint32_t> all;
  for (std::uint32_t p = 1; p < TestHost::kParts; ++p) all.push_back(p);
  h.start(all, map_of(1, 1, TestHost::kParts, {{1, all}}));
  const auto said = [&] {
    h.tick_later(10);
    std::vector<std::uint64_t> visits;
    for (const auto& [to, s] : only<wire::Status>(h.core.take_outbox()))
      for (int i = 0; i < s.visited_size(); ++i) {
        EXPECT_LT(s.visited(i), TestHost::kParts);
        EXPECT_GT(s.rays(i), 0u);
        visits.push_back(s.rays(i));
      }
    return visits;
  };
  EXPECT_TRUE(said().empty());
  h.give_range(1);
  h.run();
  const auto visits = said();
  ASSERT_FALSE(visits.empty());
  const auto rays = h.core.status().counters().camera() + h.core.status().counters().bounce();
  EXPECT_GT(std::accumulate(visits.begin(), visits.end(), std::uint64_t{0}), rays / 4);
  EXPECT_LE(std::accumulate(visits.begin(), visits.end(), std::uint64_t{0}), rays);
  EXPECT_TRUE(said().empty()) << "nothing has changed";
}

}  // namespace
}  // namespace cloudrenderer::manager_test
