// Hosts that are not alike: some only intersect, some lack what a part needs, some compute other bits.
#include <gtest/gtest.h>

#include "parts/features.h"
#include "tasks/answers.h"
#include "tasks_manager_util.h"

namespace cloudrenderer {
namespace {

using manager_test::Cluster;
using manager_test::Phase;

wire::Hello hello(bool traces, std::uint64_t memory, std::vector<std::string> features = {}) {
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_fingerprint(7);
  h.set_threads(1);
  h.set_memory(memory);
  h.set_path_credits(20000);
  if (!traces)
    for (const auto c : {wire::LOADER, wire::UNLOADER, wire::INTERSECTION}) h.add_categories(c);
  for (const std::string& f : features) h.add_features(f);
  return h;
}

// Parts 1 to 4; the last two have more than triangles.
JobSpec mixed_job() {
  JobSpec j = manager_test::job();
  j.part_features = {{}, {"triangles"}, {"triangles"}, {"triangles", "quadrics"}, {"curves"}};
  return j;
}

struct Fixture {
  explicit Fixture(JobSpec spec = mixed_job(), ManagerOptions o = {}) : c(o, std::move(spec)) {}
  HostId join(const wire::Hello& h) {
    const auto id = c.core.join(h, c.now);
    EXPECT_TRUE(id) << id.error();
    c.listen();
    return id ? *id : HostId();
  }
  Cluster c;
};

TEST(KindsOfHosts, OneThatOnlyIntersectsHoldsTrianglesOnlyAndRendersNothing) {
  ManagerOptions o;
  o.min_hosts = 2;
  Fixture f(mixed_job(), o);
  const HostId tracer = f.join(hello(true, 400)), other = f.join(hello(false, 1000));
  f.c.report_loaded(tracer);
  f.c.report_loaded(other);
  EXPECT_TRUE(f.c.ordered[tracer].contains(3));
  EXPECT_TRUE(f.c.ordered[tracer].contains(4));
  EXPECT_FALSE(f.c.ordered[other].empty());
  for (const std::uint32_t p : f.c.ordered[other]) EXPECT_LE(p, 2u);
  ASSERT_EQ(f.c.core.phase(), Phase::rendering);
  EXPECT_TRUE(f.c.tasks[other].empty());
  EXPECT_FALSE(f.c.tasks[tracer].empty());
  bool told = false;
  for (const wire::HostEntry& e : f.c.maps[tracer].hosts()) told |= e.only_intersects() && e.host() == other.value;
  EXPECT_TRUE(told);
}

TEST(KindsOfHosts, OneThatOnlyIntersectsNeedsNoRoomForTheMainScene) {
  JobSpec j = manager_test::job(3);
  j.parts[0].bytes = 5000;
  j.part_features = {{}, {"triangles"}, {"triangles"}};
  ManagerOptions o;
  o.min_hosts = 2;
  Fixture f(j, o);
  const HostId tracer = f.join(hello(true, 5100)), small = f.join(hello(false, 150));
  EXPECT_EQ(f.c.ordered[tracer].size(), 1u);
  EXPECT_EQ(f.c.ordered[small].size(), 1u);
}

TEST(KindsOfHosts, ThoseThatOnlyIntersectWaitForOneThatTraces) {
  Fixture f;
  const HostId first = f.join(hello(false, 10000));
  f.c.report_loaded(first);
  f.c.core.tick(10);
  EXPECT_EQ(f.c.core.phase(), Phase::loading);
  EXPECT_NE(f.c.core.waiting_for().find("trace paths"), std::string::npos) << f.c.core.waiting_for();
  EXPECT_EQ(f.c.core.progress().tracers, 0u);
  f.c.now = 10;
  const HostId tracer = f.join(hello(true, 10000));
  f.c.report_loaded(first);
  f.c.report_loaded(tracer);
  ASSERT_EQ(f.c.core.phase(), Phase::rendering);
  EXPECT_EQ(f.c.core.waiting_for(), "");

  // And again when it has gone, with all that it has not done.
  f.c.work(1);
  f.c.core.host_lost(tracer, f.c.now);
  f.c.gone.insert(tracer);
  EXPECT_EQ(f.c.core.phase(), Phase::rendering);
  const HostId next = f.join(hello(true, 10000));
  f.c.report_loaded(next);
  f.c.work();
  EXPECT_EQ(f.c.core.progress().paths_done, f.c.core.progress().paths_total);
}

TEST(KindsOfHosts, WhatTheLastThatTracesCannotLoadEndsTheJob) {
  Fixture f;
  f.join(hello(false, 10000));
  const HostId tracer = f.join(hello(true, 10000));
  wire::LoadReport report;
  report.set_job(1);
  report.set_error("the main scene does not fit");
  f.c.core.receive(tracer, report, 1);
  EXPECT_EQ(f.c.core.phase(), Phase::failed);
  EXPECT_NE(f.c.core.error().find("does not fit"), std::string::npos) << f.c.core.error();
}

TEST(KindsOfHosts, TheLastThatTracesMayLeave) {
  ManagerOptions o;
  o.min_hosts = 2;
  Fixture f(mixed_job(), o);
  const HostId tracer = f.join(hello(true, 10000)), other = f.join(hello(false, 10000));
  f.c.report_loaded(tracer);
  f.c.report_loaded(other);
  ASSERT_EQ(f.c.core.phase(), Phase::rendering);
  f.c.core.receive(tracer, wire::Leave(), f.c.now);
  f.c.work();
  wire::Status idle;
  idle.set_idle(true);
  idle.set_epoch(1000);
  f.c.core.receive(tracer, idle, f.c.now);
  f.c.core.receive(tracer, idle, f.c.now);
  f.c.listen();
  EXPECT_TRUE(f.c.ended.contains(tracer));
  EXPECT_EQ(f.c.core.phase(), Phase::rendering);
}

TEST(KindsOfHosts, PartsGoOnlyWhereTheirFeaturesAre) {
  ManagerOptions o;
  o.min_hosts = 2;
  Fixture f(mixed_job(), o);
  const HostId all = f.join(hello(true, 10000)), few = f.join(hello(true, 10000, {"triangles", "quadrics"}));
  EXPECT_TRUE(f.c.ordered[all].contains(4));
  EXPECT_FALSE(f.c.ordered[few].contains(4));
  EXPECT_TRUE(f.c.ordered[few].contains(3));
}

TEST(KindsOfHosts, AnInexactHostSetsNoMeasure) {
  Fixture f;
  wire::Hello other = hello(true, 10000);
  other.set_fingerprint(0);
  EXPECT_NE(f.c.core.join(other, 0).error().find("--allow-inexact"), std::string::npos);
  other.set_allow_inexact(true);
  f.join(other);
  EXPECT_FALSE(f.c.core.bit_exact());
  f.join(hello(true, 10000));
  wire::Hello third = hello(true, 10000);
  third.set_fingerprint(8);
  third.set_instruction_set("sse4.2");
  EXPECT_NE(f.c.core.join(third, 0).error().find("sse4.2"), std::string::npos);
}

TEST(KindsOfHosts, SegmentsRatherMoveThanAreAskedAbout) {
  wire::SceneHostMap map;
  map.set_epoch(1);
  map.set_part_count(2);
  for (const std::uint32_t host : {2u, 3u}) {
    auto& e = *map.add_hosts();
    e.set_host(host);
    e.set_only_intersects(host == 2);
    auto& holding = *map.add_holdings();
    holding.set_host(host);
    holding.add_parts(1);
  }
  const auto target = [&] {
    const Routing r(map, HostId(1), 0.25f);
    return r.host(r.target(PartId(1))).value;
  };
  EXPECT_EQ(target(), 3u);
  map.mutable_hosts(1)->set_load_s(1);  // but not at any price
  EXPECT_EQ(target(), 2u);
}

TEST(KindsOfHosts, OlderSplitsDoNotTellWhatTheirPartsNeed) {
  EXPECT_EQ(feature_names(0).size(), kPartFeatures.size());
  EXPECT_EQ(feature_names(kHasTriangles | kHasAlpha), (std::vector<std::string>{"triangles", "alpha"}));
}

// An engine of which nothing is asked but which candidates are marked.
class MarksAll final : public PathEngine {
 public:
  void camera(const RendererRange&, std::uint16_t, std::uint64_t, std::uint64_t, std::vector<PathSegment>&) const override {}
  void trace(SegmentBatch&) const override {}
  void route(SegmentBatch&) const override {}
  void shade(SegmentBatch&, ShadeOutput&) const override {}
  std::vector<bool> occluded(std::span<const OcclusionRay>, std::span<const float>, std::span<std::uint8_t>) const override {
    return {};
  }
  void nearest(std::span<const OcclusionRay>, std::span<AnsweredHit>) const override {}
  void mark_tested(PathSegment& s, float, const std::vector<bool>& answered) const override {
    for (std::size_t p = 0; p < answered.size(); ++p) s.tested |= std::uint64_t{answered[p]} << p;
  }
  std::uint32_t film_width() const override { return 1; }
};

TEST(KindsOfHosts, OfTwoHitsTheFirstInTheOrderOfHitsCounts) {
  wire::SceneHostMap map;
  map.set_part_count(4);
  map.add_hosts()->set_host(2);
  auto& holding = *map.add_holdings();
  holding.set_host(2);
  holding.add_parts(3);
  TraceWork::Returned back;
  back.by = HostId(2);
  back.at = std::make_shared<const Routing>(map, HostId(1), 0.25f);
  KeptSegments kept;
  kept.segments = std::make_shared<const std::vector<PathSegment>>(4);
  kept.hits.resize(4);
  for (Hit& h : kept.hits) h = {5.f, 0, 0, 1, 0xffffffffu, 0, 0, 10, 0};
  kept.hits[3] = {5.f, 0, 0, kAnsweredPart, 0xffffffffu, kAnsweredHit, 0, 10, 0};  // of a third host
  kept.surfaces.resize(1);
  kept.surfaces[0].material = 33;
  back.kept.push_back(kept);
  back.nearest.count = 4;
  back.nearest.found = {0b1011};
  back.nearest.hits = {{4.f, 0, 0, 20, 0, {}}, {5.f, 0, 0, 11, 0, {}}, {6.f, 0, 0, 1, 0, {}}};
  back.nearest.hits[0].surface.material = 44;
  SegmentBatch batch;
  batch.surfaces.resize(3);  // what has gathered before
  take_back(MarksAll(), back, batch);
  ASSERT_EQ(batch.size(), 4u);
  EXPECT_EQ(batch.hits[0].part, kAnsweredPart);
  EXPECT_EQ(batch.surfaces[batch.hits[0].index].material, 44u);
  EXPECT_EQ(batch.hits[1].part, 1u);  // as far, but a later shape
  EXPECT_EQ(batch.hits[2].part, 1u);  // nothing was found
  EXPECT_EQ(batch.surfaces[batch.hits[3].index].material, 33u);
  for (const PathSegment& s : batch.segments) EXPECT_EQ(s.tested, 0b1000u);
}

}  // namespace
}  // namespace cloudrenderer
