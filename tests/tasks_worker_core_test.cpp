#include <gtest/gtest.h>

#include "tasks_support.h"

namespace cloudrenderer {
namespace {

const std::vector<std::uint32_t> kLow = {1, 2, 3, 4}, kHigh = {5, 6, 7, 8};
const std::vector<std::uint32_t> kAll = {1, 2, 3, 4, 5, 6, 7, 8};

wire::SceneHostMap two_hosts(std::uint32_t epoch = 1, std::uint32_t generation = 1) {
  return map_of(epoch, generation, TestHost::kParts, {{1, kLow}, {2, kHigh}});
}

// The segment blocks among what was said.
std::vector<wire::SubmitTask> blocks(const WorkerCore::Outbox& outbox) {
  std::vector<wire::SubmitTask> found;
  for (auto& [to, m] : only<wire::SubmitTask>(outbox))
    if (std::holds_alternative<wire::SegmentBlock>(m.payload)) found.push_back(m);
  return found;
}

TEST(WorkerCore, ReportsThatItIsReadyAndWhatItHolds) {
  TestHost h(1);
  wire::JobStart job;
  job.set_job(7);
  job.set_width(8);
  h.core.receive(kManagerHost, job, 0);
  wire::LoadParts load;
  load.add_parts(3);
  h.core.receive(kManagerHost, load, 0);
  h.run_loader();
  const auto reports = only<wire::LoadReport>(h.said());
  ASSERT_EQ(reports.size(), 2u);
  EXPECT_EQ(reports[0].second.loaded_size(), 0);
  EXPECT_EQ(reports[1].second.loaded(0), 3u);
  EXPECT_EQ(reports[1].second.job(), 7u);
}

TEST(WorkerCore, DeclinesAPartThatItHasNoRoomFor) {
  TestHost h(1);
  h.loader.room = 2;  // the main scene and a part
  wire::JobStart job;
  job.set_job(7);
  job.set_width(8);
  h.core.receive(kManagerHost, job, 0);
  wire::LoadParts load;
  load.add_parts(3);
  load.add_parts(4);
  h.core.receive(kManagerHost, load, 0);
  h.run_loader();
  EXPECT_EQ(h.core.status().counters().parts_loaded(), 1u);
  std::vector<std::uint32_t> loaded, declined;
  for (const auto& [to, report] : only<wire::LoadReport>(h.said())) {
    EXPECT_EQ(report.error(), "");
    loaded.insert(loaded.end(), report.loaded().begin(), report.loaded().end());
    declined.insert(declined.end(), report.declined().begin(), report.declined().end());
  }
  EXPECT_EQ(loaded, std::vector<std::uint32_t>{3});
  EXPECT_EQ(declined, std::vector<std::uint32_t>{4});
}

TEST(WorkerCore, AloneItFinishesItsTasksWithoutAWordToAnyoneButTheManager) {
  TestHost h(1);
  h.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  h.give_range(1);
  h.run();
  const auto said = h.said();
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0].first, kManagerHost);
  const auto& reply = std::get<wire::Reply>(said[0].second);
  EXPECT_EQ(reply.id, (wire::TaskUuid{5, 1}));
  EXPECT_EQ(std::get<wire::RendererReply>(reply.payload).sums.size(), 32u);
  EXPECT_TRUE(h.core.idle());
  for (std::size_t s = 0; s < kTaskStates; ++s)
    EXPECT_EQ(h.core.tasks_in(static_cast<TaskState>(s)), 0u);
}

