#include <gtest/gtest.h>

#include "scene_collector.h"

namespace cloudrenderer {
namespace {

ParsedScene world(const std::string& text, Dialect dialect) {
  return parse_text("WorldBegin\n" + text + "\nWorldEnd\n", dialect);
}

const MaterialDesc& material_of(const ParsedScene& p, std::size_t shape) {
  return p.scene.materials.at(p.sink.shapes.at(shape).material.value);
}

const Dialect kBoth[] = {Dialect::v2, Dialect::v3};

TEST(Materials, MatteIsTheDefault) {
  for (const Dialect d : kBoth)
    EXPECT_EQ(material_of(world("Shape \"sphere\"", d), 0).type, "matte");
}

TEST(Materials, EqualOnesAreOne) {
  for (const Dialect d : kBoth) {
    const ParsedScene p = world(
        "Material \"matte\" \"rgb Kd\" [1 0 0] Shape \"a\" Material \"matte\" \"rgb Kd\" [0 1 0] "
        "Shape \"b\" "
        "Material \"matte\" \"rgb Kd\" [1 0 0] Shape \"c\" MakeNamedMaterial \"n\" \"string type\" "
        "\"matte\" \"rgb Kd\" "
        "[0 1 0] NamedMaterial \"n\" Shape \"d\"",
        d);
    EXPECT_EQ(p.scene.materials.size(), 2u);
    EXPECT_EQ(p.sink.shapes[0].material, p.sink.shapes[2].material);
    EXPECT_EQ(p.sink.shapes[1].material, p.sink.shapes[3].material);
  }
}

TEST(Materials, OfV2TakeTheValueWhereThereIsNoSuchTexture) {
  for (const char* both : {"\"rgb Kd\" [.7 .6 .5] \"texture Kd\" \"none\"", "\"texture Kd\" \"none\" \"rgb Kd\" [.7 .6 .5]"}) {
    const std::string text = std::string("Material \"matte\" ") + both + " Shape \"a\"";
    const ParsedScene v2 = world(text, Dialect::v2), v3 = world(text, Dialect::v3);
    EXPECT_EQ(material_of(v2, 0).params.rgb("Kd", Rgb(0.f)), Rgb(.7f, .6f, .5f));
    EXPECT_FALSE(material_of(v3, 0).params.has("Kd"));
  }
}

TEST(Materials, OfV2NamedOnesTakeTheRestFromTheOneThatIsSet) {
  const std::string text = "Material \"plastic\" \"rgb Kd\" [.7 .6 .5] MakeNamedMaterial \"n\" \"string type\" \"matte\" NamedMaterial \"n\" Shape \"a\"";
  EXPECT_EQ(material_of(world(text, Dialect::v2), 0).params.rgb("Kd", Rgb(0.f)), Rgb(.7f, .6f, .5f));
  EXPECT_FALSE(material_of(world(text, Dialect::v3), 0).params.has("Kd"));
}

TEST(Materials, BelongToTheirBlock) {
  for (const Dialect d : kBoth) {
    const ParsedScene p = world(
        "Material \"glass\" AttributeBegin Material \"mirror\" Shape \"a\" AttributeEnd Shape "
        "\"b\" "
        "TransformBegin Material \"metal\" TransformEnd Shape \"c\"",
        d);
    EXPECT_EQ(material_of(p, 0).type, "mirror");
    EXPECT_EQ(material_of(p, 1).type, "glass");
    EXPECT_EQ(material_of(p, 2).type, "metal");
  }
}

TEST(Materials, NamedOnesBelongToTheirBlock) {
  for (const Dialect d : kBoth) {
    const ParsedScene p = world(
        "MakeNamedMaterial \"m\" \"string type\" \"glass\" AttributeBegin MakeNamedMaterial \"m\" "
        "\"string type\" "
        "\"mirror\" NamedMaterial \"m\" Shape \"a\" AttributeEnd NamedMaterial \"m\" Shape \"b\"",
        d);
    EXPECT_EQ(material_of(p, 0).type, "mirror");
    EXPECT_EQ(material_of(p, 1).type, "glass");
  }
}

TEST(Materials, ParametersOfTheShapeOverride) {
  for (const Dialect d : kBoth) {
    const ParsedScene p = world(
        "Material \"plastic\" \"rgb Kd\" [1 0 0] \"float roughness\" .2 Shape \"sphere\" \"rgb "
        "Kd\" [0 0 1] "
        "\"float radius\" 3 Shape \"sphere\"",
        d);
    EXPECT_EQ(material_of(p, 0).params.rgb("Kd", {}), Rgb(0, 0, 1));
    EXPECT_EQ(material_of(p, 0).params.real("roughness", 0), .2f);
    EXPECT_FALSE(material_of(p, 0).params.has("radius"));
    EXPECT_EQ(material_of(p, 1).params.rgb("Kd", {}), Rgb(1, 0, 0));
    EXPECT_TRUE(p.sink.shapes[0].params.find("Kd")->used);
    EXPECT_FALSE(p.sink.shapes[0].params.find("radius")->used);
  }
}

TEST(Materials, InV2ATextureOfTheMaterialHidesAValueOfTheShape) {
  const std::string text =
      "Texture \"t\" \"color\" \"constant\" Material \"matte\" \"texture Kd\" \"t\" Shape \"a\" "
      "\"rgb Kd\" [1 1 1]";
  EXPECT_TRUE(material_of(world(text, Dialect::v2), 0).params.texture("Kd"));
  EXPECT_FALSE(material_of(world(text, Dialect::v3), 0).params.texture("Kd"));
}

TEST(Materials, MixNamesMaterialsBeforeIt) {
  for (const Dialect d : kBoth) {
    const ParsedScene p = world(
        "MakeNamedMaterial \"a\" \"string type\" \"glass\" MakeNamedMaterial \"b\" \"string type\" "
        "\"mirror\" "
        "MakeNamedMaterial \"c\" \"string type\" \"mix\" \"string namedmaterial1\" \"a\" \"string "
        "namedmaterial2\" \"b\" "
        "MakeNamedMaterial \"d\" \"string type\" \"mix\" \"string namedmaterial1\" \"c\" \"string "
        "namedmaterial2\" "
        "\"missing\" NamedMaterial \"d\" Shape \"x\"",
        d);
    const auto mixed = [&](const MaterialDesc& m, const char* name) -> const MaterialDesc& {
      return p.scene.materials.at(std::stoul(m.params.string(name, "")));
    };
    const MaterialDesc& outer = material_of(p, 0);
    EXPECT_EQ(outer.type, "mix");
    EXPECT_EQ(mixed(outer, "namedmaterial2").type, "matte");
    const MaterialDesc& inner = mixed(outer, "namedmaterial1");
    EXPECT_EQ(mixed(inner, "namedmaterial1").type, "glass");
    EXPECT_EQ(mixed(inner, "namedmaterial2").type, "mirror");
    EXPECT_NE(joined(p.warnings).find("\"missing\""), std::string::npos);
  }
}

TEST(Materials, UnknownNamesAreMatteWithAWarning) {
  const ParsedScene p = world("Material \"velvet\" \"rgb Kd\" [1 0 0] Shape \"a\"", Dialect::v3);
  EXPECT_EQ(material_of(p, 0).type, "matte");
  EXPECT_EQ(material_of(p, 0).params.rgb("Kd", {}), Rgb(1, 0, 0));
  EXPECT_NE(joined(p.warnings).find("velvet"), std::string::npos);
  const ParsedScene q = world("Material \"glass\" NamedMaterial \"gone\" Shape \"a\"", Dialect::v3);
  EXPECT_EQ(material_of(q, 0).type, "glass");
  EXPECT_NE(joined(q.warnings).find("gone"), std::string::npos);
}

TEST(Materials, NoneIsTheNullMaterial) {
  for (const Dialect d : kBoth)
    for (const char* name : {"\"none\"", "\"\""})
      EXPECT_EQ(material_of(world(std::string("Material ") + name + " Shape \"a\"", d), 0).type,
                "none");
}

TEST(Textures, GetUniqueNamesWhenRedefined) {
  for (const Dialect d : kBoth) {
    const ParsedScene p = world(
        "Texture \"t\" \"color\" \"constant\" Material \"matte\" \"texture Kd\" \"t\" Shape \"a\" "
        "AttributeBegin "
        "Texture \"t\" \"color\" \"checkerboard\" \"texture tex1\" \"t\" Material \"matte\" "
        "\"texture Kd\" \"t\" "
        "Shape \"b\" AttributeEnd Material \"matte\" \"texture Kd\" \"t\" Shape \"c\"",
        d);
    ASSERT_EQ(p.scene.textures.size(), 2u);
    EXPECT_EQ(p.scene.textures[1].name, "t#2");
    EXPECT_EQ(p.scene.textures[1].params.texture("tex1"), "t");
    EXPECT_EQ(material_of(p, 0).params.texture("Kd"), "t");
    EXPECT_EQ(material_of(p, 1).params.texture("Kd"), "t#2");
    EXPECT_EQ(p.sink.shapes[0].material, p.sink.shapes[2].material);
  }
}

TEST(Textures, FloatAndSpectrumOnesHaveNamesOfTheirOwn) {
  for (const Dialect d : kBoth) {
    const ParsedScene p = world(
        "Texture \"t\" \"color\" \"constant\" Texture \"t\" \"float\" \"constant\" Material "
        "\"uber\" \"texture Kd\" "
        "\"t\" \"texture bumpmap\" \"t\" Shape \"trianglemesh\" \"texture alpha\" \"t\"",
        d);
    EXPECT_EQ(material_of(p, 0).params.texture("Kd"), "t");
    EXPECT_EQ(material_of(p, 0).params.texture("bumpmap"), "t#2");
    EXPECT_EQ(p.sink.shapes[0].params.texture("alpha"), "t#2");
  }
}

TEST(Textures, OfAV2MaterialAreThoseOfTheShapesBlock) {
  const std::string text =
      "Texture \"t\" \"color\" \"constant\" Material \"matte\" \"texture Kd\" \"t\" Texture \"t\" "
      "\"color\" \"dots\" "
      "Shape \"a\"";
  EXPECT_EQ(material_of(world(text, Dialect::v2), 0).params.texture("Kd"), "t#2");
  EXPECT_EQ(material_of(world(text, Dialect::v3), 0).params.texture("Kd"), "t");
}

TEST(Textures, UnknownOnesAreDroppedWithAWarning) {
  for (const Dialect d : kBoth) {
    const ParsedScene p =
        world("Material \"matte\" \"texture Kd\" \"gone\" Shape \"a\" Shape \"b\"", d);
    EXPECT_FALSE(material_of(p, 0).params.has("Kd"));
    EXPECT_EQ(p.warnings.list().size(), 1u) << joined(p.warnings);
  }
}

TEST(Textures, KeepTheirTransformation) {
  const ParsedScene p = world("Translate 1 2 3 Texture \"t\" \"spectrum\" \"marble\"", Dialect::v3);
  EXPECT_EQ(p.scene.textures.at(0).texture_to_world.point(Vec3(0)), Vec3(1, 2, 3));
  EXPECT_FALSE(p.scene.textures[0].is_float);
}

}  // namespace
}  // namespace cloudrenderer
