// How far is the program from Embree alone? Renders some of a scene on one thread, records its rays, and lets Embree
// trace the same rays in the same order, with nothing around it. Also: what loading costs against Embree's own build.
#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <numeric>

#include "bare_embree.h"
#include "integrator/path_tracer.h"
#include "parts/split.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBatch = 16384;  // as a worker's
constexpr std::size_t kFew = 2048;     // local work below this waits for more camera rays, as in a worker

double now() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double seconds_of(const std::function<void()>& f) {
  const double start = now();
  f();
  return now() - start;
}

// The median of some runs.
double median_of(int runs, const std::function<void()>& f) {
  std::vector<double> times;
  for (int i = 0; i < runs; ++i) times.push_back(seconds_of(f));
  std::sort(times.begin(), times.end());
  return times[times.size() / 2];
}

Part must_read(const std::string& path) {
  Result<Part> part = read_part_file(path);
  if (!part) throw std::runtime_error(path + ": " + part.error());
  return std::move(*part);
}

struct Recorded {
  std::vector<OcclusionRay> camera, bounce, shadow;
  double seconds = 0;  // of the engine and the loop around it
  std::uint64_t paths = 0;
};

OcclusionRay ray_of(const PathSegment& s) { return {s.origin, s.direction, kInfinity}; }

// Tiles of all samples, in an order in which any number of the first ones lie all over the picture.
std::vector<RendererRange> spread_tiles(const FilmFrame& f, std::uint32_t spp) {
  constexpr std::uint32_t kSide = 16;
  std::vector<RendererRange> tiles;
  for (std::uint32_t y = f.y0; y < f.y1; y += kSide)
    for (std::uint32_t x = f.x0; x < f.x1; x += kSide)
      tiles.push_back({0, x, y, std::min(x + kSide, f.x1), std::min(y + kSide, f.y1), 0, spp});
  // Steps by the golden ratio.
  std::size_t step = std::max<std::size_t>(1, tiles.size() * 618 / 1000);
  while (std::gcd(step, tiles.size()) != 1) ++step;
  std::vector<RendererRange> spread;
  for (std::size_t i = 0; i < tiles.size(); ++i) spread.push_back(tiles[i * step % tiles.size()]);
  return spread;
}

// Renders until there are about `most` rays; with `record`, keeps them. Both runs do the same work.
Recorded render(PathTracer& tracer, std::uint64_t most, bool record) {
  Recorded out;
  const std::vector<RendererRange> tiles = spread_tiles(tracer.job().film.frame, tracer.job().spp);
  std::size_t tile = 0;
  std::uint64_t made = 0;  // of the tile
  if (record) tracer.record_shadow_rays(&out.shadow);
  std::uint64_t rays = 0;
  const double start = now();
  SegmentBatch batch;
  for (;;) {
    while (batch.size() < kFew && tile < tiles.size() && rays < most) {
      const std::uint64_t n = std::min<std::uint64_t>(kBatch, tiles[tile].paths() - made);
      tracer.camera(tiles[tile], 1, made, n, batch.segments);
      out.paths += n;
      made += n;
      if (made == tiles[tile].paths()) {
        made = 0;
        ++tile;
      }
    }
    if (batch.size() == 0) break;
    rays += batch.size();
    if (record)
      for (const PathSegment& s : batch.segments) ((s.flags & kCameraRay) ? out.camera : out.bounce).push_back(ray_of(s));
    tracer.trace(batch);
    ShadeOutput shaded;
    tracer.shade(batch, shaded);
    rays += shaded.counts.shadow;
    batch = {};
    batch.segments = std::move(shaded.continuing);
  }
  out.seconds = now() - start;
  tracer.record_shadow_rays(nullptr);
  return out;
}

// A folder for the split, removed at the end.
struct Scratch {
  std::string path = (fs::temp_directory_path() / "cloudrenderer-XXXXXX").string();
  Scratch() {
    if (!mkdtemp(path.data())) throw std::runtime_error("cannot make a temporary folder");
  }
  ~Scratch() { fs::remove_all(path); }
};

struct Options {
  std::string scene, isa = kEmbreeIsa;
  std::uint64_t rays = 8'000'000;
  int runs = 3;
};

void row(const char* what, double seconds, std::size_t rays, double of) {
  std::printf("| %-46s | %8.3f | %8.1f | %6.3f |\n", what, seconds, rays ? seconds * 1e9 / static_cast<double>(rays) : 0.0,
              seconds / of);
}

