#include <gtest/gtest.h>

#include <random>

#include "scene/material_specular.h"
#include "shading/bsdf_lobes.h"
#include "shading/material.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

SurfacePoint plane() {
  SurfacePoint s;
  s.ng = s.ns = {0, 0, 1};
  s.dpdu = s.shading_dpdu = {1, 0, 0};
  s.dpdv = s.shading_dpdv = {0, 1, 0};
  return s;
}

struct Built {
  explicit Built(std::vector<MaterialDesc> materials, Dialect dialect = Dialect::v2,
                 std::vector<TextureDesc> textures = {}) {
    scene.dialect = dialect;
    scene.materials = std::move(materials);
    scene.textures = std::move(textures);
    shading = Shading::build(scene, {}, warnings);
  }
  Bsdf at(const SurfacePoint& point = plane(),
          const Vec3& wo = glm::normalize(Vec3(0.3f, 0.1f, 0.9f))) const {
    SurfacePoint p = point;
    const Bsdf bsdf = shading->bsdf(static_cast<std::uint32_t>(scene.materials.size() - 1), p, wo, {});
    bool specular = false;
    for (int i = 0; i < bsdf.lobe_count(); ++i) specular = specular || bsdf.lobe(i).kind >= LobeKind::specular_reflection;
    // What lies behind the boundary of a disney material is for paths from the camera only.
    const std::string& type = scene.materials.back().type;
    EXPECT_TRUE(!specular || type == "disney" || maybe_specular(scene).back()) << type;
    return bsdf;
  }
  SceneDescription scene;
  Warnings warnings;
  std::unique_ptr<Shading> shading;
};

std::vector<LobeKind> kinds(const Bsdf& b) {
  std::vector<LobeKind> k;
  for (int i = 0; i < b.lobe_count(); ++i) k.push_back(b.lobe(i).kind);
  return k;
}

using K = LobeKind;

TEST(Materials, HaveTheLobesOfTheirDialect) {
  const auto both = [](const MaterialDesc& m, const std::vector<K>& v2, const std::vector<K>& v3) {
    const Built a({m}, Dialect::v2), b({m}, Dialect::v3);
    EXPECT_EQ(kinds(a.at()), v2) << m.type;
    EXPECT_EQ(kinds(b.at()), v3) << m.type;
    EXPECT_TRUE(a.warnings.list().empty()) << a.warnings.list()[0];
    EXPECT_TRUE(b.warnings.list().empty()) << b.warnings.list()[0];
  };
  both(material("matte"), {K::lambert}, {K::lambert});
  both(material("matte", {real_param("sigma", 20.f)}), {K::oren_nayar}, {K::oren_nayar});
  both(material("plastic"), {K::lambert, K::microfacet}, {K::lambert, K::microfacet});
  both(material("metal"), {K::microfacet}, {K::microfacet});
  both(material("mirror"), {K::specular_reflection}, {K::specular_reflection});
  both(material("glass"), {K::specular_dielectric}, {K::specular_dielectric});
  both(material("substrate"), {K::fresnel_blend}, {K::fresnel_blend});
  both(material("uber"), {K::lambert, K::microfacet}, {K::lambert, K::microfacet});
  both(material("uber", {rgb_param("opacity", Rgb(0.5f)), rgb_param("Kr", Rgb(1.f)),
                         rgb_param("Kt", Rgb(1.f))}),
       {K::specular_transmission, K::lambert, K::microfacet, K::specular_reflection,
        K::specular_transmission},
       {K::specular_transmission, K::lambert, K::microfacet, K::specular_reflection,
        K::specular_transmission});
  both(material("translucent"), {K::lambert, K::lambert, K::microfacet, K::microfacet},
       {K::lambert, K::lambert, K::microfacet_dielectric});
  both(material("shinymetal"), {K::microfacet, K::specular_reflection},
       {K::microfacet, K::specular_reflection});
  both(material("hair"), {K::hair}, {K::hair});
  both(material("disney"), {K::disney_diffuse, K::microfacet}, {K::disney_diffuse, K::microfacet});
  const MaterialDesc all = material(
      "disney", {real_param("clearcoat", 1.f), real_param("spectrans", 0.5f), bool_param("thin", true)});
  both(all, {K::disney_diffuse, K::microfacet, K::disney_clearcoat, K::microfacet_dielectric, K::lambert},
       {K::disney_diffuse, K::microfacet, K::disney_clearcoat, K::microfacet_dielectric, K::lambert});
}

