// The end of a frame: second copies of the last tasks.
#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using namespace manager_test;

const RendererRange& range_of(const wire::SubmitTask& t) {
  return std::get<RendererRange>(t.payload);
}

bool same_range(const RendererRange& a, const RendererRange& b) {
  return a.x0 == b.x0 && a.y0 == b.y0 && a.x1 == b.x1 && a.y1 == b.y1 &&
         a.sample_begin == b.sample_begin && a.sample_end == b.sample_end;
}

// Two hosts of which the second does nothing, until the first has got a copy of its last task.
struct AtTheEnd : testing::Test {
  void SetUp() override {
    a = c.join();
    b = c.join();
    c.report_loaded(a);
    c.report_loaded(b);
    while (!found() && !c.tasks[a].empty()) {
      c.now += 0.01;
      const auto t = c.tasks[a].front();
      c.tasks[a].erase(c.tasks[a].begin());
      c.do_task(a, t);
      c.listen();
    }
    ASSERT_TRUE(found());
  }
  bool found() {
    for (const auto& mine : c.tasks[a])
      for (const auto& other : c.tasks[b])
        if (same_range(range_of(mine), range_of(other))) {
          copy = mine;
          original = other;
          return true;
        }
    return false;
  }
  void expect_complete() {
    c.work();
    EXPECT_EQ(c.core.phase(), Phase::ending);
    EXPECT_EQ(c.core.progress().paths_done, c.core.progress().paths_total);
    for (const PixelSums& p : c.core.film().sums()) EXPECT_EQ(p.count[0] + p.count[1], 16u);
  }

  Cluster c;
  HostId a, b;
  wire::SubmitTask copy, original;
};

TEST_F(AtTheEnd, AnIdleHostGetsTheLastTaskOfTheLongestQueueUnderAnotherNumber) {
  EXPECT_NE(range_of(copy).task, range_of(original).task);
  EXPECT_EQ(range_of(original).task, range_of(c.tasks[b].back()).task);
  EXPECT_EQ(c.tasks[a].size(), 1u) << "no more than one at a time";
}

TEST_F(AtTheEnd, TheFirstReplyCountsAndTheOtherHostIsToldSo) {
  const auto before = c.core.progress().paths_done;
  c.do_task(a, copy);
  c.listen();
  EXPECT_EQ(c.core.progress().paths_done, before + range_of(copy).paths());
  EXPECT_TRUE(c.cancelled[b].contains(range_of(original).task));
  EXPECT_TRUE(c.cancelled[a].empty());
  const auto dropped = c.core.progress().dropped_messages;
  c.do_task(b, original);  // it was on its way
  EXPECT_EQ(c.core.progress().paths_done, before + range_of(copy).paths());
  EXPECT_EQ(c.core.progress().dropped_messages, dropped + 1);
  expect_complete();
}

TEST_F(AtTheEnd, TheHostThatHadItFirstMayWinToo) {
  c.do_task(b, original);
  c.listen();
  EXPECT_TRUE(c.cancelled[a].contains(range_of(copy).task));
  expect_complete();
}

TEST_F(AtTheEnd, WhenAHostIsLostTheOtherCopyIsEnough) {
  c.gone.insert(b);
  c.core.host_lost(b, c.now);
  c.listen();
  std::size_t copies = 0;
  for (const auto& t : c.tasks[a]) copies += same_range(range_of(t), range_of(copy)) ? 1u : 0u;
  EXPECT_EQ(copies, 1u);
  expect_complete();
}

TEST_F(AtTheEnd, ALostCopyLeavesTheOriginal) {
  c.gone.insert(a);
  c.core.host_lost(a, c.now);
  expect_complete();
}

TEST(ManagerCore, SharesOutTheRestBySpeed) {
  Cluster c({}, job(5, 256, 64));
  const HostId fast = c.join(), slow = c.join();
  c.report_loaded(fast);
  c.report_loaded(slow);
  for (int i = 0; i < 40; ++i) {  // four tasks against one
    c.now += 0.25;
    for (const HostId h : {fast, slow}) {
      if (h == slow && i % 4 != 0) continue;
      const auto t = c.tasks[h].front();
      c.tasks[h].erase(c.tasks[h].begin());
      c.do_task(h, t);
    }
    c.listen();
  }
  ASSERT_LT(c.core.progress().paths_done, c.core.progress().paths_total * 7 / 10);
  std::uint64_t most = 0;
  for (int i = 0; i < 400 &&
                  c.core.progress().paths_done < c.core.progress().paths_total * 49 / 50; ++i) {
    c.now += 0.25;
    const auto t = c.tasks[fast].front();
    c.tasks[fast].erase(c.tasks[fast].begin());
    c.do_task(fast, t);
    if (i % 4 == 0) {
      const auto s = c.tasks[slow].front();
      c.tasks[slow].erase(c.tasks[slow].begin());
      c.do_task(slow, s);
    }
    c.listen();
    most = c.outstanding_paths(slow);
  }
  EXPECT_LT(most * 2, c.outstanding_paths(fast));
}

}  // namespace
}  // namespace cloudrenderer
