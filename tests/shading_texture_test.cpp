#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "shading/material_kinds.h"
#include "shading/texture_image.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

class Textures : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::temp_directory_path() / ("shading_texture_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  template <class T>
  std::string write(const std::string& name, int width, int height, int channels,
                    const std::vector<T>& pixels, const std::vector<float>& chromaticities = {}) {
    const std::string path = (folder_ / name).string();
    auto file = OIIO::ImageOutput::create(path);
    const auto type = sizeof(T) == 1 ? OIIO::TypeDesc::UINT8 : OIIO::TypeDesc::FLOAT;
    OIIO::ImageSpec spec(width, height, channels, type);
    spec.attribute("oiio:UnassociatedAlpha", 1);  // colours as they are given
    if (!chromaticities.empty()) spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), chromaticities.data());
    file->open(path, spec);
    file->write_image(type, pixels.data());
    file->close();
    return path;
  }
  // The value of the last texture of `list`, which a matte's Kd or sigma refers to.
  Rgb eval(std::vector<TextureDesc> list, const TexturePoint& at, Dialect dialect = Dialect::v2) {
    SceneDescription scene;
    scene.dialect = dialect;
    scene.textures = std::move(list);
    const TextureDesc& last = scene.textures.back();
    scene.materials.push_back(
        material("matte", {texture_param(last.is_float ? "sigma" : "Kd", last.name)}));
    const TextureSet set(scene, std::uint64_t{1} << 30, warnings_);
    needs_ = TextureNeeds();
    if (last.is_float) {
      TexturedFloat t;
      EXPECT_TRUE(set.find(last.name, t, needs_, {}, warnings_));
      return Rgb(t(at));
    }
    TexturedRgb t;
    EXPECT_TRUE(set.find(last.name, t, needs_, {}, warnings_));
    return t(at);
  }
  static TexturePoint at(float u, float v) {
    TexturePoint p;
    p.uv = {u, v};
    return p;
  }

  std::filesystem::path folder_;
  Warnings warnings_;
  TextureNeeds needs_;
};

void expect_near(const Rgb& a, const Rgb& b, float tolerance) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], tolerance) << i;
}

// Red green / blue white, first row on top.
const std::vector<std::uint8_t> kFour{255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};

TEST_F(Textures, V2PutsTheFirstRowAtZeroAndV3AtOne) {
  const std::string path = write("four.png", 2, 2, 3, kFour);
  const auto image = [&] {
    return std::vector{texture("t", "imagemap", false, {string_param("filename", path)})};
  };
  expect_near(eval(image(), at(0.25f, 0.25f)), {1, 0, 0}, 1e-6f);
  expect_near(eval(image(), at(0.75f, 0.75f)), {1, 1, 1}, 1e-6f);
  expect_near(eval(image(), at(0.25f, 0.25f), Dialect::v3), {0, 0, 1}, 1e-6f);
  expect_near(eval(image(), at(0.25f, 0.75f), Dialect::v3), {1, 0, 0}, 1e-6f);
  expect_near(eval(image(), at(0.5f, 0.25f)), {0.5f, 0.5f, 0}, 1e-6f);  // bilinear
  expect_near(eval(image(), at(1.25f, -0.75f)), {1, 0, 0}, 1e-6f);      // repeats
  EXPECT_TRUE(needs_.uv);
  EXPECT_TRUE(needs_.footprint);
  EXPECT_TRUE(warnings_.list().empty());
}

