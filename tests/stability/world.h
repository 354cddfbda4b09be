#pragma once
// A scene from its text to what rays find in it, through the reader, the splitter and the path tracer: nothing stands in
// for anything.
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "../parts_support.h"
#include "base/random.h"
#include "integrator/path_tracer.h"
#include "parts/split.h"

namespace cloudrenderer::stability {

class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double uniform() { return static_cast<double>(mix64(state_++) >> 11) * 0x1p-53; }
  double uniform(double lo, double hi) { return lo + (hi - lo) * uniform(); }
  double log_uniform(double lo, double hi) { return lo * std::pow(hi / lo, uniform()); }
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>(uniform() * n); }
  glm::dvec3 direction() {
    const double z = uniform(-1, 1), phi = uniform(0, 2 * M_PI), r = std::sqrt(1 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
  }

 private:
  std::uint64_t state_;
};

struct ProbeRay {
  Vec3 origin, direction;
};

inline SegmentBatch batch_of(const std::vector<ProbeRay>& rays) {
  SegmentBatch batch;
  batch.segments.resize(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    PathSegment& s = batch.segments[i];
    s.origin = rays[i].origin;
    s.direction = rays[i].direction;
    s.throughput = Rgb(1.f);
    s.pixel = static_cast<std::uint32_t>(i);
    s.flags = kSpecularBounce;
  }
  return batch;
}

class World {
 public:
  static constexpr const char* kHead =
      "Camera \"perspective\"\nFilm \"image\" \"integer xresolution\" [16] \"integer yresolution\" [16] "
      "\"string filename\" \"a.exr\"\nSampler \"sobol\" \"integer pixelsamples\" [4]\n"
      "Integrator \"path\" \"integer maxdepth\" [5]\n";

  // `shapes` is what stands between WorldBegin and WorldEnd, `head` what comes before, in pbrt-v3's dialect. part_size:
  // small ones cut the scene into parts.
  explicit World(const std::string& shapes, std::uint64_t part_size = std::uint64_t{64} << 20, const std::string& head = kHead) {
    prepare_compute_thread();
    std::ofstream(folder_.path("scene.pbrt")) << head << "\nWorldBegin\n" << shapes << "\nWorldEnd\n";
    SplitOptions options;
    options.part_size = part_size;
    options.dialect = Dialect::v3;
    Warnings warnings;
    manifest_ = split_scene(folder_.path("scene.pbrt"), split(), options, warnings);
    const auto read = [](const std::string& path) { return *read_part_file(path); };
    tracer_ = std::make_unique<PathTracer>(manifest_, job_settings(manifest_.scene, {}, warnings), read(part_path(split(), 0)), resident_, warnings);
    for (std::uint32_t i = 0; i < manifest_.prototypes.size(); ++i) resident_.load_prototype(i, read(prototype_path(split(), i)));
    for (std::uint32_t i = 1; i < manifest_.parts.size(); ++i) resident_.load_part(PartId(i), read(part_path(split(), i)));
    for (const std::string& w : warnings.list()) ADD_FAILURE() << w;
  }
  std::size_t parts() const { return manifest_.parts.size(); }
  const Manifest& manifest() const { return manifest_; }
  const PathTracer& tracer() const { return *tracer_; }
  std::shared_ptr<const ResidentSet> set() const { return resident_.snapshot(); }

  // Nearest hits; a hit's part is kNone where there is none.
  SegmentBatch trace(const std::vector<ProbeRay>& rays) const {
    SegmentBatch batch = batch_of(rays);
    tracer_->trace(batch);
    return batch;
  }

 private:
  std::string split() const { return folder_.path("split"); }
  parts_test::TemporaryFolder folder_;
  Manifest manifest_;
  Resident resident_{Resident::Options{}};
  std::unique_ptr<PathTracer> tracer_;
};

}  // namespace cloudrenderer::stability
