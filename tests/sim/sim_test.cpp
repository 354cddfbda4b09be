// Thousands of failures in seconds, each replayable: CLOUDRENDERER_SIM_SEED=17 runs seed 17 only,
// and CLOUDRENDERER_SIM_SEEDS=100000 that many from CLOUDRENDERER_SIM_FIRST (default 0) on.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <string>

#include "cluster_sim.h"

namespace cloudrenderer::sim {
namespace {

constexpr std::uint64_t kSeeds = 2400;  // of the ordinary test run, in shards

std::uint64_t from_environment(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text ? std::stoull(text) : otherwise;
}

class Shard : public testing::TestWithParam<std::uint64_t> {};

TEST_P(Shard, GivesThePictureOfOneHost) {
  if (const char* only = std::getenv("CLOUDRENDERER_SIM_SEED")) {
    const Outcome o = run(random_scenario(std::stoull(only)));
    EXPECT_EQ(o.error, "");
    return;
  }
  const std::uint64_t seeds = from_environment("CLOUDRENDERER_SIM_SEEDS", kSeeds) / 4;
  const std::uint64_t first = from_environment("CLOUDRENDERER_SIM_FIRST", 0) + GetParam() * seeds;
  Outcome total;
  for (std::uint64_t seed = first; seed < first + seeds; ++seed) {
    const Outcome o = run(random_scenario(seed));
    ASSERT_EQ(o.error, "") << "replay with CLOUDRENDERER_SIM_SEED=" << seed;
    total.frames += o.frames;
    total.moved += o.moved;
    total.asked += o.asked;
    total.nearest_asked += o.nearest_asked;
    total.wasted += o.wasted;
    total.seconds += o.seconds;
    total.restored += o.restored;
    total.paged_in += o.paged_in;
    total.generations += o.generations > 1 ? 1 : 0;
    total.cancelled += o.cancelled;
    total.unloaded += o.unloaded;
    total.cut += o.cut;
    total.teams += o.teams > 1 ? 1 : 0;
    total.teams_ended += o.teams_ended;
    total.most_segments = std::max(total.most_segments, o.most_segments);
    total.most_frames = std::max(total.most_frames, o.most_frames);
  }
  // The runs did what they are for.
  EXPECT_GT(total.moved, seeds);
  EXPECT_GT(total.asked, seeds);
  EXPECT_GT(total.nearest_asked, seeds);
  EXPECT_GT(total.generations, seeds / 20);
  EXPECT_GT(total.restored, seeds);
  EXPECT_GT(total.paged_in, seeds);
  EXPECT_GT(total.cancelled, seeds / 2);
  EXPECT_GT(total.unloaded, seeds / 20);
  EXPECT_GT(total.cut, seeds / 20);
  EXPECT_GT(total.teams, seeds / 20);
  EXPECT_GT(total.teams_ended, seeds / 200);
  std::cout << seeds << " seeds, " << total.seconds << " virtual seconds, " << total.frames
            << " frames, " << total.moved << " moves, " << total.asked << " asks, " << total.nearest_asked << " segments asked about, " << total.wasted
            << " wasted paths, hosts lost in " << total.generations << " runs, " << total.restored
            << " paths restored, " << total.cancelled << " second copies cancelled, "
            << total.unloaded << " parts unloaded, " << total.cut << " links cut, "
            << total.teams << " runs with several teams, " << total.teams_ended << " teams ended, "
            << total.paged_in << " parts paged in; at most "
            << total.most_segments << " segments in a host, " << total.most_frames
            << " frames for one\n";
}

INSTANTIATE_TEST_SUITE_P(Cluster, Shard, testing::Values(0, 1, 2, 3));

}  // namespace
}  // namespace cloudrenderer::sim