TEST_F(Textures, OfPbrtV2StandOnTheLowestRowInTheFormatsThatItReadsSo) {
  const std::string tga = write("four.TGA", 2, 2, 3, kFour);
  const std::string pfm = (folder_ / "four.pfm").string();  // from the lowest row, as the format has it
  const float rows[2][2][3] = {{{0, 0, 1}, {1, 1, 1}}, {{1, 0, 0}, {0, 1, 0}}};
  std::ofstream(pfm) << "PF\n2 2\n-1\n" << std::string_view(reinterpret_cast<const char*>(rows), sizeof rows);
  for (const std::string& path : {tga, pfm}) {
    const auto image = std::vector{texture("t", "imagemap", false, {string_param("filename", path)})};
    for (const Dialect dialect : {Dialect::v2, Dialect::v3}) {
      expect_near(eval(image, at(.25f, .25f), dialect), {0, 0, 1}, 1e-6f);
      expect_near(eval(image, at(.75f, .75f), dialect), {0, 1, 0}, 1e-6f);
    }
  }
}

TEST_F(Textures, ColoursOfPbrtV4AreOfTheSpaceThatTheFileNames) {
  const std::vector<float> colour{.5f, .25f, .2f};
  const std::string aces = write("aces.exr", 1, 1, 3, colour, {.7347f, .2653f, 0, 1, .0001f, -.077f, .32168f, .33767f});
  const std::string wide = write("wide.exr", 1, 1, 3, colour, {.708f, .292f, .17f, .797f, .131f, .046f, .3127f, .329f});
  const auto image = [&](const std::string& path, bool v4, bool is_float = false) {
    return eval({texture("t", "imagemap", is_float, {string_param("filename", path), bool_param("mean", v4)})}, at(.5f, .5f), Dialect::v3);
  };
  expect_near(image(aces, true), {.921f, .184f, .171f}, 2e-3f);
  expect_near(image(wide, true), {.669f, .219f, .190f}, 2e-3f);
  expect_near(image(aces, false), {.5f, .25f, .2f}, 1e-3f);
  expect_near(image(aces, true, true), Rgb(.95f / 3), 1e-3f);  // numbers are no colours
}

TEST_F(Textures, OfPbrtV4HaveMasksInFilesWithSuchOnly) {
  const std::vector<std::uint8_t> pixel{128, 64, 191, 102};
  const auto image = [&](const std::string& path) {
    return eval({texture("t", "imagemap", true, {string_param("filename", path), bool_param("mean", true), bool_param("gamma", false)})},
                at(.5f, .5f), Dialect::v3);
  };
  expect_near(image(write("mask.png", 1, 1, 4, pixel)), Rgb(102.f / 255), 1e-3f);
  expect_near(image(write("none.tga", 1, 1, 4, pixel)), Rgb(383.f / 3 / 255), 1e-3f);
}

TEST_F(Textures, WrapModes) {
  const std::string path = write("four.png", 2, 2, 3, kFour);
  const auto image = [&](const char* wrap) {
    return std::vector{texture("t", "imagemap", false,
                               {string_param("filename", path), string_param("wrap", wrap)})};
  };
  expect_near(eval(image("clamp"), at(-3.f, -5.f)), {1, 0, 0}, 1e-6f);
  expect_near(eval(image("clamp"), at(9.f, -5.f)), {0, 1, 0}, 1e-6f);
  expect_near(eval(image("black"), at(-3.f, 0.25f)), {0, 0, 0}, 1e-6f);
  expect_near(eval(image("black"), at(0.f, 0.25f)), {0.5f, 0, 0}, 1e-6f);
}

TEST_F(Textures, GammaAndScaleOfBothDialects) {
  const std::string png = write("grey.png", 1, 1, 3, std::vector<std::uint8_t>{128, 128, 128});
  const std::string exr = write("grey.exr", 1, 1, 3, std::vector<float>{0.5f, 0.5f, 0.5f});
  const float x = 128.f / 255.f, srgb = std::pow((x + 0.055f) / 1.055f, 2.4f);
  const auto image = [&](const std::string& f, std::initializer_list<Param> more) {
    TextureDesc t = texture("t", "imagemap", false, more);
    t.params.add(string_param("filename", f));
    return std::vector{t};
  };
  expect_near(eval(image(png, {}), at(0, 0)), Rgb(x), 1e-6f);
  expect_near(eval(image(png, {real_param("gamma", 2.2f), real_param("scale", 0.5f)}), at(0, 0)),
              Rgb(std::pow(0.5f * x, 2.2f)), 1e-5f);
  expect_near(eval(image(png, {}), at(0, 0), Dialect::v3), Rgb(srgb), 1e-5f);
  expect_near(eval(image(png, {bool_param("gamma", false), real_param("scale", 2.f)}), at(0, 0),
                   Dialect::v3),
              Rgb(2.f * x), 1e-5f);
  expect_near(eval(image(exr, {}), at(0, 0), Dialect::v3), Rgb(0.5f), 1e-6f);
  expect_near(eval(image(exr, {bool_param("gamma", true)}), at(0, 0), Dialect::v3),
              Rgb(std::pow(0.555f / 1.055f, 2.4f)), 1e-4f);
}

