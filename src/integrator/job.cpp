#include "integrator/job.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "film/camera.h"
#include "scene/dialect.h"
#include "scene/language.h"
#include "scene/material_specular.h"

namespace cloudrenderer {

namespace {

std::uint32_t positive(const Entity& e, const char* name, int otherwise) {
  const int v = e.params.integer(name, otherwise);
  if (v < 1 || v > 1 << 24)
    throw SceneError(e.location, std::string(name) + " must be between 1 and 16777216, got " + std::to_string(v));
  return static_cast<std::uint32_t>(v);
}

std::uint32_t samples_per_pixel(const Entity& sampler, Dialect dialect, Warnings& warnings) {
  if (sampler.type == "stratified")
    return positive(sampler, "xsamples", dialect == Dialect::v2 ? 2 : 4) *
           positive(sampler, "ysamples", dialect == Dialect::v2 ? 2 : 4);
  if (sampler.type == "adaptive") return positive(sampler, "maxsamples", 32);
  static const std::set<std::string> known{"lowdiscrepancy", "halton", "sobol", "random", "bestcandidate",
                                           "02sequence", "zerotwosequence", "maxmindist", ""};
  if (!known.contains(sampler.type))
    warnings.add(sampler.location, "Sampler \"" + sampler.type + "\" is not known, using a scrambled Sobol sequence");
  return positive(sampler, "pixelsamples", dialect == Dialect::v2 || sampler.type == "random" ? 4 : 16);
}

constexpr std::uint32_t kDeepest = 65534;  // bounces, so that PathSegment::vertex holds one more: as good as none is the limit

// Samples a pixel of integrators that take them from no sampler.
std::optional<std::uint32_t> own_samples(const Entity& integrator, const std::string& type, bool v4) {
  const auto number = [&](const char* name, int otherwise) {
    return static_cast<std::uint32_t>(std::clamp(integrator.params.integer(name, otherwise), 1, 1 << 20));
  };
  if (type == "metropolis") return number("samplesperpixel", 100);
  if (type == "mlt") return number("mutationsperpixel", 100);
  if (type == "sppm" && !v4) return number(integrator.params.has("iterations") ? "iterations" : "numiterations", 64);
  return std::nullopt;
}

// Integrators that estimate what `path` estimates in another way.
bool is_same_transport(const std::string& type) {
  static const std::set<std::string> types{"metropolis", "igi",  "irradiancecache", "photonmap", "exphotonmap",
                                           "mlt",        "bdpt", "sppm",            "useprobes"};
  return types.contains(type);
}

// What those are chosen for, besides.
LightPaths light_paths_for(const std::string& type) {
  static const std::set<std::string> caustics{"photonmap", "exphotonmap", "sppm"}, all{"metropolis", "mlt", "bdpt"};
  return caustics.contains(type) ? LightPaths::caustics : all.contains(type) ? LightPaths::all : LightPaths::none;
}

bool may_be_specular(const SceneDescription& scene) {
  const std::vector<bool> materials = maybe_specular(scene);
  return std::ranges::find(materials, true) != materials.end();
}

// Photons show in mirrors and through glass, too, what they bring; our paths from lights end at what the camera sees without.
bool misses_seen_caustics(const SceneDescription& scene, const std::string& type) {
  return light_paths_for(type) == LightPaths::caustics &&
         std::ranges::any_of(scene.lights, [](const LightDesc& l) { return l.type != "infinite" && l.type != "exinfinite"; });
}

// Why there are no paths from lights; empty: there can be.
std::string no_light_paths(const SceneDescription& scene, const JobSettings& job) {
  const std::string& camera = scene.camera.type;
  if (job.integrator != IntegratorKind::path) return "the integrator follows no paths";
  if (job.media != MediaTransport::none) return "the scene has participating media";
  if (scene.camera.motion) return "the camera moves";
  if (camera == "environment" || camera == "realistic") return "the camera is \"" + camera + "\"";
  if (camera == "orthographic" && scene.camera.params.real("lensradius", 0.f) > 0.f) return "the orthographic camera has a lens";
  return "";
}

// `type` is the integrator as given.
MediaTransport media_transport(const SceneDescription& scene, const std::string& type, Warnings& warnings) {
  if (scene.media.empty()) return MediaTransport::none;
  if (scene.dialect == Dialect::v2) {
    if (!scene.volume_integrator) return MediaTransport::emission;
    const Entity& e = *scene.volume_integrator;
    if (e.type == "single") return MediaTransport::single;
    if (e.type != "emission")
      warnings.add(e.location, "VolumeIntegrator \"" + e.type + "\" is not known; expected emission or single: emission is used");
    return MediaTransport::emission;
  }
  if (type == "volpath" || type == "bdpt" || type == "mlt") return MediaTransport::multiple;
  warnings.add(scene.integrator.location, "integrator \"" + type + "\" knows no participating media, as in pbrt-v3: they are ignored; volpath has them");
  return MediaTransport::none;
}

// Likewise. pbrt-v3's `path` and `volpath` and pbrt-v4's `volpath` let light scatter below surfaces; of pbrt-v2 only
// `dipolesubsurface` does, but there it is what all others are made to do.
bool subsurface_transport(const SceneDescription& scene, const std::string& type, Warnings& warnings) {
  if (scene.dialect == Dialect::v2 || type == "volpath" || (type == "path" && !is_of_v4(scene))) return true;
  const auto scatters = [](const MaterialDesc& m) {
    return m.type == "subsurface" || m.type == "kdsubsurface" || (m.type == "disney" && m.params.has("scatterdistance"));
  };
  if (std::ranges::any_of(scene.materials, scatters))
    warnings.add(scene.integrator.location, "integrator \"" + type + "\" lets no light scatter below surfaces, as in pbrt-" +
                                                (is_of_v4(scene) ? "v4" : "v3") + ": their boundaries alone are there; volpath has it");
  return false;
}

// With fewer samples the edges that the camera sees matter more, and trying takes too much of the time.
constexpr std::uint32_t kSharedFrom = 32;

}  // namespace

const char* name(LightPaths paths) {
  static constexpr std::array<const char*, 3> kNames{"off", "caustics", "all"};
  return kNames.at(static_cast<std::size_t>(paths));
}

std::optional<LightPaths> light_paths_of(const std::string& text) {
  for (const LightPaths p : {LightPaths::none, LightPaths::caustics, LightPaths::all})
    if (text == name(p)) return p;
  return std::nullopt;
}

bool may_share_rays(const JobSettings& job) {
  return job.integrator == IntegratorKind::path && job.media == MediaTransport::none && job.light_paths == LightPaths::none &&
         !limits_samples(job.film);
}

JobSettings job_settings(const SceneDescription& scene, const JobOverrides& overrides, Warnings& warnings) {
  JobSettings job;
  const bool v2 = scene.dialect == Dialect::v2;
  Entity film = scene.film;
  job.film = film_options(film, scene.dialect, warnings);
  if (overrides.width || overrides.height || overrides.crop) {
    FilmFrame& f = job.film.frame;
    const double cx0 = static_cast<double>(f.x0) / f.width, cx1 = static_cast<double>(f.x1) / f.width;
    const double cy0 = static_cast<double>(f.y0) / f.height, cy1 = static_cast<double>(f.y1) / f.height;
    f.width = overrides.width.value_or(f.width);
    f.height = overrides.height.value_or(f.height);
    const auto at = [](double c, std::uint32_t n) {
      return static_cast<std::uint32_t>(std::clamp(std::ceil(c * n - 1e-6), 0.0, static_cast<double>(n)));
    };
    const auto crop = [&](int i, double own) { return overrides.crop ? static_cast<double>((*overrides.crop)[static_cast<std::size_t>(i)]) : own; };
    f.x0 = at(crop(0, cx0), f.width);
    f.x1 = at(crop(1, cx1), f.width);
    f.y0 = at(crop(2, cy0), f.height);
    f.y1 = at(crop(3, cy1), f.height);
    if (f.x0 >= f.x1 || f.y0 >= f.y1) throw UsageError("the crop window is empty");
  }

  const std::uint32_t own_spp = samples_per_pixel(scene.sampler, scene.dialect, warnings);
  scene.sampler.params.report_unused("Sampler \"" + scene.sampler.type + "\"", warnings);
  job.spp = overrides.spp.value_or(own_spp);
  job.seed = overrides.seed;
  if (scene.sampler.type == "random") job.sequence = SampleSequence::Kind::independent;

  std::string type = overrides.integrator.value_or(scene.integrator.type);
  const Entity* source = &scene.integrator;
  if (!overrides.integrator && scene.renderer && scene.renderer->type == "metropolis") {
    type = "metropolis";
    source = &*scene.renderer;
  }
  if (type.empty()) type = v2 ? "directlighting" : "path";
  const std::string type_given = type;
  job.media = media_transport(scene, type, warnings);
  job.subsurface = subsurface_transport(scene, type, warnings);
  if (scene.volume_integrator) {
    job.media_step = scene.volume_integrator->params.real("stepsize", 1.f);
    if (!(job.media_step > 0.f)) throw SceneError(scene.volume_integrator->location, "stepsize must be > 0, got " + std::to_string(job.media_step));
    scene.volume_integrator->params.report_unused("VolumeIntegrator \"" + scene.volume_integrator->type + "\"", warnings);
  }
  if (type == "volpath") type = "path";
  job.light_paths = overrides.light_paths.value_or(light_paths_for(type));
  if (!overrides.light_paths && job.light_paths == LightPaths::caustics && !may_be_specular(scene)) job.light_paths = LightPaths::none;
  if (const auto samples = own_samples(*source, type, is_of_v4(scene)); samples && !overrides.spp && !overrides.integrator) job.spp = *samples;
  if (is_same_transport(type)) {
    warnings.add(source->location, "integrator \"" + type + "\" estimates the light transport of \"path\": rendered with path" +
                                       (job.light_paths != LightPaths::none ? ", and with paths from lights" : ""));
    if (job.light_paths != LightPaths::none && misses_seen_caustics(scene, type))
      warnings.add(source->location, "caustics of lights without a size are missing where they are seen in mirrors or through glass");
    type = "path";
  }
  if (type == "diffuseprt" || type == "glossyprt") {
    warnings.add(source->location, "integrator \"" + type + "\" has the light that comes directly from all around: rendered with directlighting" +
                                       (type == "glossyprt" ? ", and with the scene's materials in place of its own" : ""));
    type = "directlighting";
  }
  const int scene_depth = source->params.integer("maxdepth", type_given == "metropolis" ? 7 : 5);
  // Paths of pbrt-v2 and v4 end when they have exactly so many bounces: a negative number is no limit.
  const bool endless = scene_depth < 0 && type == "path" && (v2 || is_of_v4(scene));
  const std::uint32_t n = std::min(overrides.max_depth.value_or(endless ? kDeepest : static_cast<std::uint32_t>(std::max(scene_depth, 0))), kDeepest);
  if (type == "path") {
    job.integrator = IntegratorKind::path;
    job.light_vertices = v2 ? n + 1 : n;
    job.emission_vertex = n;
    if (is_of_v4(scene) && !is_same_transport(type_given)) job.regularize = source->params.boolean("regularize", false);
    job.lit_behind_null = is_of_v4(scene) && type_given == "path";
  } else if (type == "directlighting" || type == "whitted") {
    job.integrator = IntegratorKind::direct;
    job.light_vertices = std::max(n, 1u);
    job.emission_vertex = job.light_vertices - 1;
    source->params.string("strategy", "all");  // the same mean either way
  } else if (type == "dipolesubsurface") {  // light that comes directly, also of what a medium scatters
    job.integrator = IntegratorKind::direct;
    job.light_vertices = n + 1;
    job.emission_vertex = n;
  } else if (type == "ambientocclusion" || type == "ao") {
    job.integrator = IntegratorKind::ambient_occlusion;
    job.light_vertices = 1;
    // pbrt-v3 has no distance, and does not divide the sum of the cosines by pi.
    if (!v2 && !is_of_v4(scene))
      job.film.scale *= kPi;
    else
      job.ao_distance = source->params.real("maxdist", kInfinity);
    job.ao_cosine = !v2 && source->params.boolean("cossample", true);
    // One occlusion ray a sample: the rays that the scene asks for become samples.
    const std::uint32_t rays = positive(*source, "nsamples", v2 ? 2048 : 64);
    if (!overrides.spp) job.spp = static_cast<std::uint32_t>(std::min<std::uint64_t>(std::uint64_t{own_spp} * rays, 1u << 20));
  } else {
    throw SceneError(source->location, "integrator \"" + type + "\" is not supported; known are " +
                                           known_types(v2 ? "SurfaceIntegrator" : "Integrator", is_of_v4(scene) ? Dialect::v4 : scene.dialect));
  }
  if (source->params.has("pixelbounds"))
    warnings.add(source->location, "the integrator's \"pixelbounds\" is ignored: all of the picture is rendered");
  if (!overrides.integrator && source == &scene.integrator)
    source->params.report_unused((v2 ? "SurfaceIntegrator \"" : "Integrator \"") + scene.integrator.type + "\"", warnings);
  if (const std::string why = job.light_paths != LightPaths::none ? no_light_paths(scene, job) : ""; !why.empty()) {
    warnings.add(source->location, why + ": there are no paths from lights, and caustics are left to those from the camera");
    job.light_paths = LightPaths::none;
  }
  job.lit_behind_null = job.lit_behind_null && job.light_paths == LightPaths::none;
  if (job.regularize && job.light_paths != LightPaths::none) {
    warnings.add(source->location, "\"regularize\" is ignored where there are paths from lights (--light-paths)");
    job.regularize = false;
  }
  if (may_share_rays(job))
    job.samples_per_ray = overrides.samples_per_ray.value_or(job.spp < kSharedFrom ? 1 : 2);
  else if (overrides.samples_per_ray.value_or(1) > 1)
    warnings.add(source->location, "samples share no camera rays (--samples-per-ray) but with path, and without media, paths from lights or limits of samples");
  job.share_if_worth = job.samples_per_ray > 1 && !overrides.samples_per_ray;
  Warnings said_later;  // by who renders with it
  job.lobes = Filter::build(scene.filter, said_later, scene.dialect)->lobes();
  // One unit of the film is 2^-30 of a contribution of one; a film scale far from one moves that along.
  const float scale = job.film.scale > 0 && std::isfinite(job.film.scale) ? job.film.scale : 1.f;
  job.k = std::clamp(30 + std::ilogb(scale), 0, 50);
  return job;
}

}  // namespace cloudrenderer
