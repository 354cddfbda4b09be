// Walks below surfaces: the same bits however the scene is cut into parts and its paths into batches.
#include <gtest/gtest.h>

#include <fstream>
#include <map>

#include "integrator/path_tracer.h"
#include "parts/split.h"
#include "parts_support.h"

namespace cloudrenderer {
namespace {

// Rough and smooth boundaries, a mix, textured coefficients, something opaque inside, an instance; lamps outside.
constexpr const char* kScene = R"(
LookAt 0 -6 2  0 0 0.5  0 0 1
Camera "perspective" "float fov" [40]
Film "image" "integer xresolution" [16] "integer yresolution" [16] "string filename" "subsurface.exr"
Sampler "sobol" "integer pixelsamples" [4]
Integrator "path" "integer maxdepth" [4]
WorldBegin
LightSource "point" "rgb I" [9 9 9] "point from" [2 -3 4]
LightSource "infinite" "rgb L" [.2 .3 .4]
Material "matte"
Shape "trianglemesh" "point P" [-4 -4 -.6  4 -4 -.6  4 4 -.6  -4 4 -.6] "integer indices" [0 1 2 2 3 0]
AttributeBegin
Translate -.6 0 .4
Material "subsurface" "rgb sigma_a" [.1 .2 .4] "rgb sigma_s" [6 5 4] "float uroughness" [.2] "float vroughness" [.2] "float g" [.6]
Shape "loopsubdiv" "integer nlevels" [4] "point P" [1 0 0  -1 0 0  0 1 0  0 -1 0  0 0 1  0 0 -1]
  "integer indices" [0 2 4  2 1 4  1 3 4  3 0 4  2 0 5  1 2 5  3 1 5  0 3 5]
Material "plastic" "rgb Kd" [.7 .1 .1]
Shape "sphere" "float radius" [.2]
AttributeEnd
Texture "board" "spectrum" "checkerboard" "float uscale" [4] "float vscale" [4] "rgb tex1" [2 3 4] "rgb tex2" [20 10 5]
ObjectBegin "ball"
Material "subsurface" "texture sigma_s" "board" "rgb sigma_a" [.3 .3 .1]
Shape "sphere" "float radius" [.5]
ObjectEnd
AttributeBegin
Translate .9 -.2 .2
ObjectInstance "ball"
AttributeEnd
MakeNamedMaterial "skin" "string type" "kdsubsurface" "rgb Kd" [.8 .5 .4] "rgb mfp" [.1 .05 .02]
MakeNamedMaterial "paint" "string type" "matte"
Material "mix" "string namedmaterial1" "skin" "string namedmaterial2" "paint"
Translate .2 1.2 .5
Shape "loopsubdiv" "integer nlevels" [4] "point P" [1 0 0  -1 0 0  0 1 0  0 -1 0  0 0 1  0 0 -1]
  "integer indices" [0 2 4  2 1 4  1 3 4  3 0 4  2 0 5  1 2 5  3 1 5  0 3 5]
WorldEnd
)";

using Sums = std::map<std::pair<std::uint32_t, std::uint32_t>, Fixed3>;

class Cluster {
 public:
  // Parts of at most this size; every `hosts`-th of them is on the same one.
  Cluster(const std::string& scene, std::uint64_t part_size, std::size_t hosts) {
    const std::string split = folder_.path("split");
    SplitOptions options;
    options.part_size = part_size;
    manifest_ = split_scene(scene, split, options, warnings_);
    const auto read = [](const std::string& path) { return *read_part_file(path); };
    for (std::size_t h = 0; h < hosts; ++h) {
      residents_.push_back(std::make_unique<Resident>(Resident::Options{}));
      tracers_.push_back(std::make_unique<PathTracer>(manifest_, job_settings(manifest_.scene, {}, warnings_), read(part_path(split, 0)),
                                                      *residents_[h], warnings_));
      for (std::uint32_t i = 0; i < manifest_.prototypes.size(); ++i) residents_[h]->load_prototype(i, read(prototype_path(split, i)));
      for (std::uint32_t i = 1; i < parts(); ++i)
        if (i % hosts == h) residents_[h]->load_part(PartId(i), read(part_path(split, i)));
    }
  }
  std::uint32_t parts() const { return static_cast<std::uint32_t>(manifest_.parts.size()); }
  std::uint64_t moves() const { return moves_; }

  Sums render(std::size_t batch_size) {
    const JobSettings& job = tracers_[0]->job();
    const FilmFrame& f = job.film.frame;
    const RendererRange range{0, f.x0, f.y0, f.x1, f.y1, 0, job.spp};
    for (std::uint64_t made = 0; made < range.paths(); made += batch_size) {
      std::vector<PathSegment> segments;
      tracers_[0]->camera(range, 1, made, std::min<std::uint64_t>(batch_size, range.paths() - made), segments);
      follow(std::move(segments));
    }
    return std::move(sums_);
  }