TEST_F(Textures, FloatImagesAreLuminance) {
  const std::string path = write("four.png", 2, 2, 3, kFour);
  const auto t = std::vector{texture("t", "imagemap", true, {string_param("filename", path)})};
  EXPECT_NEAR(eval(t, at(0.25f, 0.25f)).x, 0.212671f, 1e-3f);
  EXPECT_NEAR(eval(t, at(0.75f, 0.25f)).x, 0.715160f, 1e-3f);
}

TEST_F(Textures, WideFootprintsAverage) {
  std::vector<std::uint8_t> board;
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) board.insert(board.end(), 3, (x ^ y) & 1 ? 255 : 0);
  const std::string path = write("board.png", 64, 64, 3, board);
  for (const bool trilinear : {false, true}) {
    const auto t =
        std::vector{texture("t", "imagemap", false,
                            {string_param("filename", path), bool_param("trilinear", trilinear)})};
    TexturePoint p = at(0.37f, 0.61f);
    p.dpdx = {1, 0, 0};
    for (const float width : {1.f / 16, 0.3f, 5.f}) {
      p.duvdx = {width, 0};
      p.duvdy = {0, width};
      expect_near(eval(t, p), Rgb(0.5f), 0.03f);
      p.duvdx = {width * 4, 0};  // anisotropic
      expect_near(eval(t, p), Rgb(0.5f), 0.03f);
    }
  }
}

TEST_F(Textures, AnisotropicFilterKeepsWhatVariesAcrossTheFootprint) {
  // Stripes along u: a footprint long in u and short in v must keep them apart.
  std::vector<std::uint8_t> stripes;
  for (int y = 0; y < 64; ++y) stripes.insert(stripes.end(), 64 * 3, (y / 8) & 1 ? 255 : 0);
  const std::string path = write("stripes.png", 64, 64, 3, stripes);
  const auto t = std::vector{texture("t", "imagemap", false, {string_param("filename", path)})};
  TexturePoint p = at(0.5f, 12.f / 64);
  p.duvdx = {8.f / 64, 0};
  p.duvdy = {0, 1.f / 64};
  expect_near(eval(t, p), Rgb(1.f), 0.02f);
  std::swap(p.duvdx, p.duvdy);
  expect_near(eval(t, p), Rgb(1.f), 0.02f);
}

