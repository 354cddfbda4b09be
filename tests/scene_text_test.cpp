#include "scene/scene_text.h"

#include <gtest/gtest.h>

#include <sstream>

#include "scene/scene_codec.h"
#include "scene_collector.h"

namespace cloudrenderer {
namespace {

std::string text_of(float v) {
  std::ostringstream out;
  write_float(out, v);
  return out.str();
}

TEST(SceneText, WritesTheShortestFloats) {
  EXPECT_EQ(text_of(0.1f), "0.1");
  EXPECT_EQ(text_of(-2), "-2");
  EXPECT_EQ(text_of(16777217.f), "16777216");
  EXPECT_EQ(text_of(kInfinity), "1e39");
}

const std::string kScene = R"(
Rotate 33 1 2 3 Translate 1 2 .1
TransformTimes -1 2.5 ActiveTransform EndTime Rotate 20 0 1 0 ActiveTransform All
Camera "perspective" "float fov" [39.1]
Film "image" "integer xresolution" [320] "string filename" "a \"b\" \\ c.exr"
Sampler "halton" "integer pixelsamples" 4 PixelFilter "box" "float xwidth" 0.5
WorldBegin
Texture "t" "float" "constant" "float value" 0.3
Translate 1 .7 1
Texture "t" "color" "checkerboard" "rgb tex1" [.1 .2 .3] "bool x" "true" "point p" [1 2 3]
Material "matte" "texture Kd" "t" "texture sigma" "t" Shape "a"
MakeNamedMaterial "g" "string type" "glass" "float index" 1.37
MakeNamedMaterial "m" "string type" "mix" "string namedmaterial1" "g" "string namedmaterial2" "g" "rgb amount" [.1 .2 .3]
AttributeBegin NamedMaterial "m" AreaLightSource "area" "rgb L" [1 1e30 0.3] Shape "b" AttributeEnd
Material "none" Shape "c"
LightSource "distant" "point from" [-0 0 1] "blackbody L" [5000 3]
WorldEnd)";

// Everything but names of files and places, which a written scene has its own.
std::string essence(SceneDescription scene) {
  scene.source.clear();
  const auto strip = [](Entity& e) {
    e.location = {};
    ParamSet params;
    for (Param p : e.params.all()) {
      p.location = {};
      p.used = false;
      params.add(std::move(p));
    }
    e.params = std::move(params);
  };
  strip(scene.camera), strip(scene.film), strip(scene.sampler), strip(scene.filter),
      strip(scene.integrator);
  for (auto& t : scene.textures) strip(t);
  for (auto& m : scene.materials) strip(m), m.object_to_world = {};
  for (auto& l : scene.lights) strip(l);
  for (auto& a : scene.area_lights) strip(a);
  return encode(scene);
}

TEST(SceneText, ReadsBackAsTheSameScene) {
  for (const Dialect d : {Dialect::v2, Dialect::v3}) {
    const ParsedScene p = parse_text(kScene, d);
    std::ostringstream out;
    write_options(out, p.scene);
    write_world_head(out, p.scene);
    for (const ShapeDesc& s : p.sink.shapes) {
      out << "AttributeBegin\n";
      write_material_use(out, p.scene, s.material);
      if (s.area_light) write_area_light(out, p.scene, s.area_light);
      write_transform(out, s.object_to_world);
      write_entity(out, "Shape", s, d);
      out << "AttributeEnd\n";
    }
    out << "WorldEnd\n";
    SCOPED_TRACE(out.str());
    const ParsedScene q = parse_text(out.str());
    EXPECT_EQ(q.scene.dialect, d);
    ASSERT_EQ(q.sink.shapes.size(), p.sink.shapes.size());
    ASSERT_EQ(q.scene.materials.size(), p.scene.materials.size());
    for (std::size_t i = 0; i < p.sink.shapes.size(); ++i) {
      const auto type = [&](const ParsedScene& s) {
        return s.scene.materials[s.sink.shapes[i].material.value].type;
      };
      EXPECT_EQ(type(p), type(q));
      EXPECT_EQ(p.sink.shapes[i].object_to_world, q.sink.shapes[i].object_to_world);
    }
    // The order in which shapes first use materials may differ: compare what does not depend on it.
    SceneDescription a = p.scene, b = q.scene;
    a.materials.clear(), b.materials.clear();
    EXPECT_TRUE(essence(a) == essence(b));
  }
}

}  // namespace
}  // namespace cloudrenderer
