// Out of core: parts that no host holds come and go.
#include <gtest/gtest.h>

#include "tasks_support.h"

namespace cloudrenderer {
namespace {

const std::vector<std::uint32_t> kHeld = {1, 2, 3};
const std::vector<std::uint32_t> kAll = {1, 2, 3, 4, 5, 6, 7, 8};

wire::SceneHostMap paged_map(std::uint32_t epoch = 1) {
  auto map = map_of(epoch, 1, TestHost::kParts, {{1, kHeld}});
  for (const std::uint32_t p : {4u, 5u, 6u, 7u, 8u}) map.add_paged(p);
  return map;
}

std::vector<PixelSums> sums_of(TestHost& h) {
  for (auto& [to, reply] : only<wire::Reply>(h.said()))
    if (const auto* r = std::get_if<wire::RendererReply>(&reply.payload)) return r->sums;
  return {};
}

// Work and loads in turn until there is neither; the most parts that were resident.
std::size_t run_all(TestHost& h) {
  std::size_t most = 0;
  for (bool more = true; more;) {
    h.run();
    more = h.core.has_load_work();
    if (auto w = h.core.take_load(h.now)) {
      WorkResult r = execute(h.loader, *w);
      most = std::max(most, h.engine.resident.size());
      h.core.finish(*w, r, h.now);
    }
  }
  return most;
}

TEST(Paging, GivesTheSumsOfAHostThatHoldsEverything) {
  TestHost whole(1);
  whole.start(kAll, map_of(1, 1, TestHost::kParts, {{1, kAll}}));
  whole.give_range(1);
  whole.run();
  const auto wanted = sums_of(whole);
  ASSERT_FALSE(wanted.empty());

  for (const std::size_t pages : {1u, 2u, 4u}) {
    TestHost h(1);
    h.loader.room = 1 + kHeld.size() + pages;
    h.start(kHeld, paged_map());
    h.give_range(1);
    const std::size_t most = run_all(h);
    EXPECT_LE(most, h.loader.room);
    const auto sums = sums_of(h);
    ASSERT_EQ(sums.size(), wanted.size()) << pages;
    for (std::size_t i = 0; i < sums.size(); ++i) {
      EXPECT_EQ(sums[i].sum, wanted[i].sum);
      EXPECT_EQ(sums[i].count, wanted[i].count);
    }
    EXPECT_GE(h.core.status().counters().paged_in(), 5u);
    EXPECT_TRUE(h.core.idle());
  }
}

TEST(Paging, LoadsNothingWhileThereIsOtherWork) {
  TestHost h(1);
  h.loader.room = 5;
  h.start(kHeld, paged_map());
  h.give_range(1);
  EXPECT_FALSE(h.core.has_load_work());
  while (h.core.has_work()) {
    EXPECT_FALSE(h.core.has_load_work());
    ASSERT_TRUE(h.step());
  }
  EXPECT_TRUE(h.core.has_load_work());
}

TEST(Paging, RoutesWhatWaitsAgainWhenAPartGetsAHolder) {
  TestHost h(1);
  h.loader.room = 5;
  h.start(kHeld, paged_map());
  h.give_range(1);
  h.run();
  ASSERT_GT(h.core.kept_segments(), 0u);
  // Host 2 holds what nobody did.
  h.core.receive(kManagerHost, map_of(2, 1, TestHost::kParts, {{1, kHeld}, {2, {4, 5, 6, 7, 8}}}), 0);
  h.run();
  EXPECT_FALSE(h.core.has_load_work());
  EXPECT_FALSE(only<wire::SubmitTask>(h.said()).empty());
}

TEST(Paging, APartThatIsToStayTakesThePlaceOfPages) {
  TestHost h(1);
  h.loader.room = 5;
  h.start(kHeld, paged_map());
  h.give_range(1);
  run_all(h);
  ASSERT_EQ(h.engine.resident.size(), 5u);
  wire::LoadParts load;
  load.add_parts(8);
  h.core.receive(kManagerHost, load, 0);
  (void)h.core.take_outbox();
  h.run_loader();
  EXPECT_EQ(h.engine.resident.size(), 5u);
  EXPECT_TRUE(h.engine.resident.contains(8));
  const auto reports = only<wire::LoadReport>(h.said());
  ASSERT_EQ(reports.size(), 1u);
  EXPECT_EQ(reports[0].second.loaded(0), 8u);
}

TEST(Paging, SaysSoWhenThereIsNoRoomForAPart) {
  TestHost h(1);
  h.loader.room = 4;  // what it holds, and nothing more
  h.start(kHeld, paged_map());
  h.give_range(1);
  std::string error;
  for (int i = 0; i < 1000 && error.empty(); ++i) {
    run_all(h);
    for (const auto& [to, report] : only<wire::LoadReport>(h.said())) error = report.error();
    h.tick_later(0.1);
  }
  EXPECT_NE(error.find("there is no room for part"), std::string::npos) << error;
}

}  // namespace
}  // namespace cloudrenderer
