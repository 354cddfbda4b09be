// Parts that a host drops before the frame begins, and gets again.
#include <algorithm>

#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using namespace manager_test;

// What a host has loaded by an order before the drop is gone after it, though the part is ordered
// again.
TEST(ManagerCore, ReportsOfBeforeADropAreNotThoseOfTheNextOrder) {
  ManagerOptions o;
  o.min_hosts = 2;
  Cluster c(o);
  const HostId a = c.join(400), b = c.join(400);  // the main scene and three of four parts
  c.listen();
  const auto only_a =
      std::ranges::find_if(c.ordered[a], [&](auto p) { return !c.ordered[b].contains(p); });
  ASSERT_NE(only_a, c.ordered[a].end());
  const auto report = [&](HostId h, std::vector<std::uint32_t> loaded,
                          std::vector<std::uint32_t> declined,
                          std::vector<std::uint32_t> unloaded) {
    wire::LoadReport r;
    r.set_job(1);
    r.set_bytes_used(100);
    r.mutable_loaded()->Add(loaded.begin(), loaded.end());
    r.mutable_declined()->Add(declined.begin(), declined.end());
    r.mutable_unloaded()->Add(unloaded.begin(), unloaded.end());
    c.core.receive(h, r, 0);
    c.listen();
  };
  const std::set<std::uint32_t> first = c.ordered[b];
  report(a, {}, {*only_a}, {});  // so b must have it, and drops what a will have
  ASSERT_FALSE(c.dropped[b].empty());
  const std::uint32_t part = c.dropped[b][0];
  ASSERT_TRUE(first.contains(part));
  c.ordered[b].clear();
  report(a, {}, {part}, {});  // so b gets it again
  ASSERT_TRUE(c.ordered[b].contains(part));
  std::vector<std::uint32_t> rest;
  for (std::uint32_t p = 1; p < 5; ++p)
    if (p != part) rest.push_back(p);
  report(a, rest, {}, {});
  report(b, {part}, {}, {});  // by the first order
  for (const std::uint32_t p : c.dropped[b]) report(b, {}, {}, {p});
  report(b, rest, {}, {});
  EXPECT_EQ(c.core.phase(), Phase::loading);
  report(b, {part}, {}, {});
  EXPECT_EQ(c.core.phase(), Phase::rendering);
}

}  // namespace
}  // namespace cloudrenderer
