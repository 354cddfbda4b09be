#include "shading/texture.h"

#include <array>
#include <unordered_map>

#include "shading/texture_image.h"

namespace cloudrenderer {
namespace {

constexpr std::array kKinds{
    TextureKind{"constant", make_constant_texture<float>, make_constant_texture<Rgb>},
    TextureKind{"scale", make_scale_texture<float>, make_scale_texture<Rgb>},
    TextureKind{"mix", make_mix_texture<float>, make_mix_texture<Rgb>},
    TextureKind{"bilerp", make_bilerp_texture<float>, make_bilerp_texture<Rgb>},
    TextureKind{"imagemap", make_imagemap_texture<float>, make_imagemap_texture<Rgb>},
    TextureKind{"checkerboard", make_checkerboard_texture<float>, make_checkerboard_texture<Rgb>},
    TextureKind{"uv", make_uv_texture<float>, make_uv_texture<Rgb>},
    TextureKind{"directionmix", make_directionmix_texture<float>, make_directionmix_texture<Rgb>},
    TextureKind{"dots", make_dots_texture<float>, make_dots_texture<Rgb>},
    TextureKind{"fbm", make_fbm_texture<float>, make_fbm_texture<Rgb>},
    TextureKind{"wrinkled", make_wrinkled_texture<float>, make_wrinkled_texture<Rgb>},
    TextureKind{"windy", make_windy_texture<float>, make_windy_texture<Rgb>},
    TextureKind{"marble", make_marble_texture<float>, make_marble_texture<Rgb>},
    TextureKind{"ptex", make_unsupported_texture<float>, make_unsupported_texture<Rgb>},
};

const TextureKind* find_kind(std::string_view name) {
  for (const TextureKind& k : kKinds)
    if (k.name == name) return &k;
  return nullptr;
}

constexpr int kMaxDepth = 64;  // textures of textures; evaluation is recursive

template <class T>
struct Built {
  Textured<T> value;
  std::unique_ptr<Texture<T>> owner;
};

template <class T>
Built<T> store(MadeTexture<T> made) {
  Built<T> b;
  if (T* constant = std::get_if<T>(&made)) {
    b.value.constant = *constant;
  } else {
    b.owner = std::move(std::get<std::unique_ptr<Texture<T>>>(made));
    b.value.texture = b.owner.get();
  }
  return b;
}

// A float texture where a colour is asked for.
class Grey final : public Texture<Rgb> {
 public:
  explicit Grey(const Texture<float>& texture) : texture_(texture) {}
  Rgb eval(const TexturePoint& at) const override { return Rgb(texture_.eval(at)); }

 private:
  const Texture<float>& texture_;
};

Built<Rgb> grey(const TexturedFloat& real) {
  if (!real.texture) return store<Rgb>(Rgb(real.constant));
  return store<Rgb>(std::make_unique<Grey>(*real.texture));
}

void mark_references(const ParamSet& params,
                     const std::unordered_map<std::string_view, std::size_t>& index,
                     std::vector<bool>& used) {
  for (const Param& p : params.all()) {
    if (p.type != ParamType::texture) continue;
    for (const std::string& name : p.strings)
      if (const auto it = index.find(name); it != index.end()) used[it->second] = true;
  }
}

}  // namespace

struct TextureSet::State {
  struct Entry {
    bool built = false, is_float = false, by_chance = false;
    Built<float> real;
    Built<Rgb> rgb;
    TextureNeeds needs;
  };
  State(std::uint64_t budget, bool read_images) : images(budget, read_images) {}

  const Entry* find(std::string_view name, bool is_float) const {
    const auto it = index.find(name);
    if (it == index.end()) return nullptr;
    const Entry& e = entries[it->second];
    return e.built && (e.is_float || !is_float) ? &e : nullptr;
  }

