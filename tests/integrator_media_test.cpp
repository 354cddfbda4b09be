// A path through participating media is the same bits however the scene is split.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <random>

#include "integrator_support.h"
#include "parts/split.h"
#include "parts_support.h"
#include "scene/spectrum.h"

namespace cloudrenderer {
namespace {

constexpr unsigned kSeed = 5;

std::string grid_numbers(std::uint32_t nx, std::uint32_t ny, std::uint32_t nz) {
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<float> uniform(0.f, 1.f);
  std::string out = "\"integer nx\" [" + std::to_string(nx) + "] \"integer ny\" [" + std::to_string(ny) + "] \"integer nz\" [" +
                    std::to_string(nz) + "] \"float density\" [";
  for (std::uint32_t i = 0; i < nx * ny * nz; ++i) out += std::to_string(uniform(random)) + ' ';
  return out + "]\n";
}

Sums render_split(const std::string& text, std::uint64_t part_size, std::size_t& parts, RayCounts& counts) {
  const SplitScene scene(text, part_size);
  parts = scene.manifest.parts.size();
  return render(*scene.tracer, 1000, counts);
}

void expect_same_in_all_splits(const std::string& text, bool scatters = true) {
  std::size_t few, many;
  RayCounts together, apart;
  const Sums sums = render_split(text, std::uint64_t{64} << 20, few, together);
  EXPECT_EQ(render_split(text, 60000, many, apart), sums);
  EXPECT_EQ(few, 2u);
  EXPECT_GT(many, 5u);
  EXPECT_EQ(apart.bounce, together.bounce);
  EXPECT_EQ(apart.shadow, together.shadow);
  EXPECT_EQ(together.shadow > 300u, scatters);
  EXPECT_EQ(together.invalid, 0u);
}

const std::string kHead = R"(
LookAt 0 -6 1  0 0 0.5  0 0 1
Camera "perspective" "float fov" [40]
Film "image" "integer xresolution" [16] "integer yresolution" [12] "string filename" "media.exr"
Sampler "lowdiscrepancy" "integer pixelsamples" [4]
)";
const std::string kThings = R"(
LightSource "point" "color I" [9 9 9] "point from" [2 -2 4]
LightSource "infinite" "color L" [.2 .3 .4]
Material "matte"
Shape "trianglemesh" "point P" [-4 -4 -1  4 -4 -1  4 4 -1  -4 4 -1] "integer indices" [0 1 2 2 3 0]
)";

TEST(Media, ChromaticGridsOfPbrt2) {
  expect_same_in_all_splits(kHead + "SurfaceIntegrator \"directlighting\"\nVolumeIntegrator \"single\"\nWorldBegin\n" + kThings +
                            "Volume \"volumegrid\" \"color sigma_a\" [.1 .2 .3] \"color sigma_s\" [.9 .5 .4] \"color Le\" [.1 .1 0] "
                            "\"point p0\" [-1 -1 -.5] \"point p1\" [1 1 1.5] " + grid_numbers(40, 36, 30) +
                            "Volume \"homogeneous\" \"color sigma_s\" [.1 .1 .1] \"point p0\" [-2 -2 -1] \"point p1\" [2 2 1]\nWorldEnd\n");
}

// Light that is absorbed and emitted in a ball of one temperature everywhere: what a ray through its middle sees.
TEST(Media, AGridThatShines) {
  std::string ones = "\"integer nx\" [40] \"integer ny\" [40] \"integer nz\" [40] \"float density\" [", warm = "\"float temperature\" [";
  for (int i = 0; i < 40 * 40 * 40; ++i) {
    ones += "1 ";
    warm += "3000 ";
  }
  const std::string v4_head = R"(
LookAt 0 -6 0  0 0 0  0 0 1
Camera "perspective" "float fov" [.1]
Film "rgb" "integer xresolution" [4] "integer yresolution" [4] "string filename" "media.exr"
Sampler "zsobol" "integer pixelsamples" [2048]
Integrator "volpath" "integer maxdepth" [5]
WorldBegin
MakeNamedMedium "m" "string type" "uniformgrid" "rgb sigma_a" [.7 .7 .7] "rgb sigma_s" [0 0 0] "float Lescale" [.001]
"point3 p0" [-4 -4 -4] "point3 p1" [4 4 4]
)";
  const std::string scene = v4_head + ones + "] " + warm + "]\nAttributeBegin\nMaterial \"interface\"\nMediumInterface \"m\" \"\"\n"
                            "Shape \"sphere\" \"float radius\" [1.5]\nAttributeEnd\n";
  expect_same_in_all_splits(scene, false);
  std::size_t parts;
  RayCounts counts;
  double sum = 0, n = 0;
  for (const auto& [key, radiance] : render_split(scene, std::uint64_t{64} << 20, parts, counts)) {
    sum += static_cast<double>(radiance[1]) / static_cast<double>(std::int64_t{1} << 30);
    ++n;
  }
  // The strength of pbrt-v4's grid of one sample: 1 in the middle, less towards the sides of the box.
  double expected = 0;
  constexpr int kSteps = 3000;
  for (int i = 0; i < kSteps; ++i) {
    const double y = (i + .5) / kSteps * 3, strength = 1 - std::fabs((y - 1.5) / 8);
    expected += .7 * std::exp(-.7 * y) * strength * 3 / kSteps;
  }
  const double green = static_cast<double>(blackbody_to_rgb(3000, Dialect::v3).y) * 106.856895 * .001;
  EXPECT_NEAR(sum / n, expected * green, .01 * expected * green);
}