TEST(Materials, ShinyMetalReflectsItsColoursAtNormalIncidence) {
  const Rgb ks(0.1f, 0.4f, 0.8f), kr(0.9f, 0.5f, 0.2f);
  const Vec3 up(0, 0, 1);
  const Bsdf b = Built({material("shinymetal", {rgb_param("Ks", ks), rgb_param("Kr", kr)})}).at(plane(), up);
  BsdfSample s;
  ASSERT_TRUE(b.sample(up, 0.9999f, {0.5f, 0.5f}, s));
  ASSERT_TRUE(s.specular);
  const Rgb smooth = s.weight * b.weight(1), glossy = b.eval(up, up);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(smooth[i], kr[i], 1e-4f);
    EXPECT_NEAR(glossy[i] / glossy.z, ks[i] / ks.z, 1e-4f);
  }
  // Blinn's distribution of exponent 1 / 0.1 at its peak: Ks (e + 2) / (2 pi) / 4
  EXPECT_NEAR(glossy.z, ks.z * 12.f / (8.f * kPi), 1e-4f);
}

TEST(Materials, RoughGlassIsOfV3Only) {
  const auto glass =
      material("glass", {real_param("uroughness", 0.1f), real_param("vroughness", 0.1f)});
  EXPECT_EQ(kinds(Built({glass}, Dialect::v3).at()), std::vector{K::microfacet_dielectric});
  const Built v2({glass}, Dialect::v2);
  EXPECT_EQ(kinds(v2.at()), std::vector{K::specular_dielectric});
  EXPECT_EQ(v2.warnings.list().size(), 2u);  // two parameters that v2 does not have
}

TEST(Materials, PlasticUsesBlinnInV2AndTrowbridgeReitzInV3) {
  const auto m = material("plastic", {real_param("roughness", 0.05f)});
  const Bsdf a = Built({m}, Dialect::v2).at(), b = Built({m}, Dialect::v3).at();
  EXPECT_EQ(a.lobe(1).distribution, Distribution::blinn);
  EXPECT_NEAR(a.lobe(1).alpha_x, 20.f, 1e-4f);
  EXPECT_EQ(b.lobe(1).distribution, Distribution::trowbridge_reitz);
  EXPECT_NEAR(b.lobe(1).alpha_x, bsdf::roughness_to_alpha(0.05f), 1e-6f);
  const Bsdf c = Built({material("plastic", {real_param("roughness", 0.05f),
                                             bool_param("remaproughness", false)})},
                       Dialect::v3)
                     .at();
  EXPECT_NEAR(c.lobe(1).alpha_x, 0.05f, 1e-6f);
  const Bsdf d = Built({material("plastic", {real_param("roughness", 0.f)})}, Dialect::v2).at();
  EXPECT_EQ(d.lobe(1).alpha_x, 10000.f);
}

