#include <algorithm>
#include <bit>

#include "base/random.h"
#include "scene/dialect.h"
#include "shading/material.h"
#include "shading/material_kinds.h"
#include "shading/measured.h"

namespace cloudrenderer {
namespace {

// Displaces the shading frame by the slope of a height texture (Blinn 1978), by pbrt's finite
// differences: half the pixel's extent in u and v, or a fixed step where there is no footprint.
void bump(const TexturedFloat& height, const TexturePoint& at, float fixed_step,
          SurfacePoint& point) {
  const Vec3 dpdu = point.shading_dpdu, dpdv = point.shading_dpdv;
  const float h = height(at);
  const auto slope = [&](float step, const Vec3& tangent, const Vec2& direction) {
    TexturePoint moved = at;
    moved.p += step * tangent;
    moved.uv += step * direction;
    return (height(moved) - h) / step;
  };
  float du = 0.5f * (std::fabs(at.duvdx.x) + std::fabs(at.duvdy.x));
  float dv = 0.5f * (std::fabs(at.duvdx.y) + std::fabs(at.duvdy.y));
  if (du == 0.f) du = fixed_step;
  if (dv == 0.f) dv = fixed_step;
  const Vec3 bent_u = dpdu + slope(du, dpdu, {1, 0}) * point.ns + h * point.dndu;
  const Vec3 bent_v = dpdv + slope(dv, dpdv, {0, 1}) * point.ns + h * point.dndv;
  const Vec3 n = glm::cross(bent_u, bent_v);
  const float length2 = glm::dot(n, n);
  if (!(length2 > 0.f) || !std::isfinite(length2)) return;
  Vec3 unit = n / std::sqrt(length2);
  if (!is_finite(unit)) return;
  point.ns = glm::dot(unit, point.ng) < 0.f ? -unit : unit;
  point.shading_dpdu = bent_u;
  point.shading_dpdv = bent_v;
}

// The shading frame that a picture of normals in the space of the tangents gives, as pbrt-v4 reads it: not filtered.
void map_normal(const TexturedRgb& normals, const TexturePoint& at, SurfacePoint& point) {
  TexturePoint unfiltered;
  unfiltered.p = at.p;
  unfiltered.uv = at.uv;
  const Vec3 local = 2.f * normals(unfiltered) - Vec3(1.f), dpdu = point.shading_dpdu;
  const float length = glm::length(dpdu), length_v = glm::length(point.shading_dpdv);
  if (!(length > 0.f) || !std::isfinite(length)) return;
  const Vec3 x = dpdu / length, y = glm::cross(point.ns, x);
  const Vec3 n = local.x * x + local.y * y + local.z * point.ns;
  const float length2 = glm::dot(n, n);
  if (!(length2 > 0.f) || !std::isfinite(length2)) return;
  const Vec3 unit = n / std::sqrt(length2);
  const Vec3 along = dpdu - unit * glm::dot(unit, dpdu);
  point.ns = glm::dot(unit, point.ng) < 0.f ? -unit : unit;
  if (is_black(along)) return;
  point.shading_dpdu = glm::normalize(along) * length;
  point.shading_dpdv = glm::normalize(glm::cross(unit, along)) * length_v;
}

// The frame of anisotropic lobes: along the tangent.
Frame tangent_frame(const SurfacePoint& point) {
  const Vec3 s = point.shading_dpdu - point.ns * glm::dot(point.ns, point.shading_dpdu);
  const float length2 = glm::dot(s, s);
  if (!(length2 > 0.f) || !std::isfinite(length2)) return Frame(point.ns);
  const Vec3 unit = s / std::sqrt(length2);
  return {unit, glm::cross(point.ns, unit), point.ns};
}

std::uint32_t salt(const Vec3& p) {
  const auto bits = [](float x) { return std::uint64_t{std::bit_cast<std::uint32_t>(x)}; };
  return static_cast<std::uint32_t>(mix64(mix64(bits(p.x) << 32 | bits(p.y)) ^ bits(p.z)));
}

// Lobes that agree in everything but numbers.
bool same_kind(std::span<const Lobe> a, std::span<const Lobe> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Lobe& x, const Lobe& y) {
    return x.kind == y.kind && x.distribution == y.distribution && x.fresnel == y.fresnel && x.transmits == y.transmits &&
           x.scale_radiance == y.scale_radiance;
  });
}

Shading::Needs needs_of(std::span<const MaterialRecord> records) {
  Shading::Needs needs;
  for (const MaterialRecord& r : records) {
    needs.footprint = needs.footprint || r.needs.footprint;
    needs.uv = needs.uv || r.needs.uv;
    needs.subsurface = needs.subsurface || r.has_subsurface;
    needs.null = needs.null || !r.material;
  }
  return needs;
}

class SceneShading final : public Shading {
 public:
  SceneShading(const SceneDescription& scene, const Options& options, Warnings& warnings)
      : textures_(scene, options.texture_budget, warnings),
        records_(build_materials(scene, textures_, measured_, warnings)),
        bump_step_(scene.dialect == Dialect::v2 ? 0.01f : 0.0005f),
        by_shading_normals_(is_of_v4(scene)) {
    needs_ = needs_of(records_);
    number_kinds();
  }

  const Needs& needs() const override { return needs_; }
  std::uint64_t bytes() const override { return textures_.bytes() + measured_.bytes(); }
  bool is_null(std::uint32_t material) const override {
    return material < records_.size() && !records_[material].material;
  }

