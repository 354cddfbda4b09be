// What the core costs where nothing moves: the path of a segment through queues and results on one
// host.
#include <gtest/gtest.h>

#include <chrono>
#include <iostream>

#include "tasks_support.h"

namespace cloudrenderer {
namespace {

using Clock = std::chrono::steady_clock;

// Engine calls are timed and taken off.
class TrivialEngine final : public PathEngine {
 public:
  void camera(const RendererRange& r, std::uint16_t owner, std::uint64_t first, std::uint64_t count,
              std::vector<PathSegment>& out) const override {
    const Timer t(*this);
    const std::uint32_t samples = r.sample_end - r.sample_begin, width = r.x1 - r.x0;
    PathSegment s{};
    s.task = r.task;
    s.owner = owner;
    for (std::uint64_t i = first; i < first + count; ++i) {
      const auto pixel = static_cast<std::uint32_t>(i / samples);
      s.pixel = (r.y0 + pixel / width) * 1024 + r.x0 + pixel % width;
      s.sample = r.sample_begin + static_cast<std::uint32_t>(i % samples);
      out.push_back(s);
    }
  }
  void trace(SegmentBatch& b) const override {
    const Timer t(*this);
    b.hits.resize(b.size());
    b.next.assign(b.size(), PartId());
  }
  void route(SegmentBatch& b) const override { trace(b); }
  void shade(SegmentBatch& b, ShadeOutput& out) const override {
    const Timer t(*this);
    for (PathSegment& s : b.segments) {
      if (++s.vertex == 8)
        out.ended.push_back({s.task, s.pixel, s.sample, s.owner, 0, s.radiance});
      else
        out.continuing.push_back(s);
    }
    shaded += b.size();
  }
  std::vector<bool> occluded(std::span<const OcclusionRay>, std::span<const float>, std::span<std::uint8_t>) const override { return {}; }
  void nearest(std::span<const OcclusionRay>, std::span<AnsweredHit>) const override {}
  void mark_tested(PathSegment&, float, const std::vector<bool>&) const override {}
  std::uint32_t film_width() const override { return 1024; }

  mutable std::uint64_t shaded = 0;
  mutable Clock::duration inside{};

 private:
  struct Timer {
    explicit Timer(const TrivialEngine& e) : engine(e), start(Clock::now()) {}
    ~Timer() { engine.inside += Clock::now() - start; }
    const TrivialEngine& engine;
    Clock::time_point start;
  };
};

TEST(Overhead, OfTheCoreIsSmallAgainstTracingARay) {
  double best = 1e9;
  for (int attempt = 0; attempt < 5; ++attempt) {
    TrivialEngine engine;
    WorkerCore core(HostId(1), 1, {});
    std::set<std::uint32_t> resident;
    NoLoader loader(resident);
    wire::JobStart job;
    job.set_job(1);
    job.set_width(1024);
    job.set_height(1024);
    core.receive(kManagerHost, job, 0);
    while (auto w = core.take_load(0)) {
      WorkResult r = execute(loader, *w);
      core.finish(*w, r, 0);
    }
    core.receive(kManagerHost, map_of(1, 1, 1, {{1, {}}}), 0);
    for (std::uint32_t i = 0; i < 16; ++i)
      core.receive(
          kManagerHost,
          wire::SubmitTask{{2, i + 1}, 1, 1, RendererRange{i, i * 32, 0, i * 32 + 32, 32, 0, 16}},
          0);
    const auto start = Clock::now();
    while (auto w = core.take(0)) {
      WorkResult r = execute(engine, *w);
      core.finish(*w, r, 0);
    }
    const auto outside = Clock::now() - start - engine.inside;
    best = std::min(best, std::chrono::duration<double, std::nano>(outside).count() /
                              static_cast<double>(engine.shaded));
    ASSERT_EQ(engine.shaded, 16u * 32 * 32 * 16 * 8);
    std::size_t replies = 0;
    for (const auto& [to, m] : core.take_outbox())
      replies += std::holds_alternative<wire::Reply>(m);
    EXPECT_EQ(replies, 16u);
  }
  std::cout << "overhead of the core: " << best << " ns a segment\n";
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  EXPECT_LT(best, 60);  // about 10 on an idle machine; a busy one may take its time
#endif
}

}  // namespace
}  // namespace cloudrenderer
