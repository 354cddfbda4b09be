// The simulation of clusters that `cloudrenderer simulate` predicts with.
#include <gtest/gtest.h>

#include <cmath>

#include "simulate/dice.h"
#include "simulate/simulation.h"
#include "wire/messages.h"

namespace cloudrenderer::sim {
namespace {

constexpr std::uint64_t kMiB = 1 << 20;

// A row of parts: rays start in one and go to its neighbours.
SceneModel made_up(std::uint64_t seed, std::uint32_t parts = 13) {
  Dice dice(seed);
  SceneModel m;
  m.name = "made up";
  m.width = m.height = 128;
  m.spp = 64;
  m.columns = wire::kColumnBestHit | wire::kColumnTested;
  for (std::uint32_t p = 0; p < parts; ++p) {
    ModelPart part;
    part.placement.bytes = p == 0 ? 1000 : kMiB;
    part.placement.visits = 1;
    part.file_bytes = part.placement.bytes;
    part.triangles = p == 0 ? 0 : 10000;
    m.parts.push_back(part);
  }
  m.samples = {8, 8, 4, {}};
  for (int i = 0; i < 256; ++i) {
    PathSample path(dice.between(1, 5));
    std::uint32_t at = dice.between(1, parts - 1);
    for (PathVertex& v : path) {
      v.parts.push_back(at);
      if (dice.chance(0.4)) v.parts.push_back(at = at % (parts - 1) + 1);
      v.hit = v.parts.back();
      v.shadow = dice.chance(0.7);
      if (v.shadow) v.shadow_parts.push_back(at);
      if (v.shadow && dice.chance(0.3)) v.blocker = at;
    }
    m.samples.paths.push_back(path);
  }
  m.costs = {3e-8, 4e-7, 3e-7, 1e-7, 5e-8, 4e-7, 3e-5, 4.5e-10, 6e-7};
  return m;
}

ClusterPlan plan(std::uint32_t hosts, std::uint64_t memory = 8 * kMiB) {
  ClusterPlan p;
  p.hosts = hosts;
  p.kinds = {{"small", 1, memory, 0.1, 0.2, 1}};
  p.seed = 11;
  return p;
}

void expect_done(const Prediction& p, const SceneModel& m) {
  EXPECT_EQ(p.error, "");
  EXPECT_DOUBLE_EQ(p.paths, static_cast<double>(m.width) * m.height * m.spp);
  EXPECT_GT(p.efficiency, 0);
  EXPECT_LE(p.busy, 1.0001);
}

TEST(Simulate, OneHostTakesWhatItsCostsSay) {
  const SceneModel m = made_up(1);
  const Prediction p = simulate(m, plan(1, 100 * kMiB));
  expect_done(p, m);
  EXPECT_NEAR(p.efficiency, 1, 0.03);
  EXPECT_EQ(p.moves_per_path, 0);
  double cpu = 0;
  for (const PathSample& path : m.samples.paths) {
    cpu += m.costs.camera + m.costs.path + static_cast<double>(path.size()) * (m.costs.trace + m.costs.shade);
    for (const PathVertex& v : path) cpu += v.shadow ? m.costs.occlusion : 0;
  }
  EXPECT_NEAR(p.render_s, cpu / 256 * p.paths / 0.2, 0.04 * p.render_s);
}

// Two samples with one camera ray: it is traced, shaded and moved once.
TEST(Simulate, SharedCameraRaysCountOnce) {
  SceneModel m = made_up(1);
  ClusterPlan c = plan(4);
  c.segment = 16;
  const Prediction alone = simulate(m, c);
  expect_done(alone, m);
  m.samples_per_ray = 4;
  const Prediction shared = simulate(m, c);
  expect_done(shared, m);
  EXPECT_EQ(shared.segment, 8u);  // with more no group of samples would be left
  EXPECT_LT(shared.moves_per_path, 0.9 * alone.moves_per_path);
  EXPECT_GT(shared.moves_per_path, 0.2 * alone.moves_per_path);
  const Prediction one = simulate(m, plan(1, 100 * kMiB));
  expect_done(one, m);
  EXPECT_NEAR(one.efficiency, 1, 0.03);
  double cpu = 0;
  for (const PathSample& path : m.samples.paths) {
    cpu += m.costs.camera / 4 + m.costs.path;
    for (const PathVertex& v : path)
      cpu += (m.costs.trace + m.costs.shade + (v.shadow ? m.costs.occlusion : 0)) * (&v == &path.front() ? 0.25 : 1);
  }
  EXPECT_NEAR(one.render_s, cpu / 256 * one.paths / 0.2, 0.04 * one.render_s);
}

// Replies are as large as the tiles of their tasks, so that more hosts with smaller tiles send about as much.
TEST(Simulate, SmallTilesHaveSmallReplies) {
  const SceneModel m = made_up(1, 2);
  const Prediction one = simulate(m, plan(1)), many = simulate(m, plan(64));
  expect_done(many, m);
  EXPECT_EQ(many.moves_per_path, 0);
  EXPECT_GT(one.bytes, 16.0 * m.width * m.height);
  EXPECT_LT(many.bytes, 2 * one.bytes);
}

TEST(Simulate, TheSameSeedGivesTheSamePrediction) {
  const SceneModel m = made_up(2);
  ClusterPlan c = plan(6);
  c.trouble.failures = 200;
  c.trouble.replace_s = 0.5;
  const Prediction a = simulate(m, c), b = simulate(m, c);
  expect_done(a, m);
  EXPECT_EQ(a.render_s, b.render_s);
  EXPECT_EQ(a.bytes, b.bytes);
  EXPECT_EQ(a.cost, b.cost);
  EXPECT_EQ(a.wasted, b.wasted);
  EXPECT_EQ(a.lost, b.lost);
  EXPECT_EQ(a.events, b.events);
  c.seed = 12;
  EXPECT_NE(simulate(m, c).events, a.events);
}

TEST(Simulate, TheGrainHardlyMatters) {
  const SceneModel m = made_up(3);
  ClusterPlan c = plan(4);
  c.segment = 1;
  const Prediction fine = simulate(m, c);
  c.segment = 16;
  const Prediction coarse = simulate(m, c);
  expect_done(fine, m);
  expect_done(coarse, m);
  EXPECT_EQ(coarse.segment, 16u);
  EXPECT_GT(fine.moves_per_path, 0.05);
  EXPECT_NEAR(coarse.moves_per_path, fine.moves_per_path, 0.15 * fine.moves_per_path);
  EXPECT_NEAR(coarse.render_s, fine.render_s, 0.08 * fine.render_s);
}

TEST(Simulate, LostHostsCostPathsAndReclaimedOnesDoNot) {
  const SceneModel m = made_up(4);
  ClusterPlan c = plan(8);
  c.replication = 2;
  c.trouble.failures = 600;
  c.trouble.replace_s = 0.2;
  const Prediction lost = simulate(m, c);
  expect_done(lost, m);
  EXPECT_GT(lost.lost, 0u);
  EXPECT_GT(lost.wasted, 0);
  EXPECT_GT(lost.joined, 8u);
  c.trouble.failures = 0;
  c.trouble.reclaims = 600;
  const Prediction told = simulate(m, c);
  expect_done(told, m);
  EXPECT_GT(told.reclaimed, 0u);
  EXPECT_EQ(told.wasted, 0);
}

TEST(Simulate, ManyHostsShareTheWorkAndTheManagerKeepsUp) {
  const SceneModel m = made_up(5);
  const Prediction few = simulate(m, plan(10)), many = simulate(m, plan(200));
  expect_done(many, m);
  EXPECT_LT(many.render_s, 0.25 * few.render_s);
  EXPECT_GT(many.manager.messages, 200u);
  double sum = 0;
  for (const auto& [work, share] : many.manager.share_of) sum += share;
  EXPECT_GT(many.manager.share_of.at("film"), 0);
  EXPECT_GT(many.manager.share_of.at("tasks"), 0);
  EXPECT_NEAR(sum, many.manager.cpu_share, 1e-9);
}

TEST(Simulate, SaysWhyThereIsNoRoom) {
  EXPECT_NE(simulate(made_up(6), plan(2, kMiB / 2)).error, "");
}

}  // namespace
}  // namespace cloudrenderer::sim
