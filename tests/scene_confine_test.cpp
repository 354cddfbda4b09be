// Scenes of strangers name files: none outside of the folder that they are confined to is read, or seen to be there.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "scene_collector.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

class Confine : public ::testing::Test {
 protected:
  Confine() {
    fs::create_directories(inside_ + "/geometry");
    put(root_ + "/secret", "secret");
    put(inside_ + "/geometry/here", "400 1 700 1");
    fs::create_symlink(root_ + "/secret", inside_ + "/link");
    fs::create_directory_symlink(root_, inside_ + "/up");
  }
  ~Confine() override { fs::remove_all(root_); }
  static void put(const std::string& path, const std::string& text) { std::ofstream(path) << text; }

  // What reading a scene whose world is `world` says, "" when all is well; `confine` as the option.
  std::string read(const std::string& world, bool confined = true, std::set<std::string>* files = nullptr) {
    put(inside_ + "/scene.pbrt", "Camera \"perspective\"\nWorldBegin\n" + world + "\nWorldEnd\n");
    SceneCollector sink;
    Warnings warnings;
    ParseOptions options;
    if (confined) options.confine = inside_;
    options.files = files;
    try {
      parse_scene(inside_ + "/scene.pbrt", options, sink, warnings);
    } catch (const SceneError& e) {
      return e.what();
    }
    return "";
  }

  const std::string root_ = (fs::temp_directory_path() / ("confine" + std::to_string(getpid()))).string();
  const std::string inside_ = root_ + "/scene";
};

TEST_F(Confine, NothingOutsideIsRead) {
  const std::vector<std::string> ways{
      "Include \"@\"",
      "Shape \"sphere\" Include \"@\"",  // parameters from a file
      "Shape \"plymesh\" \"string filename\" \"@\"",
      "Texture \"t\" \"color\" \"imagemap\" \"string filename\" \"@\"",
      "LightSource \"infinite\" \"string mapname\" \"@\"",
      "LightSource \"goniometric\" \"string mapname\" [\"geometry/here\" \"@\"]",
      "Material \"measured\" \"string filename\" \"@\"",
      "Material \"fourier\" \"string bsdffile\" \"@\"",
      "Material \"metal\" \"spectrum eta\" \"@\"",
      "Material \"metal\" \"spectrum k\" [\"geometry/here\" \"@\"]"};
  const std::vector<std::string> names{root_ + "/secret", "../secret",        "geometry/../../secret", "link", "up/secret", "/etc/passwd",
                                       "..\\\\secret",    "/nowhere/at/all",  "../not-there",          "up/not-there",
                                       inside_ + "-beside"};
  for (const std::string& way : ways)
    for (const std::string& name : names) {
      std::string world = way;
      world.replace(world.find('@'), 1, name);
      const std::string said = read(world);
      EXPECT_NE(said.find("outside of the scene's folder"), std::string::npos) << world << ": " << said;
      EXPECT_NE(said.find("scene.pbrt:3:"), std::string::npos) << said;
    }
}

TEST_F(Confine, WhatIsInsideIsRead) {
  EXPECT_EQ(read("Material \"metal\" \"spectrum eta\" \"geometry/here\""), "");
  EXPECT_EQ(read("Material \"metal\" \"spectrum eta\" \"" + inside_ + "/geometry/here\""), "");
  EXPECT_EQ(read("Material \"metal\" \"spectrum eta\" \"geometry/../geometry/here\""), "");
  put(inside_ + "/geometry/part", "Include \"../geometry/more\"");  // relative to the file that names it
  put(inside_ + "/geometry/more", "Shape \"sphere\"");
  EXPECT_EQ(read("Include \"geometry/part\""), "");
  EXPECT_NE(read("Include \"geometry/none\"").find("cannot read"), std::string::npos);
}

TEST_F(Confine, TheSceneFileItselfMustBeInside) {
  put(root_ + "/other.pbrt", "Camera \"perspective\" WorldBegin WorldEnd");
  SceneCollector sink;
  Warnings warnings;
  ParseOptions options;
  options.confine = inside_;
  EXPECT_THROW(parse_scene(root_ + "/other.pbrt", options, sink, warnings), SceneError);
  options.confine = root_;
  EXPECT_NO_THROW(parse_scene(root_ + "/other.pbrt", options, sink, warnings));
}

TEST_F(Confine, WithoutItEverythingIsReadAsBefore) {
  put(root_ + "/red.spd", "400 1 700 1");
  EXPECT_EQ(read("Material \"metal\" \"spectrum eta\" \"../red.spd\"", false), "");
}

TEST_F(Confine, FilesThatASceneNamesAreTold) {
  std::set<std::string> files;
  EXPECT_EQ(read("Material \"metal\" \"spectrum eta\" \"geometry/here\"\nTexture \"t\" \"color\" \"imagemap\" \"string filename\" "
                 "\"geometry/none.png\"",
                 true, &files),
            "");
  EXPECT_EQ(files, (std::set<std::string>{inside_ + "/scene.pbrt", inside_ + "/geometry/here", inside_ + "/geometry/none.png"}));
}

}  // namespace
}  // namespace cloudrenderer