void run(const Options& o) {
  Warnings warnings;
  SplitOptions split;
  split.part_size = std::uint64_t{1} << 40;  // one part
  const Scratch scratch;
  Manifest manifest;
  const double reading = seconds_of([&] { manifest = split_scene(o.scene, scratch.path, split, warnings); });

  Resident resident({1, o.isa, {}, {}});
  prepare_compute_thread();
  const JobSettings job = job_settings(manifest.scene, {}, warnings);
  std::vector<Part> parts, prototypes;
  for (std::uint32_t i = 0; i < manifest.prototypes.size(); ++i) prototypes.push_back(must_read(prototype_path(scratch.path, i)));
  for (std::uint32_t i = 0; i < manifest.parts.size(); ++i) parts.push_back(must_read(part_path(scratch.path, i)));
  double building = 0;
  for (std::uint32_t i = 0; i < prototypes.size(); ++i)
    building += seconds_of([&] { resident.load_prototype(i, prototypes[i]); });
  PathTracer tracer(manifest, job, parts[0], resident, warnings);
  for (std::uint32_t i = 1; i < parts.size(); ++i) building += seconds_of([&] { resident.load_part(PartId{i}, parts[i]); });

  const auto bare = [&](bool robust) {
    auto scene = std::make_unique<BareEmbree>(robust, o.isa.c_str());
    for (const Part& p : prototypes) scene->add_prototype(p);
    for (const Part& p : parts) scene->add_part(p);
    scene->commit();
    return scene;
  };
  std::unique_ptr<BareEmbree> robust, loose;
  const double bare_building = seconds_of([&] { robust = bare(true); });
  loose = bare(false);

  std::uint64_t triangles = 0, text = 0;
  for (const Part& p : parts) triangles += p.triangles.size();
  for (const Part& p : prototypes) triangles += p.triangles.size();
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(o.scene).parent_path()))
    if (entry.is_regular_file() && (entry.path().extension() == ".pbrt" || entry.path().extension() == ".ply")) text += entry.file_size();

  const Recorded rays = render(tracer, o.rays, true);
  std::vector<double> totals, traces, occlusions, shades, cameras;
  for (int i = 0; i < o.runs; ++i) {
    const auto& t = tracer.time();
    const auto read = [&] { return std::array{t.camera.load(), t.trace.load(), t.shade.load(), t.occlusion.load()}; };
    const auto before = read();
    totals.push_back(render(tracer, o.rays, false).seconds);
    const auto after = read();
    const auto spent = [&](std::size_t k) { return 1e-9 * static_cast<double>(after[k] - before[k]); };
    cameras.push_back(spent(0));
    traces.push_back(spent(1));
    shades.push_back(spent(2) - spent(3));
    occlusions.push_back(spent(3));
  }
  const auto median = [](std::vector<double> v) {
    std::sort(v.begin(), v.end());
    return v[v.size() / 2];
  };
  const double total = median(totals);
  const std::size_t moving = rays.camera.size() + rays.bounce.size();

  std::printf("%s: %zu camera, %zu bounce, %zu shadow rays of %llu paths; %llu triangles, %zu other shapes%s\n\n", o.scene.c_str(),
              rays.camera.size(), rays.bounce.size(), rays.shadow.size(), static_cast<unsigned long long>(rays.paths),
              static_cast<unsigned long long>(triangles), robust->left_out(), robust->left_out() ? " (not in bare Embree's scene)" : "");
  std::printf("| processor time, one thread                     |  seconds |  ns a ray | of all |\n|---|---|---|---|\n");
  row("our render: all", total, moving + rays.shadow.size(), total);
  row("our render: tracing camera and bounce rays", median(traces), moving, total);
  row("our render: shadow rays", median(occlusions), rays.shadow.size(), total);
  row("our render: shading", median(shades), 0, total);
  row("our render: camera", median(cameras), rays.camera.size(), total);
  const auto replay = [&](const char* name, const BareEmbree& scene, bool packets) {
    std::uint64_t hits = 0;
    const double found = median_of(o.runs, [&] {
      hits += scene.intersect(rays.camera, packets, packets) + scene.intersect(rays.bounce, packets, false);
    });
    const double blocked = median_of(o.runs, [&] { hits += scene.occluded(rays.shadow, packets); });
    row((std::string(name) + ": camera and bounce rays").c_str(), found, moving, total);
    row((std::string(name) + ": shadow rays").c_str(), blocked, rays.shadow.size(), total);
    row((std::string(name) + ": together").c_str(), found + blocked, moving + rays.shadow.size(), total);
    if (hits == 0) throw std::runtime_error("bare Embree hits nothing");
  };
  replay("bare Embree, robust, packets", *robust, true);
  replay("bare Embree, robust, one by one", *robust, false);
  replay("bare Embree, not robust, packets", *loose, true);

  std::printf("\nreading, subdividing and splitting: %.2f s; %.1f MB of scene text and meshes beside the scene: %.0f MB/s\n", reading,
              1e-6 * static_cast<double>(text), 1e-6 * static_cast<double>(text) / reading);
  std::printf("building: ours %.3f s, %.2f M triangles/s; bare Embree %.3f s (ours / Embree's %.2f)\n", building,
              1e-6 * static_cast<double>(triangles) / building, bare_building, building / bare_building);
  std::printf("memory: ours %.1f bytes a triangle, vertices, normals and indices included; Embree's BVH alone %.1f\n",
              static_cast<double>(resident.bytes()) / static_cast<double>(std::max<std::uint64_t>(1, triangles)),
              static_cast<double>(robust->bytes()) / static_cast<double>(std::max<std::uint64_t>(1, triangles)));
  std::printf("a live path: %zu bytes (segment %zu, hit %zu, part to go to %zu)\n", sizeof(PathSegment) + sizeof(Hit) + sizeof(PartId),
              sizeof(PathSegment), sizeof(Hit), sizeof(PartId));
}

}  // namespace
}  // namespace cloudrenderer

int main(int argc, char** argv) {
  cloudrenderer::Options o;
  CLI::App app("Compares a render's rays with bare Embree's");
  app.add_option("scene", o.scene, "a .pbrt file")->required();
  app.add_option("--rays", o.rays, "about how many rays to record (24 bytes each; default 8000000)");
  app.add_option("--runs", o.runs, "medians of so many (default 3)")->check(CLI::PositiveNumber);
  app.add_option("--isa", o.isa, "Embree's max_isa (default: the most that the processor has, as hosts have it)");
  CLI11_PARSE(app, argc, argv);
  try {
    cloudrenderer::run(o);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "bench_ceiling: %s\n", e.what());
    return 1;
  }
}
