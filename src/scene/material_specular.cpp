#include "scene/material_specular.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "scene/material_order.h"

namespace cloudrenderer {
namespace {

// Constants of such a size are rough with every version's map from roughness to width.
constexpr float kSurelyRough = 0.01f;

bool surely_rough(const ParamSet& params, std::string_view name) {
  const Param* p = params.find(name);
  return p && p->type == ParamType::real && p->reals.size() == 1 && p->reals[0] >= kSurelyRough;
}

bool is_null(const MaterialDesc& m) { return m.type.empty() || m.type == "none"; }

bool may_be(const SceneDescription& scene, const MaterialDesc& m, const std::vector<bool>& known) {
  static constexpr std::array<std::string_view, 8> kNever{"matte", "plastic", "substrate", "translucent", "measured", "fourier", "hair", "disney"};
  if (is_null(m) || std::ranges::find(kNever, m.type) != kNever.end()) return false;
  const auto has = [&](const char* name) { return m.params.has(name); };
  // By default an uber surface is opaque and has no lobe of a mirror; metals are rough but for those of pbrt-v4.
  if (m.type == "uber") return has("Kr") || has("Kt") || has("opacity");
  if (m.type == "metal") return has("roughnessmap");
  // Without a change of the index facets bend nothing.
  const auto bends = [&](const char* name) {
    const Param* p = m.params.find(name);
    return !p || (p->type == ParamType::real && p->reals.size() == 1 && std::fabs(p->reals[0] - 1.f) > 0.01f);
  };
  if (m.type == "glass" || m.type == "coateddiffuse")
    return scene.dialect == Dialect::v2 || !bends("eta") || !bends("index") || !(surely_rough(m.params, "uroughness") || surely_rough(m.params, "vroughness"));
  if (m.type != "mix") return true;
  return std::ranges::any_of(kMixed, [&](const char* name) {
    const auto i = mixed_material(m.params, name);
    return !i || *i >= known.size() || known[*i] || is_null(scene.materials[*i]);
  });
}

}  // namespace

std::vector<bool> maybe_specular(const SceneDescription& scene) {
  std::vector<bool> out(scene.materials.size());
  for (const std::uint32_t i : material_order(scene)) out[i] = may_be(scene, scene.materials[i], out);
  return out;
}

}  // namespace cloudrenderer
