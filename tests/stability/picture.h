#pragma once
// A scene from its text to its film, once in one part and once cut into many, which must give the same sums.
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "../parts_support.h"
#include "integrator/path_tracer.h"
#include "parts/split.h"

namespace cloudrenderer::stability {

struct Picture {
  Film film;
  RayCounts counts;
  std::uint64_t samples = 0;
  float lowest = 0;  // of all channels of all pixels

  double mean(int channel = 1) const {
    double sum = 0;
    const Image image = film.image(1.f);
    for (const Rgb& c : image.pixels) sum += static_cast<double>(c[channel]);
    return sum / static_cast<double>(image.pixels.size());
  }
};

inline Picture render_cut(const std::string& text, Dialect dialect, std::uint64_t part_size) {
  prepare_compute_thread();
  const parts_test::TemporaryFolder folder;
  const std::string scene = folder.path("scene.pbrt"), split = folder.path("split");
  std::ofstream(scene) << text;
  SplitOptions options;
  options.part_size = part_size;
  options.dialect = dialect;
  Warnings warnings;
  const Manifest m = split_scene(scene, split, options, warnings);
  Resident resident({});
  const auto read = [](const std::string& path) { return *read_part_file(path); };
  const PathTracer tracer(m, job_settings(m.scene, {}, warnings), read(part_path(split, 0)), resident, warnings);
  for (std::uint32_t i = 0; i < m.prototypes.size(); ++i) resident.load_prototype(i, read(prototype_path(split, i)));
  for (std::uint32_t i = 1; i < m.parts.size(); ++i) resident.load_part(PartId(i), read(part_path(split, i)));

  const FilmFrame& f = tracer.job().film.frame;
  Picture out{Film(f, tracer.job().k, tracer.job().lobes), {}, 0, 0};
  const RendererRange range{0, f.x0, f.y0, f.x1, f.y1, 0, tracer.job().spp};
  constexpr std::uint64_t kBatch = 16384;
  for (; out.samples < range.paths(); out.samples += std::min(kBatch, range.paths() - out.samples)) {
    SegmentBatch batch;
    tracer.camera(range, 1, out.samples, std::min(kBatch, range.paths() - out.samples), batch.segments);
    while (batch.size() != 0) {
      tracer.trace(batch);
      ShadeOutput shaded;
      tracer.shade(batch, shaded);
      for (const PathEnd& e : shaded.ended)
        out.film.at(e.pixel % f.width, e.pixel / f.width, tracer.in_negative_lobe(e.pixel, e.sample, false)).add(e.radiance, e.sample);
      out.counts += shaded.counts;
      batch = {};
      batch.segments = std::move(shaded.continuing);
    }
  }
  for (const Rgb& c : out.film.image(1.f).pixels)
    for (int i = 0; i < 3; ++i) {
      EXPECT_TRUE(std::isfinite(c[i]));
      out.lowest = std::min(out.lowest, c[i]);
    }
  EXPECT_EQ(out.counts.invalid, 0u);
  EXPECT_EQ(out.counts.clamped, 0u);
  return out;
}

// `cut`: also in parts of this many bytes, whose sums must be the same bits.
inline Picture render(const std::string& text, Dialect dialect = Dialect::v3, std::uint64_t cut = 0) {
  Picture whole = render_cut(text, dialect, std::uint64_t{64} << 20);
  EXPECT_GE(whole.lowest, 0.f) << "negative radiance";
  if (cut) {
    const Picture parts = render_cut(text, dialect, cut);
    std::size_t others = 0;
    for (std::size_t i = 0; i < whole.film.sums().size(); ++i) others += whole.film.sums()[i].sum != parts.film.sums()[i].sum;
    EXPECT_EQ(others, 0u) << "pixels that the cut changes";
  }
  return whole;
}

// Camera and film before the world; `spp` samples in each of size x size pixels.
inline std::string header(const std::string& look_at, int size, std::uint64_t spp, int depth, double fov = 40,
                          const std::string& more = "") {
  return "LookAt " + look_at + "\nCamera \"perspective\" \"float fov\" [" + std::to_string(fov) +
         "]\nFilm \"image\" \"integer xresolution\" [" + std::to_string(size) + "] \"integer yresolution\" [" +
         std::to_string(size) + "] \"string filename\" \"a.exr\"\nSampler \"sobol\" \"integer pixelsamples\" [" +
         std::to_string(spp) + "]\nIntegrator \"path\" \"integer maxdepth\" [" + std::to_string(depth) + "]\n" + more +
         "WorldBegin\n";
}

}  // namespace cloudrenderer::stability
