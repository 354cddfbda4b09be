#pragma once
// What one host with everything would bring home, without any cluster.
#include <vector>

#include "cluster_sim.h"
#include "made_up_engine.h"

namespace cloudrenderer::sim {

// What every path brings home and tells: pixel * spp + sample.
struct Reference {
  std::vector<PathEnd> paths;
  std::vector<PixelFeatures> features;
};
inline Reference reference(const Scenario& s) {
  MadeUpEngine engine(s.scene);
  for (std::uint32_t p = 0; p < s.scene.parts; ++p) engine.resident.insert(p);
  std::vector<PathEnd> paths(std::size_t{s.scene.width} * s.height * s.spp);
  std::vector<PixelFeatures> features(s.scene.features ? paths.size() : 0);
  SegmentBatch batch;
  engine.camera({0, 0, 0, s.scene.width, s.height, 0, s.spp}, 1, 0, paths.size(), batch.segments);
  while (!batch.segments.empty()) {
    batch.hits.clear();
    engine.trace(batch);
    ShadeOutput out;
    engine.shade(batch, out);
    for (const PathEnd& e : out.ended) paths[std::size_t{e.pixel} * s.spp + e.sample] = e;
    for (const PathFeatures& f : out.features) {
      PixelFeatures& to = features[std::size_t{f.pixel} * s.spp + f.sample];
      for (std::size_t i = 0; i < f.values.size(); ++i) to.sum[i] += f.values[i];
      if (!(f.flags & kTellsHit)) continue;
      ++to.hits;
      if (f.sample == 0) to.ids = f.ids;
    }
    batch.segments = std::move(out.continuing);
  }
  for (PixelFeatures& f : features) f.samples = 1;
  return {std::move(paths), std::move(features)};
}

}  // namespace cloudrenderer::sim
