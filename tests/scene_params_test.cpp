#include <gtest/gtest.h>

#include "scene/params.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

// The parameters of a sphere, as read.
ParamSet params(const std::string& text, Dialect dialect = Dialect::v2) {
  ParsedScene p = parse_text("WorldBegin Shape \"sphere\" " + text + " WorldEnd", dialect);
  EXPECT_EQ(p.sink.shapes.size(), 1u);
  return p.sink.shapes.at(0).params;
}

TEST(ParamSet, LooksUpByNameAndType) {
  const ParamSet p = params(
      "\"float r\" 2.5 \"integer n\" [7] \"bool b\" \"true\" \"bool c\" [false] \"string s\" "
      "[\"word\"]"
      " \"point a\" [1 2 3] \"vector v\" [4 5 6] \"rgb x\" [.1 .2 .3]");
  EXPECT_EQ(p.real("r", 0), 2.5f);
  EXPECT_EQ(p.real("n", 0), 7.f);
  EXPECT_EQ(p.integer("n", 0), 7);
  EXPECT_TRUE(p.boolean("b", false));
  EXPECT_FALSE(p.boolean("c", true));
  EXPECT_EQ(p.string("s", ""), "word");
  EXPECT_EQ(p.point3("a", {}), Vec3(1, 2, 3));
  EXPECT_EQ(p.vector3("v", {}), Vec3(4, 5, 6));
  EXPECT_EQ(p.rgb("x", {}), Rgb(.1f, .2f, .3f));
  EXPECT_EQ(p.rgb("r", {}), Rgb(2.5f));
}

TEST(ParamSet, GivesDefaultsForAbsentNames) {
  const ParamSet p;
  EXPECT_EQ(p.real("r", 3), 3.f);
  EXPECT_EQ(p.integer("n", 4), 4);
  EXPECT_TRUE(p.boolean("b", true));
  EXPECT_EQ(p.string("s", "x"), "x");
  EXPECT_EQ(p.rgb("c", Rgb(1)), Rgb(1));
  EXPECT_FALSE(p.texture("t"));
  EXPECT_TRUE(p.reals("a").empty());
  EXPECT_TRUE(p.integers("a").empty());
}

TEST(ParamSet, ThrowsForOtherTypesAndCounts) {
  const ParamSet p =
      params("\"float r\" [1 2] \"string s\" \"x\" \"rgb c\" [1 1 1 2 2 2] \"float one\" 1");
  EXPECT_THROW(p.real("r", 0), SceneError);
  EXPECT_THROW(p.integer("one", 0), SceneError);
  EXPECT_THROW(p.real("s", 0), SceneError);
  EXPECT_THROW(p.boolean("s", false), SceneError);
  EXPECT_THROW(p.string("one", ""), SceneError);
  EXPECT_THROW(p.rgb("c", {}), SceneError);
  EXPECT_THROW(p.point3("c", {}), SceneError);
  EXPECT_THROW(p.reals("s"), SceneError);
  EXPECT_EQ(p.reals("c").size(), 6u);
  try {
    p.real("s", 0);
  } catch (const SceneError& e) {
    EXPECT_NE(std::string(e.what()).find("scene.pbrt:1:43: error: parameter \"s\""),
              std::string::npos)
        << e.what();
  }
}

TEST(ParamSet, ReportsWhatNobodyUsed) {
  const ParamSet p = params("\"float radius\" 1 \"float radios\" 2");
  p.real("radius", 0);
  Warnings w;
  p.report_unused("Shape \"sphere\"", w);
  ASSERT_EQ(w.list().size(), 1u);
  EXPECT_NE(w.list()[0].find("radios"), std::string::npos);
}

TEST(ParamSet, LaterParametersReplaceEarlierOnes) {
  const ParamSet p = params("\"float r\" 1 \"float r\" 2");
  EXPECT_EQ(p.all().size(), 1u);
  EXPECT_EQ(p.real("r", 0), 2.f);
}

TEST(Params, AcceptOldAndNewSpellingsOfTypes) {
  const ParamSet p = params(
      "\"point3 a\" [1 2 3] \"point2 b\" [1 2] \"vector3 c\" [1 2 3] \"vector2 d\" [1 2] \"normal3 "
      "e\" [0 0 1]"
      " \"color f\" [1 1 1] \"normal g\" [0 1 0]  \"float uv\" [0 0 1 1] \"  float\t st \" [1 2]");
  EXPECT_EQ(p.find("a")->type, ParamType::point3);
  EXPECT_EQ(p.find("b")->type, ParamType::point2);
  EXPECT_EQ(p.find("c")->type, ParamType::vector3);
  EXPECT_EQ(p.find("d")->type, ParamType::vector2);
  EXPECT_EQ(p.find("e")->type, ParamType::normal3);
  EXPECT_EQ(p.find("f")->type, ParamType::rgb);
  EXPECT_EQ(p.find("g")->type, ParamType::normal3);
  EXPECT_EQ(p.reals("uv").size(), 4u);
  EXPECT_EQ(p.reals("st").size(), 2u);
}

TEST(Params, DropExcessComponentsWithAWarning) {
  ParsedScene p = parse_text("WorldBegin Shape \"x\" \"point P\" [1 2 3 4 5] WorldEnd");
  EXPECT_EQ(p.sink.shapes.at(0).params.reals("P").size(), 3u);
  EXPECT_NE(joined(p.warnings).find("no multiple of 3"), std::string::npos);
}

TEST(Params, KeepTrueInfinityForScalars) {
  EXPECT_EQ(params("\"float far\" 1e100").real("far", 0), kInfinity);
}

}  // namespace
}  // namespace cloudrenderer