TEST_F(Textures, LevelsAndTexelsAreThoseOfTheFilter) {
  std::vector<std::uint8_t> stripes;
  for (int i = 0; i < 64 * 64; ++i) stripes.insert(stripes.end(), 3, i % 64 / 4 & 1 ? 255 : 0);
  ImageStore store(1 << 20);
  const ImagePyramid* image = store.get(write("stripes.png", 64, 64, 3, stripes), {}, {});
  ImageFilter filter;
  // Four texels wide: level 2, a texel a stripe; twice as wide level 3, which is grey.
  const Vec2 x(4.f / 64, 0), y(0, 4.f / 64);
  for (const auto kind : {ImageFilter::Kind::trilinear, ImageFilter::Kind::bilinear, ImageFilter::Kind::point}) {
    filter.kind = kind;
    filter.widths = 1;
    expect_near(image->lookup({6.f / 64, 0.5f}, x, y, filter), Rgb(1.f), 1e-3f);
    filter.widths = 2;
    expect_near(image->lookup({6.f / 64, 0.5f}, x, y, filter), Rgb(0.5f), 1e-2f);
  }
  // At the border of two stripes both count, or the nearer one.
  filter.kind = ImageFilter::Kind::bilinear;
  expect_near(image->lookup({4.f / 64, 0.5f}, Vec2(0.f), Vec2(0.f), filter), Rgb(0.5f), 1e-2f);
  filter.kind = ImageFilter::Kind::point;
  expect_near(image->lookup({3.9f / 64, 0.5f}, Vec2(0.f), Vec2(0.f), filter), Rgb(0.f), 1e-6f);
  expect_near(image->lookup({4.1f / 64, 0.5f}, Vec2(0.f), Vec2(0.f), filter), Rgb(1.f), 1e-6f);
}

TEST_F(Textures, PagedImagesGiveTheSameBits) {
  std::vector<float> noise;
  for (int i = 0; i < 37 * 23 * 3; ++i)
    noise.push_back(static_cast<float>((i * 7919) % 1000) / 999.f);
  const std::string path = write("noise.exr", 37, 23, 3, noise);
  ImageStore resident(1 << 30), paged(0);
  const ImagePyramid* a = resident.get(path, {}, {});
  const ImagePyramid* b = paged.get(path, {}, {});
  EXPECT_GT(resident.bytes(), 37u * 23 * 3 * 2);
  EXPECT_EQ(paged.bytes(), 0u);
  EXPECT_EQ(a, resident.get(path, {}, {}));  // read once
  for (int i = 0; i < 200; ++i) {
    const auto x = static_cast<float>(i);
    const Vec2 st(x * 0.013f, x * 0.029f), d0(0.001f * x, 0.0005f * x),
        d1(-0.0002f * x, 0.0008f * x);
    EXPECT_EQ(a->lookup(st, d0, d1, {}), b->lookup(st, d0, d1, {}));
  }
}

TEST_F(Textures, HostileCoordinatesGiveFiniteValues) {
  const std::string path = write("four.png", 2, 2, 3, kFour);
  ImageStore store(1 << 20);
  const ImagePyramid* image = store.get(path, {}, {});
  const float huge = 3e38f, nan = std::nanf("");
  for (const WrapMode wrap : {WrapMode::repeat, WrapMode::black, WrapMode::clamp})
    for (const auto kind : {ImageFilter::Kind::ellipse, ImageFilter::Kind::trilinear, ImageFilter::Kind::bilinear, ImageFilter::Kind::point})
      for (const float s : {0.f, huge, -huge, nan, kInfinity, 1e-38f})
        for (const float d : {0.f, huge, -huge, nan, kInfinity, 1e-38f, 0.1f}) {
          const ImageFilter filter{wrap, kind, 2.f, 8.f};
          EXPECT_TRUE(is_finite(image->lookup({s, s}, {d, 0.f}, {0.3f, d}, filter)));
          EXPECT_TRUE(is_finite(image->lookup({s, 0.3f}, {d, d}, {d, d}, filter)));
        }
}

TEST_F(Textures, MissingImagesAreAWarningAndAConstant) {
  const auto t =
      std::vector{texture("t", "imagemap", false, {string_param("filename", "/nowhere/x.png")})};
  expect_near(eval(t, at(0, 0)), Rgb(1.f), 1e-6f);
  ASSERT_EQ(warnings_.list().size(), 1u);
  EXPECT_NE(warnings_.list()[0].find("/nowhere/x.png"), std::string::npos);
  expect_near(eval(t, at(0, 0), Dialect::v3), Rgb(0.21404f), 1e-4f);  // sRGB 0.5
}

