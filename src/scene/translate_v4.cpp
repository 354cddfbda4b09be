// Options, lights and media of pbrt-v4.
#include "scene/translate_v4.h"

#include <cmath>
#include <string>

#include "base/portable_math.h"
#include "scene/param_make.h"

namespace cloudrenderer {

void V4Translator::camera(Entity& e) const {
  if (e.type == "realistic") {
    e.params.add(make_bool("simpleweighting", false, e.location));
    e.params.add(make_bool("exposed", true, e.location));  // the film counts the shutter
  }
  if (e.type != "spherical") return;
  const std::string mapping = e.params.string("mapping", "equalarea");
  e.params.take("mapping");
  if (mapping != "equirectangular") {
    if (mapping != "equalarea")
      warn_(e.location, "unknown mapping \"" + mapping + "\", expected equalarea or equirectangular: equalarea is used");
    e.params.add(make_string("mapping", "equalarea", e.location));
  }
  e.type = "environment";
}

// Every film is RGB without a sensor; exposure is a factor as with v4's sensor "cie1931".
void V4Translator::film(Entity& e) const {
  ParamSet& p = e.params;
  if (e.type == "spectral") warn_(e.location, "film \"spectral\": an RGB picture is made");
  if (e.type == "gbuffer") warn_(e.location, "film \"gbuffer\": only the colours are made");
  if (e.type == "rgb" || e.type == "spectral" || e.type == "gbuffer") e.type = "image";
  if (const std::string sensor = p.string("sensor", "cie1931"); sensor != "cie1931")
    warn_(e.location, "the film's sensor \"" + sensor + "\" is taken for plain exposure");
  const float exposure = p.real("iso", 100.f) * p.real("exposuretime", 1.f) / 100.f;
  for (const char* name : {"sensor", "iso"}) p.take(name);
  if (exposure != 1.f) p.add(make_real("scale", exposure, e.location));
  const auto bounds = p.take("pixelbounds");
  if (bounds && p.has("cropwindow")) {
    warn_(bounds->location, "the film has a \"cropwindow\", too: \"pixelbounds\" is ignored");
  } else if (bounds && bounds->integers.size() == 4) {
    const float w = static_cast<float>(p.integer("xresolution", 1280)),
                h = static_cast<float>(p.integer("yresolution", 720));
    const auto covers = [&](std::size_t i, float size) {
      return std::max(static_cast<float>(bounds->integers[i]), 0.f) < std::min(static_cast<float>(bounds->integers[i + 1]), size);
    };
    if (!covers(0, w) || !covers(2, h)) throw SceneError(bounds->location, "the pixel bounds are empty: they are x0 x1 y0 y1 of the film's pixels");
    // Both ends are rounded up to pixels.
    const auto at = [&](std::size_t i, float size) {
      return (static_cast<float>(bounds->integers[i]) - 0.5f) / size;
    };
    p.add(make_reals(ParamType::real, "cropwindow", {at(0, w), at(1, w), at(2, h), at(3, h)},
                     bounds->location));
  }
}

void V4Translator::expose(const Entity& camera, Entity& film) const {
  film.params.add(make_bool("keepsnegative", true, film.location));
  const float time = camera.params.real("shutterclose", 1.f) - camera.params.real("shutteropen", 0.f);
  if (!(time > 0.f)) throw SceneError(camera.location, "the shutter does not open: shutterclose must be after shutteropen");
  if (film.params.take("exposuretime") || time == 1.f) return;
  film.params.add(make_real("scale", film.params.real("scale", 1.f) * time, film.location));
}

void V4Translator::sampler(Entity& e) const {
  for (const char* name : {"seed", "randomization"}) e.params.take(name);
  if (e.type == "independent") e.type = "random";
  if (e.type == "zsobol" || e.type == "paddedsobol" || e.type == "pmj02bn") e.type = "sobol";
}

void V4Translator::pixel_filter(Entity& e) const {
  ParamSet& p = e.params;
  if (e.type == "gaussian") {
    for (const char* radius : {"xradius", "yradius"})
      if (!p.has(radius)) p.add(make_real(radius, 1.5f, e.location));
    const float sigma = p.real("sigma", 0.5f);
    if (!(sigma > 0.f)) throw SceneError(e.location, "the filter's sigma must be above 0");
    p.take("sigma");
    p.add(make_real("alpha", 1 / (2 * sigma * sigma), e.location));
  }
  p.rename("xradius", "xwidth");
  p.rename("yradius", "ywidth");
}

void V4Translator::integrator(Entity& e) const {
  if (e.type == "ao" || e.type == "ambientocclusion") {
    e.params.rename("maxdistance", "maxdist");
    e.params.add(make_integer("nsamples", 1, e.location));
  } else if (e.type == "simplevolpath") {
    e.type = "volpath";
  } else if (e.type == "simplepath" || e.type == "lightpath" || e.type == "randomwalk" || e.type == "function") {
    if (e.type == "randomwalk" || (e.type == "simplepath" && !e.params.boolean("samplelights", true)))
      warn_(e.location, "integrator \"" + e.type + "\" finds no lights without a size in pbrt: here they shine");
    warn_(e.location, "integrator \"" + e.type +
                          "\" estimates the light transport of \"path\": rendered with path");
    e.type = "path";
  }
}

void V4Translator::light(Entity& e, DMat4& ctm) const {
  ParamSet& p = e.params;
  float scale = p.real("scale", 1.f);
  const float power = p.real("power", -1.f), illuminance = p.real("illuminance", -1.f);
  p.take("power");
  const auto move_to = [&](const Vec3& from) { ctm = ctm * translate(DVec3(from)); };
  const auto decoded = [&] {
    p.rename("filename", "mapname");
    if (p.has("mapname")) p.add(make_bool("srgb", true, e.location));
  };
  const auto map = [&] {
    decoded();
    p.add(make_string("mapping", "equalarea", e.location));
  };
  if (e.type == "point") {
    move_to(p.point3("from", Vec3(0.f)));
    p.take("from");
    if (power > 0.f) scale *= power / (4 * kPi);
  } else if (e.type == "spot") {
    p.add(make_string("falloff", "smoothstep", e.location));
    if (power > 0.f) {
      const float cone = p.real("coneangle", 30.f), delta = p.real("conedeltaangle", 5.f);
      const float end = portable::cos(cone * (kPi / 180)),
                  start = portable::cos((cone - delta) * (kPi / 180));
      // Of a smooth step half of the rim counts.
      scale *= power / (2 * kPi * ((1 - start) + (start - end) / 2));
    }
  } else if (e.type == "distant") {
    if (illuminance > 0.f) scale *= illuminance;
    p.take("illuminance");
  } else if (e.type == "infinite") {
    if (p.has("filename")) {
      if (p.take("L")) warn_(e.location, "an infinite light has a \"filename\" or an \"L\", not both: \"L\" is ignored");
      map();  // what the map gives an upward patch is known when it is read
    } else {
      if (illuminance > 0.f) scale *= illuminance / kPi;
      p.take("illuminance");
    }
  } else if (e.type == "goniometric") {
    map();
    if (power > 0.f) p.add(make_real("power", power, e.location));  // its map tells how bright this is
  } else if (e.type == "projection") {
    decoded();
    if (power > 0.f) p.add(make_real("power", power, e.location));
    if (!p.has("fov")) p.add(make_real("fov", 90.f, e.location));
    ctm = ctm * cloudrenderer::scale(DVec3(1, -1, 1));
  }
  p.take("scale");
  if (scale != 1.f) p.add(make_rgb("scale", Rgb(scale), e.location));
}

void V4Translator::medium(Entity& e) const {
  ParamSet& p = e.params;
  if (e.type != "rgbgrid") {
    // A preset counts more than what is given beside it, which counts where nobody knows the preset.
    const bool named = !p.string("preset", "").empty();
    for (const std::string name : {"sigma_a", "sigma_s"}) {
      if (!p.has(name)) p.add(make_rgb(name, Rgb(1.f), e.location));
      if (named) p.rename(name, "default." + name);
    }
    if (p.has("Le") && p.has("temperature")) {
      warn_(e.location, "the medium shines by its temperature: the parameter \"Le\" is ignored");
      p.take("Le");
    }
    p.rename("Le", "emission");
  }
  if (e.type == "cloud") approximated(e, "its noise is sampled on a grid");
  // Former names.
  const auto once = [&](const char* former, const char* name) {
    if (p.has(name))
      p.take(former);
    else
      p.rename(former, name);
  };
  once("temperaturecutoff", "temperatureoffset");
  once("LeScale", "Lescale");
}

void V4Translator::area_light(Entity& e) const {
  if (e.params.has("filename")) e.params.add(make_bool("srgb", true, e.location));
  if (const float scale = e.params.real("scale", 1.f); scale != 1.f) e.params.add(make_rgb("scale", Rgb(scale), e.location));
}

}  // namespace cloudrenderer