TEST(Media, AGridInsideOfAnInterface) {
  expect_same_in_all_splits(kHead + "Integrator \"volpath\" \"integer maxdepth\" [20]\nWorldBegin\n" + kThings +
                            "MakeNamedMedium \"cloud\" \"string type\" \"heterogeneous\" \"rgb sigma_a\" [0 0 0] \"rgb sigma_s\" [4 4 4] \"float g\" [.5] "
                            "\"point p0\" [-1 -1 -.5] \"point p1\" [1 1 1.5] " + grid_numbers(40, 36, 30) +
                            "AttributeBegin\nMaterial \"\"\nMediumInterface \"cloud\" \"\"\nTranslate 0 0 .5\nShape \"sphere\" \"float radius\" [2]\nAttributeEnd\nWorldEnd\n");
}

// How bright a floor at z = -1 is under a lamp on the z axis and some absorbing fog, named "fog", in a closed surface.
double floor_brightness(const std::string& fog, const std::string& surface, const std::string& lamp_height) {
  const std::string scene = "LookAt 0 0 3  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" [60]\n"
                            "Film \"image\" \"integer xresolution\" [16] \"integer yresolution\" [16] \"string filename\" \"x.exr\"\n"
                            "Sampler \"halton\" \"integer pixelsamples\" [256]\nIntegrator \"volpath\" \"integer maxdepth\" [1]\nWorldBegin\n"
                            "LightSource \"point\" \"rgb I\" [9 9 9] \"point from\" [0 0 " + lamp_height + "]\nMaterial \"matte\"\n"
                            "Shape \"trianglemesh\" \"point P\" [-4 -4 -1  4 -4 -1  4 4 -1  -4 4 -1] \"integer indices\" [0 1 2 2 3 0]\n" +
                            fog + "Material \"none\"\nMediumInterface \"fog\" \"\"\n" + surface + "\nWorldEnd\n";
  std::size_t parts;
  RayCounts counts;
  double sum = 0;
  for (const auto& [key, radiance] : render_split(scene, std::uint64_t{64} << 20, parts, counts)) sum += static_cast<double>(radiance[1]);
  return sum;
}

// The fog "fog", everywhere or in a grid that is 4 wide.
std::string even_fog(const std::string& sigma_a) {
  return "MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [" + sigma_a + "] \"rgb sigma_s\" [0 0 0]\n";
}
std::string grid_of_fog(const std::string& sigma_a) {
  std::string text = "MakeNamedMedium \"fog\" \"string type\" \"heterogeneous\" \"point p0\" [-2 -2 -2] \"point p1\" [2 2 2] "
                     "\"rgb sigma_a\" [" + sigma_a + "] \"rgb sigma_s\" [0 0 0] \"integer nx\" 40 \"integer ny\" 40 \"integer nz\" 40 \"float density\" [";
  for (int i = 0; i < 40 * 40 * 40; ++i) text += "1 ";
  return text + "]\n";
}

TEST(Media, AGridOutsideOfItsSurfacesShadesNothing) {
  const std::string box = "Shape \"trianglemesh\" \"point P\" [-.25 -.25 -.25  .25 -.25 -.25  .25 .25 -.25  -.25 .25 -.25  -.25 -.25 .25  .25 -.25 .25  .25 .25 .25  -.25 .25 .25] "
                          "\"integer indices\" [0 2 1 0 3 2  4 5 6 4 6 7  0 1 5 0 5 4  3 6 2 3 7 6  0 7 3 0 4 7  1 2 6 1 6 5]";
  const double even = floor_brightness(even_fog("3 3 3"), box, "2");
  EXPECT_LT(even, 0.98 * floor_brightness(even_fog("0 0 0"), box, "2")) << "there is a shadow";
  EXPECT_NEAR(floor_brightness(grid_of_fog("3 3 3"), box, "2") / even, 1, 0.01);
}

// Shadow rays through a ball, from its outside into it, and from its inside to its inside, which no surface lies between.
TEST(Media, AGridsShadowIsThatOfItsSurfaces) {
  for (const char* radius : {".9", "1.6"})
    for (const char* lamp : {"2", ".2"}) {
      const std::string ball = "Shape \"sphere\" \"float radius\" [" + std::string(radius) + "]";
      const double even = floor_brightness(even_fog(".3 .3 .3"), ball, lamp), clear = floor_brightness(even_fog("0 0 0"), ball, lamp);
      EXPECT_LT(even, 0.9 * clear);
      EXPECT_NEAR(floor_brightness(grid_of_fog(".3 .3 .3"), ball, lamp) / even, 1, 0.015) << radius << " " << lamp;
    }
}

// Balls of two clouds, one in the other, smaller than their grids; an object's, too.
TEST(Media, GridsInsideOfGrids) {
  const auto cloud = [](const char* name, const char* sigma_s) {
    return "MakeNamedMedium \"" + std::string(name) + "\" \"string type\" \"heterogeneous\" \"rgb sigma_a\" [.1 0 0] \"rgb sigma_s\" " + sigma_s +
           " \"point p0\" [-1.5 -1.5 -1] \"point p1\" [1.5 1.5 1.5] " + grid_numbers(40, 36, 30);
  };
  expect_same_in_all_splits(kHead + "Integrator \"volpath\" \"integer maxdepth\" [10]\nWorldBegin\n" + kThings + cloud("large", "[2 2 2]") + cloud("small", "[4 4 4]") +
                            "AttributeBegin\nMaterial \"\"\nMediumInterface \"large\" \"\"\nShape \"sphere\" \"float radius\" [.9]\nAttributeEnd\n"
                            "ObjectBegin \"o\"\nMaterial \"\"\nMediumInterface \"small\" \"large\"\nShape \"sphere\" \"float radius\" [.4]\nObjectEnd\n"
                            "ObjectInstance \"o\"\nWorldEnd\n");
}

}  // namespace
}  // namespace cloudrenderer