TEST_F(Textures, ScaleAndMixCombineAndFoldConstants) {
  const auto a = texture("a", "constant", false, {rgb_param("value", {0.2f, 0.4f, 0.6f})});
  const auto s =
      texture("s", "scale", false, {texture_param("tex1", "a"), real_param("tex2", 0.5f)});
  expect_near(eval({a, s}, at(0, 0)), {0.1f, 0.2f, 0.3f}, 1e-6f);
  EXPECT_FALSE(needs_.uv);
  const auto m = texture(
      "m", "mix", false,
      {texture_param("tex1", "a"), rgb_param("tex2", {1, 1, 1}), real_param("amount", 0.25f)});
  expect_near(eval({a, m}, at(0, 0)), {0.4f, 0.55f, 0.7f}, 1e-6f);
  const auto uv =
      texture("uv", "uv", false, {real_param("uscale", 2.f), real_param("vdelta", 0.5f)});
  const auto su =
      texture("su", "scale", false, {texture_param("tex1", "uv"), texture_param("tex2", "a")});
  expect_near(eval({a, uv, su}, at(0.3f, 0.7f)), {0.6f * 0.2f, 0.2f * 0.4f, 0.f}, 1e-5f);
  EXPECT_TRUE(needs_.uv);
  EXPECT_FALSE(needs_.footprint);
}

TEST_F(Textures, BilerpInterpolatesItsCorners) {
  const auto t = texture("t", "bilerp", true,
                         {real_param("v00", 0.f), real_param("v01", 1.f), real_param("v10", 2.f),
                          real_param("v11", 5.f)});
  EXPECT_NEAR(eval({t}, at(0, 1)).x, 1.f, 1e-6f);
  EXPECT_NEAR(eval({t}, at(1, 0)).x, 2.f, 1e-6f);
  EXPECT_NEAR(eval({t}, at(0.5f, 0.5f)).x, 2.f, 1e-6f);
}

TEST_F(Textures, CheckerboardAlternatesAndFilters) {
  const auto t = std::vector{texture("t", "checkerboard", true,
                                     {real_param("uscale", 2.f), real_param("vscale", 2.f),
                                      real_param("tex1", 1.f), real_param("tex2", 0.f)})};
  EXPECT_EQ(eval(t, at(0.2f, 0.2f)).x, 1.f);
  EXPECT_EQ(eval(t, at(0.7f, 0.2f)).x, 0.f);
  EXPECT_EQ(eval(t, at(0.7f, 0.7f)).x, 1.f);
  EXPECT_EQ(eval(t, at(-0.2f, 0.2f)).x, 0.f);
  TexturePoint p = at(0.5f, 0.25f);
  p.duvdx = {0.1f, 0};
  EXPECT_NEAR(eval(t, p).x, 0.5f, 1e-5f);  // half on each side of the edge
  p.uv = {0.45f, 0.25f};
  EXPECT_NEAR(eval(t, p).x, 0.75f, 1e-5f);
  p.duvdx = {10.f, 0};
  EXPECT_EQ(eval(t, p).x, 0.5f);
  EXPECT_TRUE(needs_.footprint);
  auto none = t;
  none[0].params.add(string_param("aamode", "none"));
  EXPECT_EQ(eval(none, p).x, 1.f);
  EXPECT_FALSE(needs_.footprint);
  auto solid = t;
  solid[0].params.add(integer_param("dimension", 3));
  p.p = {0.5f, 1.5f, 0.5f};
  EXPECT_EQ(eval(solid, p).x, 0.f);
  EXPECT_FALSE(needs_.uv);
}

