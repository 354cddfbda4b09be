// Whether samples share camera rays is tried before a frame, and then they do so in whole groups only.
#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using namespace manager_test;

// Samples deviate by this from their mean; the halves of a pixel to opposite sides.
std::vector<PixelSums> sums_of(const RendererRange& r, std::int64_t deviation) {
  std::vector<PixelSums> sums(r.pixels());
  for (PixelSums& p : sums)
    for (std::uint32_t s = r.sample_begin; s < r.sample_end; ++s) {
      const std::int64_t v = 1000 + (s % 2 ? deviation : -deviation);
      p.add({v, v, v}, s);
    }
  return sums;
}

TEST(ShareTrial, TakesSquaresWithinTheFrameAndComparesVariances) {
  for (const FilmFrame frame : {FilmFrame{200, 150, 0, 0, 200, 150}, FilmFrame{4000, 3000, 100, 50, 3000, 2999}, FilmFrame{64, 64, 60, 3, 63, 5}}) {
    ShareTrial trial(frame, 1);
    std::uint64_t paths = 0, tasks = 0;
    bool lost = false;
    while (auto r = trial.next()) {
      if (!lost) {  // its host was lost
        trial.give_back(*r);
        lost = true;
        continue;
      }
      EXPECT_TRUE(r->trial);
      ASSERT_GE(r->x0, frame.x0);
      ASSERT_GE(r->y0, frame.y0);
      ASSERT_LE(r->x1, frame.x1);
      ASSERT_LE(r->y1, frame.y1);
      ASSERT_LT(r->x0, r->x1);
      ASSERT_LT(r->y0, r->y1);
      paths += r->paths();
      ++tasks;
      ASSERT_TRUE(trial.pending());
      trial.merge(*r, sums_of(*r, r->shares ? 30 : 20));
    }
    EXPECT_FALSE(trial.pending());
    EXPECT_LE(paths, std::max<std::uint64_t>(2 * 8 * 64, frame.pixels() * 3 / 2));
    EXPECT_LE(tasks, 600u);
    ASSERT_TRUE(trial.ratio());
    EXPECT_NEAR(*trial.ratio(), 2.25, 1e-9);
  }
}

TEST(ShareTrial, KnowsNothingOfAPictureWithoutNoise) {
  ShareTrial trial({64, 64, 0, 0, 64, 64}, 1);
  while (auto r = trial.next()) trial.merge(*r, sums_of(*r, 0));
  EXPECT_FALSE(trial.ratio());
}

JobSpec sharing(bool if_worth, std::uint32_t spp = 32) {
  JobSpec spec = job(1, 64, spp);
  spec.samples_per_ray = 2;
  spec.share_if_worth = if_worth;
  return spec;
}

// Renders with hosts whose samples deviate as said; the samples of the film that shared rays.
std::uint64_t shared_samples(Cluster& c, std::int64_t alone, std::int64_t shared, std::uint64_t& tried) {
  std::uint64_t n = 0;
  bool begun = false;
  for (bool any = true; any;) {
    any = false;
    c.listen();
    for (auto& [h, list] : c.tasks) {
      if (list.empty() || c.gone.contains(h)) continue;
      any = true;
      const auto task = list.front();
      list.erase(list.begin());
      const auto& r = std::get<RendererRange>(task.payload);
      if (!r.trial) {
        begun = true;
        n += r.shares ? r.paths() : 0;
        EXPECT_TRUE(!r.shares || (r.sample_begin % 4 == 0 && r.sample_end % 4 == 0)) << r.sample_begin << " to " << r.sample_end;
      } else {
        EXPECT_FALSE(begun) << "the frame began before the trial was over";
        tried += r.paths();
      }
      wire::RendererReply reply;
      reply.task = r.task;
      reply.sums = sums_of(r, r.shares ? shared : alone);
      c.core.receive(h, wire::Reply{task.id, 1, std::move(reply)}, c.now);
    }
    c.now += 0.01;
  }
  return n;
}