 private:
  using Segments = std::vector<PathSegment>;

  // Paths go from host to host until they end.
  void follow(Segments segments) {
    std::vector<Segments> at(tracers_.size());
    at[0] = std::move(segments);
    for (bool busy = true; busy;) {
      busy = false;
      for (std::size_t h = 0; h < tracers_.size(); ++h) {
        if (at[h].empty()) continue;
        busy = true;
        SegmentBatch batch;
        batch.segments = std::move(at[h]);
        at[h].clear();
        tracers_[h]->trace(batch);
        std::vector<SegmentBatch> found(tracers_.size());
        for (std::size_t i = 0; i < batch.size(); ++i) find(h, batch, i, found);
        for (std::size_t g = 0; g < tracers_.size(); ++g) shade(g, found[g], at[g]);
      }
    }
  }

  // Conditional moves of one segment: whoever has a nearer hit has it from there on.
  void find(std::size_t host, const SegmentBatch& traced, std::size_t i, std::vector<SegmentBatch>& found) {
    SegmentBatch own;
    own.segments = {traced.segments[i]};
    own.hits = {traced.hits[i]};
    own.next = {traced.next[i]};
    while (own.next[0]) {
      ++moves_;
      const std::size_t other = own.next[0].value % tracers_.size();
      SegmentBatch moved;
      moved.segments = own.segments;
      Hit known;
      known.t = own.segments[0].best.t;
      known.shape = own.segments[0].best.shape;
      known.primitive = own.segments[0].best.primitive;
      moved.hits = {known};
      tracers_[other]->trace(moved);
      if (moved.hits[0].part != kNone) {
        own = std::move(moved);
        host = other;
        continue;
      }
      own.segments[0].tested = moved.segments[0].tested;
      own.segments[0].window = moved.segments[0].window;
      tracers_[host]->route(own);
    }
    found[host].segments.push_back(own.segments[0]);
    found[host].hits.push_back(own.hits[0]);
  }

  void shade(std::size_t host, SegmentBatch& batch, Segments& next) {
    ShadeOutput out;
    tracers_[host]->shade(batch, out);
    next.insert(next.end(), out.continuing.begin(), out.continuing.end());
    for (const PathEnd& e : out.ended) ended(e.pixel, e.sample, e.radiance);
    for (const ShadowAsk& a : out.asks) {
      ParkedPath& p = out.parked[a.parked];
      bool free = true;
      for (const auto& t : tracers_) {
        std::uint8_t blocked = 0;
        t->occluded(std::span(&a.ray, 1), {}, std::span(&blocked, 1));
        free = free && !blocked;
      }
      if (free)
        for (std::size_t c = 0; c < 3; ++c) p.segment.radiance[c] += a.contribution[c];
      if (p.ended)
        ended(p.segment.pixel, p.segment.sample, p.segment.radiance);
      else
        next.push_back(p.segment);
    }
  }
  void ended(std::uint32_t pixel, std::uint32_t sample, const Fixed3& radiance) {
    EXPECT_TRUE(sums_.emplace(std::pair(pixel, sample), radiance).second);
  }

  parts_test::TemporaryFolder folder_;
  Warnings warnings_;
  Manifest manifest_;
  std::vector<std::unique_ptr<Resident>> residents_;
  std::vector<std::unique_ptr<PathTracer>> tracers_;
  Sums sums_;
  std::uint64_t moves_ = 0;
};

TEST(Subsurface, HasTheSameBitsWholeSplitAndOverHosts) {
  prepare_compute_thread();
  const parts_test::TemporaryFolder folder;
  const std::string scene = folder.path("scene.pbrt");
  std::ofstream(scene) << kScene;
  Cluster whole(scene, std::uint64_t{64} << 20, 1), parts(scene, 60000, 1), hosts(scene, 60000, 3);
  EXPECT_EQ(whole.parts(), 2u);
  EXPECT_GE(parts.parts(), 5u);
  const Sums sums = whole.render(100000);
  EXPECT_EQ(sums.size(), 16u * 16u * 4u);
  std::size_t lit = 0;
  for (const auto& [where, radiance] : sums) lit += radiance[0] > 0 ? 1 : 0;
  EXPECT_GT(lit, 800u);
  EXPECT_EQ(parts.render(37), sums);
  EXPECT_EQ(hosts.render(100000), sums);
  EXPECT_GT(hosts.moves(), 300u);
}

}  // namespace
}  // namespace cloudrenderer
