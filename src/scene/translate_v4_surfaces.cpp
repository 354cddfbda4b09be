// Materials and textures of pbrt-v4.
#include <algorithm>
#include <cctype>
#include <filesystem>
#include <string>

#include "scene/named_spectra.h"
#include "scene/param_make.h"
#include "scene/translate_v4.h"

namespace cloudrenderer {

void V4Translator::approximated(const Entity& e, const std::string& as) const {
  warn_(e.location, "\"" + e.type + "\" is approximated: " + as);
}

void V4Translator::roughness(Entity& e, float otherwise, std::initializer_list<std::string> prefixes) const {
  for (const std::string& prefix : prefixes) {
    Param both = make_real("roughness", otherwise, e.location);
    if (auto given = e.params.take(prefix + "roughness")) both = std::move(*given);
    for (const char* axis : {"uroughness", "vroughness"}) {
      if (e.params.has(prefix + axis)) continue;
      Param p = both;
      p.name = prefix + axis;
      e.params.add(std::move(p));
    }
  }
  const bool remaps = e.params.boolean("remaproughness", true);
  e.params.take("remaproughness");
  e.params.add(make_string("roughnessmap", remaps ? "sqrt" : "none", e.location));
}

// A spectrum of indices becomes one index.
void V4Translator::index(Entity& e, const char* name, float otherwise) const {
  auto given = e.params.take(name);
  if (!given) {
    e.params.add(make_real(name, otherwise, e.location));
    return;
  }
  if (given->type == ParamType::rgb && given->reals.size() == 3)
    given = make_real(name, given->reals[1], given->location);
  e.params.add(std::move(*given));
}

void V4Translator::copper(Entity& e, const std::string& prefix) const {
  if (e.params.has("reflectance")) return;
  for (const char* name : {"eta", "k"})
    if (!e.params.has(prefix + name))
      e.params.add(make_rgb(prefix + name, named_spectrum("metal-Cu-" + std::string(name)).value_or(Rgb(1.f)), e.location));
}

void V4Translator::conductor(Entity& e) const {
  e.type = "metal";
  copper(e, "");
  roughness(e, 0.f);
}

void V4Translator::material(Entity& e) const {
  ParamSet& p = e.params;
  if (p.has("normalmap")) p.take("displacement");  // only one counts
  p.rename("displacement", "bumpmap");
  if (e.type == "interface" || e.type == "none" || e.type.empty()) {
    e.type = "none";
  } else if (e.type == "diffuse") {
    e.type = "matte";
    p.rename("reflectance", "Kd");
    p.add(make_bool("atmostone", true, e.location));
  } else if (e.type == "conductor") {
    conductor(e);
  } else if (e.type == "dielectric") {
    e.type = "glass";
    if (const Param* eta = p.find("eta"); eta && eta->type == ParamType::rgb && (eta->reals[0] != eta->reals[1] || eta->reals[1] != eta->reals[2]))
      warn_(eta->location, "light is not dispersed: one index of refraction is used in place of the spectrum");
    index(e, "eta", 1.5f);
    roughness(e, 0.f);
  } else if (e.type == "thindielectric") {
    index(e, "eta", 1.5f);
  } else if (e.type == "diffusetransmission") {
    e.type = "translucent";
    if (!p.has("reflectance")) p.add(make_rgb("reflectance", Rgb(0.25f), e.location));
    if (!p.has("transmittance")) p.add(make_rgb("transmittance", Rgb(0.25f), e.location));
    p.rename("reflectance", "reflect");
    p.rename("transmittance", "transmit");
    p.add(make_rgb("Kd", Rgb(p.real("scale", 1.f)), e.location));
    p.add(make_rgb("Ks", Rgb(0.f), e.location));
    p.add(make_bool("atmostone", true, e.location));
    p.take("scale");
  } else if (e.type == "coateddiffuse") {
    index(e, "eta", 1.5f);
    roughness(e, 0.f);
  } else if (e.type == "coatedconductor") {
    index(e, "interface.eta", 1.5f);
    copper(e, "conductor.");
    roughness(e, 0.f, {"interface.", "conductor."});
  } else if (e.type == "hair") {
    p.add(make_bool("tiltsout", true, e.location));
    if (p.has("reflectance")) p.take("color");  // its former name
    p.rename("reflectance", "color");
  } else if (e.type == "measured") {
    p.rename("filename", "bsdffile");  // v2's has another format
  } else if (e.type == "subsurface") {
    if (p.has("reflectance")) {
      e.type = "kdsubsurface";
      p.rename("reflectance", "Kd");
      for (const char* decided : {"name", "sigma_a", "sigma_s"}) p.take(decided);
    }
    roughness(e, 0.f);
  } else if (e.type == "mix") {
    // v4's amount is the share of the second one.
    if (const Param* amount = p.find("amount"); amount && amount->type == ParamType::real)
      p.add(make_rgb("amount", Rgb(p.real("amount", 0.5f)), e.location));
    auto names = p.take("materials");
    if (!names || names->type != ParamType::string || names->strings.size() != 2)
      throw SceneError(e.location, "mix needs \"string materials\" with two names");
    p.add(make_string("namedmaterial1", names->strings[1], names->location));
    p.add(make_string("namedmaterial2", names->strings[0], names->location));
    p.add(make_bool("atmostone", true, e.location));
  }
}

void V4Translator::texture(Entity& e, DMat4& ctm) const {
  ParamSet& p = e.params;
  if (p.string("mapping", "uv") == "cylindrical") p.add(make_bool("byheight", true, e.location));
  if (e.type == "checkerboard") p.add(make_bool("tent", true, e.location));
  if (e.type == "imagemap") {
    p.add(make_bool("mean", true, e.location));
    // Other files than these have one encoding only, whatever is asked for.
    std::string ending = std::filesystem::path(p.string("filename", "")).extension().string();
    std::ranges::transform(ending, ending.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (ending != ".png") {
      p.take("encoding");
      p.add(make_bool("gamma", ending != ".exr" && ending != ".pfm" && ending != ".hdr", e.location));
    }
  }
  if (e.type == "fbm" || e.type == "windy" || e.type == "wrinkled" || e.type == "marble" ||
      (e.type == "checkerboard" && p.integer("dimension", 2) == 3)) {
    // v3 applies the transformation to the point, v4 its inverse.
    if (const DMat4 inverse = glm::inverse(ctm); std::isfinite(inverse[0][0])) ctm = inverse;
  } else if (p.string("mapping", "uv") == "planar") {
    // v3 takes the point in the world.
    const DMat4 inverse = glm::inverse(ctm);
    if (!std::isfinite(inverse[0][0])) return;
    const auto axis = [&](const char* name, const char* delta, const Vec3& otherwise) {
      const glm::dvec4 v(DVec3(p.vector3(name, otherwise)), 0.0);
      const glm::dvec4 moved = glm::transpose(inverse) * v;
      p.add(make_vector(name, Vec3(moved), e.location));
      p.add(make_real(delta, p.real(delta, 0.f) + static_cast<float>(moved.w), e.location));
    };
    axis("v1", "udelta", {1, 0, 0});
    axis("v2", "vdelta", {0, 1, 0});
  }
}

}  // namespace cloudrenderer
