// Going on from a checkpoint.
#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using namespace manager_test;

ManagerOptions recording(std::uint32_t fixed_tile = 0) {
  ManagerOptions o;
  o.keep_merged = true;
  o.fixed_tile = fixed_tile;
  return o;
}

// One host, to the end of `tasks` tasks.
void begin(Cluster& c, std::size_t tasks = 100000) {
  c.report_loaded(c.join());
  c.work(tasks);
}

void expect_whole(const ManagerCore& core, std::uint32_t spp) {
  for (const PixelSums& p : core.film().sums()) {
    ASSERT_EQ(p.count[0] + p.count[1], spp);
    ASSERT_TRUE(p.sum[0][0] + p.sum[1][0] == spp * (spp - 1) / 2);
  }
}

TEST(ManagerCore, GoesOnFromWhatAnEarlierRunHasMerged) {
  for (const std::size_t tasks : {1, 3, 7, 20}) {
    Cluster first(recording());
    begin(first, tasks);
    const auto merged = first.core.take_merged();
    ASSERT_EQ(merged.size(), tasks);
    EXPECT_TRUE(first.core.take_merged().empty());
    Cluster second(recording(first.core.tile_size()));
    for (const TileSums& t : merged) {
      ASSERT_TRUE(second.core.restore(t));
      ASSERT_FALSE(second.core.restore(t)) << "counted twice";
    }
    const auto before = second.core.progress();
    EXPECT_EQ(before.paths_done, first.core.progress().paths_done);
    EXPECT_EQ(before.paths_restored, before.paths_done);
    begin(second);
    EXPECT_EQ(second.core.phase(), Phase::ending);
    expect_whole(second.core, 16);
    EXPECT_EQ(second.core.progress().paths_done, second.core.progress().paths_total);
    std::uint64_t made = 0;
    for (const TileSums& t : second.core.take_merged())
      made += t.sums.size() * (t.samples[0].end - t.samples[0].begin);
    EXPECT_EQ(made + before.paths_done, before.paths_total);
  }
}

TEST(ManagerCore, IsDoneAtOnceWhenNothingIsLeft) {
  Cluster first(recording());
  begin(first);
  Cluster second(recording(first.core.tile_size()));
  for (const TileSums& t : first.core.take_merged()) ASSERT_TRUE(second.core.restore(t));
  EXPECT_EQ(second.core.phase(), Phase::done);
  EXPECT_EQ(second.core.complete_samples(), 16u);
  expect_whole(second.core, 16);
}

TEST(ManagerCore, AddsSamplesToAFinishedPicture) {
  for (const std::uint32_t spp : {17u, 24u, 40u}) {
    Cluster first(recording(), job(5, 64, 11));  // ends inside a round
    begin(first);
    Cluster second(recording(first.core.tile_size()), job(5, 64, spp));
    for (std::size_t i = 0; i < first.core.tiles(); ++i)
      ASSERT_TRUE(second.core.restore(*first.core.tile_sums(i)));
    EXPECT_EQ(second.core.complete_samples(), 0u);
    begin(second);
    EXPECT_EQ(second.core.phase(), Phase::ending);
    expect_whole(second.core, spp);
    for (const TileSums& t : second.core.take_merged()) EXPECT_GE(t.samples[0].begin, 11u);
  }
}

TEST(ManagerCore, GoesOnRoundByRound) {
  Cluster first(recording(), job(5, 64, 40));
  begin(first, 3);  // in the first round
  ManagerOptions o = recording(first.core.tile_size());
  o.hold_rounds = true;
  Cluster second(o, job(5, 64, 40));
  for (const TileSums& t : first.core.take_merged()) ASSERT_TRUE(second.core.restore(t));
  begin(second);
  // The first round completes whatever was begun without rounds.
  int rounds = 1;
  while (second.core.round_complete()) {
    ASSERT_EQ(second.core.goals()[0] % 16, 0u);
    for (const PixelSums& p : second.core.film().sums()) ASSERT_EQ(p.count[0] + p.count[1], second.core.goals()[0]);
    ++rounds;
    second.core.next_round(second.now);
    second.work();
  }
  EXPECT_EQ(rounds, 3);
  EXPECT_EQ(second.core.phase(), Phase::ending);
  expect_whole(second.core, 40);
}

