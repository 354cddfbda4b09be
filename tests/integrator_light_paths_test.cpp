// Paths from lights bring what paths from the camera would, in expectation, and what these never find; the same bits however
// the scene is split.
#include <gtest/gtest.h>

#include "integrator_support.h"

namespace cloudrenderer {
namespace {

struct Picture {
  std::vector<PixelSums> sums;
  std::vector<Splat> splats;
  double mean = 0;  // of green
  std::size_t parts = 0, splatted = 0;
  RayCounts counts;
};

struct Look {
  LightPaths light_paths = LightPaths::caustics;
  std::uint32_t spp = 256;
  std::uint64_t part_size = std::uint64_t{64} << 20;
};

Picture picture_of(const std::string& text, const Look& look) {
  JobOverrides overrides;
  overrides.spp = look.spp;
  overrides.light_paths = look.light_paths;
  const SplitScene split(text, look.part_size, overrides);
  EXPECT_TRUE(split.warnings.list().empty()) << split.warnings.list()[0];
  const PathTracer& tracer = *split.tracer;
  const FilmFrame& f = tracer.job().film.frame;
  Film film(f, tracer.job().k, tracer.job().lobes);
  Picture out;
  out.parts = split.manifest.parts.size();
  const RendererRange range{0, f.x0, f.y0, f.x1, f.y1, 0, look.spp};
  constexpr std::uint64_t kBatch = 4096;
  std::uint64_t ended = 0;
  for (std::uint64_t made = 0; made < range.paths(); made += kBatch) {
    SegmentBatch batch;
    tracer.camera(range, 1, made, std::min(kBatch, range.paths() - made), batch.segments);
    while (batch.size() != 0) {
      tracer.trace(batch);
      ShadeOutput shaded;
      tracer.shade(batch, shaded);
      for (const PathEnd& e : shaded.ended) {
        film.at(e.pixel % f.width, e.pixel / f.width, tracer.in_negative_lobe(e.pixel, e.sample, false)).add(e.radiance, e.sample);
        ++ended;
        if (e.target == PathEnd().target) continue;
        EXPECT_TRUE(tracer.may_splat(e.target));
        Splat splat{e.target, {}};
        splat.add(e.splat, e.sample);
        film.add(splat);
        ++out.splatted;
      }
      EXPECT_TRUE(shaded.parked.empty());
      out.counts += shaded.counts;
      batch = {};
      batch.segments = std::move(shaded.continuing);
    }
  }
  EXPECT_EQ(ended, range.paths()) << "every sample ends once";
  film.count_light_paths({f.pixels() * ((look.spp + 1) / 2), f.pixels() * (look.spp / 2)});
  for (std::size_t p = 0; p < f.pixels(); ++p) out.mean += film.mean(p, 1, 1 / fixed_units(tracer.job().k)) / static_cast<double>(f.pixels());
  out.sums.assign(film.sums().begin(), film.sums().end());
  out.splats.assign(film.splats().begin(), film.splats().end());
  EXPECT_EQ(out.counts.invalid, 0u);
  return out;
}

std::string scene(const std::string& world, const std::string& options = "", const std::string& integrator = "Integrator \"path\"") {
  return "LookAt 0 4 -5  0 0 1  0 1 0\nCamera \"perspective\" \"float fov\" [40]\n"
         "Film \"image\" \"integer xresolution\" [24] \"integer yresolution\" [16] \"string filename\" [\"a.exr\"]\n" +
         integrator + " \"integer maxdepth\" [8]\n" + options + "WorldBegin\n" + world +
         "Material \"matte\" \"rgb Kd\" [.5 .5 .5]\n"
         "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-9 0 -9  9 0 -9  9 0 9  -9 0 9]\nWorldEnd\n";
}

// What shines, inside of glass: all light on the floor comes by the glass.
std::string bulb(const std::string& lamp, const std::string& glass = "\"sphere\" \"float radius\" [1.2]") {
  return "AttributeBegin\nTranslate 0 2.5 1.5\n" + lamp + "AttributeEnd\nAttributeBegin\nTranslate 0 2.5 1.5\nMaterial \"glass\"\nShape " + glass +
         "\nAttributeEnd\n";
}
const std::string kBall = "AreaLightSource \"diffuse\" \"rgb L\" [9 9 9]\nShape \"sphere\" \"float radius\" [.8]\n";
const std::string kSheet = "AreaLightSource \"diffuse\" \"rgb L\" [9 9 9] \"bool twosided\" [\"true\"]\n"
                           "Shape \"trianglemesh\" \"integer indices\" [0 2 1 0 3 2] \"point P\" [-.7 0 -.7 .7 0 -.7 .7 0 .7 -.7 0 .7]\n";
// With normals that are not the triangles'.
const std::string kSmoothed = "\"loopsubdiv\" \"integer nlevels\" [1] \"integer indices\" [0 2 4 2 1 4 1 3 4 3 0 4 2 0 5 1 2 5 3 1 5 0 3 5] "
                              "\"point P\" [2 0 0 -2 0 0 0 2 0 0 -2 0 0 0 2 0 0 -2]";

struct Expected {
  double tolerance = 0.01, share = 0.1;  // of the light that paths from lights bring: at least
  LightPaths kind = LightPaths::caustics;
  std::uint32_t spp = 1536;  // of the other picture
};
void expect_same_light(const std::string& text, const Expected& expected = {}) {
  const Picture both = picture_of(text, {.light_paths = expected.kind, .spp = 256}), camera_only = picture_of(text, {.light_paths = LightPaths::none, .spp = expected.spp});
  EXPECT_GT(both.splatted, 300u);
  EXPECT_EQ(camera_only.splatted, 0u);
  EXPECT_GT(camera_only.mean, 0.002);
  EXPECT_NEAR(both.mean / camera_only.mean, 1, expected.tolerance) << text;
  double splats = 0, all = 0;
  for (const Splat& s : both.splats) splats += static_cast<double>(s.sum[0][1] + s.sum[1][1]);
  for (const PixelSums& s : both.sums) all += static_cast<double>(s.sum[0][1] + s.sum[1][1]);
  EXPECT_GT(splats / (splats + all), expected.share) << "much of it is theirs, or the test says little";
}

TEST(LightPaths, BringWhatPathsFromTheCameraFind) {
  expect_same_light(scene(bulb(kBall)));
  expect_same_light(scene(bulb(kSheet)));
  expect_same_light(scene(bulb(kBall, kSmoothed)), {.tolerance = 0.015});
  // The sun of a sky, in a dome of glass.
  const parts_test::TemporaryFolder folder;
  Image sky{32, 16, std::vector<Rgb>(32 * 16, Rgb(.2f))};
  for (const std::uint32_t at : {70u, 71u, 102u, 103u}) sky.pixels[at] = Rgb(100.f);
  FilmFrame frame{32, 16, 0, 0, 32, 16};
  write_image(folder.path("sky.exr"), sky, frame);
  expect_same_light(scene("AttributeBegin\nRotate -90 1 0 0\nLightSource \"infinite\" \"string mapname\" \"" + folder.path("sky.exr") +
                          "\"\nAttributeEnd\nAttributeBegin\nMaterial \"glass\"\nShape \"sphere\" \"float radius\" [12]\nAttributeEnd\n"), {.tolerance = 0.02, .share = 0.05});
}

TEST(LightPaths, MeetEveryKindOfFilterCameraAndDialect) {
  expect_same_light(scene(bulb(kBall), "PixelFilter \"mitchell\"\n"), {.tolerance = 0.015});
  expect_same_light(scene(bulb(kBall), "Camera \"perspective\" \"float fov\" [40] \"float lensradius\" [.4] \"float focaldistance\" [5]\n"));
  expect_same_light(scene(bulb(kBall), "Camera \"orthographic\" \"float screenwindow\" [-2.5 2.5 -2 2]\n"));
  expect_same_light(scene(bulb(kBall), "Scale 2 2 2\nCamera \"perspective\" \"float fov\" [40]\n"));
  expect_same_light(scene(bulb(kBall), "", "SurfaceIntegrator \"path\""));
}

// A light in a mirror is a second light: Fresnel's terms are one there.
TEST(LightPaths, BringPointLightsByMirrors) {
  const std::string mirror = "AttributeBegin\nMaterial \"mirror\" \"rgb Kr\" [1 1 1]\n"
                             "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [5 0 -30  5 30 -30  5 30 30  5 0 30]\nAttributeEnd\n";
  const std::string near = "Camera \"perspective\" \"float fov\" [15]\n";  // sees the floor alone
  const auto at = [](const char* type, const char* one, const char* other) {
    return std::pair("LightSource " + std::string(type) + one + "\n", "LightSource " + std::string(type) + other + "\n");
  };
  for (const auto& [light, image] :
       {at("\"point\" \"rgb I\" [20 20 20]", " \"point from\" [4 2 1.5]", " \"point from\" [6 2 1.5]"),
        at("\"spot\" \"rgb I\" [90 90 90] \"float coneangle\" [35]", " \"point from\" [3 3 1.5] \"point to\" [5 1.5 1.2]", " \"point from\" [7 3 1.5] \"point to\" [5 1.5 1.2]"),
        at("\"distant\" \"rgb L\" [2 2 2]", " \"point from\" [-1 1 .2]", " \"point from\" [1 1 .2]")}) {
    const Picture mirrored = picture_of(scene(light + mirror, near), {.spp = 2048});
    const Picture direct = picture_of(scene(light, near), {.light_paths = LightPaths::none, .spp = 64}),
                  both = picture_of(scene(light + image, near), {.light_paths = LightPaths::none, .spp = 64});
    EXPECT_GT(both.mean, 1.05 * direct.mean) << light;
    EXPECT_NEAR((mirrored.mean - direct.mean) / (both.mean - direct.mean), 1, 0.045) << light;
  }
}

// Nothing else can find the light then, and nothing of it is given away.
TEST(LightPaths, LeaveCurvesToPathsFromTheCamera) {
  const std::string lamp = "AttributeBegin\nTranslate 0 5 2\nAreaLightSource \"diffuse\" \"rgb L\" [9 9 9]\nShape \"sphere\" \"float radius\" [1.2]\nAttributeEnd\n";
  for (const char* type : {"flat", "cylinder", "ribbon\" \"normal N\" [0 1 0 0 1 0] \"string basis\" \"bezier"}) {
    const std::string curve = "AttributeBegin\nMaterial \"glass\"\nTranslate 0 1 0\nShape \"curve\" \"string type\" \"" + std::string(type) +
                              "\" \"point P\" [-2 0 0 -.5 1.5 0 .5 -.5 0 2 0 0] \"float width\" [.4]\nAttributeEnd\n";
    const Picture off = picture_of(scene(lamp + curve), {.light_paths = LightPaths::none, .spp = 64}),
                  caustics = picture_of(scene(lamp + curve), {.light_paths = LightPaths::caustics, .spp = 64});
    EXPECT_EQ(off.mean, caustics.mean) << type;
    EXPECT_EQ(caustics.splatted, 0u) << type;
  }
}

// As shadow rays do not pass it, light that has scattered behind it does not come through.
TEST(LightPaths, PassNoSurfaceWithoutMaterialThatOthersDoNot) {
  const std::string shell = "AttributeBegin\nTranslate 0 4 1\nAreaLightSource \"diffuse\" \"rgb L\" [9 9 9]\nShape \"sphere\" \"float radius\" [.4]\nAttributeEnd\n"
                            "AttributeBegin\nTranslate 0 4 1\nMaterial \"none\"\nShape \"sphere\" \"float radius\" [.7]\nAttributeEnd\n";
  const std::string wall = "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-4 0 4  4 0 4  4 6 4  -4 6 4]\n";
  EXPECT_EQ(picture_of(scene(shell + wall), {.light_paths = LightPaths::all, .spp = 64}).mean, 0);
}

TEST(LightPaths, AreTheSameInAllSplits) {
  std::string world = bulb(kBall, kSmoothed);
  for (int i = 0; i < 40; ++i)
    world += "AttributeBegin\nTranslate " + std::to_string(i % 8 - 4) + " .2 " + std::to_string(i / 8 - 1) + "\nScale .1 .1 .1\nMaterial \"" +
             (i % 3 ? "matte" : "mirror") + "\"\nShape " + kSmoothed + "\nAttributeEnd\n";
  for (const LightPaths kind : {LightPaths::caustics, LightPaths::all}) {
    const Picture whole = picture_of(scene(world), {.light_paths = kind, .spp = 16}), split = picture_of(scene(world), {.light_paths = kind, .spp = 16, .part_size = 20000});
    EXPECT_EQ(whole.parts, 2u);
    EXPECT_GT(split.parts, 5u);
    EXPECT_GT(whole.splatted, 100u);
    EXPECT_EQ(whole.counts.bounce, split.counts.bounce);
    ASSERT_EQ(whole.splats.size(), split.splats.size());
    for (std::size_t i = 0; i < whole.splats.size(); ++i) EXPECT_TRUE(whole.splats[i].sum == split.splats[i].sum) << i;
    for (std::size_t i = 0; i < whole.sums.size(); ++i) EXPECT_TRUE(whole.sums[i].sum == split.sums[i].sum) << i;
  }
}

// A box that is open to the front, with a lamp behind a screen: all that is seen is lit by what the lamp lights first.
std::string behind_a_screen(const std::string& lamp, const std::string& material = "\"matte\" \"rgb Kd\" [.6 .6 .6]") {
  return lamp + "Material " + material +
         "\nShape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-3 0 3  3 0 3  3 5 3  -3 5 3]\n"
         "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-3 0 3  -3 5 3  -3 5 -3  -3 0 -3]\n"
         "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-3 5 3  3 5 3  3 5 -3  -3 5 -3]\n"
         // The screen, below the lamp.
         "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-1.5 3 3  1.5 3 3  1.5 3 -1.5  -1.5 3 -1.5]\n";
}

TEST(LightPaths, BringAllLightThatIsNotDirect) {
  const auto area = [](const char* shape) { return "AttributeBegin\nTranslate 0 4 1\nAreaLightSource \"diffuse\" \"rgb L\" [9 9 9]\n" + std::string(shape) + "\nAttributeEnd\n"; };
  const Expected all{.tolerance = 0.02, .share = 0.03, .kind = LightPaths::all, .spp = 768};
  for (const std::string& lamp :
       {area("Shape \"sphere\" \"float radius\" [.4]"), area("Shape \"cylinder\" \"float radius\" [.3] \"float zmin\" [-.4] \"float zmax\" [.4]"),
        area("Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-.5 0 -.5 .5 0 -.5 .5 0 .5 -.5 0 .5]"),
        // Many, so that the choice of the light counts: more than are weighed one by one.
        [&] {
          std::string out;
          for (int i = 0; i < 20; ++i)
            out += "AttributeBegin\nTranslate " + std::to_string(i % 5 - 2) + " 4 " + std::to_string(i / 5 - 1) + "\nAreaLightSource \"diffuse\" \"rgb L\" [" +
                   std::to_string(i) + " 4 4]\nShape \"sphere\" \"float radius\" [.15]\nAttributeEnd\n";
          return out;
        }(),
        std::string("LightSource \"point\" \"rgb I\" [9 9 9] \"point from\" [0 4 1]\n"),
        std::string("LightSource \"spot\" \"rgb I\" [30 30 30] \"point from\" [0 4 1] \"point to\" [0 5 1.2] \"float coneangle\" [40]\n"),
        std::string("LightSource \"distant\" \"rgb L\" [2 2 2] \"point from\" [0 1 -1] \"point to\" [0 1.3 0]\n"),
        std::string("LightSource \"infinite\" \"rgb L\" [1 1 1]\n")}) {
    Expected e = all;
    if (lamp.find("infinite") != std::string::npos || lamp.find("distant") != std::string::npos) e.share = 0;
    expect_same_light(scene(behind_a_screen(lamp)), e);
  }
  const std::string lamp = area("Shape \"sphere\" \"float radius\" [.4]");
  expect_same_light(scene(behind_a_screen(lamp, "\"plastic\" \"rgb Ks\" [.4 .4 .4] \"float roughness\" [.1]")), all);
  expect_same_light(scene(behind_a_screen(lamp, "\"uber\" \"rgb Kd\" [.3 .3 .3] \"rgb Ks\" [.2 .2 .2] \"rgb Kr\" [.3 .3 .3] \"rgb opacity\" [.8 .8 .8]")), all);
  expect_same_light(scene(behind_a_screen(lamp), "", "SurfaceIntegrator \"path\""), all);
  // Paths of few vertices are those of paths from the camera.
  for (const char* depth : {"1", "2", "3"}) {
    std::string text = scene(behind_a_screen(lamp));
    text.replace(text.find("[8]"), 3, "[" + std::string(depth) + "]");
    if (depth[0] == '1') {
      EXPECT_EQ(picture_of(text, {.light_paths = LightPaths::all, .spp = 16}).splatted, 0u);
    } else {
      expect_same_light(text, all);
    }
  }
}

TEST(LightPaths, ComeWithIntegratorsThatAreChosenForThem) {
  const auto kind = [](const std::string& integrator, const std::string& material, std::optional<LightPaths> wanted = {}) {
    SceneDescription s;
    s.dialect = Dialect::v3;
    s.integrator.type = integrator;
    s.materials.emplace_back().type = material;
    JobOverrides o;
    o.light_paths = wanted;
    Warnings warnings;
    return job_settings(s, o, warnings).light_paths;
  };
  for (const char* name : {"bdpt", "mlt", "sppm"}) {
    const bool caustics = std::string(name) == "sppm";
    EXPECT_EQ(kind(name, "glass"), caustics ? LightPaths::caustics : LightPaths::all) << name;
    EXPECT_EQ(kind(name, "matte"), caustics ? LightPaths::none : LightPaths::all) << name;
    EXPECT_EQ(kind(name, "glass", LightPaths::none), LightPaths::none) << name;
  }
  EXPECT_EQ(kind("path", "glass"), LightPaths::none);
  EXPECT_EQ(kind("path", "glass", LightPaths::all), LightPaths::all);
  EXPECT_EQ(kind("directlighting", "glass", LightPaths::all), LightPaths::none);
}

}  // namespace
}  // namespace cloudrenderer
