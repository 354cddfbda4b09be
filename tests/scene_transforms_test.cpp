#include <gtest/gtest.h>

#include "scene/transforms.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

void expect_near(const Vec3& a, const Vec3& b) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], 1e-6f) << "axis " << i;
}

Transform shape_transform(const std::string& directives) {
  ParsedScene p = parse_text("WorldBegin " + directives + " Shape \"sphere\" WorldEnd");
  return p.sink.shapes.at(0).object_to_world;
}

TEST(Transforms, QuarterTurnsAreExact) {
  for (const double turn : {90.0, -270.0, 450.0}) {
    const Transform t = to_transform(*rotate(turn, {0, 0, 1}));
    EXPECT_EQ(t.point({1, 0, 0}), Vec3(0, 1, 0)) << turn;
    EXPECT_EQ(t.point({0, 1, 0}), Vec3(-1, 0, 0)) << turn;
  }
  EXPECT_EQ(to_transform(*rotate(180, {0, 3, 0})).point({1, 2, 3}), Vec3(-1, 2, -3));
}

TEST(Transforms, RotatesAroundAnyAxis) {
  const Transform t = to_transform(*rotate(120, {1, 1, 1}));  // permutes the axes
  expect_near(t.point({1, 2, 3}), {3, 1, 2});
  EXPECT_NEAR(shape_transform("Rotate 30 0 0 1").point({1, 0, 0}).x, 0.8660254f, 1e-7f);
  EXPECT_FALSE(rotate(30, {0, 0, 0}));
}

TEST(Transforms, ApplyFromTheLastToTheFirst) {
  EXPECT_EQ(shape_transform("Translate 1 2 3 Scale 2 2 2").point({1, 1, 1}), Vec3(3, 4, 5));
  EXPECT_EQ(shape_transform("Scale 2 2 2 Translate 1 2 3").point({1, 1, 1}), Vec3(4, 6, 8));
}

TEST(Transforms, MatricesAreListedByColumns) {
  const std::string m = "[1 0 0 0  0 2 0 0  0 0 3 0  10 20 30 1]";
  EXPECT_EQ(shape_transform("Scale 9 9 9 Transform " + m).point({1, 1, 1}), Vec3(11, 22, 33));
  EXPECT_EQ(shape_transform("Scale 2 2 2 ConcatTransform " + m).point({1, 1, 1}), Vec3(22, 44, 66));
  EXPECT_EQ(shape_transform("Transform 1 0 0 0  0 2 0 0  0 0 3 0  10 20 30 1").point({0, 0, 0}),
            Vec3(10, 20, 30));
  EXPECT_TRUE(shape_transform("Scale 2 2 2 Identity").is_identity());
}

TEST(Transforms, LookAtPutsTheTargetOnTheAxis) {
  ParsedScene p =
      parse_text("LookAt 1 2 3  1 2 8  0 1 0 Camera \"perspective\" WorldBegin WorldEnd");
  const Transform& t = p.scene.camera.world_to_camera;
  EXPECT_EQ(t.point({1, 2, 3}), Vec3(0));
  EXPECT_EQ(t.point({1, 2, 8}), Vec3(0, 0, 5));
  EXPECT_EQ(t.point({2, 2, 3}), Vec3(1, 0, 0));  // left-handed: +x is to the right
  expect_near(t.inverse().point({0, 1, 0}), {1, 3, 3});
}

TEST(Transforms, SingularLookAtIsIgnoredWithAWarning) {
  for (const char* look :
       {"LookAt 0 0 0  0 1 0  0 2 0", "LookAt 1 1 1  1 1 1  0 1 0", "LookAt 0 0 0  1 0 0  0 0 0"}) {
    ParsedScene p = parse_text(std::string(look) + " Camera \"perspective\" WorldBegin WorldEnd");
    EXPECT_TRUE(p.scene.camera.world_to_camera.is_identity()) << look;
    EXPECT_NE(joined(p.warnings).find("LookAt"), std::string::npos);
  }
}

TEST(Transforms, NamedCoordinateSystemsCanBeUsedAgain) {
  EXPECT_EQ(
      shape_transform("Translate 1 0 0 CoordinateSystem \"a\" Scale 5 5 5 CoordSysTransform \"a\"")
          .point(Vec3(0)),
      Vec3(1, 0, 0));
  ParsedScene p = parse_text(
      "Translate 0 0 5 Camera \"perspective\" WorldBegin CoordSysTransform \"camera\" Shape "
      "\"sphere\" WorldEnd");
  EXPECT_EQ(p.sink.shapes.at(0).object_to_world.point(Vec3(0)), Vec3(0, 0, -5));
}

TEST(Transforms, WorldBeginResets) {
  ParsedScene p = parse_text("Scale 2 2 2 WorldBegin Shape \"sphere\" WorldEnd");
  EXPECT_TRUE(p.sink.shapes.at(0).object_to_world.is_identity());
}

