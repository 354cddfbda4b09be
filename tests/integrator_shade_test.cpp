// What a path gathers is a function of the path: it does not depend on which batch its vertices are shaded in.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <set>

#include "integrator/path_time.h"
#include "integrator_support.h"
#include "parts/split.h"
#include "parts_support.h"

namespace cloudrenderer {
namespace {

// Some of everything that vertices can be: materials of several kinds, on meshes with and without normals and uvs, on
// quadrics, in instances, textured; lights of several kinds.
constexpr const char* kWorld = R"(
LookAt 0 -6 3  0 0 0.5  0 0 1
Camera "perspective" "float fov" [40]
Film "image" "integer xresolution" [24] "integer yresolution" [20] "string filename" "batches.exr"
Sampler "lowdiscrepancy" "integer pixelsamples" [4]
%INTEGRATOR%
WorldBegin
LightSource "point" "color I" [4 4 4] "point from" [2 -2 4]
LightSource "infinite" "color L" [.2 .3 .4]
AttributeBegin
AreaLightSource "diffuse" "color L" [5 5 5]
Material "matte" "color Kd" [0 0 0]
Translate -2 0 3
Shape "sphere" "float radius" [.4]
AttributeEnd
AttributeBegin
AreaLightSource "diffuse" "color L" [3 2 1]
Shape "trianglemesh" "point P" [2 1 3  2 2 3  1 2 3  1 1 3] "integer indices" [0 1 2 2 3 0]
AttributeEnd
Texture "board" "color" "checkerboard" "float uscale" [8] "float vscale" [8] "color tex1" [.2 .2 .2] "color tex2" [.8 .8 .8]
Material "matte" "texture Kd" "board"
Shape "trianglemesh" "point P" [-4 -4 0  4 -4 0  4 4 0  -4 4 0] "float uv" [0 0  1 0  1 1  0 1] "integer indices" [0 1 2 2 3 0]
Material "matte" "color Kd" [.5 .4 .3]
Shape "trianglemesh" "point P" [-4 4 0  4 4 0  4 4 4  -4 4 4] "float uv" [0 0  0 1  1 1  1 0] "integer indices" [0 1 2 2 3 0]
Material "plastic" "color Kd" [.3 .1 .1] "color Ks" [.5 .5 .5] "float roughness" [.1]
Shape "trianglemesh" "point P" [-2 0 0  0 0 0  -1 1 2  -1 -1 0] "normal N" [-1 0 -1  1 0 -1  0 1 1  0 -1 0]
  "integer indices" [0 1 2  1 3 2  3 0 2]
Material "plastic" "color Kd" [.1 .3 .1] "color Ks" [.3 .3 .3] "float roughness" [.02]
Shape "trianglemesh" "point P" [0 0 0  2 0 0  1 1 1  1 -1 0] "integer indices" [0 1 2  1 3 2  3 0 2]
Material "metal" "float roughness" [.05]
Translate 0 -1.5 .5
Shape "sphere" "float radius" [.5]
Material "glass"
Translate 1.2 0 0
Shape "sphere" "float radius" [.4]
ObjectBegin "thing"
Material "matte" "color Kd" [.2 .2 .6]
Shape "trianglemesh" "point P" [0 0 0  1 0 0  .5 0 1] "integer indices" [0 1 2]
ObjectEnd
Translate -3 0 0
ObjectInstance "thing"
ActiveTransform EndTime
Rotate 40 0 0 1
Translate .5 0 .3
ActiveTransform All
Shape "sphere" "float radius" [.5]
ObjectInstance "thing"
WorldEnd
)";

// The time of a path: over the pixels uniform, and in every pixel spread evenly over each half of its samples.
TEST(PathTime, IsUniformAndStratified) {
  JobSettings job;
  const Shutter shutter{0, 1}, later{2, 4};
  double sum = 0, squares = 0, with_film = 0;
  constexpr std::uint32_t kPixels = 500, kSamples = 32;
  for (std::uint32_t pixel = 0; pixel < kPixels; ++pixel) {
    std::array<std::array<int, kSamples / 2>, 2> strata{};
    for (std::uint32_t sample = 0; sample < kSamples; ++sample) {
      const float t = path_time(job, shutter, pixel, sample);
      ASSERT_GE(t, shutter.open);
      ASSERT_LE(t, shutter.close);
      const auto u = static_cast<double>(t);
      EXPECT_NEAR(path_time(job, later, pixel, sample), 2 + 2 * t, 1e-6);
      ++strata[sample % 2][std::min<std::size_t>(kSamples / 2 - 1, static_cast<std::size_t>(u * (kSamples / 2)))];
      sum += u;
      squares += u * u;
      const Vec2 film = SampleSequence(job.sequence, job.seed, pixel, sample).get_2d(0);
      with_film += (u - 0.5) * (static_cast<double>(film.x) - 0.5);
    }
    for (const auto& half : strata)
      for (const int n : half) ASSERT_EQ(n, 1) << "pixel " << pixel;
  }
  const double n = kPixels * kSamples;
  EXPECT_NEAR(sum / n, 1.0 / 2, 1e-3);
  EXPECT_NEAR(squares / n, 1.0 / 3, 1e-3);
  EXPECT_NEAR(with_film / n, 0, 2e-3);  // of 1/12
  job.sequence = SampleSequence::Kind::independent;
  EXPECT_NE(path_time(job, shutter, 0, 0), path_time(job, shutter, 0, 1));
}

// The scene with this integrator, all of it loaded.
struct World {
  World(const std::string& integrator, const JobOverrides& overrides);
  Warnings warnings;
  Resident resident{{}};
  std::optional<PathTracer> tracer;
};

World::World(const std::string& integrator, const JobOverrides& overrides) {
  prepare_compute_thread();
  const parts_test::TemporaryFolder folder;
  std::string text = kWorld;
  text.replace(text.find("%INTEGRATOR%"), 12, integrator);
  const std::string scene = folder.path("scene.pbrt"), split = folder.path("split");
  std::ofstream(scene) << text;
  const Manifest m = split_scene(scene, split, {}, warnings);
  const auto read = [](const std::string& path) { return *read_part_file(path); };
  tracer.emplace(m, job_settings(m.scene, overrides, warnings), read(part_path(split, 0)), resident, warnings);
  for (std::uint32_t i = 0; i < m.prototypes.size(); ++i) resident.load_prototype(i, read(prototype_path(split, i)));
  for (std::uint32_t i = 1; i < m.parts.size(); ++i) resident.load_part(PartId(i), read(part_path(split, i)));
}

void expect_same_in_all_batches(const std::string& integrator, const JobOverrides& overrides = {}) {
  const World world(integrator, overrides);
  const bool shares = overrides.samples_per_ray.value_or(1) > 1;
  const std::uint64_t paths = 24u * 20u * overrides.spp.value_or(4);
  RayCounts together, apart;
  const Sums sums = render(*world.tracer, 100000, together, shares);
  EXPECT_EQ(sums.size(), paths);
  EXPECT_GT(together.bounce, 1000u);
  EXPECT_EQ(together.camera, paths / overrides.samples_per_ray.value_or(1));
  for (const std::size_t size : {1u, 5u, 64u}) {
    apart = {};
    EXPECT_EQ(render(*world.tracer, size, apart, shares), sums) << "in batches of " << size;
    // Groups that a batch cuts go one by one.
    EXPECT_EQ(apart.camera, shares && size < 64 ? paths : together.camera);
    EXPECT_EQ(apart.bounce, together.bounce);
    EXPECT_EQ(apart.shadow, together.shadow);
  }
}

TEST(Shade, WhatAPathGathersDoesNotDependOnItsBatchInV2) {
  expect_same_in_all_batches("SurfaceIntegrator \"path\" \"integer maxdepth\" [4]");
}
TEST(Shade, WhatAPathGathersDoesNotDependOnItsBatchInV3) {
  expect_same_in_all_batches("Integrator \"path\" \"integer maxdepth\" [5]");
}
TEST(Shade, DirectLightDoesNotDependOnItsBatch) {
  expect_same_in_all_batches("SurfaceIntegrator \"directlighting\"");
}
TEST(Shade, SamplesThatShareRaysDoNotDependOnTheirBatch) {
  JobOverrides overrides;
  overrides.spp = 16;
  overrides.samples_per_ray = 4;
  expect_same_in_all_batches("SurfaceIntegrator \"path\" \"integer maxdepth\" [4]", overrides);
  expect_same_in_all_batches("Integrator \"path\" \"integer maxdepth\" [5]", overrides);
}

// The samples of a group bring other light than they would alone, but all together the same.
TEST(Shade, SamplesThatShareRaysHaveTheSameMean) {
  JobOverrides overrides;
  overrides.spp = 512;
  overrides.samples_per_ray = 4;
  const World world("Integrator \"path\" \"integer maxdepth\" [5]", overrides);
  RayCounts counts;
  const auto mean = [&](bool shares) {
    Rgb sum(0.f);
    for (const auto& [sample, radiance] : render(*world.tracer, 65536, counts, shares))
      for (int c = 0; c < 3; ++c) sum[c] += static_cast<float>(std::ldexp(static_cast<double>(radiance[static_cast<std::size_t>(c)]), -30) / (480 * 512));
    return sum;
  };
  const Rgb alone = mean(false), shared = mean(true);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(shared[c] / alone[c], 1, 0.004) << c;
}

TEST(Shade, SamplesShareRaysWhereThatIsAskedForAndPossible) {
  const auto of = [](const std::string& integrator, std::uint32_t spp, std::optional<std::uint32_t> asked) {
    JobOverrides overrides;
    overrides.spp = spp;
    overrides.samples_per_ray = asked;
    const World world(integrator, overrides);
    const auto is_told = [](const std::string& w) { return w.find("share no camera rays") != std::string::npos; };
    const bool told = std::ranges::any_of(world.warnings.list(), is_told);
    EXPECT_EQ(told, asked && *asked != world.tracer->job().samples_per_ray);
    return std::pair(world.tracer->job().samples_per_ray, world.tracer->job().share_if_worth);
  };
  const std::string path = "Integrator \"path\"", direct = "SurfaceIntegrator \"directlighting\"", bdpt = "Integrator \"bdpt\"";
  EXPECT_EQ(of(path, 64, {}), std::pair(2u, true));
  EXPECT_EQ(of(path, 31, {}), std::pair(1u, false));
  EXPECT_EQ(of(path, 31, 4), std::pair(4u, false));
  EXPECT_EQ(of(path, 64, 1), std::pair(1u, false));
  EXPECT_EQ(of(direct, 64, {}), std::pair(1u, false));
  EXPECT_EQ(of(direct, 64, 2), std::pair(1u, false));
  EXPECT_EQ(of(bdpt, 64, 2), std::pair(1u, false));
}

TEST(Shade, IntegratorsOfOtherKindsSayThemselvesHowManySamplesTheyTake) {
  const auto of = [](const std::string& integrator, std::optional<std::uint32_t> spp = {}) {
    JobOverrides overrides;
    overrides.spp = spp;
    return World(integrator, overrides).tracer->job().spp;
  };
  EXPECT_EQ(of("Integrator \"sppm\" \"integer numiterations\" 20"), 20u);
  EXPECT_EQ(of("Integrator \"sppm\""), 64u);
  EXPECT_EQ(of("Integrator \"sppm\"", 3), 3u);
  EXPECT_EQ(of("Integrator \"mlt\" \"integer mutationsperpixel\" 12"), 12u);
  EXPECT_EQ(of("Renderer \"metropolis\" \"integer samplesperpixel\" 9"), 9u);
}

// Numbers of the rays' samples: each once, in both sequences of a pixel.
TEST(SharedRays, CountOnOneByOne) {
  for (const std::uint32_t group : {2u, 4u, 8u}) {
    const SharedRays rays(group, 100);
    EXPECT_EQ(rays.end, 100 / (2 * group) * 2 * group);
    std::map<std::uint32_t, std::set<std::uint32_t>> by_ray;
    for (std::uint32_t s = 0; s < rays.end; ++s) by_ray[rays.ray_sample(s, true)].insert(s);
    EXPECT_EQ(by_ray.size(), rays.end / group);
    EXPECT_EQ(by_ray.rbegin()->first, rays.end / group - 1);
    for (const auto& [ray, samples] : by_ray) {
      EXPECT_EQ(samples.size(), group);
      for (const std::uint32_t s : samples) {
        EXPECT_EQ(rays.first(s), *samples.begin());
        EXPECT_EQ(s % 2, ray % 2);
      }
    }
  }
  EXPECT_EQ(SharedRays(4, 100).ray_sample(13, false), 13u);
  EXPECT_EQ(SharedRays().ray_sample(13, true), 13u);
}

}  // namespace
}  // namespace cloudrenderer