  using Shading::bsdf;
  Bsdf lobes(std::uint32_t material, SurfacePoint& point, const Footprint& footprint, bool regularized) const override {
    const MaterialRecord* r = material < records_.size() ? &chosen(records_[material], point, footprint) : nullptr;
    if (r && r->material && (r->textured || r->bends() || regularized)) return textured(*r, point, footprint, regularized);
    Bsdf b(r && r->tangents ? tangent_frame(point) : Frame(point.ns), deciding_normal(point));
    if (r) b.add(std::span<const Lobe>(r->lobes));
    if (r && r->estimated) b.set_salt(salt(point.p));
    return b;
  }

  bool prefetch(std::uint32_t material, const SurfacePoint& point) const override {
    if (material >= records_.size() || records_[material].needs.tables.empty()) return false;
    const TexturePoint at(point, Footprint{});
    for (const TableTexture* table : records_[material].needs.tables) table->prefetch(at);
    return true;
  }

  bool subsurface(std::uint32_t material, const SurfacePoint& point, const Footprint& footprint,
                  SubsurfacePoint& out) const override {
    if (material >= records_.size()) return false;
    const MaterialRecord& r = chosen(records_[material], point, footprint);
    if (r.subsurface) out = *r.subsurface;
    return r.subsurface || (r.has_subsurface && r.textured && r.material->subsurface(TexturePoint(point, footprint), out));
  }

  std::uint32_t kind(std::uint32_t material) const override {
    return material < records_.size() ? records_[material].kind : 0;
  }

  Bsdf8 bsdf(const std::array<std::uint32_t, kLanes>& materials, const Vec3x8& ns, const Vec3x8& ng,
             const Vec3x8& wo) const override {
    Bsdf8 b(FrameOf<Float8>(ns), by_shading_normals_ ? ns : ng);
    const MaterialRecord& first = records_[materials[0]];
    const bool one = std::all_of(materials.begin(), materials.end(), [&](std::uint32_t m) { return m == materials[0]; });
    if (one) b.add(std::span<const LobeOf<Float8>>(first.lobes8));
    for (std::size_t i = 0; !one && i < first.lobes.size(); ++i) {
      LobeOf<Float8> lobe = first.lobes8[i];
      for (std::size_t lane = 1; lane < kLanes; ++lane) bsdf::put(lobe, lane, records_[materials[lane]].lobes[i]);
      b.add(lobe);
    }
    b.finish(wo);
    return b;
  }

  float alpha(std::uint32_t texture, const Vec2& uv, const Vec3& p) const override {
    const TexturedFloat* t = textures_.float_texture(texture);
    if (!t) return 1.f;
    TexturePoint at;
    at.p = p;
    at.uv = uv;
    return (*t)(at);
  }

  bool alpha_by_chance(std::uint32_t texture) const override { return textures_.by_chance(texture); }

 private:
  static const MaterialRecord& chosen(const MaterialRecord& record, const SurfacePoint& point, const Footprint& footprint) {
    const MaterialRecord* r = &record;
    while (r->chooses) r = r->material->chosen(TexturePoint(point, footprint));
    return *r;
  }
  const Vec3& deciding_normal(const SurfacePoint& point) const { return by_shading_normals_ ? point.ns : point.ng; }
  Bsdf textured(const MaterialRecord& r, SurfacePoint& point, const Footprint& footprint, bool regularized) const {
    TexturePoint at(point, footprint);
    at.regularized = regularized;
    if (r.has_bump) bump(r.bump, at, bump_step_, point);
    if (r.has_normal_map) map_normal(r.normal_map, at, point);
    Bsdf b(r.tangents ? tangent_frame(point) : Frame(point.ns), deciding_normal(point));
    if (r.textured || regularized) {
      LobeSink sink(b);
      r.material->add_lobes(at, sink);
    } else {
      b.add(std::span<const Lobe>(r.lobes));
    }
    if (r.estimated) b.set_salt(salt(point.p));
    return b;
  }

  void number_kinds() {
    std::vector<const MaterialRecord*> firsts;
    for (MaterialRecord& r : records_) {
      if (!r.material || r.textured || r.bends() || r.tangents || r.has_subsurface || r.lobes.empty() ||
          r.lobes.size() > Bsdf8::kMaxLobes ||
          !std::all_of(r.lobes.begin(), r.lobes.end(), eight_wide))
        continue;
      const auto same = std::find_if(firsts.begin(), firsts.end(),
                                     [&](const MaterialRecord* f) { return same_kind(r.lobes, f->lobes); });
      for (const Lobe& lobe : r.lobes) r.lobes8.push_back(bsdf::in_all_lanes(lobe));
      r.kind = same != firsts.end() ? (*same)->kind : kinds_++;
      if (same == firsts.end()) firsts.push_back(&r);
    }
  }

  TextureSet textures_;  // these before the records, whose materials point to them
  MeasuredStore measured_;
  std::vector<MaterialRecord> records_;
  Needs needs_;
  float bump_step_;
  bool by_shading_normals_;  // pbrt-v4: which side of a surface a direction is on; before it the geometric ones say it
};

}  // namespace

std::unique_ptr<Shading> Shading::build(const SceneDescription& scene, const Options& options,
                                        Warnings& warnings) {
  return std::make_unique<SceneShading>(scene, options, warnings);
}

Shading::Needs Shading::check(const SceneDescription& scene, Warnings& warnings) {
  const TextureSet textures(scene, 0, warnings, false);
  MeasuredStore measured;
  return needs_of(build_materials(scene, textures, measured, warnings));
}

}  // namespace cloudrenderer