TEST(ManagerCore, GivesEveryTileTheSamplesThatItsGoalSays) {
  ManagerOptions o;
  o.hold_rounds = true;
  o.tile = 8;
  Cluster c(o, job(5, 64, 100));
  c.report_loaded(c.join());
  c.work();
  ASSERT_TRUE(c.core.round_complete());
  ASSERT_EQ(c.core.goals().size(), 64u);
  std::vector<std::uint32_t> goals(64, 16);
  goals[9] = 40;   // tile (1, 1)
  goals[63] = 24;
  goals[0] = 8;    // less than there is: nothing
  c.core.next_round(c.now, goals, 100'000);
  EXPECT_EQ(c.core.progress().paths_total, 100'000u);
  c.work();
  ASSERT_TRUE(c.core.round_complete());
  for (std::uint32_t y = 0; y < 64; ++y) {
    for (std::uint32_t x = 0; x < 64; ++x) {
      const PixelSums& p = c.core.film().at(x, y);
      const std::uint32_t tile = y / 8 * 8 + x / 8, expected = tile == 9 ? 40 : tile == 63 ? 24 : 16;
      ASSERT_EQ(p.count[0] + p.count[1], expected) << x << " " << y;
    }
  }
  c.core.next_round(c.now, std::vector<std::uint32_t>(64, 1000));
  c.work();
  EXPECT_FALSE(c.core.round_complete());
  EXPECT_EQ(c.core.phase(), Phase::ending) << "100 samples are all that the job has";
}

TEST(ManagerCore, GoesOnWithTheDecisionOfAnEarlierRun) {
  ManagerOptions o = recording();
  o.hold_rounds = true;
  o.tile = 8;
  const auto decide = [](Cluster& c) {
    std::vector<std::uint32_t> goals(64);
    for (std::uint32_t i = 0; i < 64; ++i) goals[i] = 16 + i;
    c.core.next_round(c.now, goals);
  };
  Cluster whole(o, job(5, 64, 100));
  begin(whole);
  decide(whole);
  whole.work();
  Cluster first(o, job(5, 64, 100));
  begin(first);
  decide(first);
  first.work(10);  // some of the round
  o.fixed_tile = first.core.tile_size();
  Cluster second(o, job(5, 64, 100));
  for (const TileSums& t : first.core.take_merged()) ASSERT_TRUE(second.core.restore(t));
  EXPECT_FALSE(second.core.restore_goals({1, 2, 3})) << "of another film";
  EXPECT_FALSE(second.core.restore_goals(std::vector<std::uint32_t>(64, 101))) << "more than a pixel may have";
  ASSERT_TRUE(second.core.restore_goals({first.core.goals().begin(), first.core.goals().end()}));
  begin(second);
  ASSERT_TRUE(second.core.round_complete());
  for (std::size_t p = 0; p < 64 * 64; ++p) {
    ASSERT_EQ(second.core.film().sums()[p].count, whole.core.film().sums()[p].count);
    ASSERT_EQ(second.core.film().sums()[p].sum, whole.core.film().sums()[p].sum);
  }
}

TEST(ManagerCore, TakesNoTileOfAnotherFilm) {
  Cluster first(recording());
  begin(first, 1);
  const TileSums t = first.core.take_merged().at(0);
  EXPECT_FALSE(Cluster(recording()).core.restore(t)) << "without a tile size";
  Cluster more(recording(first.core.tile_size()), job(5, 64, t.samples[0].end - 1));
  EXPECT_FALSE(more.core.restore(t)) << "more samples than asked for";
  Cluster c(recording(first.core.tile_size()));
  for (const int wrong : {0, 1, 2}) {
    TileSums bad = t;
    if (wrong == 0) ++bad.x0;
    if (wrong == 1) bad.sums.pop_back();
    if (wrong == 2) bad.y0 = bad.y1 = 9999;
    EXPECT_FALSE(c.core.restore(bad)) << wrong;
  }
  EXPECT_EQ(c.core.progress().paths_done, 0u);
  EXPECT_TRUE(c.core.restore(t));
}

TEST(ManagerCore, RefusesHostsThatComputeOtherBitsThanTheCheckpoint) {
  ManagerOptions o = recording();
  o.fingerprint = 5;
  Cluster c(o);
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_memory(10000);
  h.set_threads(1);
  h.set_fingerprint(6);
  const auto id = c.core.join(h, 0);
  ASSERT_FALSE(id);
  EXPECT_NE(id.error().find("checkpoint"), std::string::npos);
  h.set_fingerprint(5);
  EXPECT_TRUE(c.core.join(h, 0));
}

}  // namespace
}  // namespace cloudrenderer
