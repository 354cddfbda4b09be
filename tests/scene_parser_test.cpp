#include <gtest/gtest.h>

#include "scene_collector.h"

namespace cloudrenderer {
namespace {

ParsedScene world(const std::string& text, std::optional<Dialect> dialect = std::nullopt) {
  return parse_text("WorldBegin\n" + text + "\nWorldEnd\n", dialect);
}

TEST(Parser, ReadsAWholeScene) {
  const ParsedScene p = parse_text(R"(
LookAt 0 0 -5  0 0 0  0 1 0
Camera "perspective" "float fov" [39]
Film "image" "integer xresolution" 320 "string filename" "out.exr"
Sampler "halton" "integer pixelsamples" [16]
PixelFilter "gaussian" "float xwidth" 2
SurfaceIntegrator "path" "integer maxdepth" [7]
VolumeIntegrator "single"
Accelerator "kdtree"
WorldBegin
LightSource "point" "rgb I" [1 2 3]
AttributeBegin
  Translate 0 0 1
  AreaLightSource "area" "rgb L" [5 5 5]
  ReverseOrientation
  Shape "sphere" "float radius" .5
AttributeEnd
Shape "disk"
WorldEnd
)");
  EXPECT_EQ(p.scene.dialect, Dialect::v2);
  EXPECT_EQ(p.scene.camera.params.real("fov", 0), 39.f);
  EXPECT_EQ(p.scene.film.params.string("filename", ""), "out.exr");
  EXPECT_EQ(p.scene.sampler.type, "halton");
  EXPECT_EQ(p.scene.filter.type, "gaussian");
  EXPECT_EQ(p.scene.integrator.params.integer("maxdepth", 0), 7);
  ASSERT_TRUE(p.scene.volume_integrator);
  EXPECT_FALSE(p.scene.renderer);
  ASSERT_EQ(p.scene.lights.size(), 1u);
  ASSERT_EQ(p.sink.shapes.size(), 2u);
  EXPECT_TRUE(p.sink.shapes[0].reverse_orientation);
  EXPECT_EQ(p.sink.shapes[0].area_light, AreaLightId(0));
  EXPECT_EQ(p.sink.shapes[0].object_to_world.point(Vec3(0)), Vec3(0, 0, 1));
  EXPECT_EQ(p.sink.shapes[0].location.line, 16u);
  EXPECT_FALSE(p.sink.shapes[1].reverse_orientation);
  EXPECT_FALSE(p.sink.shapes[1].area_light);
  EXPECT_TRUE(p.sink.shapes[1].object_to_world.is_identity());
  EXPECT_TRUE(p.warnings.list().empty()) << joined(p.warnings);
}

TEST(Parser, HasTheDefaultsOfTheDialect) {
  const SceneDescription v2 = world("").scene, v3 = world("", Dialect::v3).scene;
  EXPECT_EQ(v2.dialect, Dialect::v2);
  EXPECT_EQ(v2.camera.type + v2.film.type + v2.filter.type, "perspectiveimagebox");
  EXPECT_EQ(v2.sampler.type, "lowdiscrepancy");
  EXPECT_EQ(v2.integrator.type, "directlighting");
  EXPECT_EQ(v3.sampler.type, "halton");
  EXPECT_EQ(v3.integrator.type, "path");
}

TEST(Parser, TellsTheDialects) {
  const auto dialect = [](const std::string& text) { return parse_text(text).scene.dialect; };
  EXPECT_EQ(dialect("SurfaceIntegrator \"path\" WorldBegin WorldEnd"), Dialect::v2);
  EXPECT_EQ(dialect("Renderer \"sampler\" WorldBegin WorldEnd"), Dialect::v2);
  EXPECT_EQ(dialect("Integrator \"path\" WorldBegin WorldEnd"), Dialect::v3);
  EXPECT_EQ(
      dialect("WorldBegin Shape \"trianglemesh\" \"point P\" [1 2 3] Shape \"plymesh\" WorldEnd"),
      Dialect::v3);
  EXPECT_EQ(dialect("WorldBegin MakeNamedMedium \"m\" WorldEnd"), Dialect::v3);
  EXPECT_EQ(dialect("WorldBegin Texture \"Integrator\" \"float\" \"scale\" WorldEnd"), Dialect::v2);
  EXPECT_EQ(dialect("WorldBegin WorldEnd # Integrator"), Dialect::v2);
  EXPECT_EQ(parse_text("Integrator \"path\" WorldBegin WorldEnd", Dialect::v2).scene.dialect,
            Dialect::v2);
}

TEST(Parser, TellsTheDialectFromSmallSigns) {
  for (const char* v3 : {"Sampler \"02sequence\"", "Material \"disney\"", "Material \"none\"", "Shape \"sphere\" \"point3 P\" [0 0 0]",
                         "Camera \"realistic\"", "Film \"image\" \"float  diagonal\" 3", "AreaLightSource \"diffuse\" \"bool\ttwosided\" \"true\"",
                         "MakeNamedMaterial \"m\" \"string type\" \"fourier\"", "Material \"glass\" \"float uroughness\" .1",
                         "MakeNamedMaterial \"m\" \"string type\" \"subsurface\" \"texture sigma_s\" \"t\"",
                         "Texture \"t\" \"color\" \"imagemap\" \"bool gamma\" \"false\"", "Shape \"loopsubdiv\" \"integer levels\" 2",
                         "LightSource \"infinite\" \"integer samples\" 4", "Sampler \"halton\" \"bool samplepixelcenter\" \"true\""})
    EXPECT_EQ(parse_text(std::string("WorldBegin ") + v3 + " WorldEnd").scene.dialect, Dialect::v3) << v3;
  for (const char* v2 : {"Material \"matte\"", "Material \"substrate\" \"float uroughness\" .1", "Shape \"sphere\" \"point P\" [0 0 0]", "Sampler \"lowdiscrepancy\"",
                         "Texture \"point3\" \"color\" \"constant\"", "Material \"shinymetal\" Material \"metal\" \"float uroughness\" .1",
                         "LightSource \"point\" \"float scale\" 3 Material \"matte\"", "Sampler \"bestcandidate\""})
    EXPECT_EQ(parse_text(std::string("WorldBegin ") + v2 + " WorldEnd").scene.dialect, Dialect::v2) << v2;
}

TEST(Parser, TellsTheDialectFromAnInclude) {
  const TemporaryFolder folder;
  folder.write("geometry/a.pbrt", "Shape \"plymesh\" \"string filename\" \"mesh.ply\"");
  const std::string path =
      folder.write("a.pbrt", "WorldBegin Include \"geometry/a.pbrt\" WorldEnd");
  SceneCollector sink;
  Warnings warnings;
  EXPECT_EQ(parse_scene(path, {}, sink, warnings).dialect, Dialect::v3);
}

TEST(Parser, IncludesAndFilesAreRelativeToTheTopOrTheIncluder) {
  const TemporaryFolder folder;
  folder.write("geometry/a.pbrt",
               "Include \"b.pbrt\"\nShape \"plymesh\" \"string filename\" \"beside.ply\"");
  folder.write("geometry/b.pbrt",
               "Include \"geometry/c.pbrt\" Shape \"b\" \"string filename\" \"top.ply\"");
  folder.write("geometry/c.pbrt", "Shape \"c\" \"string filename\" \"nowhere.ply\"");
  folder.write("geometry/beside.ply", "");
  folder.write("top.ply", "");
  folder.write("geometry/top.ply", "");
  const std::string path =
      folder.write("a.pbrt", "WorldBegin Include \"geometry/a.pbrt\" Shape \"last\" WorldEnd");
  SceneCollector sink;
  Warnings warnings;
  parse_scene(path, {}, sink, warnings);
  ASSERT_EQ(sink.shapes.size(), 4u);
  EXPECT_EQ(sink.shapes[0].params.string("filename", ""), folder.path("nowhere.ply"));
  EXPECT_EQ(sink.shapes[1].params.string("filename", ""), folder.path("top.ply"));
  EXPECT_EQ(sink.shapes[2].params.string("filename", ""), folder.path("geometry/beside.ply"));
  EXPECT_EQ(sink.shapes[3].type, "last");
}

TEST(Parser, BeforeV4AFileMayHoldSomeOfTheParameters) {
  const TemporaryFolder folder;
  folder.write("more.pbrt", "\"float b\" 2\n# nothing\n\"float c\" [3]\n");
  folder.write("wrong.pbrt", "\"float b\" 2 WorldEnd");
  const auto parse = [&](const std::string& list) {
    SceneCollector sink;
    Warnings warnings;
    parse_scene(folder.write("a.pbrt", "WorldBegin Texture \"t\" \"spectrum\" \"constant\" Shape \"x\" " + list + " WorldEnd"), {}, sink, warnings);
    return sink.shapes;
  };
  const auto shapes = parse("\"float a\" 1 Include \"more.pbrt\" \"float d\" 4 Shape \"y\"");
  ASSERT_EQ(shapes.size(), 2u);
  const char* name = "abcd";
  for (float i = 1; i <= 4; ++i) EXPECT_EQ(shapes[0].params.real(std::string(1, *name++), 0), i);
  EXPECT_TRUE(parse("\"texture b\" \"t\" Include \"more.pbrt\"").at(0).params.texture("b"));
  try {
    parse("Include \"wrong.pbrt\"");
    ADD_FAILURE() << "a directive between parameters was read";
  } catch (const SceneError& e) {
    EXPECT_NE(std::string(e.what()).find("wrong.pbrt:1:13"), std::string::npos) << e.what();
  }
}

TEST(Parser, ObjectsAndInstances) {
  const ParsedScene p = world(R"(
ObjectBegin "tree"
  Translate 1 0 0
  Shape "sphere"
ObjectEnd
Translate 0 5 0
ObjectInstance "tree"
ObjectInstance "bush"
Shape "disk")");
  EXPECT_EQ(p.sink.events, (std::vector<std::string>{"begin tree", "shape sphere", "end",
                                                     "instance", "shape disk"}));
  EXPECT_EQ(p.sink.shapes[0].object, ObjectId(0));
  EXPECT_EQ(p.sink.shapes[0].object_to_world.point(Vec3(0)), Vec3(1, 0, 0));
  EXPECT_FALSE(p.sink.shapes[1].object);
  ASSERT_EQ(p.sink.instances.size(), 1u);
  EXPECT_EQ(p.sink.instances[0].instance_to_world.point(Vec3(0)), Vec3(0, 5, 0));
  EXPECT_NE(joined(p.warnings).find("no object \"bush\""), std::string::npos);
}

TEST(Parser, ToleratesMisnestedBlocks) {
  const ParsedScene p = world(R"(
AttributeBegin
ObjectBegin "a"
Shape "sphere"
AttributeEnd
ObjectEnd
ObjectBegin "b"
ObjectBegin "c"
Shape "disk"
ObjectEnd
ObjectEnd
TransformBegin
AttributeBegin
Translate 1 0 0
TransformEnd
Shape "cone"
AttributeEnd)");
  EXPECT_EQ(p.sink.events,
            (std::vector<std::string>{"begin a", "shape sphere", "end", "begin b", "end", "begin c",
                                      "shape disk", "end", "shape cone"}));
  EXPECT_TRUE(p.sink.shapes.back().object_to_world.is_identity());
}

TEST(Parser, MissingEndsAreWarnings) {
  const ParsedScene p = parse_text("WorldBegin AttributeBegin ObjectBegin \"a\" Shape \"sphere\"");
  EXPECT_EQ(p.sink.events.back(), "end");
  const std::string all = joined(p.warnings);
  EXPECT_NE(all.find("without WorldEnd"), std::string::npos);
  EXPECT_NE(all.find("ObjectEnd is missing"), std::string::npos);
  EXPECT_NE(all.find("AttributeEnd is missing"), std::string::npos);
}

TEST(Parser, RendersTheFirstOfSeveralWorlds) {
  const ParsedScene p =
      parse_text("WorldBegin Shape \"a\" WorldEnd\nWorldBegin Shape \"b\" WorldEnd");
  EXPECT_EQ(p.sink.shapes.size(), 1u);
  EXPECT_NE(joined(p.warnings).find("only the first world"), std::string::npos);
  EXPECT_EQ(world("WorldBegin Shape \"a\"").sink.shapes.size(), 1u);
}

TEST(Parser, DirectivesOutOfPlaceAreIgnoredWithAWarning) {
  const ParsedScene p = parse_text(
      "AttributeBegin Shape \"a\" AttributeEnd WorldBegin Film \"x\" Camera \"y\" WorldEnd");
  EXPECT_TRUE(p.sink.shapes.empty());
  EXPECT_EQ(p.scene.film.type, "image");
  EXPECT_EQ(p.scene.camera.type, "perspective");
  EXPECT_EQ(p.warnings.list().size(), 5u) << joined(p.warnings);
}

TEST(Parser, MediaAndTheSurfacesBetweenThem) {
  const ParsedScene p = world(R"(
MakeNamedMedium "fog" "string type" "homogeneous" "rgb sigma_a" [1 2 3]
AttributeBegin
Translate 1 0 0
MakeNamedMedium "milk" "string type" "homogeneous"
MediumInterface "milk" "fog"
Material "glass"
Shape "sphere"
MediumInterface "fog"
Shape "sphere"
AttributeEnd
Material "glass"
Shape "sphere"
MediumInterface "" "smoke"
MediumInterface "smoke" "fog"
Shape "sphere")");
  ASSERT_EQ(p.scene.media.size(), 3u);  // one for what is not there
  EXPECT_EQ(p.scene.media[0].type, "homogeneous");
  EXPECT_EQ(p.scene.media[0].params.rgb("sigma_a", Rgb(0.f)), Rgb(1, 2, 3));
  EXPECT_EQ(p.scene.media[1].medium_to_world.point(Vec3(0.f)), Vec3(1, 0, 0));
  const auto material = [&](std::size_t shape) { return p.scene.materials[p.sink.shapes[shape].material.value]; };
  EXPECT_EQ(material(0).inside, MediumId(1));
  EXPECT_EQ(material(0).outside, MediumId(0));
  EXPECT_FALSE(material(1).is_interface()) << "the same on both sides";
  EXPECT_EQ(p.sink.shapes[1].material, p.sink.shapes[2].material);
  EXPECT_EQ(material(3).inside, MediumId(2));
  EXPECT_EQ(p.scene.media[2].params.rgb("sigma_s", Rgb(1.f)), Rgb(0));
  EXPECT_EQ(material(3).outside, MediumId(0));
  EXPECT_EQ(p.scene.materials.size(), 3u);
  EXPECT_EQ(p.warnings.list().size(), 1u) << joined(p.warnings);
  EXPECT_NE(p.warnings.list()[0].find("scene.pbrt:15:1: warning: there is no medium \"smoke\""), std::string::npos);
}

TEST(Parser, TheCameraStandsInTheOutsideMedium) {
  const ParsedScene p = parse_text(R"(
MakeNamedMedium "fog" "string type" "homogeneous"
MediumInterface "" "fog"
Camera "perspective"
WorldBegin
Shape "sphere"
WorldEnd)");
  EXPECT_EQ(p.scene.camera.medium, MediumId(0));
  EXPECT_EQ(p.scene.materials.at(p.sink.shapes[0].material.value).outside, MediumId(0));
}

// pbrt-v3 makes the camera at the world's end, pbrt-v4 where it stands.
TEST(Parser, TheCameraStandsInWhatIsOutsideAtTheEnd) {
  const auto medium = [](const char* head, const char* end) {
    return parse_text(std::string("Camera \"perspective\"\nMakeNamedMedium \"fog\" \"string type\" \"homogeneous\"\nMediumInterface \"\" \"fog\"\n") + head +
                      "WorldBegin\nShape \"sphere\"\n" + end).scene.camera.medium;
  };
  EXPECT_EQ(medium("", "WorldEnd"), MediumId(0));
  EXPECT_EQ(medium("", "AttributeBegin MediumInterface \"fog\" \"\" Shape \"sphere\" AttributeEnd WorldEnd"), MediumId(0));
  EXPECT_EQ(medium("", "MediumInterface \"\" \"\" Shape \"sphere\" WorldEnd"), MediumId());
  EXPECT_EQ(medium("Film \"rgb\"\n", ""), MediumId());
}

TEST(Parser, MediaMayBeMadeBehindWhatNamesThem) {
  const ParsedScene p = world("MediumInterface \"fog\" \"\" MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [1 2 3] Shape \"sphere\"");
  EXPECT_EQ(p.scene.materials.at(p.sink.shapes[0].material.value).inside, MediumId(0));
  EXPECT_EQ(p.scene.media.at(0).params.rgb("sigma_a", Rgb(0.f)), Rgb(1, 2, 3));
  EXPECT_TRUE(p.warnings.list().empty()) << joined(p.warnings);
}

// As in pbrt-v2 and pbrt-v3, which look for a parameter among those of its type.
TEST(Parser, ParametersOfAnotherTypeAreNotThere) {
  const auto ignored = [](const std::string& directive, const char* what, Dialect dialect = Dialect::v3) {
    const ParsedScene p = parse_text("WorldBegin\n" + directive + "\nShape \"sphere\"\nWorldEnd", dialect);
    EXPECT_EQ(p.warnings.list().size(), 1u) << directive << joined(p.warnings);
    EXPECT_NE(joined(p.warnings).find(what), std::string::npos) << joined(p.warnings);
    return p;
  };
  const auto lamp = ignored("AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"float scale\" 2000", "\"scale\" is of type float, not spectrum: ignored, as in pbrt");
  EXPECT_FALSE(lamp.scene.area_lights.at(0).params.has("scale"));
  EXPECT_FALSE(ignored("Material \"matte\" \"float Kd\" .9", "is of type float, not spectrum").scene.materials.at(0).params.has("Kd"));
  ignored("Texture \"t\" \"color\" \"imagemap\" \"string filename\" \"a.png\" \"float gamma\" 2.2", "is of type float, not bool");
  ignored("MakeNamedMaterial \"m\" \"string type\" \"plastic\" \"string Kd\" \"x\"", "is of type string, not spectrum");
  ignored("MakeNamedMaterial \"m\" \"string type\" \"plastic\" \"rgb roughness\" [1 1 1]", "is of type rgb, not float");
  ignored("Material \"matte\" \"skinlayer layers\" [1 2 3 4] \"rgb Kd\" [1 0 0]", "types are float");
  ignored("Material \"matte\" \"Kd\" 3 \"rgb Kd\" [1 0 0]", "types are float");
  ignored("Shape \"cylinder\" \"float radius\" [1 2]", "\"radius\" has 2 values, not one");
  ignored("Shape \"cylinder\" \"float radius\" []", "\"radius\" has 0 values, not one");
  ignored("Shape \"cylinder\" \"float radius\" \"2\"", "the value of parameter \"radius\" is not of type float: ignored");
  ignored("Shape \"cylinder\" \"float radius\" [ \"a ]\" \"2\" ] \"float zmax\" 3", "the value of parameter \"radius\" is not of type float");
  ignored("AreaLightSource \"diffuse\" \"bool twosided\" [1]", "the value of parameter \"twosided\" is not of type bool");
  ignored("Texture \"t\" \"color\" \"imagemap\" \"string filename\" 5", "the value of parameter \"filename\" is not of type string");
  for (const char* fine : {"Material \"matte\" \"float sigma\" 3 \"spectrum Kd\" [400 1 700 1]", "Shape \"trianglemesh\" \"point2 uv\" [0 0]",
                           "Texture \"t\" \"float\" \"scale\" \"float tex1\" 2 \"float tex2\" 3", "LightSource \"spot\" \"integer coneangle\" 20",
                           "Texture \"t\" \"color\" \"constant\" \"rgb value\" [1 1 1] Texture \"u\" \"color\" \"mix\" \"texture tex1\" \"t\"",
                           "Shape \"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [0 0 0 1 0 0 0 1 0]", "Material \"matte\" \"spectrum Kd\" \"a.spd\"",
                           "AreaLightSource \"diffuse\" \"bool twosided\" [\"true\"]", "Material \"someones\" \"float Kd\" 3"})
    EXPECT_EQ(joined(parse_text(std::string("WorldBegin\n") + fine + "\nWorldEnd", Dialect::v3).warnings).find("not "), std::string::npos) << fine;
  // In pbrt-v4 types decide about the meaning.
  EXPECT_THROW(parse_text("WorldBegin\nShape \"sphere\" \"flaot radius\" 1", Dialect::v4), SceneError);
}

// Rays pass a mesh whose alpha is 0, light samples find it: weighed as if rays did, too.
TEST(Parser, LampsWithAnAlphaOfNothingShineUnseen) {
  const auto lamp = [](const char* shape) { return world(std::string("AreaLightSource \"diffuse\" ") + shape); };
  const ParsedScene hidden = lamp("Shape \"trianglemesh\" \"float alpha\" 0 Shape \"trianglemesh\"");
  ASSERT_EQ(hidden.scene.area_lights.size(), 2u) << joined(hidden.warnings);
  EXPECT_TRUE(hidden.scene.area_lights[0].params.boolean("invisible", false));
  EXPECT_TRUE(hidden.scene.area_lights[0].params.boolean("weighed", false));
  EXPECT_TRUE(hidden.sink.shapes[0].params.texture("alpha"));
  EXPECT_FALSE(hidden.scene.area_lights[1].params.has("invisible"));
  EXPECT_FALSE(lamp("Shape \"sphere\" \"float alpha\" 0").scene.area_lights.at(0).params.has("invisible"));
  EXPECT_FALSE(world("Shape \"trianglemesh\" \"float alpha\" 0").sink.shapes[0].params.texture("alpha"));
}

TEST(Parser, MeshesWithAShadowAlphaOfNothingThrowNoShadow) {
  const ParsedScene p = world("Shape \"trianglemesh\" \"float shadowalpha\" 0 Shape \"trianglemesh\" \"float shadowalpha\" 1 Shape \"plymesh\" \"float shadowalpha\" 0");
  ASSERT_TRUE(p.sink.shapes[0].params.texture("shadowalpha"));
  EXPECT_EQ(*p.sink.shapes[0].params.texture("shadowalpha"), p.scene.textures.at(0).name);
  EXPECT_EQ(p.scene.textures[0].params.real("value", 1), 0);
  EXPECT_EQ(p.scene.textures.size(), 1u);
  EXPECT_FALSE(p.sink.shapes[1].params.find("shadowalpha")->type == ParamType::texture);
  EXPECT_TRUE(p.sink.shapes[2].params.texture("shadowalpha"));
}

TEST(Parser, TexturesCountBeforePbrtV4) {
  for (const char* both : {"\"texture Kd\" \"t\" \"rgb Kd\" [0 1 0]", "\"rgb Kd\" [0 1 0] \"texture Kd\" \"t\""}) {
    const ParsedScene p = world(std::string("Texture \"t\" \"color\" \"constant\" Material \"matte\" ") + both + " Shape \"sphere\"");
    EXPECT_TRUE(p.scene.materials.at(0).params.texture("Kd")) << both;
  }
}

TEST(Parser, UnknownTexturesLeaveTheDefault) {
  const ParsedScene p = world("Texture \"t\" \"color\" \"plaid\" Material \"matte\" \"texture Kd\" \"t\" Shape \"sphere\"");
  EXPECT_TRUE(p.scene.textures.empty());
  EXPECT_FALSE(p.scene.materials.at(0).params.has("Kd"));
  EXPECT_NE(joined(p.warnings).find("unknown texture \"plaid\", expected one of "), std::string::npos) << joined(p.warnings);
}

TEST(Parser, AreaLightsInObjectsAreOnlySeen) {
  const ParsedScene p =
      world("AreaLightSource \"area\" ObjectBegin \"a\" Shape \"sphere\" Shape \"disk\" ObjectEnd");
  EXPECT_EQ(p.sink.shapes[0].area_light, AreaLightId(0));
  EXPECT_EQ(p.sink.shapes[1].area_light, AreaLightId(0));
  ASSERT_EQ(p.scene.area_lights.size(), 1u);
  EXPECT_TRUE(p.scene.area_lights[0].params.boolean("onlyseen", false));
  EXPECT_EQ(p.warnings.list().size(), 1u);
}

TEST(Parser, ShapesShareTheirAreaLight) {
  const ParsedScene p = world(
      "AreaLightSource \"area\" Shape \"a\" Shape \"b\" AreaLightSource \"area\" Shape \"c\"");
  EXPECT_EQ(p.scene.area_lights.size(), 2u);
  EXPECT_EQ(p.sink.shapes[1].area_light, AreaLightId(0));
  EXPECT_EQ(p.sink.shapes[2].area_light, AreaLightId(1));
}

TEST(Parser, BracketedNamesAreNames) {
  const ParsedScene p = world("Material [\"glass\"] Shape [ \"sphere\" ]");
  EXPECT_EQ(p.sink.shapes.at(0).type, "sphere");
  EXPECT_EQ(p.scene.materials.at(0).type, "glass");
}

}  // namespace
}  // namespace cloudrenderer