TEST(Transforms, BothEndsOfAMovementAreKept) {
  const ParsedScene p = parse_text(
      "TransformTimes 2 5 WorldBegin Scale 2 2 2 "
      "ActiveTransform StartTime Translate 1 0 0 ActiveTransform EndTime Translate 0 5 0 ActiveTransform All "
      "Translate 0 0 2 Shape \"sphere\" "
      "AttributeBegin ActiveTransform StartTime Identity AttributeEnd Shape \"disk\" "
      "CoordinateSystem \"moved\" Identity Shape \"cone\" "
      "ActiveTransform EndTime CoordSysTransform \"moved\" Shape \"cylinder\" WorldEnd");
  EXPECT_TRUE(p.warnings.list().empty()) << joined(p.warnings);
  ASSERT_EQ(p.sink.shapes.size(), 4u);
  for (const std::size_t moving : {0u, 1u, 3u}) {
    const ShapeDesc& s = p.sink.shapes[moving];
    ASSERT_TRUE(s.motion) << moving;
    EXPECT_EQ(s.object_to_world.point(Vec3(0)), Vec3(2, 0, 4));
    EXPECT_EQ(s.motion->end.point(Vec3(0)), Vec3(0, 10, 4));
    EXPECT_EQ(s.motion->start_time, 2.f);
    EXPECT_EQ(s.motion->end_time, 5.f);
  }
  EXPECT_FALSE(p.sink.shapes[2].motion);
}

TEST(Transforms, EqualEndsAreNoMovement) {
  const ParsedScene p = parse_text(
      "WorldBegin ActiveTransform StartTime Translate 1 0 0 ActiveTransform EndTime Translate 1 0 0 Shape \"sphere\" WorldEnd");
  EXPECT_FALSE(p.sink.shapes.at(0).motion);
}

TEST(Transforms, CamerasAndInstancesMoveAndLightsDoNot) {
  const ParsedScene p = parse_text(
      "LookAt 0 0 -5 0 0 0 0 1 0 ActiveTransform EndTime Translate 0 0 1 ActiveTransform All Camera \"perspective\" "
      "TransformTimes -1 1 WorldBegin ObjectBegin \"a\" Shape \"sphere\" ObjectEnd "
      "ActiveTransform StartTime Translate 0 3 0 ActiveTransform All ObjectInstance \"a\" LightSource \"point\" "
      "LightSource \"point\" AreaLightSource \"diffuse\" Shape \"sphere\" WorldEnd");
  ASSERT_TRUE(p.scene.camera.motion);
  EXPECT_EQ(p.scene.camera.world_to_camera.point(Vec3(0)), Vec3(0, 0, 5));
  EXPECT_EQ(p.scene.camera.motion->end.point(Vec3(0)), Vec3(0, 0, 6));
  EXPECT_EQ(p.scene.camera.motion->start_time, -1.f);  // TransformTimes may stand behind the camera
  ASSERT_TRUE(p.sink.instances.at(0).motion);
  EXPECT_EQ(p.sink.instances[0].instance_to_world.point(Vec3(0)), Vec3(0, 3, 0));
  EXPECT_TRUE(p.sink.instances[0].motion->end.is_identity());
  EXPECT_EQ(p.scene.lights.at(0).light_to_world.point(Vec3(0)), Vec3(0, 3, 0));
  EXPECT_FALSE(p.sink.shapes.at(1).area_light);
  ASSERT_EQ(p.warnings.list().size(), 2u) << joined(p.warnings);
  EXPECT_NE(p.warnings.list()[0].find("a light does not move"), std::string::npos);
  EXPECT_NE(p.warnings.list()[1].find("area lights on moving shapes do not shine"), std::string::npos);
}

TEST(Transforms, MovementsThatCannotBeStandStill) {
  for (const char* end : {"Scale 1 0 1", "Scale -1 1 1"}) {
    const ParsedScene p =
        parse_text(std::string("WorldBegin ActiveTransform EndTime ") + end + " Shape \"sphere\" WorldEnd");
    EXPECT_FALSE(p.sink.shapes.at(0).motion);
    ASSERT_EQ(p.warnings.list().size(), 1u);
    EXPECT_NE(p.warnings.list()[0].find("scene.pbrt:1"), std::string::npos);
    EXPECT_NE(p.warnings.list()[0].find("it stands where it starts"), std::string::npos);
  }
}

TEST(Transforms, SingularOnesLoseTheirShape) {
  ParsedScene p = parse_text("WorldBegin Scale 1 0 1 Shape \"sphere\" WorldEnd");
  EXPECT_TRUE(p.sink.shapes.empty());
  EXPECT_EQ(p.warnings.list().size(), 1u);
}

}  // namespace
}  // namespace cloudrenderer