TEST(WorkerCore, TwoHostsGiveThePixelsOfOne) {
  TestHost alone(1);
  alone.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  alone.give_range(1);
  alone.run();
  const auto expected =
      std::get<wire::RendererReply>(only<wire::Reply>(alone.said()).at(0).second.payload);

  TestHost a(1), b(2);
  a.start(kLow, two_hosts());
  b.start(kHigh, two_hosts());
  a.give_range(1);
  for (int i = 0; i < 1000; ++i) {
    for (TestHost* h : {&a, &b}) {
      h->run();
      h->tick_later(0.01);
      for (auto& [to, m] : h->said()) {
        if (to != kManagerHost) {
          (to == a.id ? a : b).core.receive(h->id, std::move(m), h->now);
          continue;
        }
        const auto got = std::get<wire::RendererReply>(std::get<wire::Reply>(m).payload);
        for (std::size_t p = 0; p < got.sums.size(); ++p) {
          EXPECT_TRUE(got.sums[p].sum == expected.sums[p].sum) << p;
          EXPECT_EQ(got.sums[p].count, expected.sums[p].count);
        }
        EXPECT_GT(h->core.status().counters().moved(), 0u);
        EXPECT_GT(h->core.status().counters().shadow_asked(), 0u);
        return;
      }
    }
  }
  FAIL() << "the task has not ended";
}

TEST(WorkerCore, KeepsABatchUntilReplied) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();
  const auto sent = blocks(a.said());
  ASSERT_FALSE(sent.empty());
  const std::size_t kept = a.core.kept_segments();
  EXPECT_GE(kept, std::get<wire::SegmentBlock>(sent[0].payload).size());
  a.tick_later(100);
  EXPECT_EQ(a.core.kept_segments(), kept);

  wire::TracerReply all;
  all.count = static_cast<std::uint32_t>(std::get<wire::SegmentBlock>(sent[0].payload).size());
  all.accepted.assign((all.count + 63) / 64, 0);
  for (std::uint32_t i = 0; i < all.count; ++i)
    all.accepted[i / 64] |= std::uint64_t{1} << (i % 64);
  a.core.receive(HostId(2), wire::Reply{sent[0].id, 1, all}, a.now);
  EXPECT_EQ(a.core.kept_segments(), kept - all.count);
}

TEST(WorkerCore, AnswersABlockRightAfterItsIntersection) {
  TestHost a(1), b(2);
  a.start(kLow, two_hosts());
  b.start(kHigh, two_hosts());
  a.give_range(1);
  a.run();
  const auto sent = blocks(a.said());
  ASSERT_FALSE(sent.empty());
  b.core.receive(a.id, sent[0], 0);
  ASSERT_TRUE(b.step());  // one piece of work: the trace; nothing is shaded yet
  const auto replies = only<wire::Reply>(b.said());
  ASSERT_EQ(replies.size(), 1u);
  EXPECT_EQ(replies[0].first, a.id);
  const auto& r = std::get<wire::TracerReply>(replies[0].second.payload);
  std::size_t accepted = 0;
  for (const std::uint64_t w : r.accepted) accepted += static_cast<std::size_t>(std::popcount(w));
  EXPECT_EQ(r.tested.size() + accepted, r.count);
  EXPECT_GT(accepted, 0u);
  EXPECT_GT(r.tested.size(), 0u);
}

TEST(WorkerCore, TakesNoAnswerFromAStrangerOrOfTheWrongSize) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();
  const auto sent = blocks(a.said());
  ASSERT_FALSE(sent.empty());
  wire::TracerReply r;
  r.count = 1;
  r.accepted = {1};
  const std::size_t kept = a.core.kept_segments();
  const auto dropped = a.core.dropped_messages();
  a.core.receive(HostId(3), wire::Reply{sent[0].id, 1, r}, 0);
  a.core.receive(HostId(2), wire::Reply{{1, 999}, 1, r}, 0);
  r.count = 100000;
  a.core.receive(HostId(2), wire::Reply{sent[0].id, 1, r}, 0);
  a.core.receive(HostId(2), wire::Reply{sent[0].id, 1, wire::OcclusionReply{}}, 0);
  EXPECT_EQ(a.core.kept_segments(), kept);
  EXPECT_EQ(a.core.dropped_messages(), dropped + 4);
}

TEST(WorkerCore, LooksForAnotherWayWhenRefused) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();
  const auto sent = blocks(a.said());
  const std::size_t before = a.core.kept_segments();
  a.core.receive(HostId(2), wire::Reply{sent[0].id, 2, wire::Refusal{}}, a.now);
  EXPECT_EQ(a.core.kept_segments(), before);
  EXPECT_EQ(a.core.tasks_in(TaskState::fresh), 1u);
  (void)a.said();
  a.core.receive(kManagerHost, map_of(2, 1, TestHost::kParts, {{1, kLow}, {2, {}}, {3, kHigh}}),
                 a.now);
  a.run();
  for (const auto& [to, m] : only<wire::SubmitTask>(a.said())) EXPECT_EQ(to, HostId(3));
}