// pbrt-v2's formulas written out again, against the lobes.
TEST(Materials, V2PlasticHasTheValueOfTheBook) {
  const Bsdf b = Built({material("plastic", {rgb_param("Kd", Rgb(0.3f)), rgb_param("Ks", Rgb(0.5f)),
                                             real_param("roughness", 0.1f)})})
                     .at();
  for (const float x : {0.f, 0.5f, 0.9f}) {
    const Vec3 wo = glm::normalize(Vec3(0.3f, 0.1f, 0.9f)),
               wi = glm::normalize(Vec3(-x, 0.2f, 1.1f - x));
    const Vec3 wh = glm::normalize(wo + wi);
    const float d = 12.f / (2 * kPi) * std::pow(wh.z, 10.f), dot = glm::dot(wo, wh);
    const float g = std::min(1.f, std::min(2 * wh.z * wo.z / dot, 2 * wh.z * wi.z / dot));
    const float sin_t = 1.5f * std::sqrt(1 - dot * dot);
    float f = 1.f;
    if (sin_t < 1.f) {
      const float t = std::sqrt(1 - sin_t * sin_t);
      const float parallel = (dot - 1.5f * t) / (dot + 1.5f * t),
                  perpendicular = (1.5f * dot - t) / (1.5f * dot + t);
      f = 0.5f * (parallel * parallel + perpendicular * perpendicular);
    }
    const float expected = 0.3f * kInvPi + 0.5f * d * g * f / (4 * wo.z * wi.z);
    EXPECT_NEAR(b.eval(wo, wi).x, expected, 1e-4f * expected);
  }
}

TEST(Materials, AWhiteSurfaceUnderASmoothCoatReflectsAllThatArrives) {
  const Built b({material("coateddiffuse", {rgb_param("reflectance", Rgb(1.f)), real_param("thickness", 0.f), integer_param("maxdepth", 1000)})}, Dialect::v3);
  std::mt19937 random(11);
  std::uniform_real_distribution<float> u(0.f, 1.f);
  for (const float cosine : {1.f, 0.7f, 0.4f, 0.15f}) {
    const Vec3 wo(std::sqrt(1.f - cosine * cosine), 0, cosine);
    const Bsdf bsdf = b.at(plane(), wo);
    double sum = 0;
    constexpr int kSamples = 40000;
    for (int i = 0; i < kSamples; ++i) {
      BsdfSample s;
      if (bsdf.sample(wo, u(random), {u(random), u(random)}, s)) sum += static_cast<double>(s.weight.y);
    }
    EXPECT_NEAR(sum / kSamples, 1, 0.004) << "cosine " << cosine << ", seed 11";
  }
}

TEST(Materials, CoatsAreLayersWhereTheyHaveNoFormula) {
  const auto of = [](const char* type, std::initializer_list<Param> params) { return Built({material(type, params)}, Dialect::v3); };
  EXPECT_EQ(kinds(of("coateddiffuse", {}).at()), (std::vector<K>{K::coated_lambert, K::specular_reflection}));
  EXPECT_EQ(kinds(of("coateddiffuse", {rgb_param("albedo", Rgb(0.5f))}).at()), (std::vector<K>{K::specular_reflection, K::layered}));
  EXPECT_EQ(kinds(of("coatedconductor", {string_param("roughnessmap", "sqrt")}).at()), (std::vector<K>{K::specular_reflection}));
  EXPECT_EQ(kinds(of("coatedconductor", {string_param("roughnessmap", "sqrt"), real_param("conductor.uroughness", 0.1f),
                                         real_param("conductor.vroughness", 0.1f)}).at()),
            (std::vector<K>{K::specular_reflection, K::layered}));
  const Built rough = of("coateddiffuse", {string_param("roughnessmap", "sqrt"), real_param("uroughness", 0.1f), real_param("vroughness", 0.3f)});
  const Bsdf b = rough.at();
  ASSERT_EQ(kinds(b), (std::vector<K>{K::microfacet, K::layered}));
  EXPECT_FLOAT_EQ(b.lobe(0).alpha_x, std::sqrt(0.1f));
  EXPECT_FLOAT_EQ(b.lobe(0).alpha_y, std::sqrt(0.3f));
  // Smooth ones are shaded eight at once.
  EXPECT_NE(of("coateddiffuse", {}).shading->kind(0), 0u);
  EXPECT_EQ(rough.shading->kind(0), 0u);
}

