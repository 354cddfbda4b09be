// Every parameter of every material with the default that pbrt-v2 and pbrt-v3 give it: naming the default changes nothing,
// another value does, and nothing is reported as unused.
#include <gtest/gtest.h>

#include <optional>

#include "shading/material.h"
#include "shading_fourier_support.h"
#include "shading_support.h"

namespace cloudrenderer {
namespace {

using namespace testing;

constexpr int kV2 = 1, kV3 = 2;

struct Row {
  int dialects;
  const char* material;
  Param value;  // the default
  Param other;
  std::vector<Param> beside = {};  // what the parameter needs to have an effect, or takes its default from
};

Row real(int dialects, const char* material, const char* name, float value, float other, std::vector<Param> beside = {}) {
  return {dialects, material, real_param(name, value), real_param(name, other), std::move(beside)};
}
Row color(int dialects, const char* material, const char* name, const Rgb& value, std::vector<Param> beside = {}) {
  return {dialects, material, rgb_param(name, value), rgb_param(name, Rgb(0.61f, 0.52f, 0.43f)), std::move(beside)};
}
Row truth(int dialects, const char* material, const char* name, bool value, std::vector<Param> beside = {}) {
  return {dialects, material, bool_param(name, value), bool_param(name, !value), std::move(beside)};
}

std::vector<Row> rows() {
  constexpr int kBoth = kV2 | kV3;
  const Param half_thin = real_param("flatness", 0.5f), thin = bool_param("thin", true);
  // of copper, as the two programs convert its spectrum
  const Rgb eta(0.200416f, 0.924047f, 1.102217f), k(3.912948f, 2.452838f, 2.142200f);
  constexpr float kV3Scale = 470.f / 471.f;
  return {
      color(kBoth, "matte", "Kd", Rgb(0.5f)),
      real(kBoth, "matte", "sigma", 0.f, 20.f),
      color(kBoth, "plastic", "Kd", Rgb(0.25f)),
      color(kBoth, "plastic", "Ks", Rgb(0.25f)),
      real(kBoth, "plastic", "roughness", 0.1f, 0.2f),
      truth(kV3, "plastic", "remaproughness", true),
      color(kBoth, "translucent", "Kd", Rgb(0.25f)),
      color(kBoth, "translucent", "Ks", Rgb(0.25f)),
      color(kBoth, "translucent", "reflect", Rgb(0.5f)),
      color(kBoth, "translucent", "transmit", Rgb(0.5f)),
      real(kBoth, "translucent", "roughness", 0.1f, 0.2f),
      truth(kV3, "translucent", "remaproughness", true),
      color(kBoth, "glass", "Kr", Rgb(1.f)),
      color(kBoth, "glass", "Kt", Rgb(1.f)),
      real(kBoth, "glass", "index", 1.5f, 1.3f),
      real(kV3, "glass", "eta", 1.5f, 1.3f),
      real(kV3, "glass", "uroughness", 0.f, 0.1f),
      real(kV3, "glass", "vroughness", 0.f, 0.1f),
      truth(kV3, "glass", "remaproughness", true, {real_param("uroughness", 0.1f), real_param("vroughness", 0.2f)}),
      color(kBoth, "mirror", "Kr", Rgb(0.9f)),
      color(kV2, "metal", "eta", eta),
      color(kV2, "metal", "k", k),
      color(kV3, "metal", "eta", eta * kV3Scale),
      color(kV3, "metal", "k", k * kV3Scale),
      real(kBoth, "metal", "roughness", 0.01f, 0.2f),
      real(kV3, "metal", "uroughness", 0.3f, 0.2f, {real_param("roughness", 0.3f)}),
      real(kV3, "metal", "vroughness", 0.3f, 0.2f, {real_param("roughness", 0.3f)}),
      real(kV3, "metal", "vroughness", 0.3f, 0.2f, {real_param("roughness", 0.3f), real_param("uroughness", 0.1f)}),
      truth(kV3, "metal", "remaproughness", true),
      color(kV2, "shinymetal", "Ks", Rgb(1.f)),
      color(kV2, "shinymetal", "Kr", Rgb(1.f)),
      real(kV2, "shinymetal", "roughness", 0.1f, 0.2f),
      color(kBoth, "substrate", "Kd", Rgb(0.5f)),
      color(kBoth, "substrate", "Ks", Rgb(0.5f)),
      real(kBoth, "substrate", "uroughness", 0.1f, 0.2f),
      real(kBoth, "substrate", "vroughness", 0.1f, 0.2f),
      truth(kV3, "substrate", "remaproughness", true),
      color(kBoth, "uber", "Kd", Rgb(0.25f)),
      color(kBoth, "uber", "Ks", Rgb(0.25f)),
      color(kBoth, "uber", "Kr", Rgb(0.f)),
      color(kBoth, "uber", "Kt", Rgb(0.f)),
      color(kBoth, "uber", "opacity", Rgb(1.f)),
      real(kBoth, "uber", "roughness", 0.1f, 0.2f),
      real(kV3, "uber", "uroughness", 0.3f, 0.2f, {real_param("roughness", 0.3f)}),
      real(kV3, "uber", "vroughness", 0.3f, 0.2f, {real_param("roughness", 0.3f)}),
      real(kV3, "uber", "vroughness", 0.1f, 0.2f, {real_param("roughness", 0.3f), real_param("uroughness", 0.1f)}),
      truth(kV3, "uber", "remaproughness", true),
      real(kBoth, "uber", "index", 1.5f, 1.3f),
      real(kV3, "uber", "eta", 1.5f, 1.3f),
      color(kV3, "disney", "color", Rgb(0.5f)),
      real(kV3, "disney", "metallic", 0.f, 0.3f),
      real(kV3, "disney", "eta", 1.5f, 1.3f),
      real(kV3, "disney", "roughness", 0.5f, 0.3f),
      real(kV3, "disney", "speculartint", 0.f, 0.3f, {rgb_param("color", {0.8f, 0.2f, 0.1f})}),
      real(kV3, "disney", "anisotropic", 0.f, 0.3f),
      real(kV3, "disney", "sheen", 0.f, 0.3f),
      real(kV3, "disney", "sheentint", 0.5f, 0.3f, {real_param("sheen", 1.f), rgb_param("color", {0.8f, 0.2f, 0.1f})}),
      real(kV3, "disney", "clearcoat", 0.f, 0.3f),
      real(kV3, "disney", "clearcoatgloss", 1.f, 0.3f, {real_param("clearcoat", 1.f)}),
      real(kV3, "disney", "spectrans", 0.f, 0.3f),
      truth(kV3, "disney", "thin", false),
      real(kV3, "disney", "flatness", 0.f, 0.3f, {thin}),
      real(kV3, "disney", "difftrans", 1.f, 0.3f, {thin, half_thin}),
      real(kV3, "hair", "eta", 1.55f, 1.3f),
      real(kV3, "hair", "beta_m", 0.3f, 0.2f),
      real(kV3, "hair", "beta_n", 0.3f, 0.2f),
      real(kV3, "hair", "alpha", 2.f, 1.f),
      real(kV3, "hair", "eumelanin", 1.3f, 0.5f),
      real(kV3, "hair", "eumelanin", 0.f, 0.5f, {real_param("pheomelanin", 0.7f)}),
      real(kV3, "hair", "pheomelanin", 0.f, 0.5f, {real_param("eumelanin", 0.7f)}),
      color(kV3, "hair", "sigma_a", 1.3f * Rgb(0.419f, 0.697f, 1.37f)),
      color(kBoth, "mix", "amount", Rgb(0.5f), {string_param("namedmaterial1", "0"), string_param("namedmaterial2", "1")}),
  };
}

struct Built {
  std::vector<Lobe> lobes;
  std::vector<std::string> warnings;
};

Built build(Dialect dialect, const Row& row, const Param* more) {
  SceneDescription scene;
  scene.dialect = dialect;
  scene.materials = {material("matte", {rgb_param("Kd", Rgb(0.8f))}), material("mirror")};
  MaterialDesc desc = material(row.material);
  for (const Param& p : row.beside) desc.params.add(p);
  if (more) desc.params.add(*more);
  scene.materials.push_back(desc);
  Warnings warnings;
  const auto shading = Shading::build(scene, {}, warnings);
  SurfacePoint p;
  p.ng = p.ns = {0, 0, 1};
  p.shading_dpdu = {1, 0, 0};
  p.shading_dpdv = {0, 1, 0};
  p.uv = {0.5f, 0.7f};
  const Bsdf b = shading->bsdf(2, p, {0, 0.6f, 0.8f}, {});
  Built out;
  for (int i = 0; i < b.lobe_count(); ++i) out.lobes.push_back(b.lobe(i));
  out.warnings = warnings.list();
  return out;
}

bool near(const Rgb& a, const Rgb& b) {
  for (int i = 0; i < 3; ++i)
    if (!(std::fabs(a[i] - b[i]) <= 1e-6f * (1 + std::fabs(a[i])))) return false;
  return true;
}
bool same(const std::vector<Lobe>& a, const std::vector<Lobe>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Lobe& x, const Lobe& y) {
    return x.kind == y.kind && x.distribution == y.distribution && x.fresnel == y.fresnel && x.transmits == y.transmits &&
           near(x.scale, y.scale) && near(x.scale2, y.scale2) && near(x.eta, y.eta) && near(x.k, y.k) &&
           near({x.alpha_x, x.alpha_y, x.norm}, {y.alpha_x, y.alpha_y, y.norm});
  });
}

