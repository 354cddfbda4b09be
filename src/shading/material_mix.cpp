#include <charconv>

#include "shading/material_kinds.h"

namespace cloudrenderer {
namespace {

// amount * first + (1 - amount) * second; both stand before the mix in the scene's list.
class Mix final : public Material {
 public:
  Mix(const Material* first, const Material* second, const TexturedRgb& amount)
      : first_(first), second_(second), amount_(amount) {}
  void add_lobes(const TexturePoint& at, LobeSink& out) const override {
    const Rgb a = positive(amount_(at)), b = positive(Rgb(1.f) - a);
    if (first_ && !is_black(a)) {
      LobeSink sink = out.scaled(a);
      first_->add_lobes(at, sink);
    }
    if (second_ && !is_black(b)) {
      LobeSink sink = out.scaled(b);
      second_->add_lobes(at, sink);
    }
  }

 private:
  const Material* first_;  // owned by earlier records
  const Material* second_;
  TexturedRgb amount_;
};

const MaterialRecord* mixed(MaterialInputs& in, std::string_view name) {
  const std::string text = in.params.params().string(name, "");
  std::size_t index = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), index);
  if (error != std::errc() || end != text.data() + text.size() || index >= in.earlier.size()) {
    in.params.warn("mix material: there is no material for \"" + std::string(name) +
                   "\"; leaving it out");
    return nullptr;
  }
  const MaterialRecord* r = &in.earlier[index];
  in.params.needs() |= r->needs;
  if (r->textured) in.params.set_textured();
  in.tangents = in.tangents || r->tangents;
  in.depth = std::max(in.depth, r->depth + 1);
  return r;
}

}  // namespace

std::unique_ptr<Material> make_mix(MaterialInputs& in) {
  const TexturedRgb amount = in.params.rgb("amount", Rgb(0.5f));
  const MaterialRecord* a = mixed(in, "namedmaterial1");
  const MaterialRecord* b = mixed(in, "namedmaterial2");
  in.base = a;
  return std::make_unique<Mix>(a ? a->material.get() : nullptr, b ? b->material.get() : nullptr,
                               amount);
}

}  // namespace cloudrenderer