// What pbrt-v4's "regularize" makes of widths: nothing else, and nothing of other versions.
TEST(Materials, RegularizedOnesHaveNoNarrowFacets) {
  const auto lobes = [](const char* type, std::vector<Param> params, bool v4 = true) {
    if (v4) params.push_back(string_param("roughnessmap", "none"));
    MaterialDesc m = material(type, {});
    for (Param& p : params) m.params.add(std::move(p));
    const Built built({m}, Dialect::v3);
    SurfacePoint p = plane();
    return built.shading->bsdf(0, p, glm::normalize(Vec3(0.3f, 0.1f, 0.9f)), {}, true);
  };
  EXPECT_EQ(kinds(lobes("glass", {})), std::vector<K>{K::microfacet_dielectric});
  EXPECT_FLOAT_EQ(lobes("glass", {}).lobe(0).alpha_x, 0.1f);
  EXPECT_EQ(kinds(lobes("glass", {}, false)), std::vector<K>{K::specular_dielectric});
  for (const auto& [before, after] : std::array<std::array<float, 2>, 6>{{{0, 0.1f}, {0.02f, 0.1f}, {0.08f, 0.16f}, {0.2f, 0.3f}, {0.3f, 0.3f}, {0.7f, 0.7f}}}) {
    const Bsdf b = lobes("metal", {real_param("roughness", before)});
    ASSERT_EQ(kinds(b), std::vector<K>{K::microfacet});
    EXPECT_FLOAT_EQ(b.lobe(0).alpha_x, after);
    EXPECT_FLOAT_EQ(b.lobe(0).alpha_y, after);
  }
  EXPECT_EQ(kinds(lobes("coateddiffuse", {})), (std::vector<K>{K::microfacet, K::layered}));
  EXPECT_EQ(kinds(lobes("coatedconductor", {})), (std::vector<K>{K::microfacet, K::layered}));
  EXPECT_EQ(kinds(lobes("thindielectric", {})), std::vector<K>{K::specular_dielectric});
  EXPECT_EQ(kinds(lobes("matte", {})), std::vector<K>{K::lambert});
}

TEST(Materials, EstimatesDifferFromPointToPoint) {
  const Vec3 wo = glm::normalize(Vec3(0.3f, 0.1f, 0.9f)), wi = glm::normalize(Vec3(-0.2f, 0.5f, 0.7f));
  const MaterialDesc coated = material("coateddiffuse", {string_param("roughnessmap", "sqrt"), real_param("uroughness", 0.3f), real_param("vroughness", 0.3f)});
  const Built alone({coated}, Dialect::v3);
  const Built mixed({material("matte"), coated, material("mix", {string_param("namedmaterial1", "0"), string_param("namedmaterial2", "1")})}, Dialect::v3);
  SurfacePoint here = plane(), there = plane();
  there.p.x = 1.f;
  for (const Built* b : {&alone, &mixed}) {
    EXPECT_EQ(b->at(here, wo).eval(wo, wi), b->at(here, wo).eval(wo, wi));
    EXPECT_NE(b->at(here, wo).eval(wo, wi), b->at(there, wo).eval(wo, wi));
  }
}

TEST(Materials, NoneIsTheNullMaterialAndNoMaterialIsBlack) {
  const Built none({material("none")}, Dialect::v3), empty({material("")}, Dialect::v3),
      matte({material("matte")});
  EXPECT_TRUE(none.shading->is_null(0));
  EXPECT_TRUE(empty.shading->is_null(0));
  EXPECT_FALSE(matte.shading->is_null(0));
  EXPECT_FALSE(matte.shading->is_null(0xffffffffu));
  SurfacePoint p = plane();
  EXPECT_TRUE(matte.shading->bsdf(0xffffffffu, p, {0, 0, 1}, {}).empty());
}

