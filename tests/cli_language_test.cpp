// The tables of the scene language against what the readers do.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <sstream>

#include "cli_scene_support.h"
#include "nanovdb_support.h"
#include "scene/language.h"
#include "scene/parser.h"
#include "shading_rgl_support.h"

namespace cloudrenderer {
namespace {

// A value that any parameter of this type and name may have.
std::string value_of(const LanguageRow& row, const LanguageParam& p) {
  const std::string name(p.name), type(p.type);
  static const std::map<std::string, std::string> kNamed{{"portal", "[0 0 0 0 1 0 1 1 0 1 0 0]"}, 
      {"shutteropen", "0"},
      {"indices", "[0 1 2]"},   {"P", "[0 0 0 1 0 0 0 1 0]"},
      {"N", "[0 0 1 0 0 1 0 0 1]"}, {"S", "[1 0 0 1 0 0 1 0 0]"},
      {"uv", "[0 0 1 0 0 1]"},  {"st", "[0 0 1 0 0 1]"},
      {"nu", "2"},              {"nv", "2"},
      {"Pz", "[0 0 0 0]"},      {"p1", "[1 0 0]"},
      {"p2", "[1 1 1]"},        {"innerradius", "0.25"},
      {"zmin", "0.1"},          {"zmax", "0.4"},
      {"screenwindow", "[-1 1 -1 1]"}, {"cropwindow", "[0 1 0 1]"},
      {"fov", "45"},            {"halffov", "30"},
      {"to", "[0 0 1]"},        {"from", "[1 2 3]"},
      {"dimension", "2"},       {"mapping", "\"planar\""},
      {"wrap", "\"clamp\""},    {"aamode", "\"none\""},
      {"strategy", "\"all\""},  {"namedmaterial1", "\"m\""},
      {"namedmaterial2", "\"m\""}, {"mapname", "\"map.png\""},
      {"pixelbounds", "[0 4 0 4]"}, {"encoding", "\"linear\""},
      {"filter", "\"bilinear\""}, {"sensor", "\"cie1931\""},
      {"materials", "[\"m\" \"m\"]"}, {"lensfile", "\"lens.dat\""},
      {"basis", "\"bezier\""}, {"density", "[0 0 0 0 0 0 0 1]"}, {"temperature", "[0 0 0 0 0 0 0 900]"},
      {"gridname", "\"density\""}, {"temperaturename", "\"temperature\""}, {"normalmap", "\"map.png\""},
      {"uknots", "[0 0 1 1]"}, {"vknots", "[0 0 1 1]"},
      {"u0", "0"}, {"v0", "0"}, {"bsdffile", "\"none.bsdf\""},
      {"Pw", "[0 0 0 1 1 0 0 1 0 1 0 1 1 1 0 1]"}};
  if (row.type == "nurbs" && name == "P") return "[0 0 0 1 0 0 0 1 0 1 1 0]";
  if (row.type == "curve" && name == "type") return "\"ribbon\"";
  if (row.type == "curve" && name == "N") return "[0 0 1 0 0 1]";
  if (row.type == "bilinearmesh") {
    if (name == "indices") return "[0 1 2 3]";
    if (name == "P" || name == "N") return "[0 0 1 1 0 1 0 1 1 1 1 1]";
    if (name == "uv") return "[0 0 1 0 0 1 1 1]";
  }
  if (row.type == "spherical" && name == "mapping") return "\"equalarea\"";
  if (row.type == "cloud" && name == "density") return "1";
  if (row.type == "rgbgrid" && type == "rgb") {
    std::string numbers = "[";
    for (int i = 0; i < 24; ++i) numbers += " 0.5";
    return numbers + " ]";
  }
  if (name == "filename") {
    if (row.directive == "Film") return "\"picture.exr\"";
    if (row.type == "plymesh") return "\"mesh.ply\"";
    if (row.type == "nanovdb") return "\"grid.nvdb\"";
    if (row.type == "measured") return row.dialects == kInV4 ? "\"table.bsdf\"" : "\"table.brdf\"";
    return "\"map.png\"";
  }
  if (const auto found = kNamed.find(name); found != kNamed.end()) return found->second;
  if (type == "integer") return "2";
  if (type == "bool") return "\"true\"";
  if (type == "string") return "\"\"";
  if (type == "texture") return "\"t\"";
  if (type == "float") return "0.5";
  return "[0.5 0.5 0.5]";
}

// Parameters that another one hides, which must be absent for them to count.
const std::map<std::string, std::string, std::less<>> kHiddenBy{
    {"st", "uv"}, {"Le", "temperature"}, {"LeScale", "Lescale"}, {"temperaturecutoff", "temperatureoffset"}, {"Pw", "P"}, {"name", "reflectance"}, {"sigma_a", "reflectance"}, {"sigma_s", "reflectance"}, {"eta", "reflectance"}, {"k", "reflectance"}, {"cropwindow", "pixelbounds"}, {"index", "eta"}, {"uscale", "mapping"}, {"vscale", "mapping"}};

std::string params_text(const LanguageRow& row, Dialect dialect, std::string_view without) {
  std::string out;
  for (const LanguageParam& p : language_params(row)) {
    if ((p.dialects & dialect_bit(dialect)) == 0) continue;
    if (p.name == without) continue;
    std::string type(p.type);
    if (type == "spectrum") type = "rgb";
    out += " \"" + type + " " + std::string(p.name) + "\" " + value_of(row, p);
  }
  return out;
}

std::string v(Dialect dialect) { return dialect_name(dialect); }

// A scene that uses one type of one directive.
std::string scene_with(const LanguageRow& row, Dialect dialect, std::string_view without = {}) {
  const std::string directive(row.directive), type(row.type);
  const std::string params = params_text(row, dialect, without);
  const std::string own = directive + " \"" + type + "\"" + params + "\n";
  std::string before, world = "Texture \"t\" \"float\" \"constant\"\nMakeNamedMaterial \"m\" \"string type\" \"" +
                              std::string(dialect == Dialect::v4 ? "diffuse" : "matte") + "\"\n";
  const std::string triangle =
      "Shape \"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [0 0 0 1 0 0 0 1 0]\n";
  if (directive == "Shape") {
    world += own;
  } else if (directive == "Material") {
    world += own + triangle;
  } else if (directive == "Texture") {
    const bool is_float = false;
    world += "Texture \"own\" \"" + std::string(is_float ? "float" : "spectrum") + "\" \"" + type +
             "\"" + params + "\n";
    world += dialect == Dialect::v4 ? "Material \"diffuse\" \"texture reflectance\" \"own\"\n"
                                    : "Material \"matte\" \"texture Kd\" \"own\"\n";
    world += triangle;
  } else if (directive == "LightSource") {
    world += own;
  } else if (directive == "AreaLightSource") {
    world += own + triangle;
  } else if (directive == "MakeNamedMedium") {
    world += "MakeNamedMedium \"medium\" \"string type\" \"" + type + "\"" + params + "\n";
  } else if (directive == "Volume") {
    world += own;
  } else {
    before = own;
  }
  return before + "WorldBegin\n" + world + (dialect == Dialect::v4 ? "" : "WorldEnd\n");
}

class LanguageTables : public ::testing::Test {
 protected:
  LanguageTables() {
    write_file(folder_.path("mesh.ply"),
               "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
               "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
               "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    // One black pixel.
    write_file(folder_.path("map.pgm"), std::string("P5\n1 1\n255\n") + '\0');
    std::filesystem::copy_file(folder_.path("map.pgm"), folder_.path("map.png"));
    nanovdb_test::write_small(folder_.path("grid.nvdb"));
    write_file(folder_.path("lens.dat"), "0 1 0 20\n50 2 1.5 30\n-50 47 1 30\n");
    write_file(folder_.path("table.bsdf"), testing::RglFormula{.thetas = 2, .fine = 3, .coarse = 2}.bytes());
    write_file(folder_.path("table.brdf"), "1 550  0.5 0 0.5 3.14 0.3  0.5 0 0.4 3 0.3  1 0 1 3 0.3");
  }

  ReadScene read(const std::string& text, Dialect dialect) {
    write_file(folder_.path("scene.pbrt"), text);
    return read_scene(folder_.path("scene.pbrt"), folder_.path("split"), dialect);
  }

  const parts_test::TemporaryFolder folder_;
};

constexpr Dialect kDialects[] = {Dialect::v2, Dialect::v3, Dialect::v4};

TEST_F(LanguageTables, EveryRowSaysWhatBecomesOfTheTypeAndItsParameters) {
  for (const LanguageTable table : language_tables())
    for (const LanguageRow& row : table) {
      if (row.type.empty()) continue;
      for (const Dialect dialect : kDialects) {
        if ((row.dialects & dialect_bit(dialect)) == 0) continue;
        const std::string text = scene_with(row, dialect);
        SCOPED_TRACE(v(dialect) + ":\n" + text);
        const ReadScene scene = read(text, dialect);
        EXPECT_EQ(scene.error, "");
        const bool says = scene.warns("not supported") || scene.warns("approximated") ||
                          scene.warns("left out") || scene.warns("rendered with path") ||
                          scene.warns("unknown");
        if (row.state == LanguageState::done) {
          EXPECT_FALSE(scene.warns("approximated") || scene.warns("left out") ||
                       scene.warns("unknown"))
              << scene.warnings;
        }
        if (row.state == LanguageState::missing) {
          EXPECT_TRUE(says) << scene.warnings;
        }
        if (row.state == LanguageState::missing && row.directive != "Camera") continue;
        for (const LanguageParam& p : language_params(row)) {
          if ((p.dialects & dialect_bit(dialect)) == 0) continue;
          const std::string words = "parameter \"" + std::string(p.name) + "\"";
          bool warned = scene.warns(words);
          if (const auto hidden = kHiddenBy.find(p.name); warned && hidden != kHiddenBy.end())
            warned = read(scene_with(row, dialect, hidden->second), dialect).warns(words);
          EXPECT_EQ(warned, p.state == LanguageState::missing) << p.name << "\n" << scene.warnings;
        }
        EXPECT_FALSE(scene.warns("has no parameter")) << scene.warnings;
      }
    }
}

TEST_F(LanguageTables, UnknownParametersAreReportedForEveryTypeThatIsDone) {
  for (const LanguageTable table : language_tables())
    for (const LanguageRow& row : table) {
      if (row.type.empty() || row.state != LanguageState::done || row.type == "none") continue;
      for (const Dialect dialect : kDialects) {
        if ((row.dialects & dialect_bit(dialect)) == 0) continue;
        LanguageRow more = row;
        const std::string params = std::string(row.params) + ", float xyzzy";
        more.params = params;
        const std::string text = scene_with(more, dialect);
        EXPECT_TRUE(read(text, dialect).warns("has no parameter \"xyzzy\": ignored"))
            << v(dialect) << "\n" << text;
      }
    }
}

TEST_F(LanguageTables, HaveEveryDirectiveOfTheParser) {
  std::vector<std::string> listed;
  for (const LanguageRow& row : language_directives())
    listed.emplace_back(row.directive);
  std::sort(listed.begin(), listed.end());
  EXPECT_EQ(listed, Parser::directives());
}

TEST_F(LanguageTables, NameNothingTwice) {
  for (const LanguageTable table : language_tables())
    for (std::size_t i = 1; i < table.size(); ++i)
      for (std::size_t j = 0; j < i; ++j)
        EXPECT_FALSE(table[i].directive == table[j].directive && table[i].type == table[j].type &&
                     (table[i].dialects & table[j].dialects) != 0)
            << table[i].directive << " " << table[i].type << " stands twice";
}

TEST(LanguagePage, IsUpToDate) {
  std::ifstream file(CLOUDRENDERER_SOURCE_DIR "/docs/language.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_TRUE(text.str() == language_page())
      << "docs/language.md is not what the tables say; run: cloudrenderer info --language > "
         "docs/language.md";
}

TEST(LanguageWords, SlipsOfTheFingerGetAHint) {
  EXPECT_EQ(unused_message("Shape \"sphere\"", "radios"),
            "Shape \"sphere\" has no parameter \"radios\": ignored; is it \"radius\"?");
  EXPECT_EQ(unused_message("Shape \"sphere\"", "colour"),
            "Shape \"sphere\" has no parameter \"colour\": ignored");
  EXPECT_EQ(unused_message("LightSource \"infinite\"", "nsamples"), "");
}

}  // namespace
}  // namespace cloudrenderer