TEST(ManagerCore, SharesCameraRaysWhereItWasFoundToPay) {
  for (const std::int64_t shared : {20, 30}) {
    Cluster c({}, sharing(true));
    c.report_loaded(c.join());
    std::uint64_t tried = 0;
    EXPECT_EQ(shared_samples(c, 20, shared, tried), shared == 20 ? 64u * 64 * 32 : 0u);
    EXPECT_GT(tried, 0u);
    EXPECT_EQ(c.core.phase(), Phase::ending);
    for (const PixelSums& p : c.core.film().sums()) ASSERT_EQ(p.count[0] + p.count[1], 32u) << "samples of the trial are in the picture";
    EXPECT_EQ(c.core.progress().paths_done, 64u * 64 * 32);
  }
}

TEST(ManagerCore, SharesNoCameraRaysWhereNoGroupIsWhole) {
  Cluster c({}, sharing(true, 3));
  c.report_loaded(c.join());
  std::uint64_t tried = 0;
  EXPECT_EQ(shared_samples(c, 20, 20, tried), 0u);
  EXPECT_EQ(tried, 0u);
  EXPECT_EQ(c.core.samples_per_ray(), 1u);
  EXPECT_EQ(c.core.progress().paths_done, 64u * 64 * 3);
}

TEST(ManagerCore, SharesCameraRaysInWholeGroupsOnly) {
  Cluster c({}, sharing(false, 38));
  c.report_loaded(c.join());
  std::uint64_t tried = 0;
  EXPECT_EQ(shared_samples(c, 20, 20, tried), 64u * 64 * 36);
  EXPECT_EQ(tried, 0u);
  for (const PixelSums& p : c.core.film().sums()) ASSERT_EQ(p.count[0] + p.count[1], 38u);
}

TEST(ManagerCore, TriesAgainWhatALostHostWasTrying) {
  Cluster c({}, sharing(true));
  const HostId a = c.join(), b = c.join();
  c.report_loaded(a);
  c.report_loaded(b);
  c.listen();
  ASSERT_FALSE(c.tasks[b].empty());
  EXPECT_TRUE(std::get<RendererRange>(c.tasks[b].front().payload).trial);
  c.core.host_lost(b, c.now);
  c.gone.insert(b);
  std::uint64_t tried = 0;
  EXPECT_EQ(shared_samples(c, 20, 20, tried), 64u * 64 * 32);
  EXPECT_EQ(c.core.phase(), Phase::ending);
}

TEST(ManagerCore, SharesNothingWhereAnEarlierRunLeftAPartOfAGroup) {
  ManagerOptions o;
  o.keep_merged = true;
  Cluster first(o, sharing(false, 34));
  first.report_loaded(first.join());
  std::uint64_t tried = 0;
  shared_samples(first, 20, 20, tried);
  o.fixed_tile = first.core.tile_size();
  const std::vector<TileSums> merged = first.core.take_merged();
  // The last samples of a run share nothing; with its own number of samples the rest does as before.
  Cluster again(o, sharing(false, 34)), more(o, sharing(false, 64));
  for (const TileSums& t : merged) {
    const bool left_out = t.x0 == 0 && t.y0 == 0;
    ASSERT_TRUE(left_out || again.core.restore(t));
    ASSERT_TRUE(more.core.restore(t));
  }
  again.report_loaded(again.join());
  EXPECT_EQ(shared_samples(again, 20, 20, tried), again.core.tile_size() * again.core.tile_size() * 32);
  more.report_loaded(more.join());
  EXPECT_EQ(shared_samples(more, 20, 20, tried), 0u);
}

TEST(ManagerCore, SharedRaysWantHostsThatKnowThem) {
  Cluster c({}, sharing(true));
  wire::Hello h = hello();
  h.add_features("layers");
  const auto refused = c.core.join(h, 0);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().find("shared rays"), std::string::npos);
  h.add_features("shared rays");
  EXPECT_TRUE(c.core.join(h, 0));
}

}  // namespace
}  // namespace cloudrenderer