TEST(Materials, OpacityLetsRaysThroughUnbent) {
  const Bsdf b = Built({material("uber", {rgb_param("opacity", Rgb(0.f))})}).at();
  const Vec3 wo = glm::normalize(Vec3(0.3f, 0.1f, 0.9f));
  BsdfSample s;
  ASSERT_TRUE(b.sample(wo, 0.5f, {0.5f, 0.5f}, s));
  EXPECT_TRUE(s.specular && s.transmission);
  EXPECT_NEAR(glm::length(s.wi + wo), 0.f, 1e-6f);
  EXPECT_NEAR(s.weight.x, 1.f, 1e-6f);
}

TEST(Materials, MixAddsScaledLobes) {
  const auto mix = [](const Rgb& amount) {
    return material("mix", {rgb_param("amount", amount), string_param("namedmaterial1", "0"),
                            string_param("namedmaterial2", "1")});
  };
  const std::vector parts{
      material("matte", {rgb_param("Kd", Rgb(0.8f))}),
      material("plastic", {rgb_param("Kd", Rgb(0.4f)), rgb_param("Ks", Rgb(1.f))})};
  auto all = parts;
  all.push_back(mix(Rgb(0.25f)));
  const Built built(all);
  const Bsdf b = built.at();
  ASSERT_EQ(kinds(b), (std::vector{K::lambert, K::microfacet}));  // equal kinds are one lobe
  EXPECT_NEAR(b.lobe(0).scale.x, 0.25f * 0.8f + 0.75f * 0.4f, 1e-6f);
  EXPECT_NEAR(b.lobe(1).scale.x, 0.75f, 1e-6f);
  EXPECT_TRUE(built.warnings.list().empty());

  auto nested = parts;
  for (int i = 0; i < 12; ++i)
    nested.push_back(material("mix", {string_param("namedmaterial1", std::to_string(i + 1)),
                                      string_param("namedmaterial2", std::to_string(i + 1))}));
  EXPECT_THROW(Built{nested}, SceneError);
}

TEST(Materials, MixesOfAnythingWithAnything) {
  const auto mix = [](int a, int b, float amount = 0.5f) {
    return material("mix", {real_param("amount", amount), string_param("namedmaterial1", std::to_string(a)),
                            string_param("namedmaterial2", std::to_string(b))});
  };
  const Vec3 wo = glm::normalize(Vec3(0.3f, 0.1f, 0.9f));
  {  // the share of a null material goes straight on
    const Built built({material("none"), material("matte"), mix(0, 1, 0.25f)}, Dialect::v3);
    const Bsdf b = built.at(plane(), wo);
    ASSERT_EQ(kinds(b), (std::vector{K::specular_transmission, K::lambert}));
    EXPECT_FALSE(built.shading->is_null(2));
    BsdfSample s;
    ASSERT_TRUE(b.sample(wo, 0.f, {0.5f, 0.5f}, s));
    EXPECT_NEAR(glm::length(s.wi + wo), 0.f, 1e-6f);
    EXPECT_NEAR(s.weight.x * b.weight(0), 0.25f, 1e-6f);
  }
  {  // specular, hair and disney, nested
    const Built built({material("mirror"), material("hair"), mix(0, 1, 0.5f), material("disney"), mix(2, 3, 0.5f)}, Dialect::v3);
    const Bsdf b = built.at(plane(), wo);
    ASSERT_EQ(kinds(b), (std::vector{K::specular_reflection, K::hair, K::disney_diffuse, K::microfacet}));
    EXPECT_NEAR(b.lobe(0).scale.x, 0.25f * 0.9f, 1e-6f);
    EXPECT_NEAR(b.lobe(1).scale.x, 0.25f, 1e-6f);
    EXPECT_NEAR(b.lobe(2).scale.x, 0.5f * 0.5f, 1e-6f);
    EXPECT_NEAR(b.lobe(3).scale.x, 0.5f, 1e-6f);
    EXPECT_TRUE(built.warnings.list().empty());
  }
  // There is room for 32 lobes; that there may be more is told.
  std::vector<MaterialDesc> many;
  for (int i = 0; i < 4; ++i)
    many.push_back(material("uber", {rgb_param("Kd", Rgb(0.f)), rgb_param("Kr", Rgb(0.1f * static_cast<float>(i + 1))),
                                     rgb_param("Kt", Rgb(0.1f)), rgb_param("opacity", Rgb(0.5f))}));
  many.push_back(mix(0, 1));
  many.push_back(mix(2, 3));
  many.push_back(mix(4, 5));
  const Built four(many);
  EXPECT_EQ(four.at().lobe_count(), 16);
  EXPECT_EQ(four.shading->kind(6), 0u);
  EXPECT_TRUE(four.warnings.list().empty());
  many.push_back(mix(6, 6));
  const Built eight(many);
  EXPECT_EQ(eight.at().lobe_count(), 32);
  ASSERT_EQ(eight.warnings.list().size(), 1u);
  EXPECT_NE(eight.warnings.list()[0].find("40 lobes"), std::string::npos) << eight.warnings.list()[0];
}