TEST(WorkerCore, RefusesBlocksOfEpochsInWhichItHeldMore) {
  TestHost b(2);
  b.start(kHigh, two_hosts());
  wire::UnloadParts unload;
  unload.add_parts(5);
  unload.set_epoch(4);
  b.core.receive(kManagerHost, unload, 0);
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();
  auto block = blocks(a.said()).at(0);
  b.core.receive(a.id, block, 0);
  const auto replies = only<wire::Reply>(b.said());
  ASSERT_EQ(replies.size(), 1u);
  EXPECT_TRUE(std::holds_alternative<wire::Refusal>(replies[0].second.payload));
}

TEST(WorkerCore, UnloadsOnlyWhileNoHitPointsIntoThePart) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();  // segments wait for host 2, with hits in parts of this host
  ASSERT_GT(a.core.kept_segments(), 0u);
  wire::UnloadParts unload;
  unload.add_parts(2);
  a.core.receive(kManagerHost, unload, 0);
  EXPECT_FALSE(a.core.has_load_work());
  a.core.receive(kManagerHost, two_hosts(2, 2), 0);  // everything in flight is forgotten
  EXPECT_TRUE(a.core.has_load_work());
}

TEST(WorkerCore, MakesRoomBeforeItGoesOnAfterALoss) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();
  auto map = map_of(2, 2, TestHost::kParts, {{1, {1, 2}}});
  map.add_drops()->set_host(1);
  map.mutable_drops(0)->add_parts(3);
  a.core.receive(kManagerHost, map, 0);
  a.run();  // path ends may be collected, nothing is traced
  EXPECT_FALSE(a.core.has_work());
  EXPECT_TRUE(a.engine.resident.contains(3));
  a.run_loader();
  EXPECT_FALSE(a.engine.resident.contains(3));
  EXPECT_TRUE(a.core.has_work());
}

TEST(WorkerCore, DropsBlocksOfAnOlderGenerationAndKeepsNewerOnes) {
  TestHost a(1), b(2);
  a.start(kLow, two_hosts());
  b.start(kHigh, two_hosts(2, 2));
  a.give_range(1);
  a.run();
  auto block = blocks(a.said()).at(0);
  b.core.receive(a.id, block, 0);
  EXPECT_FALSE(b.core.has_work());
  block.id.number += 1000;
  block.generation = 3;
  b.core.receive(a.id, block, 0);
  EXPECT_FALSE(b.core.has_work());
  b.core.receive(kManagerHost, two_hosts(3, 3), 0);
  EXPECT_TRUE(b.core.has_work());
}

TEST(WorkerCore, TheSameSubmissionTwiceIsOneTask) {
  TestHost a(1), b(2);
  a.start(kLow, two_hosts());
  b.start(kHigh, two_hosts());
  a.give_range(1);
  a.run();
  const auto block = blocks(a.said()).at(0);
  b.core.receive(a.id, block, 0);
  const std::size_t queued = b.core.queued_segments();
  b.core.receive(a.id, block, 0);
  EXPECT_EQ(b.core.queued_segments(), queued);
}

TEST(WorkerCore, MakesOnlyWhatIsMissingAfterALoss) {
  WorkerOptions o;
  o.camera_batch = 16;
  o.trace_batch = 16;
  o.small_batch = 1;
  TestHost a(1, o);
  a.start(kLow, two_hosts());
  a.give_range(1, 8);
  a.run();
  (void)a.said();
  const std::uint64_t waiting = a.core.live_paths();
  ASSERT_GT(waiting, 0u);
  ASSERT_LT(waiting, 256u);
  a.core.receive(kManagerHost, map_of(2, 2, TestHost::kParts, {{1, kAll}}), 0);
  EXPECT_EQ(a.core.kept_segments(), 0u);
  for (const std::uint32_t p : kHigh) a.engine.resident.insert(p);
  a.run();
  EXPECT_EQ(only<wire::Reply>(a.said()).size(), 1u);
  EXPECT_EQ(a.core.status().counters().wasted_paths(), waiting);
}

