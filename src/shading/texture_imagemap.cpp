#include <charconv>

#include "base/portable_math.h"
#include "shading/texture_image.h"
#include "shading/texture_mapping.h"

namespace cloudrenderer {
namespace {

template <class T>
class ImagemapTexture final : public Texture<T>, public TableTexture {
 public:
  ImagemapTexture(const TextureMapping& mapping, const ImagePyramid* image,
                  const ImageFilter& filter, bool at_most_one)
      : mapping_(mapping), image_(image), filter_(filter), at_most_one_(at_most_one) {}
  T eval(const TexturePoint& at) const override {
    const TextureCoordinates c = mapping_(at);
    const Rgb v = image_->lookup(c.st, c.dstdx, c.dstdy, filter_);
    if constexpr (std::is_same_v<T, float>)
      return v.x;
    else
      return at_most_one_ ? glm::min(v, Rgb(1.f)) : v;
  }
  void prefetch(const TexturePoint& at) const override { image_->prefetch(mapping_(at).st, filter_.wrap); }

 private:
  TextureMapping mapping_;
  const ImagePyramid* image_;
  ImageFilter filter_;
  bool at_most_one_;  // before textures that it is part of
};

// pbrt-v3 decodes sRGB by default for the formats that hold it; JPEG it does not read, we do.
bool is_srgb_file(std::string_view path) {
  return is_file_of(path, {".png", ".tga", ".jpg", ".jpeg"});
}

// pbrt-v4's names.
void read_encoding(const TextureInputs& in, const std::string& name, ImageEncoding& encoding) {
  encoding.srgb = name == "sRGB" || name == "srgb";
  if (encoding.srgb || name == "linear") return;
  float gamma = 0;
  if (name.starts_with("gamma "))
    std::from_chars(name.data() + 6, name.data() + name.size(), gamma);
  if (gamma > 0.f && gamma < 100.f) {
    encoding.gamma = gamma;
    if (encoding.scale > 0.f) encoding.scale = portable::pow(encoding.scale, 1.f / gamma);
  } else {
    in.params.warn("unknown encoding \"" + name +
                   "\", expected sRGB, linear or \"gamma 2.2\"; using sRGB");
    encoding.srgb = true;
  }
}

}  // namespace

template <class T>
MadeTexture<T> make_imagemap_texture(TextureInputs& in) {
  const ParamSet& p = in.params.params();
  const std::string path = p.string("filename", "");
  ImageEncoding encoding;
  encoding.scale = p.real("scale", 1.f);
  if (in.params.dialect() == Dialect::v3) {
    encoding.srgb = p.boolean("gamma", is_srgb_file(path));
    if (p.has("encoding")) read_encoding(in, p.string("encoding", "sRGB"), encoding);
    encoding.invert = p.boolean("invert", false);
  } else {
    encoding.gamma = p.real("gamma", 1.f);
  }
  // pbrt-v3 puts the lower left corner of the picture at (0,0), pbrt-v2 the first row that its readers give.
  encoding.flip = in.params.dialect() == Dialect::v3 || is_upside_down_in_v2(path);
  encoding.luminance = std::is_same_v<T, float>;
  const bool v4 = p.boolean("mean", false);
  encoding.mean = v4 && encoding.luminance;
  encoding.masks = encoding.mean && is_file_of(path, {".png", ".exr"});  // of no other files
  encoding.primaries = v4 && !encoding.luminance;
  ImageFilter filter;
  const std::string kind = p.string("filter", v4 ? "bilinear" : "ewa");
  if (kind == "bilinear")
    filter.kind = ImageFilter::Kind::bilinear;
  else if (kind == "point")
    filter.kind = ImageFilter::Kind::point;
  else if (p.boolean("trilinear", false) || kind == "trilinear")
    filter.kind = ImageFilter::Kind::trilinear;
  else if (kind != "ewa" && kind != "EWA")
    in.params.warn("unknown filter \"" + kind + "\", expected bilinear, trilinear, point or ewa; using ewa");
  if (v4 || in.params.dialect() == Dialect::v2) filter.widths = 2;
  filter.max_anisotropy = std::clamp(p.real("maxanisotropy", 8.f), 1.f, 64.f);
  const std::string wrap = p.string("wrap", "repeat");
  if (wrap == "black")
    filter.wrap = WrapMode::black;
  else if (wrap == "clamp")
    filter.wrap = WrapMode::clamp;
  else if (wrap != "repeat")
    in.params.warn("unknown wrap \"" + wrap + "\", expected repeat, black or clamp; using repeat");
  in.params.needs().footprint = true;
  const TextureMapping mapping(in);
  const bool at_most_one = p.boolean("albedo", false);
  try {
    if (path.empty()) throw SceneError(in.params.location(), "imagemap texture needs a \"string filename\"");
    const ImagePyramid* image = in.images.get(path, encoding, p.find("filename")->location);
    auto texture = std::make_unique<ImagemapTexture<T>>(mapping, image, filter, at_most_one);
    in.params.needs().tables.push_back(texture.get());
    return texture;
  } catch (const SceneError& e) {
    // As pbrt-v2 and pbrt-v3: a picture with a surface in one colour is better than none.
    const std::string what = e.what();
    const std::size_t reason = what.find("error: ");  // behind the place, which is said already
    in.params.warn((reason == std::string::npos ? what : what.substr(reason + 7)) +
                   (in.params.dialect() == Dialect::v3 ? ": grey is used" : ": white is used"));
    return T(encoding.decode(in.params.dialect() == Dialect::v3 ? 0.5f : 1.f));
  }
}

template MadeTexture<float> make_imagemap_texture<float>(TextureInputs&);
template MadeTexture<Rgb> make_imagemap_texture<Rgb>(TextureInputs&);

}  // namespace cloudrenderer
