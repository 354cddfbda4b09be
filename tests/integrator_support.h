#pragma once
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <optional>
#include <string>

#include "integrator/path_tracer.h"
#include "parts/split.h"
#include "parts_support.h"

namespace cloudrenderer {

// A scene that was split without warnings, with all of its parts loaded.
struct SplitScene {
  SplitScene(const std::string& text, std::uint64_t part_size, const JobOverrides& overrides = {}) {
    prepare_compute_thread();
    const parts_test::TemporaryFolder folder;
    const std::string scene = folder.path("scene.pbrt"), split = folder.path("split");
    std::ofstream(scene) << text;
    SplitOptions options;
    options.part_size = part_size;
    manifest = split_scene(scene, split, options, warnings);
    EXPECT_TRUE(warnings.list().empty()) << warnings.list()[0];
    const auto read = [](const std::string& path) { return *read_part_file(path); };
    tracer.emplace(manifest, job_settings(manifest.scene, overrides, warnings), read(part_path(split, 0)), resident, warnings);
    for (std::uint32_t i = 1; i < manifest.parts.size(); ++i) resident.load_part(PartId(i), read(part_path(split, i)));
  }
  Warnings warnings;  // of the tracer too
  Manifest manifest;
  Resident resident{{}};
  std::optional<PathTracer> tracer;
};

using Sums = std::map<std::pair<std::uint32_t, std::uint32_t>, Fixed3>;  // by pixel and sample

// shares: samples share camera rays, as many as the job says.
inline Sums render(const PathTracer& tracer, std::size_t batch_size, RayCounts& counts, bool shares = false) {
  const FilmFrame& f = tracer.job().film.frame;
  const RendererRange range{0, f.x0, f.y0, f.x1, f.y1, 0, tracer.job().spp, shares};
  Sums sums;
  SegmentBatch batch;
  for (std::uint64_t made = 0; made < range.paths() || batch.size() != 0;) {
    // Among those that go on.
    const std::uint64_t n = std::min<std::uint64_t>(batch_size, range.paths() - made);
    tracer.camera(range, 1, made, n, batch.segments);
    made += n;
    tracer.trace(batch);
    ShadeOutput out;
    tracer.shade(batch, out);
    for (const PathEnd& e : out.ended) EXPECT_TRUE(sums.emplace(std::pair(e.pixel, e.sample), e.radiance).second);
    EXPECT_TRUE(out.parked.empty());
    counts += out.counts;
    batch = {};
    batch.segments = std::move(out.continuing);
  }
  return sums;
}

}  // namespace cloudrenderer
