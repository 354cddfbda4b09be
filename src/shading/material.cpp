// The table of materials, and what they share.
#include "shading/material.h"

#include <array>
#include <string>

#include "scene/material_order.h"
#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

constexpr std::array kKinds{
    MaterialKind{"matte", make_matte, 1},
    MaterialKind{"plastic", make_plastic, 2},
    MaterialKind{"metal", make_metal, 1},
    MaterialKind{"shinymetal", make_shinymetal, 2},
    MaterialKind{"mirror", make_mirror, 1},
    MaterialKind{"glass", make_glass, 1},
    MaterialKind{"uber", make_uber, 5},
    MaterialKind{"substrate", make_substrate, 1},
    MaterialKind{"translucent", make_translucent, 4},
    MaterialKind{"mix", make_mix, 0, false},
    MaterialKind{"coateddiffuse", make_coateddiffuse, 2},
    MaterialKind{"coatedconductor", make_coatedconductor, 2},
    MaterialKind{"thindielectric", make_thindielectric, 1},
    MaterialKind{"disney", make_disney, 5},
    MaterialKind{"kdsubsurface", make_kdsubsurface, 1},
    MaterialKind{"subsurface", make_subsurface, 1},
    MaterialKind{"measured", make_measured, 1},
    MaterialKind{"fourier", make_fourier, 1},
    MaterialKind{"hair", make_hair, 1, false},
};

const MaterialKind* find_kind(std::string_view name) {
  for (const MaterialKind& k : kKinds)
    if (k.name == name) return &k;
  return nullptr;
}

constexpr int kMaxMixDepth = 8;  // a mix of mixes doubles the work with each level

}  // namespace

void LobeSink::add(Lobe lobe) {
  if (scaled_) bsdf::scale_lobe(lobe, factor_);
  // Diffuse lobes of mixed materials become one.
  if (lobe.kind == LobeKind::lambert)
    for (int i = 0; i < bsdf_.lobe_count(); ++i)
      if (Lobe& other = bsdf_.lobe(i);
          other.kind == LobeKind::lambert && other.transmits == lobe.transmits) {
        other.scale += lobe.scale;
        return;
      }
  bsdf_.add(lobe);
}

Roughness::Roughness(MaterialInputs& in, const TexturedFloat& u, const TexturedFloat& v)
    : u_(u),
      v_(v),
      dialect_(in.params.dialect()),
      v4_(in.params.params().has("roughnessmap")),
      root_(v4_ && in.params.params().string("roughnessmap", "") == "sqrt"),
      remap_(dialect_ == Dialect::v3 && !v4_ && in.params.params().boolean("remaproughness", true)),
      isotropic_(u.texture == v.texture && (u.texture || u.constant == v.constant)) {
  in.tangents = in.tangents || !isotropic_;
}

Roughness Roughness::one(MaterialInputs& in, float otherwise) {
  const TexturedFloat r = in.params.real("roughness", otherwise);
  return {in, r, r};
}

Roughness Roughness::overridden(MaterialInputs& in, float otherwise, V follow) {
  const TexturedFloat r = in.params.real("roughness", otherwise);
  TexturedFloat u = r, v = r;
  if (in.params.dialect() == Dialect::v3) {
    in.params.optional_real("uroughness", u);
    if (!in.params.optional_real("vroughness", v) && follow == V::follows_u) v = u;
  }
  return {in, u, v};
}

Roughness Roughness::two_axes(MaterialInputs& in, float otherwise, std::string_view prefix) {
  const TexturedFloat u = in.params.real(std::string(prefix) + "uroughness", otherwise);
  return {in, u, in.params.real(std::string(prefix) + "vroughness", otherwise)};
}

bsdf::Microfacets Roughness::operator()(const TexturePoint& at) const {
  float u = u_(at), v = isotropic_ ? u : v_(at);
  if (dialect_ == Dialect::v2) return bsdf::blinn_anisotropic(u, v);
  if (root_) {
    u = std::sqrt(std::max(u, 0.f));
    v = isotropic_ ? u : std::sqrt(std::max(v, 0.f));
  }
  if (remap_) {
    u = bsdf::roughness_to_alpha(u);
    v = isotropic_ ? u : bsdf::roughness_to_alpha(v);
  }
  if (widens(at)) {
    for (float* const width : {&u, &v})
      if (!(*width >= 0.3f)) *width = std::clamp(2.f * *width, 0.1f, 0.3f);
  }
  return bsdf::trowbridge_reitz(u, v);
}

std::vector<MaterialRecord> build_materials(const SceneDescription& scene,
                                            const TextureSet& textures, MeasuredStore& measured,
                                            Warnings& warnings) {
  std::vector<MaterialRecord> out(scene.materials.size());
  for (const std::uint32_t index : material_order(scene)) {
    const MaterialDesc& desc = scene.materials[index];
    if (desc.type.empty() || desc.type == "none") continue;
    MaterialRecord& r = out[index];
    TexturedParams params(desc.params, textures, scene.dialect, desc.location, warnings);
    MaterialInputs in{params, out, measured};
    const MaterialKind* kind = find_kind(desc.type);
    if (!kind) {
      std::string names;
      for (const MaterialKind& k : kKinds)
        names += (names.empty() ? "" : ", ") + std::string(k.name);
      warnings.add(desc.location, "unknown material \"" + desc.type + "\", expected one of " +
                                      names + "; using matte");
      kind = find_kind("matte");
    }
    r.material = kind->make(in);
    if (in.depth > kMaxMixDepth)
      throw SceneError(desc.location,
                       "materials are mixed more than " + std::to_string(kMaxMixDepth) + " deep");
    r.lobes_at_most = kind->lobes + in.lobes;
    if (r.lobes_at_most > Bsdf::kMaxLobes)
      warnings.add(desc.location, "the mixed materials may have " + std::to_string(r.lobes_at_most) +
                                      " lobes where there is room for " + std::to_string(Bsdf::kMaxLobes) +
                                      ": the last ones are left out");
    r.textured = params.textured();
    r.has_bump = kind->bump && params.optional_real("bumpmap", r.bump) &&
                 r.bump.texture;  // a constant displacement bends nothing
    r.has_normal_map = kind->bump && !r.has_bump && params.optional_rgb("normalmap", r.normal_map) && r.normal_map.texture;
    if (in.base) {                // the first of two mixed materials gives the shading frame
      r.has_bump = in.base->has_bump;
      r.bump = in.base->bump;
      r.has_normal_map = in.base->has_normal_map;
      r.normal_map = in.base->normal_map;
    }
    r.chooses = in.chooses;
    r.tangents = in.tangents;
    r.estimated = in.estimated;
    r.needs = params.needs();
    r.needs.uv = r.needs.uv || r.tangents || r.bends();
    r.depth = in.depth;
    if (!r.textured) {
      Bsdf constant;
      LobeSink sink(constant);
      r.material->add_lobes(TexturePoint(), sink);
      for (int i = 0; i < constant.lobe_count(); ++i) r.lobes.push_back(constant.lobe(i));
      if (SubsurfacePoint inside; r.material->subsurface(TexturePoint(), inside)) r.subsurface = inside;
    }
    r.has_subsurface = r.material->has_subsurface();
    desc.params.report_unused("Material \"" + desc.type + "\"", warnings);
  }
  return out;
}

}  // namespace cloudrenderer