TEST(WorkerCore, RegroupsWhatAHostInGoodOrderLeftUnanswered) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();
  (void)a.said();
  const std::size_t kept = a.core.kept_segments();
  a.core.receive(kManagerHost, map_of(2, 1, TestHost::kParts, {{1, kLow}, {3, kHigh}}), 0);
  EXPECT_EQ(a.core.queued_segments(), kept);
  a.run();
  a.tick_later(1);
  const auto again = only<wire::SubmitTask>(a.said());
  ASSERT_FALSE(again.empty());
  for (const auto& [to, m] : again) EXPECT_EQ(to, HostId(3));
}

TEST(WorkerCore, HoldsEndsForAnOwnerThatIsNotOnItsListYet) {
  TestHost a(1), b(2);
  a.start(kLow, two_hosts());
  b.start(kHigh, two_hosts());
  a.give_range(1);
  a.run();
  auto block = blocks(a.said()).at(0);
  auto segments = std::make_shared<std::vector<PathSegment>>(
      *std::get<wire::SegmentBlock>(block.payload).chunks[0]);
  for (PathSegment& s : *segments) s.owner = 9;
  std::get<wire::SegmentBlock>(block.payload).chunks = {segments};
  b.core.receive(a.id, block, 0);
  b.run();
  b.tick_later(1);
  EXPECT_TRUE(only<wire::PathEnds>(b.said()).empty());
  b.core.receive(kManagerHost, map_of(2, 1, TestHost::kParts, {{1, kLow}, {2, kHigh}, {9, {}}}),
                 b.now);
  b.tick_later(1);
  const auto ends = only<wire::PathEnds>(b.said());
  ASSERT_FALSE(ends.empty());
  EXPECT_EQ(ends[0].first, HostId(9));
}

TEST(WorkerCore, CreditsLimitTheCameraOnly) {
  WorkerOptions o;
  o.path_credits = 10;
  TestHost a(1, o);
  a.start(kLow, two_hosts());
  a.give_range(1);
  a.run();
  EXPECT_EQ(a.core.live_paths(), 10u);
  EXPECT_FALSE(a.core.has_work());
  // Paths of others are taken at any time.
  TestHost c(3);
  c.start({}, map_of(1, 1, TestHost::kParts, {{1, kLow}, {2, kHigh}, {3, {}}}));
  c.give_range(2);
  c.run();
  for (auto& [to, m] : only<wire::SubmitTask>(c.said()))
    if (to == a.id) a.core.receive(c.id, m, 0);
  EXPECT_TRUE(a.core.has_work());
}

TEST(WorkerCore, MakesNoCameraRaysWhileAnotherHostIsOverloaded) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  wire::HostList list;
  list.add_hosts()->set_host(1);
  auto* other = list.add_hosts();
  other->set_host(2);
  other->set_load_s(50);
  a.core.receive(kManagerHost, list, 0);
  a.give_range(1);
  EXPECT_FALSE(a.core.has_work());
  other->set_load_s(0);
  a.core.receive(kManagerHost, list, 0);
  EXPECT_TRUE(a.core.has_work());
}

TEST(WorkerCore, DoesDeepWorkBeforeCameraRays) {
  WorkerOptions o;
  o.camera_batch = 8;
  o.small_batch = 1;
  TestHost a(1, o);
  a.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  a.give_range(1);
  auto first = a.core.take(0);
  ASSERT_TRUE(first && std::holds_alternative<CameraWork>(first->what));
  WorkResult r = execute(a.engine, *first);
  a.core.finish(*first, r, 0);
  auto second = a.core.take(0);
  ASSERT_TRUE(second && std::holds_alternative<TraceWork>(second->what));
}

TEST(WorkerCore, JoinsSmallBatches) {
  WorkerOptions o;
  o.camera_batch = 8;
  TestHost a(1, o);
  a.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  a.give_range(1);
  for (int i = 0; i < 16; ++i) ASSERT_TRUE(a.step());
  auto w = a.core.take(0);
  ASSERT_TRUE(w && std::holds_alternative<TraceWork>(w->what));
  EXPECT_EQ(w->segments(), 128u);
  EXPECT_EQ(w->tasks.size(), 16u);
}

