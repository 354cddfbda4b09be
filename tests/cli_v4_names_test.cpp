// pbrt-v4: names of materials, textures and media are of the whole scene, also in front of what they name.
#include <gtest/gtest.h>

#include "cli_scene_support.h"

namespace cloudrenderer {
namespace {

class V4Names : public ::testing::Test {
 protected:
  RenderedScene picture(const std::string& world) {
    write_file(folder_.path("scene.pbrt"),
               "LookAt 0 -4 2  0 0 0  0 0 1\nCamera \"perspective\" \"float fov\" 45\n"
               "Film \"rgb\" \"integer xresolution\" 16 \"integer yresolution\" 16 \"string filename\" \"x.exr\"\n"
               "Sampler \"zsobol\" \"integer pixelsamples\" 4\nWorldBegin\n"
               "LightSource \"point\" \"point3 from\" [2 -3 4] \"rgb I\" [30 20 10]\n" + world);
    return render_scene(folder_.path("scene.pbrt"), Dialect::v4);
  }
  const parts_test::TemporaryFolder folder_;
};

const std::string kTexture = "Texture \"rows\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [.9 .2 .1] \"rgb tex2\" [.1 .2 .9] \"float uscale\" 6\n";
const std::string kMaterials = "AttributeBegin\nMakeNamedMaterial \"red\" \"string type\" \"diffuse\" \"rgb reflectance\" [.9 .1 .1]\n"
                               "MakeNamedMaterial \"rows\" \"string type\" \"diffuse\" \"texture reflectance\" \"rows\"\n"
                               "MakeNamedMaterial \"both\" \"string type\" \"mix\" \"string materials\" [\"red\" \"rows\"] \"float amount\" .4\nAttributeEnd\n";
const std::string kMedium = "MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [1 2 3] \"rgb sigma_s\" [2 2 2]\n";
const std::string kShapes = "NamedMaterial \"red\"\nShape \"sphere\" \"float radius\" .6\n"
                            "AttributeBegin\nNamedMaterial \"both\"\nTranslate 1.2 0 0\nShape \"sphere\" \"float radius\" .5\nAttributeEnd\n"
                            "AttributeBegin\nMediumInterface \"fog\" \"\"\nMaterial \"interface\"\nTranslate 0 -1 0\nShape \"sphere\" \"float radius\" .3\n"
                            "NamedMaterial \"red\"\nTranslate -1 0 0\nShape \"sphere\" \"float radius\" .1\nAttributeEnd\n"
                            "Material \"diffuse\" \"texture reflectance\" \"rows\"\n"
                            "Shape \"bilinearmesh\" \"point3 P\" [-5 -5 -1  5 -5 -1  -5 5 -1  5 5 -1] \"point2 uv\" [0 0 1 0 0 1 1 1]\n";

TEST_F(V4Names, MayStandInFrontOfWhatTheyName) {
  const auto usual = picture(kTexture + kMaterials + kMedium + kShapes);
  const auto late = picture(kShapes + kMedium + kMaterials + kTexture);
  EXPECT_EQ(usual.error + usual.warnings, "");
  EXPECT_EQ(late.error + late.warnings, "");
  ASSERT_FALSE(usual.pixels.empty());
  EXPECT_EQ(usual.pixels, late.pixels);
}

TEST_F(V4Names, ThatNothingHasAreWarnedOf) {
  const auto scene = picture(kShapes);
  EXPECT_EQ(scene.error, "");
  for (const char* part : {"10:1: warning: there is no material \"both\": diffuse is used", "there is no material \"red\"", "there is no medium \"fog\": vacuum is used",
                           "there is no texture \"rows\": the parameter is ignored"})
    EXPECT_NE(scene.warnings.find(part), std::string::npos) << part << "\nin\n" << scene.warnings;
}

// A mix of two materials that are not there yet, or of itself, is no circle.
TEST_F(V4Names, MixesWantWhatTheyMix) {
  const std::string mix = "MakeNamedMaterial \"a\" \"string type\" \"mix\" \"string materials\" [\"b\" \"a\"]\n"
                          "MakeNamedMaterial \"b\" \"string type\" \"mix\" \"string materials\" [\"a\" \"b\"]\n";
  const auto scene = picture("NamedMaterial \"a\"\nShape \"sphere\"\nNamedMaterial \"b\"\nShape \"disk\"\n" + mix);
  EXPECT_EQ(scene.error, "");
  EXPECT_NE(scene.warnings.find("there is no material \"b\": diffuse is mixed"), std::string::npos) << scene.warnings;
  ASSERT_FALSE(scene.pixels.empty());
}

TEST_F(V4Names, UnknownPresetsLeaveWhatIsGivenOrOne) {
  const auto fog = [&](const std::string& params) {
    return picture("MediumInterface \"fog\" \"\"\nMaterial \"interface\"\nShape \"sphere\"\n"
                   "MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" " + params + "\n");
  };
  const auto one = fog("");
  const auto unknown = fog("\"string preset\" \"porridge\"");
  EXPECT_NE(unknown.warnings.find("there is no measured medium \"porridge\""), std::string::npos);
  EXPECT_EQ(unknown.pixels, one.pixels);
  EXPECT_EQ(fog("\"string preset\" \"porridge\" \"rgb sigma_a\" [3 2 1]").pixels, fog("\"rgb sigma_a\" [3 2 1]").pixels);
  const auto ketchup = fog("\"string preset\" \"Ketchup\"");
  EXPECT_EQ(fog("\"string preset\" \"Ketchup\" \"rgb sigma_a\" [3 2 1]").pixels, ketchup.pixels) << "a preset counts more";
  EXPECT_NE(ketchup.pixels, one.pixels);
}

}  // namespace
}  // namespace cloudrenderer