// Against a sum over the triangle, in two and three dimensions.
TEST_F(Textures, CheckerboardsOfPbrtV4AreFilteredByATriangle) {
  auto flat = texture("t", "checkerboard", true, {bool_param("tent", true)}), solid = flat;
  solid.params.add(integer_param("dimension", 3));
  for (const float width : {0.f, 1e-4f, 0.02f, 0.1f, 0.3f, 0.5f, 0.9f, 3.f, 1e9f})
    for (int i = -40; i <= 40; ++i) {
      const float x = 0.11f * static_cast<float>(i);
      const double r = 1.5 * static_cast<double>(width);
      double mean = 0;
      constexpr int kSteps = 20000;
      for (int k = 0; k < kSteps; ++k) {
        const double t = 2 * (k + 0.5) / kSteps - 1, at = static_cast<double>(x) + t * r;
        mean += (1 - std::fabs(t)) * (std::fmod(std::floor(at), 2.0) == 0 ? 1 : -1) / (kSteps / 2.0);
      }
      if (width > 1e6f) mean = 0;
      TexturePoint p = at(x, 0.5f);
      p.duvdy = {width, 0};
      EXPECT_NEAR(eval({flat}, p).x, 0.5 + 0.5 * mean, 2e-4) << x << " " << width;
      p.p = {0.5f, 0.5f, x};
      p.dpdx = {0, 0, -width};
      EXPECT_NEAR(eval({solid}, p).x, 0.5 + 0.5 * mean, 2e-4) << x << " " << width;
    }
  EXPECT_TRUE(needs_.footprint);
}

TEST_F(Textures, MappingsFollowTheSurface) {
  TexturePoint p;
  p.p = {0.25f, 0.5f, 3.f};
  const auto planar =
      texture("t", "uv", false, {string_param("mapping", "planar"), real_param("udelta", 0.125f)});
  expect_near(eval({planar}, p), {0.375f, 0.5f, 0}, 1e-6f);
  p.p = {0, 2, 0};
  const auto spherical = texture("t", "uv", false, {string_param("mapping", "spherical")});
  expect_near(eval({spherical}, p), {0.5f, 0.25f, 0}, 1e-6f);
  const auto cylindrical = texture("t", "uv", false, {string_param("mapping", "cylindrical")});
  expect_near(eval({cylindrical}, p), {0.75f, 0.f, 0}, 1e-6f);
  EXPECT_FALSE(needs_.uv);
}

TEST_F(Textures, UnknownReferencesAreWarnings) {
  SceneDescription scene;
  scene.materials.push_back(material("matte", {texture_param("Kd", "missing")}));
  const auto shading = Shading::build(scene, {}, warnings_);
  ASSERT_EQ(warnings_.list().size(), 1u);
  EXPECT_NE(warnings_.list()[0].find("missing"), std::string::npos);
}

TEST_F(Textures, AlphaLooksUpFloatTextures) {
  SceneDescription scene;
  scene.textures.push_back(
      texture("a", "checkerboard", true, {real_param("uscale", 2.f), real_param("vscale", 2.f)}));
  scene.textures.push_back(texture("b", "constant", true, {real_param("value", 0.f)}));
  const auto shading = Shading::build(scene, {}, warnings_);
  EXPECT_EQ(shading->alpha(0, {0.2f, 0.2f}, Vec3(0.f)), 1.f);
  EXPECT_EQ(shading->alpha(0, {0.7f, 0.2f}, Vec3(0.f)), 0.f);
  EXPECT_EQ(shading->alpha(1, {0.2f, 0.2f}, Vec3(0.f)), 0.f);
  EXPECT_EQ(shading->alpha(9, {0.2f, 0.2f}, Vec3(0.f)), 1.f);
  EXPECT_FALSE(shading->needs().uv);  // alpha has its own coordinates
}

TEST(TexturePoint, FindsTheFootprintInUv) {
  SurfacePoint s;
  s.dpdu = {2, 0, 0};
  s.dpdv = {1, 4, 0};
  const TexturePoint at(s, Footprint(s, {2, 0, 0}, {1, 4, 0}));
  EXPECT_NEAR(at.duvdx.x, 1.f, 1e-6f);
  EXPECT_NEAR(at.duvdx.y, 0.f, 1e-6f);
  EXPECT_NEAR(at.duvdy.x, 0.f, 1e-6f);
  EXPECT_NEAR(at.duvdy.y, 1.f, 1e-6f);
}

}  // namespace
}  // namespace cloudrenderer
