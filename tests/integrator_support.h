#pragma once
#include <gtest/gtest.h>

#include <map>

#include "integrator/path_tracer.h"

namespace cloudrenderer {

using Sums = std::map<std::pair<std::uint32_t, std::uint32_t>, Fixed3>;  // by pixel and sample

inline Sums render(const PathTracer& tracer, std::size_t batch_size, RayCounts& counts) {
  const FilmFrame& f = tracer.job().film.frame;
  const RendererRange range{0, f.x0, f.y0, f.x1, f.y1, 0, tracer.job().spp};
  Sums sums;
  for (std::uint64_t made = 0; made < range.paths();) {
    const std::uint64_t n = std::min<std::uint64_t>(batch_size, range.paths() - made);
    SegmentBatch batch;
    tracer.camera(range, 1, made, n, batch.segments);
    made += n;
    while (batch.size() != 0) {
      tracer.trace(batch);
      ShadeOutput out;
      tracer.shade(batch, out);
      for (const PathEnd& e : out.ended) EXPECT_TRUE(sums.emplace(std::pair(e.pixel, e.sample), e.radiance).second);
      EXPECT_TRUE(out.parked.empty());
      counts += out.counts;
      batch = {};
      batch.segments = std::move(out.continuing);
    }
  }
  return sums;
}

}  // namespace cloudrenderer