TEST(MaterialParameters, HaveTheDefaultsOfBothVersions) {
  for (const Row& row : rows())
    for (const Dialect dialect : {Dialect::v2, Dialect::v3}) {
      if (!(row.dialects & (dialect == Dialect::v2 ? kV2 : kV3))) continue;
      const std::string what = std::string(row.material) + " \"" + row.value.name + "\" v" + (dialect == Dialect::v2 ? "2" : "3");
      const Built without = build(dialect, row, nullptr), with = build(dialect, row, &row.value),
                  other = build(dialect, row, &row.other);
      EXPECT_TRUE(same(without.lobes, with.lobes)) << what << ": another default";
      EXPECT_FALSE(same(without.lobes, other.lobes)) << what << ": has no effect";
      for (const Built* b : {&without, &with, &other}) EXPECT_TRUE(b->warnings.empty()) << what << ": " << b->warnings[0];
    }
}

// The bump map of each material that has one; a mix takes that of its first part.
TEST(MaterialParameters, BumpMapsBendEveryMaterialThatHasThem) {
  const BsdfFile table(FourierFormula{}.bytes());
  const TextureDesc ramp = texture("ramp", "bilerp", true,
                                   {real_param("v00", 0.f), real_param("v01", 0.f), real_param("v10", 0.5f), real_param("v11", 0.5f)});
  const auto normal = [&](const std::vector<MaterialDesc>& materials, std::size_t* warnings = nullptr) {
    SceneDescription scene;
    scene.dialect = Dialect::v3;
    scene.textures = {ramp};
    scene.materials = materials;
    Warnings list;
    const auto shading = Shading::build(scene, {}, list);
    SurfacePoint p;
    p.ng = p.ns = {0, 0, 1};
    p.dpdu = p.shading_dpdu = {1, 0, 0};
    p.dpdv = p.shading_dpdv = {0, 1, 0};
    if (warnings) *warnings = list.list().size();
    return shading->bsdf(static_cast<std::uint32_t>(materials.size() - 1), p, {0, 0, 1}, {}).frame().n;
  };
  const Vec3 bent = glm::normalize(Vec3(-0.5f, 0, 1)), flat(0, 0, 1);
  const Param bump = texture_param("bumpmap", "ramp");
  for (const char* type : {"matte", "plastic", "metal", "shinymetal", "mirror", "glass", "uber", "substrate", "translucent",
                           "disney", "kdsubsurface"})
    EXPECT_LT(glm::length(normal({material(type, {bump})}) - bent), 1e-3f) << type;
  EXPECT_LT(glm::length(normal({material("fourier", {bump, string_param("bsdffile", table.path())})}) - bent), 1e-3f);

  const Param first = string_param("namedmaterial1", "0"), second = string_param("namedmaterial2", "1");
  std::size_t warnings = 0;
  EXPECT_LT(glm::length(normal({material("matte", {bump}), material("mirror"), material("mix", {first, second})}) - bent), 1e-3f);
  EXPECT_EQ(normal({material("mirror"), material("matte", {bump}), material("mix", {first, second})}), flat);
  EXPECT_EQ(normal({material("mirror"), material("matte"), material("mix", {first, second, bump})}, &warnings), flat);
  EXPECT_EQ(warnings, 1u) << "a mix has no bump map of its own";
  EXPECT_EQ(normal({material("hair", {bump})}, &warnings), flat);
  EXPECT_EQ(warnings, 1u) << "nor has hair";
}

}  // namespace
}  // namespace cloudrenderer
