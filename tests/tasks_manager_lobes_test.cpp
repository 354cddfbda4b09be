// Scenes whose pixel filter has negative lobes: two sums of each pixel.
#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using namespace manager_test;

JobSpec with_lobes() {
  JobSpec spec = job(1);
  spec.lobes = {1.5, 0.5};
  return spec;
}

TEST(NegativeLobes, WantRenderersThatKnowThem) {
  Cluster c({}, with_lobes());
  wire::Hello h = hello();
  h.add_features("layers");
  const auto refused = c.core.join(h, 0);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().find("lobes"), std::string::npos);
  wire::Hello intersects = h;
  for (const auto category : {wire::LOADER, wire::UNLOADER, wire::INTERSECTION}) intersects.add_categories(category);
  EXPECT_TRUE(c.core.join(intersects, 0)) << "it sums nothing";
  h.add_features("lobes");
  EXPECT_TRUE(c.core.join(h, 0));
}

TEST(NegativeLobes, AreInReplyFilmAndCheckpointOrTheHostIsGivenUp) {
  for (const bool both : {true, false}) {
    ManagerOptions o;
    o.keep_merged = true;
    Cluster c(o, with_lobes());
    const HostId a = c.join();
    c.report_loaded(a);
    const auto& range = std::get<RendererRange>(c.tasks[a].at(0).payload);
    wire::RendererReply r;
    r.task = range.task;
    r.negative_lobes = both;
    r.sums.resize(range.pixels() * (both ? 2 : 1));
    for (std::size_t i = 0; i < r.sums.size(); ++i)
      for (std::uint32_t s = range.sample_begin; s < range.sample_end; ++s)
        if (!both || (s % 3 == 0) == (i % 2 == 1)) r.sums[i].add({i % 2 ? 5 : 1, 2, 3}, s);
    c.core.receive(a, wire::Reply{c.tasks[a][0].id, 1, std::move(r)}, c.now);
    EXPECT_EQ(c.core.take_gone().empty(), both);
    const auto merged = c.core.take_merged();
    ASSERT_EQ(merged.size(), both ? 1u : 0u);
    if (!both) continue;
    EXPECT_EQ(merged[0].sums.size(), 2 * range.pixels());
    Film& film = c.core.film();
    EXPECT_EQ(film.at(range.x0, range.y0).count[0] + film.at(range.x0, range.y0, true).count[0], (range.sample_end + 1) / 2 - (range.sample_begin + 1) / 2);
    EXPECT_TRUE(film.at(range.x1 - 1, range.y0, true).sum[0][0] == 5 * Int128{film.at(range.x1 - 1, range.y0, true).count[0]});
    ManagerOptions again;
    again.fixed_tile = c.core.tile_size();
    Cluster second(again, with_lobes());
    EXPECT_TRUE(second.core.restore(merged[0]));
    EXPECT_EQ(second.core.film().samples(0), range.sample_end - range.sample_begin);
    Cluster other(again, job(1));
    EXPECT_FALSE(other.core.restore(merged[0]));
  }
}

}  // namespace
}  // namespace cloudrenderer
