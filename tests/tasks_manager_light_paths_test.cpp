// Jobs with paths from lights: what these bring to any pixel of the film.
#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using namespace manager_test;

JobSpec with_light_paths(bool has = true) {
  JobSpec spec = job(1);
  spec.start.set_light_paths(has ? 1 : 0);
  return spec;
}

TEST(LightPathsJob, WantsHostsThatKnowThem) {
  Cluster c({}, with_light_paths());
  wire::Hello h = hello();
  h.add_features("layers");
  const auto refused = c.core.join(h, 0);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().find("paths from lights"), std::string::npos);
  h.add_features("aimed light paths");
  EXPECT_TRUE(c.core.join(h, 0));
}

wire::RendererReply reply_to(const RendererRange& range, std::vector<Splat> splats) {
  wire::RendererReply r;
  r.task = range.task;
  r.sums.resize(range.pixels());
  for (PixelSums& p : r.sums)
    for (std::uint32_t s = range.sample_begin; s < range.sample_end; ++s) p.add({4, 4, 4}, s);
  r.splats = std::move(splats);
  return r;
}

Splat light_at(std::uint32_t pixel, std::int64_t light) {
  Splat s{pixel, {}};
  s.add({light, 0, 0}, 0);
  return s;
}

TEST(LightPathsJob, SplatsAreInFilmAndCheckpointWhereverTheyFall) {
  ManagerOptions o;
  o.keep_merged = true;
  Cluster c(o, with_light_paths());
  const HostId a = c.join();
  c.report_loaded(a);
  const auto range = std::get<RendererRange>(c.tasks[a].at(0).payload);
  const FilmFrame& frame = c.core.film().frame();
  const std::uint32_t here = range.y0 * frame.width + range.x0, elsewhere = (frame.y1 - 1) * frame.width + frame.x1 - 1;
  ASSERT_LT(here, elsewhere);
  c.core.receive(a, wire::Reply{c.tasks[a][0].id, 1, reply_to(range, {light_at(here, 80), light_at(elsewhere, 160)})}, c.now);
  EXPECT_TRUE(c.core.take_gone().empty());
  const Film& film = c.core.film();
  ASSERT_EQ(film.splats().size(), frame.pixels());
  EXPECT_EQ(film.splats().back().pixel, elsewhere);
  EXPECT_TRUE(film.splats().back().sum[0][0] == 160);
  // Of all samples of the task together, as if each had a picture of one pixel.
  EXPECT_DOUBLE_EQ(film.mean(0, 0, 1), 4 + 80.0 * static_cast<double>(frame.pixels()) / static_cast<double>(range.paths()));
  EXPECT_DOUBLE_EQ(film.mean(0, 1, 1), 4);

  // As a journal has it, and as one record a tile has it: the tile of the other pixel has no samples yet.
  ManagerOptions again;
  again.fixed_tile = c.core.tile_size();
  const auto merged = c.core.take_merged();
  ASSERT_EQ(merged.size(), 1u);
  std::vector<TileSums> tiles;
  for (std::size_t i = 0; i < c.core.tiles(); ++i)
    if (auto t = c.core.tile_sums(i)) tiles.push_back(*t);
  ASSERT_EQ(tiles.size(), 1u);
  ASSERT_GT(c.core.tiles(), 1u);
  for (const TileSums& t : {merged[0], tiles[0]}) {
    Cluster second(again, with_light_paths());
    EXPECT_TRUE(second.core.restore(t));
    EXPECT_DOUBLE_EQ(second.core.film().mean(0, 0, 1), film.mean(0, 0, 1));
    EXPECT_TRUE(second.core.film().splats().back().sum == film.splats().back().sum);
    Cluster other(again, with_light_paths(false));
    EXPECT_FALSE(other.core.restore(t));
  }
}

TEST(LightPathsJob, GivesUpHostsWhoseSplatsAreOfNoFilm) {
  const auto frame = job(1).frame;
  const std::uint32_t last = (frame.y1 - 1) * frame.width + frame.x1 - 1;
  const auto outside = frame.height * frame.width;
  using Splats = std::vector<Splat>;
  for (const auto& [splats, has, good] : {std::tuple(Splats{light_at(last, 1)}, true, true), std::tuple(Splats{light_at(outside, 1)}, true, false),
                                          std::tuple(Splats{light_at(last, 1), light_at(last, 1)}, true, false),
                                          std::tuple(Splats{light_at(last, 1)}, false, false)}) {
    Cluster c({}, with_light_paths(has));
    const HostId a = c.join();
    c.report_loaded(a);
    const auto range = std::get<RendererRange>(c.tasks[a].at(0).payload);
    c.core.receive(a, wire::Reply{c.tasks[a][0].id, 1, reply_to(range, splats)}, c.now);
    EXPECT_EQ(c.core.take_gone().empty(), good) << splats[0].pixel << ' ' << has;
  }
}

}  // namespace
}  // namespace cloudrenderer