  ImageStore images;
  std::vector<std::string> names;  // what the index's keys point to
  std::unordered_map<std::string_view, std::size_t> index;
  std::vector<Entry> entries;
};

TextureSet::TextureSet(const SceneDescription& scene, std::uint64_t budget, Warnings& warnings,
                       bool read_images)
    : state_(std::make_unique<State>(budget, read_images)) {
  State& s = *state_;
  const std::size_t n = scene.textures.size();
  s.entries.resize(n);
  s.names.reserve(n);
  for (std::size_t i = 0; i < n; ++i) s.index[s.names.emplace_back(scene.textures[i].name)] = i;

  std::vector<bool> used(n, false), referenced(n, false);
  for (const MaterialDesc& m : scene.materials) mark_references(m.params, s.index, used);
  for (const TextureDesc& t : scene.textures) mark_references(t.params, s.index, referenced);
  for (std::size_t i = n; i-- > 0;) {
    if (scene.textures[i].is_float && !referenced[i]) used[i] = true;  // perhaps an alpha mask
    if (used[i]) mark_references(scene.textures[i].params, s.index, used);
  }

  for (std::size_t i = 0; i < n; ++i) {
    if (!used[i]) continue;
    const TextureDesc& desc = scene.textures[i];
    const TextureKind* kind = find_kind(desc.type);
    if (!kind) {
      std::string names;
      for (const TextureKind& k : kKinds)
        names += (names.empty() ? "" : ", ") + std::string(k.name);
      warnings.add(desc.location, "unknown texture \"" + desc.type + "\", expected one of " +
                                      names + "; using 0.5");
      kind = find_kind("ptex");
    }
    TexturedParams params(desc.params, *this, scene.dialect, desc.location, warnings);
    TextureInputs inputs{params, desc.texture_to_world, s.images};
    State::Entry& e = s.entries[i];
    e.is_float = desc.is_float;
    e.by_chance = desc.params.boolean("chance", false);
    if (desc.is_float)
      e.real = store<float>(kind->make_float(inputs)), e.rgb = grey(e.real.value);
    else
      e.rgb = store<Rgb>(kind->make_rgb(inputs));
    e.needs = params.needs();
    if (++e.needs.depth > kMaxDepth)
      throw SceneError(desc.location, "textures refer to textures more than " +
                                          std::to_string(kMaxDepth) + " deep");
    e.built = true;
    desc.params.report_unused("Texture \"" + desc.type + "\"", warnings);
  }
}

TextureSet::~TextureSet() = default;

bool TextureSet::find(std::string_view name, TexturedFloat& out, TextureNeeds& needs,
                      const FileLocation& where, Warnings& warnings) const {
  const State::Entry* e = state_->find(name, true);
  if (!e) {
    warnings.add(where, "there is no float texture \"" + std::string(name) +
                            "\" before this line; using the default");
    return false;
  }
  out = e->real.value;
  if (out.texture) needs |= e->needs;
  return true;
}

bool TextureSet::find(std::string_view name, TexturedRgb& out, TextureNeeds& needs,
                      const FileLocation& where, Warnings& warnings) const {
  const State::Entry* e = state_->find(name, false);
  if (!e) {
    warnings.add(where, "there is no colour texture \"" + std::string(name) +
                            "\" before this line; using the default");
    return false;
  }
  out = e->rgb.value;
  if (out.texture) needs |= e->needs;
  return true;
}

const TexturedFloat* TextureSet::float_texture(std::uint32_t index) const {
  if (index >= state_->entries.size()) return nullptr;
  const State::Entry& e = state_->entries[index];
  return e.built && e.is_float ? &e.real.value : nullptr;
}

bool TextureSet::by_chance(std::uint32_t index) const {
  return index < state_->entries.size() && state_->entries[index].by_chance;
}

std::uint64_t TextureSet::bytes() const { return state_->images.bytes(); }

template <class T>
bool TexturedParams::find(std::string_view name, Textured<T>& out) {
  const Param* p = params_.find(name);
  if (!p || p->type != ParamType::texture) return false;
  const auto texture = params_.texture(name);
  if (!texture || !textures_.find(*texture, out, needs_, p->location, warnings_)) return false;
  textured_ = textured_ || out.texture;
  return true;
}

namespace {

bool is_texture(const ParamSet& params, std::string_view name) {
  const Param* p = params.find(name);
  return p && p->type == ParamType::texture;
}

}  // namespace

TexturedFloat TexturedParams::real(std::string_view name, float otherwise) {
  TexturedFloat out{otherwise, nullptr};
  if (is_texture(params_, name))
    find(name, out);
  else
    out.constant = params_.real(name, otherwise);
  return out;
}

TexturedRgb TexturedParams::rgb(std::string_view name, const Rgb& otherwise) {
  TexturedRgb out{otherwise, nullptr};
  if (is_texture(params_, name))
    find(name, out);
  else
    out.constant = params_.rgb(name, otherwise);
  return out;
}

bool TexturedParams::optional_real(std::string_view name, TexturedFloat& out) {
  if (!params_.has(name)) return false;
  out = real(name, 0.f);
  return true;
}
bool TexturedParams::optional_rgb(std::string_view name, TexturedRgb& out) {
  if (!params_.has(name)) return false;
  out = rgb(name, Rgb(0.f));
  return true;
}

}  // namespace cloudrenderer
