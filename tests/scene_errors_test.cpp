// Broken scenes: each gives an error with its place, none does anything worse.
#include <gtest/gtest.h>

#include <random>

#include "scene_collector.h"

namespace cloudrenderer {
namespace {

std::string error_of(const std::string& text) {
  try {
    parse_text(text);
  } catch (const SceneError& e) {
    return e.what();
  }
  return "no error";
}

struct Broken {
  const char* text;
  const char* place;    // line:column
  const char* message;  // a part of it
};

class BrokenScene : public testing::TestWithParam<Broken> {};

TEST_P(BrokenScene, SaysWhereAndWhat) {
  const std::string what = error_of(GetParam().text);
  EXPECT_NE(what.find(std::string("scene.pbrt:") + GetParam().place + ": error: "),
            std::string::npos)
      << what;
  EXPECT_NE(what.find(GetParam().message), std::string::npos) << what;
}

INSTANTIATE_TEST_SUITE_P(
    All, BrokenScene,
    testing::Values(
        Broken{"", "1:1", "no WorldBegin"},
        Broken{"Camera \"perspective\"\n", "2:1", "no WorldBegin"},
        Broken{"WorldBegin Foo \"x\" WorldEnd", "1:12", "unknown directive 'Foo'"},
        Broken{"WorldBegin\n  5 WorldEnd", "2:3", "expected a directive, found '5'"},
        Broken{"WorldBegin \"x\"", "1:12", "expected a directive, found \"x\""},
        Broken{"WorldBegin ]", "1:12", "expected a directive"},
        Broken{"WorldBegin [", "1:12", "expected a directive"},
        Broken{"WorldEnd", "1:1", "WorldEnd without WorldBegin"},
        Broken{"WorldBegin Shape", "1:17", "expected a type in quotes, found the end"},
        Broken{"WorldBegin Shape 5", "1:18", "expected a type in quotes, found '5'"},
        Broken{"WorldBegin Shape [\"a\" 5", "1:23", "expected ']'"},
        Broken{"WorldBegin Shape \"sphere", "1:18", "string does not end"},
        Broken{"WorldBegin Shape \"sphere\n\"", "1:18", "string does not end on its line"},
        Broken{"WorldBegin Shape \"a\" \"float\" 5", "1:22", "has no name"},
        Broken{"Option \"x\" WorldBegin Shape \"a\" \"double x\" 5", "1:33", "types are float"},
        Broken{"Option \"x\" WorldBegin Shape \"a\" \"radius\" 5", "1:33", "expected a parameter as \"type name\""},
        Broken{"Option \"x\" WorldBegin Shape \"a\" \"\" 5", "1:33", "expected a parameter"},
        Broken{"WorldBegin Shape \"a\" \"float x\"", "1:31",
               "expected a number or '[', found the end"},
        Broken{"Option \"x\" WorldBegin Shape \"a\" \"float x\" \"y\"", "1:43",
               "expected a number or '[', found \"y\""},
        Broken{"WorldBegin Shape \"a\" \"float x\" [1 2", "1:36",
               "expected a number or ']', found the end"},
        Broken{"WorldBegin Shape \"a\" \"float x\" [1\n2 abc]", "2:3", "found 'abc'"},
        Broken{"WorldBegin Shape \"a\" \"float x\" [1 2x]", "1:35", "'2x' is not a number"},
        Broken{"WorldBegin Shape \"a\" \"float x\" [1 [2]]", "1:35",
               "expected a number or ']', found '['"},
        Broken{"WorldBegin Shape \"a\" \"float x\" [1 - 2]", "1:35", "'-' is not a number"},
        Broken{"WorldBegin Shape \"a\" \"float x\" [1 1e]", "1:35", "'1e' is not a number"},
        Broken{"WorldBegin Shape \"a\" \"float x\" [nanny]", "1:33", "found 'nanny'"},
        Broken{"Option \"x\" WorldBegin Shape \"a\" \"float x\" [\"1\"]", "1:44", "expected a number"},
        Broken{"WorldBegin Shape \"a\" \"float x\" 1.2.3", "1:32", "'1.2.3' is not a number"},
        Broken{"WorldBegin Shape \"a\" \"point P\" [1 2 1e39]", "1:37", "too large for a float"},
        Broken{"WorldBegin Shape \"a\" \"point P\" [1 2]", "1:22", "no multiple of 3"},
        Broken{"WorldBegin Shape \"a\" \"rgb P\" 1", "1:22", "no multiple of 3"},
        Broken{"WorldBegin Shape \"a\" \"integer n\" [1 3000000000]", "1:37", "32 bits"},
        Broken{"WorldBegin Shape \"a\" \"integer n\" [99999999999999999999]", "1:35", "32 bits"},
        Broken{"WorldBegin Shape \"a\" \"integer n\" [1 x]", "1:37", "found 'x'"},
        Broken{"WorldBegin Shape \"a\" \"integer n\" [1 2..]", "1:37", "is not a number"},
        Broken{"WorldBegin Shape \"a\" \"integer n\" 1e10", "1:34", "32 bits"},
        Broken{"WorldBegin Shape \"a\" \"bool b\" maybe", "1:31",
               "expected true or false, found 'maybe'"},
        Broken{"WorldBegin Shape \"a\" \"bool b\" [true 1]", "1:37", "expected true or false"},
        Broken{"WorldBegin Shape \"a\" \"bool b\" [true", "1:36", "found the end of the file"},
        Broken{"WorldBegin Shape \"a\" \"string s\" word", "1:33", "expected a string in quotes"},
        Broken{"WorldBegin Shape \"a\" \"string s\" [\"x\" 5]", "1:38",
               "expected a string in quotes"},
        Broken{"WorldBegin Shape \"a\" \"string s\" [\"x\"", "1:37", "found the end of the file"},
        Broken{"WorldBegin Shape \"a\" \"texture t\" [\"x\" \"y\"]", "1:22",
               "must name one texture"},
        Broken{"WorldBegin Shape \"a\" \"spectrum s\" [1]", "1:22",
               "pairs of wavelength and value"},
        Broken{"WorldBegin Shape \"a\" \"spectrum s\" []", "1:22", "pairs of wavelength and value"},
        Broken{"WorldBegin Shape \"a\" \"spectrum s\" [\"x\" 5]", "1:40", "expected the name of a .spd file"},
        Broken{"Option \"x\" WorldBegin Shape \"a\" \"spectrum s\" \"gone.spd\"", "1:46", "gone.spd"},
        Broken{"WorldBegin Shape \"a\" \"spectrum s\" [400 true]", "1:40",
               "wavelengths and values"},
        Broken{"WorldBegin Shape \"a\" \"blackbody s\" [6500]", "1:22", "no multiple of 2"},
        Broken{"Translate 1 2", "1:14", "Translate: expected a number, found the end"},
        Broken{"LookAt 1 2 3 4 5 6 7 8 up", "1:24", "LookAt: expected a number, found 'up'"},
        Broken{"Scale 1 1e400 1", "1:1", "too large"},
        Broken{"Scale 1e30 1 1 Scale 1e30 1 1", "1:16", "makes the transformation too large"},
        Broken{"Transform [1 2 3]", "1:17", "expected a number, found ']'"},
        Broken{"Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1]", "1:44",
               "expected ']' after 16 numbers"},
        Broken{"Rotate 1 2 - 4", "1:12", "'-' is not a number"},
        Broken{"Scale 0 1 1 Camera \"perspective\"", "1:13", "camera cannot be inverted"},
        Broken{"WorldBegin Scale 0 1 1 LightSource \"point\"", "1:24", "light cannot be inverted"},
        Broken{"ActiveTransform Never", "1:17", "StartTime, EndTime or All"},
        Broken{"TransformTimes 1 0", "1:16", "end must not be before the start"},
        Broken{"TransformTimes 0 1e99", "1:18", "must be finite"},
        Broken{"TransformTimes 0 nan", "1:18", "expected a number"},
        Broken{"ActiveTransform EndTime Scale 1e38 1 1 Scale 1e38 1 1", "1:40", "makes the transformation too large"},
        Broken{"CoordSysTransform 5", "1:19", "coordinate system in quotes"},
        Broken{"Include \"gone.pbrt\"", "1:1", "No such file"},
        Broken{"Include 7", "1:9", "name of a file in quotes"},
        Broken{"\nInclude \"scene.pbrt\"", "2:1", "includes itself"},
        Broken{"ColorSpace \"srgb\" WorldBegin Texture \"t\" \"vector\" \"constant\"", "1:42",
               "\"float\" or \"spectrum\""},
        Broken{"WorldBegin Texture \"t\" \"float\"", "1:31", "expected a type in quotes"},
        Broken{"WorldBegin NamedMaterial", "1:25", "name of a material in quotes"},
        Broken{"Option \"x\" WorldBegin MakeNamedMaterial \"m\" \"string type\" 5", "1:59",
               "expected a string in quotes"},
        Broken{"WorldBegin MakeNamedMaterial \"m\" \"float type\" 5", "1:34",
               "must be of type string"},
        Broken{"WorldBegin ObjectInstance", "1:26", "name of an object in quotes"},
        Broken{"WorldBegin MediumInterface Shape", "1:28", "name of a medium in quotes"},
        Broken{"WorldBegin Volume \"volumegrid\" \"integer nx\" 2 \"float density\" [1 2 3]", "1:12", "needs 2 values"},
        Broken{"WorldBegin Volume \"volumegrid\"", "1:12", "needs 1 values"},
        Broken{"WorldBegin Volume \"volumegrid\" \"integer nx\" -1", "1:12", "nx of a density grid must be"},
        Broken{"WorldBegin Volume \"volumegrid\" \"integer nx\" 1000000 \"integer ny\" 1000000 \"integer nz\" 1000000 \"float density\" 1",
               "1:12", "needs 1000000000000000000 values"},
        Broken{"WorldBegin Volume \"volumegrid\" \"float density\" -1", "1:12", "densities must be"},
        Broken{"WorldBegin MakeNamedMedium \"m\" \"string type\" \"heterogeneous\" \"float density\" 1 \"point p1\" [0 1 1]", "1:12",
               "must have a volume"}));

TEST(Errors, ComeFromTheIncludedFile) {
  const TemporaryFolder folder;
  folder.write("parts/b.pbrt", "Shape \"sphere\"\n  \"float radius\" oops");
  const std::string path = folder.write("a.pbrt", "WorldBegin Include \"parts/b.pbrt\" WorldEnd");
  SceneCollector sink;
  Warnings warnings;
  try {
    parse_scene(path, {}, sink, warnings);
    FAIL();
  } catch (const SceneError& e) {
    EXPECT_EQ(std::string(e.what()).find(folder.path("parts/b.pbrt") + ":2:18: error: "), 0u)
        << e.what();
  }
}

TEST(Errors, EndlessIncludesAreSeen) {
  const TemporaryFolder folder;
  folder.write("b.pbrt", "Include \"c.pbrt\"");
  folder.write("c.pbrt", "Include \"./b.pbrt\"");
  const std::string path = folder.write("a.pbrt", "WorldBegin Include \"b.pbrt\" WorldEnd");
  SceneCollector sink;
  Warnings warnings;
  EXPECT_THROW(parse_scene(path, {}, sink, warnings), SceneError);
}

TEST(Errors, AFileThatCannotBeOpenedIsOne) {
  SceneCollector sink;
  Warnings warnings;
  EXPECT_THROW(parse_scene("/nowhere/scene.pbrt", {}, sink, warnings), SceneError);
  EXPECT_THROW(parse_scene("/", {}, sink, warnings), SceneError);
}

TEST(Errors, ABadSpectrumFileSaysItsOwnPlace) {
  const TemporaryFolder folder;
  folder.write("a.spd", "400 1\n500 x\n");
  const std::string path =
      folder.write("a.pbrt", "WorldBegin Shape \"a\" \"spectrum s\" \"a.spd\" WorldEnd");
  SceneCollector sink;
  Warnings warnings;
  try {
    parse_scene(path, {}, sink, warnings);
    FAIL();
  } catch (const SceneError& e) {
    EXPECT_NE(std::string(e.what()).find("a.spd:2:5: error: 'x' is not a number"),
              std::string::npos)
        << e.what();
  }
}

TEST(Errors, HugeNestingIsBounded) {
  std::string text = "WorldBegin ";
  for (int i = 0; i < 30000; ++i) text += "AttributeBegin ";
  EXPECT_NE(error_of(text).find("nested too deep"), std::string::npos);
  text = "WorldBegin Shape \"a\" ";
  for (int i = 0; i < 1100; ++i) text += "\"float a" + std::to_string(i) + "\" 1 ";
  EXPECT_NE(error_of(text).find("more than 1000 parameters"), std::string::npos);
}

const char* const kSeed = R"(LookAt 0 0 -5  0 0 0  0 1 0
Camera "perspective" "float fov" [39] Film "image" "integer xresolution" 320
Sampler "halton" Integrator "path" "bool x" "true"
WorldBegin # comment
CoordinateSystem "a" Texture "t" "color" "constant" "rgb value" [1 .5 0]
MakeNamedMaterial "m" "string type" "glass" NamedMaterial "m"
MakeNamedMaterial "x" "string type" "mix" "string namedmaterial1" "m" "texture amount" "t"
AttributeBegin AreaLightSource "diffuse" "blackbody L" [6500 1]
Shape "trianglemesh" "point P" [0 0 0 1 0 0 0 1e+000 0] "integer indices" [0 1 2] AttributeEnd
ObjectBegin "o" Rotate 30 1 0 0 Shape "sphere" "spectrum Kd" [400 1 700 2] ObjectEnd
TransformBegin Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1] ObjectInstance "o" TransformEnd
Material "matte" "texture Kd" "t" Shape "disk" "xyz Kd" [1 1 1] ReverseOrientation
WorldEnd
)";

