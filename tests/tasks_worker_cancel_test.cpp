// Renderer tasks that another host has done first.
#include <gtest/gtest.h>

#include "tasks_support.h"

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kTask = 1, kSamples = 8, kPaths = TestHost::kWidth * 4 * kSamples;
const std::vector<std::uint32_t> kLow = {1, 2, 3, 4}, kHigh = {5, 6, 7, 8};
const std::vector<std::uint32_t> kAll = {1, 2, 3, 4, 5, 6, 7, 8};

wire::CancelTask cancel(std::uint32_t task = kTask) {
  wire::CancelTask m;
  m.set_task(task);
  m.set_paths(kPaths);
  return m;
}

WorkerOptions small_batches() {
  WorkerOptions o;
  o.camera_batch = o.trace_batch = 16;
  o.small_batch = 1;
  return o;
}

wire::SceneHostMap two_hosts(std::uint32_t generation = 1) {
  return map_of(generation, generation, TestHost::kParts, {{1, kLow}, {2, kHigh}});
}

std::uint64_t copied(const TestHost& h) { return h.core.status().counters().copied_paths(); }

TEST(CancelTask, OfWhatHasNotBegunNothingIsMade) {
  TestHost a(1, small_batches());
  a.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  a.give_range(kTask, kSamples);
  a.core.receive(kManagerHost, cancel(), 0);
  EXPECT_TRUE(a.core.idle());
  a.run();
  EXPECT_EQ(a.core.status().counters().bounce(), 0u);
  EXPECT_EQ(copied(a), 0u);
  EXPECT_TRUE(only<wire::Reply>(a.said()).empty());
}

TEST(CancelTask, OfWhatHasBegunNoMoreIsMadeAndWhatWasMadeIsCounted) {
  TestHost a(1, small_batches());
  a.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  a.give_range(kTask, kSamples);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(a.step());
  const std::uint64_t made = a.core.live_paths();
  ASSERT_GT(made, 0u);
  ASSERT_LT(made, kPaths);
  a.core.receive(kManagerHost, cancel(), 0);
  EXPECT_EQ(a.core.live_paths(), made) << "they take up credits until they have ended";
  a.run();
  EXPECT_EQ(copied(a), made);
  EXPECT_EQ(a.core.live_paths(), 0u);
  EXPECT_TRUE(a.core.idle());
  EXPECT_TRUE(only<wire::Reply>(a.said()).empty());
  a.give_range(kTask + 1, kSamples);  // and it goes on
  a.run();
  EXPECT_EQ(only<wire::Reply>(a.said()).size(), 1u);
}

TEST(CancelTask, WhileAThreadCollectsNeitherReplyNorHarmComesOfIt) {
  TestHost a(1);
  a.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  a.give_range(kTask, kSamples);
  for (;;) {
    auto w = a.core.take(0);
    ASSERT_TRUE(w);
    const bool collects = std::holds_alternative<CollectWork>(w->what);
    WorkResult r = execute(a.engine, *w);
    const bool last = collects && !r.completed.empty();
    if (last) a.core.receive(kManagerHost, cancel(), 0);
    a.core.finish(*w, r, 0);
    if (last) break;
  }
  EXPECT_TRUE(only<wire::Reply>(a.said()).empty());
  EXPECT_EQ(copied(a), kPaths);
  EXPECT_TRUE(a.core.idle());
}

TEST(CancelTask, WhatWasRepliedAlreadyWasMadeTwice) {
  TestHost a(1);
  a.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  a.give_range(kTask, kSamples);
  a.run();
  ASSERT_EQ(only<wire::Reply>(a.said()).size(), 1u);
  a.core.receive(kManagerHost, cancel(), 0);
  EXPECT_EQ(copied(a), kPaths);
}

TEST(CancelTask, ALossForgetsWhatWasStillOnItsWay) {
  TestHost a(1, small_batches());
  a.start(kLow, two_hosts());
  a.give_range(kTask, kSamples);
  a.run();
  ASSERT_GT(a.core.live_paths(), 0u) << "some wait for the other host";
  a.core.receive(kManagerHost, cancel(), 0);
  EXPECT_EQ(copied(a), kPaths);
  EXPECT_FALSE(a.core.idle());
  const auto bounces = a.core.status().counters().bounce();
  a.core.receive(kManagerHost, map_of(2, 2, TestHost::kParts, {{1, kAll}}), 0);
  for (const std::uint32_t p : kHigh) a.engine.resident.insert(p);
  a.run();
  EXPECT_EQ(a.core.status().counters().bounce(), bounces) << "nothing is made again";
  EXPECT_EQ(copied(a), kPaths);
  EXPECT_TRUE(a.core.idle());
}

TEST(CancelTask, IsTakenFromTheManagerOnlyAndOnce) {
  TestHost a(1, small_batches());
  a.start(kLow, two_hosts());
  a.give_range(kTask, kSamples);
  a.run();
  const auto live = a.core.live_paths();
  a.core.receive(HostId(2), cancel(), 0);
  EXPECT_EQ(copied(a), 0u);
  EXPECT_EQ(a.core.dropped_messages(), 1u);
  for (int i = 0; i < 2; ++i) a.core.receive(kManagerHost, cancel(), 0);
  EXPECT_EQ(a.core.dropped_messages(), 2u);
  EXPECT_EQ(copied(a), kPaths);
  EXPECT_EQ(a.core.live_paths(), live);
}

}  // namespace
}  // namespace cloudrenderer
