#include <algorithm>
#include <array>
#include <bit>

#include "base/random.h"
#include "scene/material_order.h"
#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// amount * first + (1 - amount) * second; both stand before the mix in the scene's list.
class Mix final : public Material {
 public:
  Mix(const MaterialRecord* first, const MaterialRecord* second, const TexturedRgb& amount, const Rgb& most)
      : parts_{part(first), part(second)}, amount_(amount), most_(most) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb a = glm::min(positive(amount_(at)), most_);
    add(parts_[0], a, at, out);
    add(parts_[1], positive(Rgb(1.f) - a), at, out);
  }
  bool has_subsurface() const override {
    return std::ranges::any_of(parts_, [](const Part& p) { return p.material && p.material->has_subsurface(); });
  }
  // Of the two that one counts which is mixed in more.
  bool subsurface(const TexturePoint& at, SubsurfacePoint& out) const override {
    const std::size_t more = luminance(positive(amount_(at))) < 0.5f ? 1 : 0;
    for (const std::size_t i : {more, 1 - more})
      if (parts_[i].material && parts_[i].material->subsurface(at, out)) return true;
    return false;
  }

 private:
  struct Part {
    const Material* material;  // owned by an earlier record; null: none
    bool passes;               // the null material: its share of the light goes straight on
  };
  static Part part(const MaterialRecord* r) { return {r ? r->material.get() : nullptr, r && !r->material}; }
  static void add(const Part& part, const Rgb& amount, const TexturePoint& at, LobeSink& out) {
    if (is_black(amount)) return;
    LobeSink sink = out.scaled(amount);
    if (part.material) part.material->add_lobes(at, sink);
    if (part.passes) sink.add(bsdf::specular_transmission(Rgb(1.f), 1.f, false));
  }

  std::array<Part, 2> parts_;
  TexturedRgb amount_;
  Rgb most_;
};

// pbrt-v4 decides for one of the two by the hash of the place. Where their normals are bent in different ways no sum of
// their lobes has the same mean.
class Choice final : public Material {
 public:
  Choice(const MaterialRecord* first, const MaterialRecord* second, const TexturedRgb& amount) : parts_{first, second}, amount_(amount) {}
  const MaterialRecord* chosen(const TexturePoint& at) const override {
    std::uint64_t key = 0;
    for (int i = 0; i < 3; ++i) key = mix64(key ^ std::bit_cast<std::uint32_t>(at.p[i]));
    return parts_[to_unit(static_cast<std::uint32_t>(key >> 32)) < luminance(amount_(at)) ? 0 : 1];
  }
  void add_lobes(const TexturePoint& at, LobeSink& out) const override { chosen(at)->material->add_lobes(at, out); }
  bool has_subsurface() const override { return parts_[0]->has_subsurface || parts_[1]->has_subsurface; }

 private:
  std::array<const MaterialRecord*, 2> parts_;  // with materials
  TexturedRgb amount_;
};

bool bend_alike(const MaterialRecord& a, const MaterialRecord& b) {
  const bool bumps = a.has_bump == b.has_bump && (!a.has_bump || a.bump.texture == b.bump.texture);
  const bool maps = a.has_normal_map == b.has_normal_map && (!a.has_normal_map || a.normal_map.texture == b.normal_map.texture);
  return bumps && maps && !a.chooses && !b.chooses;
}

const MaterialRecord* mixed(MaterialInputs& in, std::string_view name) {
  in.params.params().string(name, "");  // so that it counts as read
  const auto index = mixed_material(in.params.params(), name);
  if (!index || *index >= in.all.size()) {
    in.params.warn("mix material: there is no material for \"" + std::string(name) +
                   "\"; leaving it out");
    return nullptr;
  }
  const MaterialRecord* r = &in.all[*index];
  in.params.needs() |= r->needs;
  if (r->textured) in.params.set_textured();
  in.tangents = in.tangents || r->tangents;
  in.estimated = in.estimated || r->estimated;
  in.depth = std::max(in.depth, r->depth + 1);
  in.lobes += r->material ? r->lobes_at_most : 1;
  return r;
}

}  // namespace

std::unique_ptr<Material> make_mix(MaterialInputs& in) {
  const TexturedRgb amount = in.params.rgb("amount", Rgb(0.5f));
  const MaterialRecord* a = mixed(in, "namedmaterial1");
  const MaterialRecord* b = mixed(in, "namedmaterial2");
  const bool v4 = in.params.params().boolean("atmostone", false);
  if (v4 && a && b && a->material && b->material && !bend_alike(*a, *b)) {
    in.chooses = true;
    in.params.set_textured();
    return std::make_unique<Choice>(a, b, amount);
  }
  in.base = a;
  return std::make_unique<Mix>(a, b, amount, most_reflected(in));
}

}  // namespace cloudrenderer
