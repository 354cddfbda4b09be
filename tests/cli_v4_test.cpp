// pbrt-v4 scenes: pairs of files in v3's and v4's words that must give the same picture, and what is
// v4's own.
#include <gtest/gtest.h>

#include "cli_scene_support.h"
#include "images/images.h"
#include "scene/color_space.h"
#include "scene/language.h"
#include "scene/named_spectra.h"
#include "scene/spectrum.h"
#include "base/equal_area.h"
#include "shading_rgl_support.h"

namespace cloudrenderer {
namespace {

class V4Scenes : public ::testing::Test {
 protected:
  V4Scenes() {
    write_file(folder_.path("white.ppm"), "P6\n2 2\n255\n" + std::string(12, '\xff'));
  }
  RenderedScene picture(const std::string& text, Dialect dialect) {
    write_file(folder_.path("scene.pbrt"), text);
    return render_scene(folder_.path("scene.pbrt"), dialect);
  }
  const parts_test::TemporaryFolder folder_;
};

struct Pair {
  const char* name;
  const char* v3;  // in the world
  const char* v4;
};

constexpr const char* kView = "LookAt 0 -4 2  0 0 0  0 0 1\nCamera \"perspective\" \"float fov\" 45\n";
constexpr const char* kShapes =
    "Shape \"sphere\"\n"
    "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3]\n"
    "  \"point P\" [-5 -5 -1  5 -5 -1  5 5 -1  -5 5 -1] \"float uv\" [0 0 1 0 1 1 0 1]\n";
constexpr const char* kLamp = "LightSource \"point\" \"point from\" [2 -3 4] \"rgb I\" [30 20 10]\n";

const Pair kPairs[] = {
    {"power of a sphere", "AttributeBegin\nTranslate 0 -1 3\nAreaLightSource \"diffuse\" \"rgb L\" [2 4 6]\nShape \"sphere\" \"float radius\" .5\nAttributeEnd",
     "AttributeBegin\nTranslate 0 -1 3\nAreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float power\" 19.739209\nShape \"sphere\" \"float radius\" .5\nAttributeEnd"},
    {"power of triangles", "AreaLightSource \"diffuse\" \"rgb L\" [2 4 6]\nShape \"trianglemesh\" \"integer indices\" [0 2 1 0 3 2] \"point P\" [1 -1 3 2 -1 3 2 0 3 1 0 3]\nAreaLightSource \"diffuse\" \"rgb L\" [0 0 0]",
     "AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float power\" 3.1415927\nShape \"trianglemesh\" \"integer indices\" [0 2 1 0 3 2] \"point3 P\" [1 -1 3 2 -1 3 2 0 3 1 0 3]\nAreaLightSource \"diffuse\" \"rgb L\" [0 0 0]"},
    {"power of a goniometric light", "LightSource \"point\" \"rgb I\" [3 6 9]",
     "LightSource \"goniometric\" \"rgb I\" [1 2 3] \"string filename\" \"white.ppm\" \"float power\" 37.699112"},
    {"diffuse", "Material \"matte\" \"rgb Kd\" [.8 .4 .2]",
     "Material \"diffuse\" \"rgb reflectance\" [.8 .4 .2]"},
    {"conductor without remapping",
     "Material \"metal\" \"rgb eta\" [.2 .9 1.1] \"rgb k\" [3 2 2] \"float roughness\" .2 "
     "\"bool remaproughness\" false",
     "Material \"conductor\" \"rgb eta\" [.2 .9 1.1] \"rgb k\" [3 2 2] \"float roughness\" .2 "
     "\"bool remaproughness\" false"},
    {"v4's roughness is the square of the width",
     "Material \"metal\" \"rgb eta\" [.2 .9 1.1] \"rgb k\" [3 2 2] \"float roughness\" .5 "
     "\"bool remaproughness\" false",
     "Material \"conductor\" \"rgb eta\" [.2 .9 1.1] \"rgb k\" [3 2 2] \"float roughness\" .25"},
    {"dielectric", "LightSource \"infinite\" \"rgb L\" [1 .5 1]\nMaterial \"glass\" \"float eta\" 1.5168",
     "LightSource \"infinite\" \"rgb L\" [1 .5 1]\n"
     "Material \"dielectric\" \"spectrum eta\" \"glass-BK7\""},
    {"diffusetransmission",
     "Material \"translucent\" \"rgb Kd\" [1 1 1] \"rgb Ks\" [0 0 0] \"rgb reflect\" [.5 .4 .3] "
     "\"rgb transmit\" [.25 .25 .25]",
     "Material \"diffusetransmission\" \"rgb reflectance\" [.5 .4 .3]"},
    {"one triangle needs no indices",
     "Shape \"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [-1 -1 1 1 -1 1 0 0 2]",
     "Shape \"trianglemesh\" \"point3 P\" [-1 -1 1 1 -1 1 0 0 2]"},
    {"mix",
     "MakeNamedMaterial \"a\" \"string type\" \"matte\" \"rgb Kd\" [.8 .1 .1]\n"
     "MakeNamedMaterial \"b\" \"string type\" \"matte\" \"rgb Kd\" [.1 .1 .8]\n"
     "Material \"mix\" \"string namedmaterial1\" \"b\" \"string namedmaterial2\" \"a\" "
     "\"rgb amount\" [.25 .25 .25]",
     "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" \"rgb reflectance\" [.8 .1 .1]\n"
     "MakeNamedMaterial \"b\" \"string type\" \"diffuse\" \"rgb reflectance\" [.1 .1 .8]\n"
     "Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" .25"},
    {"names outlive their block in v4",
     "MakeNamedMaterial \"a\" \"string type\" \"matte\" \"rgb Kd\" [.8 .1 .1]\n"
     "NamedMaterial \"a\"",
     "AttributeBegin\nMakeNamedMaterial \"a\" \"string type\" \"diffuse\" "
     "\"rgb reflectance\" [.8 .1 .1]\nAttributeEnd\nNamedMaterial \"a\""},
    {"attributes are defaults", "Material \"matte\" \"rgb Kd\" [.8 .1 .1]",
     "Attribute \"material\" \"rgb reflectance\" [.8 .1 .1]\nMaterial \"diffuse\""},
    {"scaled textures",
     "Texture \"t\" \"spectrum\" \"bilerp\" \"rgb v00\" [.8 .4 .2] \"rgb v11\" [.1 .1 .1] "
     "\"rgb v01\" [.3 .3 .3] \"rgb v10\" [0 .2 .1]\n"
     "Texture \"s\" \"spectrum\" \"scale\" \"texture tex1\" \"t\" \"rgb tex2\" [.5 .5 .5]\n"
     "Material \"matte\" \"texture Kd\" \"s\"",
     "Texture \"t\" \"spectrum\" \"bilerp\" \"rgb v00\" [.8 .4 .2] \"rgb v11\" [.1 .1 .1] "
     "\"rgb v01\" [.3 .3 .3] \"rgb v10\" [0 .2 .1]\n"
     "Texture \"s\" \"spectrum\" \"scale\" \"texture tex\" \"t\" \"float scale\" .5\n"
     "Material \"diffuse\" \"texture reflectance\" \"s\""},
    {"inverted pictures",
     "Texture \"t\" \"spectrum\" \"constant\" \"rgb value\" [.5 .5 .5]\n"
     "Material \"matte\" \"texture Kd\" \"t\"",
     "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"white.ppm\" \"bool invert\" true "
     "\"float scale\" .5\n"
     "Material \"diffuse\" \"texture reflectance\" \"t\""},
    {"power of a point", "LightSource \"point\" \"rgb I\" [1 1 1] \"rgb scale\" [2 2 2] \"point from\" [1 -2 3]",
     "LightSource \"point\" \"float power\" 25.132741 \"point from\" [1 -2 3]"},
    {"illuminance of the sky", "LightSource \"infinite\" \"rgb L\" [2 1 0.5]",
     "LightSource \"infinite\" \"rgb L\" [1 0.5 0.25] \"float illuminance\" 6.2831853"},
    {"a sun", "LightSource \"distant\" \"point from\" [1 -1 2] \"rgb L\" [3 3 3]",
     "LightSource \"distant\" \"point from\" [1 -1 2] \"float illuminance\" 1.5 \"float scale\" 2"},
    {"an even map of equal areas", "LightSource \"infinite\" \"rgb L\" [1 1 1]",
     "LightSource \"infinite\" \"string filename\" \"white.ppm\""},
    {"thin glass without an index is not there", "LightSource \"infinite\"\nMaterial \"none\"",
     "LightSource \"infinite\"\nMaterial \"thindielectric\" \"float eta\" 1"},
    {"a lamp", "AreaLightSource \"diffuse\" \"rgb L\" [4 2 1] \"bool twosided\" true",
     "AreaLightSource \"diffuse\" \"rgb L\" [2 1 .5] \"float scale\" 2 \"bool twosided\" true"},
};

TEST_F(V4Scenes, SayTheSameAsV3InOtherWords) {
  for (const Pair& pair : kPairs) {
    SCOPED_TRACE(pair.name);
    const auto v3 = picture(std::string(kView) +
                                "Film \"image\" \"integer xresolution\" 16 \"integer yresolution\" 16 "
                                "\"string filename\" \"x.exr\" \"float scale\" 2\n"
                                "PixelFilter \"gaussian\" \"float xwidth\" 1.5 \"float ywidth\" 1.5\n"
                                "Sampler \"sobol\" \"integer pixelsamples\" 4\n"
                                "Integrator \"path\" \"integer maxdepth\" 3\nWorldBegin\n" +
                                kLamp + pair.v3 + "\n" + kShapes + "WorldEnd\n",
                            Dialect::v3);
    const auto v4 = picture(std::string(kView) +
                                "Film \"rgb\" \"integer xresolution\" 16 \"integer yresolution\" 16 "
                                "\"string filename\" \"x.exr\" \"float iso\" 200\n"
                                "Sampler \"zsobol\" \"integer pixelsamples\" 4\n"
                                "Integrator \"path\" \"integer maxdepth\" 3\nWorldBegin\n" +
                                kLamp + pair.v4 + "\n" + kShapes,
                            Dialect::v4);
    ASSERT_EQ(v3.error, "");
    ASSERT_EQ(v4.error, "");
    ASSERT_EQ(v3.pixels.size(), v4.pixels.size());
    double sum = 0, difference = 0;
    for (std::size_t i = 0; i < v3.pixels.size(); ++i) {
      sum += static_cast<double>(v3.pixels[i]);
      difference += std::fabs(static_cast<double>(v3.pixels[i] - v4.pixels[i]));
    }
    EXPECT_GT(sum, 1.0);
    // The map is sampled in another way than the constant.
    EXPECT_LE(difference, (std::string(pair.name).find("map of") != std::string::npos ? 0.2 : 1e-5) * sum);
  }
}

TEST_F(V4Scenes, SmoothConductorsShowNoLightsWithoutSize) {
  for (const char* smooth : {"", "\"float roughness\" .0009 \"bool remaproughness\" false"}) {
    const auto scene = [&](const std::string& light) {
      return picture(std::string(kView) +
                         "Film \"rgb\" \"integer xresolution\" 16 \"integer yresolution\" 16 \"string filename\" \"x.exr\"\n"
                         "Sampler \"zsobol\" \"integer pixelsamples\" 4\nWorldBegin\n" +
                         light + "Material \"conductor\" " + smooth + "\nShape \"sphere\"\n",
                     Dialect::v4);
    };
    double lit = 0, mirrored = 0;
    for (const float f : scene(kLamp).pixels) lit += static_cast<double>(f);
    for (const float f : scene("LightSource \"infinite\"\n").pixels) mirrored += static_cast<double>(f);
    EXPECT_EQ(lit, 0.0);
    EXPECT_GT(mirrored, 0.8 * 16 * 16 * 3);
    EXPECT_LT(mirrored, 0.99 * 16 * 16 * 3);
  }
}

TEST_F(V4Scenes, MeasuredMaterialsAreRead) {
  write_file(folder_.path("matt.bsdf"), testing::RglFormula{.alpha_x = 1, .alpha_y = 1, .diffuse = 1, .gloss = 0, .rgb = true}.bytes());
  const auto scene = [&](const std::string& material) {
    return picture(std::string(kView) +
                       "Film \"rgb\" \"integer xresolution\" 16 \"integer yresolution\" 16 \"string filename\" \"x.exr\"\n"
                       "Sampler \"zsobol\" \"integer pixelsamples\" 64\nIntegrator \"path\" \"integer maxdepth\" 2\nWorldBegin\n" +
                       kLamp + "LightSource \"infinite\"\n" + material + kShapes,
                   Dialect::v4);
  };
  const auto measured = scene("Material \"measured\" \"string filename\" \"matt.bsdf\"\n");
  const auto matt = scene("Material \"diffuse\" \"rgb reflectance\" [.9 .6 .3]\n");
  EXPECT_EQ(measured.error + measured.warnings, "");
  ASSERT_EQ(measured.pixels.size(), matt.pixels.size());
  double sum = 0, difference = 0;
  for (std::size_t i = 0; i < matt.pixels.size(); ++i) {
    sum += static_cast<double>(matt.pixels[i]);
    difference += std::fabs(static_cast<double>(matt.pixels[i] - measured.pixels[i]));
  }
  EXPECT_LT(difference, 0.03 * sum);
  EXPECT_NE(scene("Material \"measured\"\n").error.find("needs a \"string filename\""), std::string::npos);
  const std::string missing = scene("Material \"measured\"\n  \"string filename\" \"none.bsdf\"\n").error;
  EXPECT_NE(missing.find("scene.pbrt:10:3: "), std::string::npos) << missing;
  EXPECT_NE(missing.find("none.bsdf': No such file"), std::string::npos) << missing;
}

// What a plane that fills the view reflects.
TEST_F(V4Scenes, FloatTexturesAreTheMeanOfDecodedColours) {
  write_file(folder_.path("moss.ppm"), std::string("P6\n1 1\n255\n") + "\x33\x66\x1a");
  std::vector<unsigned char> file;
  const std::array<std::uint8_t, 3> moss{0x33, 0x66, 0x1a};
  std::string why;
  ASSERT_TRUE(encode_bytes("moss.png", 1, 1, moss.data(), file, why)) << why;
  write_file(folder_.path("moss.png"), std::string(file.begin(), file.end()));
  const auto reflected = [&](const std::string& name, const std::string& more) {
    const auto scene = picture("Camera \"orthographic\"\nFilm \"rgb\" \"integer xresolution\" 2 \"integer yresolution\" 2 \"string filename\" \"x.exr\"\n"
                               "Sampler \"zsobol\" \"integer pixelsamples\" 256\nWorldBegin\nLightSource \"infinite\"\n"
                               "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"" + name + "\" " + more + "\n"
                               "Texture \"c\" \"spectrum\" \"scale\" \"rgb tex\" [1 1 1] \"texture scale\" \"t\"\n"
                               "Material \"diffuse\" \"texture reflectance\" \"c\"\nShape \"disk\" \"float radius\" 9 \"float height\" 2\n",
                               Dialect::v4);
    EXPECT_EQ(scene.error, "");
    return scene.pixels.empty() ? 0.f : scene.pixels[0];
  };
  EXPECT_NEAR(reflected("moss.png", "\"string encoding\" \"sRGB\""), .0588f, 1e-3f);
  EXPECT_NEAR(reflected("moss.png", "\"string encoding\" \"linear\""), .2340f, 2e-3f);
  EXPECT_NEAR(reflected("moss.ppm", "\"string encoding\" \"linear\""), .0588f, 1e-3f) << "pictures of other kinds than PNG have their encoding";
}

// A spectrum picture ends at 1 before other textures see it, unless it is of something that may be more.
TEST_F(V4Scenes, PicturesOfAlbedosEndAtOne) {
  write_file(folder_.path("grey.ppm"), std::string("P6\n1 1\n255\n") + "\xf3\xf3\xf3");  // 0.896 when decoded
  const auto seen = [&](const std::string& texture, const std::string& material) {
    const auto scene = picture("Camera \"orthographic\"\nFilm \"rgb\" \"integer xresolution\" 2 \"integer yresolution\" 2 \"string filename\" \"x.exr\"\n"
                               "Sampler \"zsobol\" \"integer pixelsamples\" 64\nWorldBegin\nLightSource \"infinite\"\n"
                               "Texture \"w\" \"spectrum\" \"imagemap\" \"string filename\" \"grey.ppm\" \"float scale\" 3\n" + texture + material +
                               "\nShape \"disk\" \"float radius\" 9 \"float height\" 2\n",
                               Dialect::v4);
    EXPECT_EQ(scene.error, "");
    return scene.pixels.empty() ? 0.f : scene.pixels[0];
  };
  const std::string diffuse = "Material \"diffuse\" \"texture reflectance\" \"t\"";
  EXPECT_NEAR(seen("Texture \"t\" \"spectrum\" \"scale\" \"texture tex\" \"w\" \"float scale\" .5\n", diffuse), 0.5f, 1e-3f);
  EXPECT_NEAR(seen("Texture \"t\" \"spectrum\" \"mix\" \"texture tex1\" \"w\" \"rgb tex2\" [.5 .5 .5] \"float amount\" .5\n", diffuse), 0.75f, 1e-3f);
  // Conductors: ((eta - 1)^2 + k^2) / ((eta + 1)^2 + k^2), here for eta = 2.688 / 2 and k = 1.
  EXPECT_NEAR(seen("Texture \"t\" \"spectrum\" \"scale\" \"texture tex\" \"w\" \"float scale\" .5\n",
                   "Material \"conductor\" \"texture eta\" \"t\" \"rgb k\" [1 1 1]"), 0.1722f, 2e-3f);
}

// Whatever paths see of a mirror behind a diffuse surface is what a rough one shows; seen by itself it stays a mirror.
TEST_F(V4Scenes, RegularizedPathsSeeRoughMirrorsBehindDiffuseSurfaces) {
  const auto shown = [&](bool regularize, const std::string& roughness, const std::string& view) {
    const std::string integrator = "Integrator \"path\" \"integer maxdepth\" 3 \"bool regularize\" " + std::string(regularize ? "true" : "false") + "\n";
    RenderedScene out = picture(integrator + view + "Camera \"perspective\" \"float fov\" 45\nSampler \"independent\" \"integer pixelsamples\" 16\n"
        "Film \"rgb\" \"integer xresolution\" 16 \"integer yresolution\" 12\nWorldBegin\n" + std::string(kLamp) +
        "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [9 9 9]\nTranslate 3 0 1\nShape \"sphere\" \"float radius\" .5\nAttributeEnd\n"
        "Material \"diffuse\"\nShape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point3 P\" [-5 -5 -1  5 -5 -1  5 5 -1  -5 5 -1]\n"
        "Material \"conductor\" \"bool remaproughness\" false \"float roughness\" " + roughness + "\n"
        "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point3 P\" [-2 3 -1  2 3 -1  2 3 3  -2 3 3]\n", Dialect::v4);
    EXPECT_EQ(out.error, "");
    EXPECT_EQ(out.warnings, "");
    return out.pixels;
  };
  const std::string floor = "LookAt 0 0 4  0 0.01 0  0 1 0\n", mirror = "LookAt 0 0 1  0 3 1  0 0 1\n";
  EXPECT_EQ(shown(true, "0", floor), shown(false, ".1", floor));
  EXPECT_EQ(shown(true, ".1", floor), shown(false, ".2", floor));
  EXPECT_NE(shown(false, "0", floor), shown(false, ".1", floor));
  EXPECT_NE(shown(true, "0", mirror), shown(false, ".1", mirror));
}

TEST_F(V4Scenes, LampsThatAConstantMaskHidesShine) {
  const auto lit = [&](const std::string& alpha) {
    const auto scene = picture("LookAt 0 0 3 0 0 0 0 1 0\nCamera \"orthographic\" \"float screenwindow\" [-.1 .1 -.1 .1]\nFilm \"rgb\" \"integer xresolution\" 2 \"integer yresolution\" 2 \"string filename\" \"x.exr\"\n"
                               "Sampler \"zsobol\" \"integer pixelsamples\" 64\nIntegrator \"path\" \"integer maxdepth\" 1\nWorldBegin\n"
                               "Texture \"none\" \"float\" \"constant\" \"float value\" 0\nMaterial \"diffuse\" \"rgb reflectance\" [1 1 1]\nShape \"disk\" \"float radius\" 20\n"
                               "AreaLightSource \"diffuse\" \"rgb L\" [10 10 10]\nTranslate 0 0 6\nReverseOrientation\n"
                               "Shape \"trianglemesh\" \"point3 P\" [-.5 -.5 0 .5 -.5 0 .5 .5 0 -.5 .5 0] \"integer indices\" [0 1 2 0 2 3] " + alpha + "\n",
                               Dialect::v4);
    EXPECT_EQ(scene.error, "");
    return scene.pixels.empty() ? 0.f : scene.pixels[0];
  };
  // 10 / pi times the form factor of a unit square at distance 6 above.
  for (const char* alpha : {"", "\"float alpha\" 0", "\"texture alpha\" \"none\""}) EXPECT_NEAR(lit(alpha), 10 / kPi / 36 * 0.9908f, 2e-3f) << alpha;
}

TEST_F(V4Scenes, ParametersGoOnBehindAnInclude) {
  write_file(folder_.path("dense.pbrt"), "MakeNamedMedium \"m\" \"string type\" \"uniformgrid\" \"float density\" [1]\n");
  write_file(folder_.path("outer.pbrt"), "Include \"dense.pbrt\"\n");
  const auto scene = picture("Film \"rgb\" \"integer xresolution\" 4 \"integer yresolution\" 4 \"string filename\" \"x.exr\"\nWorldBegin\nLightSource \"infinite\"\nInclude \"outer.pbrt\"\n\"float g\" .5 \"spectrum sigma_a\" [300 20 830 20]\nMediumInterface \"m\" \"\"\nShape \"sphere\"\n",
                             Dialect::v4);
  EXPECT_EQ(scene.error, "");
  EXPECT_EQ(scene.warnings, "");
}

TEST_F(V4Scenes, OptionsAreANameAndAValueOrLikeParameters) {
  for (const char* option : {"\"seed\" 5", "\"disablepixeljitter\" true", "\"rendercoordsys\" \"world\"",
                             "\"msereferenceimage\" [ \"a.exr\" ]", "\"integer seed\" 5"}) {
    const auto scene = picture("Option " + std::string(option) +
                                   "\nFilm \"rgb\" \"integer xresolution\" 2 \"integer yresolution\" 2 \"string filename\" \"x.exr\"\n"
                                   "WorldBegin\nLightSource \"infinite\"\n",
                               Dialect::v4);
    EXPECT_EQ(scene.error, "") << option;
    EXPECT_EQ(scene.pixels.size(), 12u);
  }
  EXPECT_NE(picture("Option \"seed\"", Dialect::v4).error, "");
}

TEST_F(V4Scenes, AreToldFromTheOlderOnes) {
  const auto dialect_of = [&](const std::string& text) {
    write_file(folder_.path("scene.pbrt"), text);
    Warnings warnings;
    LanguageUse use;
    ParseOptions options;
    options.use = &use;
    struct : SceneSink {
      void begin_object(ObjectId, const std::string&) override {}
      void end_object(ObjectId) override {}
      void shape(ShapeDesc&&, const SceneDescription&) override {}
      void instance(const InstanceDesc&, const SceneDescription&) override {}
    } sink;
    parse_scene(folder_.path("scene.pbrt"), options, sink, warnings);
    return use.dialect();
  };
  EXPECT_EQ(dialect_of("WorldBegin WorldEnd"), Dialect::v2);
  EXPECT_EQ(dialect_of("Integrator \"path\" WorldBegin WorldEnd"), Dialect::v3);
  EXPECT_EQ(dialect_of("Film \"image\" \"float scale\" 2 WorldBegin WorldEnd"), Dialect::v3);
  EXPECT_EQ(dialect_of("Film \"image\" WorldBegin Texture \"t\" \"color\" \"imagemap\" \"float scale\" 2 WorldEnd"), Dialect::v2);
  EXPECT_EQ(dialect_of("WorldBegin Material \"glass\" \"float eta\" 1.6 WorldEnd"), Dialect::v3);
  EXPECT_EQ(dialect_of("WorldBegin Material \"kdsubsurface\" \"rgb mfp\" [1 1 1] WorldEnd"), Dialect::v3);
  EXPECT_EQ(dialect_of("Integrator \"volpath\" Film \"rgb\" WorldBegin"), Dialect::v4);
  EXPECT_EQ(dialect_of("Integrator \"path\" Film \"image\" WorldBegin WorldEnd"), Dialect::v3);
  EXPECT_EQ(dialect_of("WorldBegin MakeNamedMaterial \"x\" \"string type\" \"diffuse\""), Dialect::v4);
  EXPECT_EQ(dialect_of("WorldBegin MakeNamedMaterial \"x\" \"string type\" [ \"matte\" ] WorldEnd"),
            Dialect::v2);
  EXPECT_EQ(dialect_of("Option \"bool disablepixeljitter\" true WorldBegin"), Dialect::v4);
  EXPECT_EQ(dialect_of("ColorSpace \"rec2020\" WorldBegin"), Dialect::v4);
  EXPECT_EQ(dialect_of("WorldBegin Material \"conductor\" \"spectrum eta\" \"metal-Au-eta\""),
            Dialect::v4);
}

TEST(V4Spectra, LightsHaveALuminanceOfOneAndReflectancesAreSeenByDaylight) {
  for (const char* name : {"stdillum-A", "stdillum-F11", "illum-acesD60"})
    EXPECT_NEAR(luminance(*named_spectrum(name)), 1.f, 1e-3f) << name;
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR((*named_spectrum("stdillum-D65"))[c], 1.f, 2e-3f);
    EXPECT_NEAR(reflectance_to_rgb({{400, 700}, {0.5, 0.5}})[c], 0.5f, 1e-3f);
    EXPECT_NEAR((*named_spectrum("metal-MgO-eta"))[c], 1.7375f, 0.03f);
  }
  EXPECT_NEAR(luminance(illuminant_to_rgb({{400, 700}, {3, 8}})), 1.f, 1e-4f);
  EXPECT_FALSE(named_spectrum("metal-Unobtainium-k"));
}

TEST(V4Spectra, ColorSpacesKeepWhite) {
  for (const char* name : {"srgb", "rec2020", "dci-p3"}) {
    const Rgb white = ColorSpace::find(name)->to_working({1, 1, 1});
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(white[c], 1.f, 2e-3f) << name;
  }
  // ITU-R BT.2087: the red of BT.2020 in BT.709.
  const Rgb red = ColorSpace::find("rec2020")->to_working({1, 0, 0});
  EXPECT_NEAR(red.x, 1.6605f, 5e-3f);
  EXPECT_NEAR(red.y, -0.1246f, 5e-3f);
  EXPECT_NEAR(red.z, -0.0182f, 5e-3f);
  EXPECT_FALSE(ColorSpace::find("cmyk"));
}

TEST(V4Maps, SquaresOfEqualAreaGoToTheSphereAndBack) {
  constexpr int kSide = 64;
  double z2 = 0, x2 = 0;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const Vec2 uv((static_cast<float>(x) + 0.5f) / kSide, (static_cast<float>(y) + 0.5f) / kSide);
      const Vec3 d = equal_area_square_to_sphere(uv);
      EXPECT_NEAR(glm::length(d), 1.f, 1e-5f);
      const Vec2 back = equal_area_sphere_to_square(d);
      EXPECT_NEAR(back.x, uv.x, 1e-4f);
      EXPECT_NEAR(back.y, uv.y, 1e-4f);
      z2 += static_cast<double>(d.z * d.z) / (kSide * kSide);
      x2 += static_cast<double>(d.x * d.x) / (kSide * kSide);
    }
  EXPECT_NEAR(z2, 1.0 / 3, 1e-3);  // as of uniform directions
  EXPECT_NEAR(x2, 1.0 / 3, 1e-3);
  EXPECT_EQ(equal_area_sphere_to_square({0, 0, 1}), Vec2(0.5f));
  EXPECT_GT(equal_area_square_to_sphere({0.9f, 0.5f}).x, 0.f);
  EXPECT_GT(equal_area_square_to_sphere({0.5f, 0.9f}).y, 0.f);
}

}  // namespace
}  // namespace cloudrenderer
