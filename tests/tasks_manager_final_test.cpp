// What hosts have counted when they leave a job is in its report.
#include "tasks_manager_util.h"

namespace cloudrenderer::manager_test {
namespace {

using Phase = ManagerCore::Phase;

wire::Status final_status(std::uint64_t bytes) {
  wire::Status s;
  s.set_final(true);
  s.mutable_counters()->set_bytes_sent(bytes);
  return s;
}

// A job of two hosts, one of which has just been told that it may go.
struct Departure : Cluster {
  Departure() : Cluster({}, job(5, 256, 64)), stays(join()), goes(join()) {
    report_loaded(stays);
    report_loaded(goes);
    core.receive(goes, wire::Leave(), now);
    listen();
    work(200);
    while (!tasks[goes].empty()) {
      const auto t = tasks[goes].front();
      tasks[goes].erase(tasks[goes].begin());
      do_task(goes, t);
    }
    wire::Status idle;
    idle.set_idle(true);
    idle.set_epoch(maps[goes].epoch());
    idle.mutable_counters()->set_bytes_sent(7);
    core.receive(goes, idle, now);
    listen();
    EXPECT_TRUE(ended.contains(goes));
    EXPECT_EQ(maps[stays].hosts_size(), 1);
    tasks.erase(goes);
    ended.erase(goes);
  }

  std::uint64_t reported() const { return core.hosts().at(goes).last.counters().bytes_sent(); }

  HostId stays, goes;
};

TEST(FinalCounters, OfAHostThatHasLeftAreWaitedFor) {
  Departure d;
  EXPECT_TRUE(d.core.take_gone().empty()) << "its connection would be closed before it has said what it counted";
  EXPECT_EQ(d.reported(), 7u);
  d.core.receive(d.goes, final_status(1000), d.now);
  EXPECT_EQ(d.reported(), 1000u);
  EXPECT_EQ(d.core.take_gone(), std::vector{d.goes});
  d.work();
  d.finals();
  EXPECT_EQ(d.core.phase(), Phase::done);
  EXPECT_EQ(d.core.take_gone(), std::vector{d.stays});
}

TEST(FinalCounters, OfAHostThatHasLeftMayComeAfterThoseOfTheOthers) {
  Departure d;
  d.work();
  d.finals();
  EXPECT_EQ(d.core.phase(), Phase::ending);
  d.core.receive(d.goes, final_status(1000), d.now);
  EXPECT_EQ(d.core.phase(), Phase::done);
  EXPECT_EQ(d.reported(), 1000u);
}

TEST(FinalCounters, AreNotWaitedForWithoutEnd) {
  Departure d;
  const auto tick = [&](double after_s) {
    d.core.receive(d.stays, wire::Status(), d.now + after_s);
    d.core.tick(d.now + after_s);
  };
  tick(2);
  EXPECT_TRUE(d.core.take_gone().empty());
  tick(3.5);
  EXPECT_EQ(d.core.take_gone(), std::vector{d.goes});
  d.core.receive(d.goes, final_status(1000), d.now + 4);
  EXPECT_EQ(d.reported(), 7u);
}

TEST(FinalCounters, AreNotWaitedForWhenTheConnectionHasEnded) {
  Departure d;
  d.work();
  d.finals();
  d.core.host_lost(d.goes, d.now);
  EXPECT_EQ(d.core.phase(), Phase::done);
  EXPECT_FALSE(d.core.hosts().at(d.goes).lost) << "it has done all that it took";
}

TEST(FinalCounters, OfAHostThatAsksToLeaveWhenTheJobEnds) {
  Cluster c;
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.work();
  ASSERT_EQ(c.core.phase(), Phase::ending);
  c.core.receive(b, wire::Leave(), c.now);
  EXPECT_TRUE(c.core.take_gone().empty());
  c.core.receive(a, final_status(500), c.now);
  EXPECT_EQ(c.core.phase(), Phase::ending);
  c.core.receive(b, final_status(600), c.now);
  EXPECT_EQ(c.core.phase(), Phase::done);
  EXPECT_EQ(c.core.hosts().at(b).last.counters().bytes_sent(), 600u);
}

TEST(FinalCounters, OfEveryHostAreWaitedForWhateverTheOthersSayAfterTheirs) {
  Cluster c;
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.work();
  c.core.receive(a, final_status(500), c.now);
  wire::Status beat;
  beat.mutable_counters()->set_bytes_sent(3);
  c.core.receive(a, beat, c.now);
  EXPECT_EQ(c.core.phase(), Phase::ending);
  c.core.receive(b, final_status(600), c.now);
  EXPECT_EQ(c.core.phase(), Phase::done);
  EXPECT_EQ(c.core.hosts().at(a).last.counters().bytes_sent(), 500u);
}

TEST(FinalCounters, CountFromTheEndOfTheJobOn) {
  Cluster c;
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.core.receive(a, final_status(1), c.now);  // nobody has asked
  wire::Status beat;
  beat.mutable_counters()->set_bytes_sent(2);
  c.core.receive(a, beat, c.now);
  EXPECT_EQ(c.core.hosts().at(a).last.counters().bytes_sent(), 2u);
  c.work();
  c.core.receive(b, final_status(600), c.now);
  EXPECT_EQ(c.core.phase(), Phase::ending);
  c.core.receive(a, final_status(500), c.now);
  EXPECT_EQ(c.core.phase(), Phase::done);
}

}  // namespace
}  // namespace cloudrenderer::manager_test