TEST(WorkerCore, GathersForABusyHostUntilABlockIsFullOrOld) {
  WorkerOptions o;
  o.camera_batch = 16;
  o.trace_batch = 16;
  o.small_batch = 1;
  TestHost a(1, o);
  a.start(kLow, two_hosts());
  a.give_range(1, 8);
  while (a.step() && only<wire::SubmitTask>(a.said()).empty()) {
  }
  a.run();  // host 2 owes answers: the rest gathers
  const auto before = blocks(a.said()).size();
  EXPECT_GT(a.core.tasks_in(TaskState::submitting), 0u);
  a.tick_later(0.002);
  EXPECT_EQ(a.core.tasks_in(TaskState::submitting), 0u);
  EXPECT_EQ(before + blocks(a.said()).size(), 1u);
}

TEST(WorkerCore, SendsNothingUnderANewMapThatWasRoutedByTheOldOne) {
  WorkerOptions o;
  o.camera_batch = 16;
  o.trace_batch = 16;
  o.small_batch = 1;
  TestHost a(1, o);
  a.start(kLow, two_hosts());
  a.give_range(1, 8);
  a.run();
  ASSERT_GT(a.core.tasks_in(TaskState::submitting), 0u);
  (void)a.said();
  // Host 2 leaves: still on the list, but no holder.
  a.core.receive(kManagerHost, map_of(2, 1, TestHost::kParts, {{1, kLow}, {2, {}}, {3, kHigh}}),
                 a.now);
  a.run();
  a.tick_later(1);
  const auto sent = only<wire::SubmitTask>(a.said());
  ASSERT_FALSE(sent.empty());
  for (const auto& [to, m] : sent) EXPECT_EQ(to, HostId(3));
}

TEST(WorkerCore, TakesOrdersFromTheManagerOnly) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  const auto dropped = a.core.dropped_messages();
  a.core.receive(HostId(2), wire::JobEnd(), 0);
  a.core.receive(HostId(2), two_hosts(9, 9), 0);
  a.core.receive(HostId(2), wire::LoadParts(), 0);
  a.core.receive(HostId(2), wire::SubmitTask{{5, 1}, 1, 1, RendererRange{1, 0, 0, 4, 4, 0, 4}}, 0);
  a.core.receive(HostId(2), wire::Hello(), 0);
  EXPECT_EQ(a.core.dropped_messages(), dropped + 5);
  EXPECT_FALSE(a.core.has_work());
}

TEST(WorkerCore, ForgetsAJobThatEndsInTheMiddle) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.give_range(1);
  auto running = a.core.take(0);
  WorkResult r = execute(a.engine, *running);
  wire::JobEnd end;
  end.set_job(1);
  a.core.receive(kManagerHost, end, 0);
  a.core.finish(*running, r, 0);  // its results come too late
  EXPECT_FALSE(a.core.has_work());
  a.run_loader();
  EXPECT_TRUE(a.loader.ended);
  EXPECT_TRUE(a.core.idle());
  bool last = false;
  for (const auto& [to, s] : only<wire::Status>(a.core.take_outbox())) last |= s.final();
  EXPECT_TRUE(last);
}

TEST(WorkerCore, SaysIdleOnlyWhenItsPeersHaveEverything) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  EXPECT_FALSE(a.core.status().idle());
  DriverCounters c;
  c.drained = true;
  a.core.set_driver_counters(c);
  EXPECT_TRUE(a.core.status().idle());
}

TEST(WorkerCore, TellsTheManagerWhomItCannotReachForSomeTime) {
  TestHost a(1);
  a.start(kLow, two_hosts());
  a.core.peer_unreachable(HostId(2));
  EXPECT_EQ(a.core.status().unreachable_size(), 1);
  a.tick_later(60);
  EXPECT_EQ(a.core.status().unreachable_size(), 0);
}

}  // namespace
}  // namespace cloudrenderer