// Begins with "file:line:column: error: ".
bool has_place(std::string_view what) {
  const std::size_t colon = what.find(':');
  if (colon == 0 || colon == std::string_view::npos) return false;
  what.remove_prefix(colon);
  for (int i = 0; i < 2; ++i) {
    const std::size_t digits = what.find_first_not_of("0123456789", 1);
    if (digits == 1 || digits == std::string_view::npos || what[0] != ':') return false;
    what.remove_prefix(digits);
  }
  return what.starts_with(": error: ");
}

TEST(Errors, DamagedScenesNeverCrash) {
  std::mt19937 random(3);
  const std::string seed = kSeed;
  const TemporaryFolder folder;
  const auto error_in_file = [&](const std::string& text) -> std::string {
    SceneCounter sink;
    Warnings warnings;
    try {
      parse_scene(folder.write("scene.pbrt", text), {}, sink, warnings);
    } catch (const SceneError& e) {
      return e.what();
    }
    return "no error";
  };
  const std::string_view pieces[] = {"[",        "]",     "\"", "#",  "\n", "AttributeEnd",
                                     "WorldEnd", "1e999", "-",  "\\", "0"};
  for (int i = 0; i < 1000; ++i) {
    std::string text = seed;
    for (unsigned j = random() % 4; j != 0; --j) {
      const std::size_t at = random() % text.size();
      switch (random() % 4) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text.erase(at, random() % 30);
          break;
        case 2:
          text.insert(at, pieces[random() % std::size(pieces)]);
          break;
        default:
          text.insert(at, text.substr(random() % text.size(), random() % 60));
      }
    }
    const std::string what = error_in_file(text);
    if (what == "no error") continue;
    ASSERT_TRUE(has_place(what)) << what;
  }
  EXPECT_EQ(error_in_file(seed), "no error");
}

}  // namespace
}  // namespace cloudrenderer
