// What a path gathers is a function of the path: it does not depend on which batch its vertices are shaded in.
#include <gtest/gtest.h>

#include <fstream>

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

void expect_same_in_all_batches(const std::string& integrator) {
  prepare_compute_thread();
  const parts_test::TemporaryFolder folder;
  std::string text = kWorld;
  text.replace(text.find("%INTEGRATOR%"), 12, integrator);
  const std::string scene = folder.path("scene.pbrt"), split = folder.path("split");
  std::ofstream(scene) << text;
  Warnings warnings;
  const Manifest m = split_scene(scene, split, {}, warnings);
  Resident resident({});
  const auto read = [](const std::string& path) { return *read_part_file(path); };
  const PathTracer tracer(m, job_settings(m.scene, {}, warnings), read(part_path(split, 0)), resident, warnings);
  for (std::uint32_t i = 0; i < m.prototypes.size(); ++i) resident.load_prototype(i, read(prototype_path(split, i)));
  for (std::uint32_t i = 1; i < m.parts.size(); ++i) resident.load_part(PartId(i), read(part_path(split, i)));
  RayCounts together, apart;
  const Sums sums = render(tracer, 100000, together);
  EXPECT_EQ(sums.size(), 24u * 20u * 4u);
  EXPECT_GT(together.bounce, 1000u);
  for (const std::size_t size : {1u, 5u, 64u}) {
    apart = {};
    EXPECT_EQ(render(tracer, size, apart), sums) << "in batches of " << size;
    EXPECT_EQ(apart.camera, together.camera);
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

}  // namespace
}  // namespace cloudrenderer