TEST(Materials, UnknownKindsAreWarnings) {
  const Built b({material("nonsense")}, Dialect::v3);
  EXPECT_EQ(b.warnings.list().size(), 1u);
  EXPECT_TRUE(b.at().has_smooth());
}

TEST(Materials, ReportUnusedParameters) {
  const Built b({material("matte", {real_param("roughness", 0.1f)})});
  ASSERT_EQ(b.warnings.list().size(), 1u);
  EXPECT_NE(b.warnings.list()[0].find("roughness"), std::string::npos);
}

TEST(Materials, NeedOnlyWhatTheyUse) {
  EXPECT_FALSE(Built({material("plastic")}).shading->needs().uv);
  EXPECT_FALSE(Built({material("substrate")}).shading->needs().uv);
  EXPECT_TRUE(Built({material("substrate", {real_param("uroughness", 0.2f)})}).shading->needs().uv);
  const std::vector textures{texture("c", "constant", false, {rgb_param("value", Rgb(0.7f))}),
                             texture("u", "uv", false)};
  EXPECT_FALSE(Built({material("matte", {texture_param("Kd", "c")})}, Dialect::v2, textures)
                   .shading->needs().uv);
  const Built uv({material("matte", {texture_param("Kd", "u")})}, Dialect::v2, textures);
  EXPECT_TRUE(uv.shading->needs().uv);
  EXPECT_FALSE(uv.shading->needs().footprint);
  SurfacePoint p = plane();
  p.uv = {0.25f, 0.5f};
  EXPECT_NEAR(uv.at(p).lobe(0).scale.x, 0.25f, 1e-6f);
}

TEST(BumpMaps, TiltTheNormalByTheSlope) {
  // Height 0.5 u on a plane with p = (u, v, 0): the normal is (-0.5, 0, 1) normalised.
  const auto ramp = texture("ramp", "bilerp", true,
                            {real_param("v00", 0.f), real_param("v01", 0.f),
                             real_param("v10", 0.5f), real_param("v11", 0.5f)});
  for (const Dialect d : {Dialect::v2, Dialect::v3}) {
    const Built b({material("matte", {texture_param("bumpmap", "ramp")})}, d, {ramp});
    EXPECT_TRUE(b.shading->needs().uv);
    SurfacePoint p = plane();
    p.uv = {0.3f, 0.4f};
    const Bsdf bsdf = b.shading->bsdf(0, p, {0, 0, 1}, {});
    const Vec3 expected = glm::normalize(Vec3(-0.5f, 0, 1));
    EXPECT_NEAR(glm::length(p.ns - expected), 0.f, 1e-3f);
    EXPECT_NEAR(glm::length(bsdf.frame().n - expected), 0.f, 1e-3f);
    EXPECT_EQ(bsdf.ng(), Vec3(0, 0, 1));
    p = plane();  // a mirrored parametrisation keeps the normal on the geometric side
    p.dpdv = p.shading_dpdv = {0, -1, 0};
    p.uv = {0.3f, 0.4f};
    b.shading->bsdf(0, p, {0, 0, 1}, {});
    EXPECT_GT(p.ns.z, 0.f);
  }
}

