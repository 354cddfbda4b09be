#include "web/tiles.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using manager_test::Cluster;

TEST(Rgb9e5, KeepsColoursWithinHalfAStepOfTheLargestChannel) {
  constexpr unsigned kSeed = 5;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<float> exponent(-14.f, 15.9f), share(0.f, 1.f);
  for (int i = 0; i < 100000; ++i) {
    const float largest = std::exp2(exponent(random));
    const Rgb c(largest, largest * share(random), largest * share(random));
    const Rgb back = unpack_rgb9e5(pack_rgb9e5(c));
    for (int k = 0; k < 3; ++k) ASSERT_NEAR(back[k], c[k], largest / 512) << "seed " << kSeed << ", colour " << i;
  }
}

TEST(Rgb9e5, HasAValueForWhateverComes) {
  EXPECT_EQ(pack_rgb9e5(Rgb(0.f)), 0u);
  EXPECT_EQ(pack_rgb9e5(Rgb(-1.f, std::nanf(""), 0.f)), 0u);
  EXPECT_EQ(unpack_rgb9e5(pack_rgb9e5(Rgb(1e30f, kInfinity, 65408.f))), Rgb(65408.f));
  EXPECT_EQ(unpack_rgb9e5(pack_rgb9e5(Rgb(1.f, 0.5f, 0.25f))), Rgb(1.f, 0.5f, 0.25f));
  EXPECT_EQ(unpack_rgb9e5(pack_rgb9e5(Rgb(0.99999f))), Rgb(1.f)) << "rounds up to the next power of two";
  EXPECT_EQ(unpack_rgb9e5(pack_rgb9e5(Rgb(1e-30f))), Rgb(0.f));
}

// Of 64 x 64 pixels, with tiles of 16.
struct Growing {
  Growing() {
    ManagerOptions o;
    o.fixed_tile = 16;
    cluster.emplace(o);
    cluster->join();
    cluster->report_loaded(HostId{1});
  }
  std::optional<Cluster> cluster;
};

TEST(TileWatch, ChoosesEveryTileOnceThenOnlyWhatHasChanged) {
  Growing g;
  TileWatch watch;
  EXPECT_TRUE(watch.choose(g.cluster->core, 1000000).empty()) << "there is nothing yet";
  g.cluster->work();
  const std::size_t all = g.cluster->core.tiles();
  ASSERT_EQ(all, 16u);
  std::vector<std::size_t> seen;
  for (int i = 0; i < 8; ++i) {
    const auto some = watch.choose(g.cluster->core, 2 * 256);
    EXPECT_EQ(some.size(), 2u);
    seen.insert(seen.end(), some.begin(), some.end());
  }
  std::sort(seen.begin(), seen.end());
  seen.erase(std::unique(seen.begin(), seen.end()), seen.end());
  EXPECT_EQ(seen.size(), all);
  EXPECT_TRUE(watch.choose(g.cluster->core, 1000000).empty());
}

TEST(TileWatch, ChoosesAllTilesAgainAsLightOfPathsFromLightsGrows) {
  ManagerOptions o;
  o.fixed_tile = 16;
  JobSpec spec = manager_test::job();
  spec.start.set_light_paths(1);
  Cluster cluster(o, spec);
  const HostId host = cluster.join();
  cluster.report_loaded(host);
  TileWatch watch;
  // Each task brings light to the last tile.
  std::size_t answered = 0, chosen = 0;
  for (; answered < cluster.tasks[host].size(); ++answered) {
    const auto task = cluster.tasks[host][answered];
    const auto range = std::get<RendererRange>(task.payload);
    wire::RendererReply r;
    r.task = range.task;
    r.sums.resize(range.pixels());
    for (PixelSums& p : r.sums)
      for (std::uint32_t s = range.sample_begin; s < range.sample_end; ++s) p.add({4, 4, 4}, s);
    r.splats.push_back({64 * 64 - 1, {}});
    r.splats[0].add({5, 5, 5}, 0);
    cluster.core.receive(host, wire::Reply{task.id, 1, std::move(r)}, cluster.now);
    chosen += watch.choose(cluster.core, 1000000).size();
    cluster.listen();
  }
  ASSERT_GT(answered, 16u);
  EXPECT_EQ(cluster.core.progress().paths_done, cluster.core.progress().paths_total);
  EXPECT_GE(chosen, answered + 15) << "all again at the end";
  EXPECT_TRUE(watch.choose(cluster.core, 1000000).empty());
}

TEST(CoarsePicture, HasEveryStepOfAllThePicture) {
  Growing g;
  g.cluster->work();
  const Film& film = g.cluster->core.film();
  for (const std::size_t most : {1u, 15u, 16u, 1000u, 4096u}) {
    const std::string bytes = encode_coarse(g.cluster->core, FilmOptions{}, most);
    std::vector<std::uint32_t> words(bytes.size() / 4);
    std::memcpy(words.data(), bytes.data(), bytes.size());
    const std::uint32_t step = words[0], w = words[1], h = words[2];
    EXPECT_EQ(w, (64 + step - 1) / step);
    EXPECT_EQ(h, w);
    ASSERT_EQ(words.size(), 3 + w * h);
    EXPECT_LE(w * h, most);
    const std::uint32_t finer = step > 1 ? (64 + step - 2) / (step - 1) : 0;
    if (step > 1) {
      EXPECT_GT(finer * finer, most) << "a finer one would do";
    }
    const std::uint32_t x = std::min(63u, (w - 1) * step + step / 2), y = std::min(63u, step / 2);
    EXPECT_EQ(words[3 + w - 1], pack_rgb9e5(film.colour(y * 64 + x, 1.f)));
  }
}

TEST(TileWatch, ChoosesOneTileEvenIfThatIsTooMuch) {
  Growing g;
  g.cluster->work();
  EXPECT_EQ(TileWatch().choose(g.cluster->core, 1).size(), 1u);
}

TEST(TileBoard, ATileSaysWhereItIsAndWhatIsInIt) {
  Growing g;
  g.cluster->work();
  const std::string bytes = TileBoard::encode(g.cluster->core, 5, FilmOptions{});
  ASSERT_EQ(bytes.size(), 4u * (5 + 256));
  std::array<std::uint32_t, 6> words{};
  std::memcpy(words.data(), bytes.data(), sizeof words);
  EXPECT_EQ((std::array{words[0], words[1], words[2], words[3], words[4]}), (std::array{16u, 16u, 16u, 16u, 16u}));
  const Rgb there = g.cluster->core.film().image(1.f).pixels[16 * 64 + 16];
  EXPECT_EQ(words[5], pack_rgb9e5(there));
}

TEST(TileBoard, AViewerGetsTheOldestNewsFirstAndEveryStateOnce) {
  TileBoard board;
  for (std::size_t i = 0; i < 4; ++i) board.put(i, std::string(100, static_cast<char>('a' + i)));
  TileBoard::Viewer viewer, late;
  auto got = board.next(viewer, 250);
  ASSERT_EQ(got.size(), 2u);
  EXPECT_EQ(got[0]->front(), 'a');
  board.put(0, std::string(100, 'z'));
  got = board.next(viewer, 1000);
  ASSERT_EQ(got.size(), 3u);
  EXPECT_EQ(got[0]->front(), 'c');
  EXPECT_EQ(got[2]->front(), 'z');
  EXPECT_TRUE(board.next(viewer, 1000).empty());
  EXPECT_EQ(board.next(late, 1).size(), 1u) << "one at least";
  EXPECT_EQ(board.next(late, 1000).size(), 3u);
}

}  // namespace
}  // namespace cloudrenderer