TEST(BumpMaps, ConstantHeightsAndDegenerateTangentsChangeNothing) {
  const auto flat = texture("flat", "constant", true, {real_param("value", 3.f)});
  const Built b({material("matte", {texture_param("bumpmap", "flat")})}, Dialect::v2, {flat});
  EXPECT_FALSE(b.shading->needs().uv);
  const auto ramp = texture("ramp", "bilerp", true);
  const Built c({material("matte", {texture_param("bumpmap", "ramp")})}, Dialect::v2, {ramp});
  SurfacePoint p = plane();
  p.shading_dpdu = p.shading_dpdv = Vec3(0.f);
  c.shading->bsdf(0, p, {0, 0, 1}, {});
  EXPECT_EQ(p.ns, Vec3(0, 0, 1));
}

TEST(NormalMaps, TurnTheFrameOfTheTangents) {
  const auto normals = texture("normals", "bilerp", false,
                               {rgb_param("v00", {.8f, .5f, .9f}), rgb_param("v01", {.8f, .5f, .9f}),
                                rgb_param("v10", {.5f, .2f, .9f}), rgb_param("v11", {.5f, .2f, .9f})});
  const Built b({material("matte", {texture_param("normalmap", "normals")})}, Dialect::v3, {normals});
  EXPECT_TRUE(b.shading->needs().uv);
  EXPECT_EQ(b.shading->kind(0), 0u);
  SurfacePoint p = plane();
  p.shading_dpdu = {0, 3, 0};  // x of the map; y is along the cross product of the normal with it
  p.uv = {0, .5f};
  const Bsdf bsdf = b.shading->bsdf(0, p, {0, 0, 1}, {});
  EXPECT_LT(glm::length(p.ns - Vec3(0, .6f, .8f)), 1e-5f);
  EXPECT_LT(glm::length(bsdf.frame().n - p.ns), 1e-6f);
  EXPECT_LT(std::fabs(glm::dot(p.ns, p.shading_dpdu)), 1e-5f);
  EXPECT_NEAR(glm::length(p.shading_dpdu), 3.f, 1e-5f);
  p = plane();
  p.shading_dpdu = {0, 3, 0};
  p.uv = {1, .5f};
  b.shading->bsdf(0, p, {0, 0, 1}, {});
  EXPECT_LT(glm::length(p.ns - Vec3(.6f, 0, .8f)), 1e-5f);  // minus y is +x here
  p = plane();
  p.shading_dpdu = p.shading_dpdv = Vec3(0.f);
  b.shading->bsdf(0, p, {0, 0, 1}, {});
  EXPECT_EQ(p.ns, Vec3(0, 0, 1));
}

TEST(Materials, AnisotropyFollowsTheTangent) {
  const Built b({material("metal", {real_param("uroughness", 0.4f), real_param("vroughness", 0.05f),
                                    bool_param("remaproughness", false)})},
                Dialect::v3);
  SurfacePoint p = plane();
  p.shading_dpdu = {0, 3, 0};
  const Vec3 wo(0, 0, 1);
  const Bsdf bsdf = b.shading->bsdf(0, p, wo, {});
  const Rgb along = bsdf.eval(wo, glm::normalize(Vec3(0, 0.9f, 1))),
            across = bsdf.eval(wo, glm::normalize(Vec3(0.9f, 0, 1)));
  EXPECT_GT(along.x, 2.f * across.x);
}

}  // namespace
}  // namespace cloudrenderer
