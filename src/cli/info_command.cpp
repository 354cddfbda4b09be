#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>

#include "cli/commands.h"
#include "cli/size.h"
#include "cluster/job_start.h"
#include "parts/features.h"
#include "scene/language.h"
#include "shapes/geometry.h"

namespace cloudrenderer {
namespace {

using Counts = std::map<std::string, std::uint64_t>;

// Counts what streams by; keeps nothing. Says of shapes what a render would, but for what only reading or refining large meshes tells.
class CountingSink final : public SceneSink {
 public:
  explicit CountingSink(Warnings& warnings) : warnings_(warnings) {}
  void begin_object(ObjectId, const std::string&) override { ++objects; }
  void end_object(ObjectId) override {}
  void shape(ShapeDesc&& shape, const SceneDescription& scene) override {
    ++shapes[shape.type];
    if (shape.area_light) ++emissive;
    if (shape.motion) ++moving;
    if (shape.params.has("alpha") || shape.params.has("shadowalpha")) ++masked;
    try {
      check(shape, scene.dialect);
    } catch (const SceneError& e) {
      if (!error) error = e;
    }
  }
  void instance(const InstanceDesc& instance, const SceneDescription&) override {
    ++instances;
    if (instance.motion) ++moving;
  }

  Counts shapes;
  std::uint64_t objects = 0, instances = 0, emissive = 0, moving = 0, masked = 0;
  std::optional<SceneError> error;  // that a render would end with

 private:
  void check(const ShapeDesc& shape, Dialect dialect) {
    if (shape.type == "loopsubdiv") return;
    if (shape.type != "plymesh") {
      make_geometry(shape, dialect, warnings_);
      return;
    }
    const std::string path = shape.params.string("filename", "");
    std::error_code unreadable;
    if (!std::filesystem::exists(path, unreadable)) throw SceneError(shape.location, path.empty() ? "a plymesh needs \"filename\"" : "cannot read '" + path + "'");
  }

  Warnings& warnings_;
};

template <class List>
Counts count_types(const List& list) {
  Counts counts;
  for (const auto& e : list) ++counts[e.type.empty() ? "none" : e.type];
  return counts;
}

void print_counts(const char* what, const Counts& counts) {
  std::uint64_t total = 0;
  std::string kinds;
  for (const auto& [name, n] : counts) {
    total += n;
    kinds += fmt::format("{}{} {}", kinds.empty() ? "" : ", ", name, n);
  }
  fmt::print("{:<12}{}{}\n", what, total, kinds.empty() ? "" : " (" + kinds + ")");
}

void print_description(const SceneDescription& scene, const JobSettings& job, Dialect dialect) {
  fmt::print("{:<12}{}\n", "dialect", dialect_name(dialect));
  fmt::print("{:<12}{}\n", "camera", scene.camera.type);
  const FilmFrame& f = job.film.frame;
  fmt::print("{:<12}{} x {}, window [{}, {}) x [{}, {}), {}\n", "film", f.width, f.height, f.x0,
             f.x1, f.y0, f.y1, job.film.filename);
  fmt::print("{:<12}{}, {} samples a pixel, {} a camera ray{}\n", "sampler", scene.sampler.type, job.spp, job.samples_per_ray,
             job.share_if_worth ? " if it pays" : "");
  fmt::print("{:<12}{}\n", "filter", scene.filter.type);
  const bool metropolis = scene.renderer && scene.renderer->type == "metropolis";  // whatever the integrator beside it
  fmt::print("{:<12}{}, light gathered at {} vertices", "integrator", metropolis ? "metropolis" : scene.integrator.type, job.light_vertices);
  if (job.light_paths != LightPaths::none) fmt::print(", paths from lights: {}", name(job.light_paths));
  fmt::print("\n");
  print_counts("materials", count_types(scene.materials));
  print_counts("textures", count_types(scene.textures));
  print_counts("lights", count_types(scene.lights));
  if (!scene.media.empty()) print_counts("media", count_types(scene.media));
}

// Every directive and type of the scene with its number and state; see docs/language.md.
void print_use(const LanguageUse& use) {
  fmt::print("language\n");
  for (const LanguageUse::Line& line : use.lines()) {
    fmt::print("  {:<34}{:>8}  {}{}{}\n", line.what, line.count, state_word(line.state),
               line.note.empty() ? "" : ": ", line.note);
    for (const LanguageUse::Line::Parameter& p : line.params)
      fmt::print("    {:<32}{:>8}  {}\n", p.name, p.count, p.state);
  }
}

// What shapes need (PartFeature bits), and how many shine.
struct ShapeNeeds {
  std::uint32_t features = 0;
  std::uint64_t emissive = 0;
};

ShapeNeeds shape_needs(const CountingSink& sink) {
  ShapeNeeds needs;
  needs.emissive = sink.emissive;
  for (const auto& [type, n] : sink.shapes) {
    static constexpr auto kQuadrics =
        std::to_array<std::string_view>({"sphere", "cylinder", "disk", "cone", "paraboloid", "hyperboloid"});
    const bool quadric = std::ranges::find(kQuadrics, type) != kQuadrics.end();
    needs.features |= quadric ? kHasQuadrics : type == "curve" ? kHasCurves : kHasTriangles;
  }
  if (sink.instances) needs.features |= kHasInstances;
  if (sink.moving) needs.features |= kHasMotion;
  if (sink.masked) needs.features |= kHasAlpha;
  return needs;
}

// What is on and what is off: what a scene does not need is neither stored, nor sent, nor run.
void print_model(const SceneNeeds& needs, const ShapeNeeds& shapes) {
  const auto line = [](const char* what, bool on) { fmt::print("  {:<44}{}\n", what, on ? "on" : "off"); };
  const auto has = [&](std::uint32_t feature) { return (shapes.features & feature) != 0; };
  fmt::print("model\n");
  line("textures filtered by ray footprints", needs.shading.footprint);
  line("uv and tangents at hits", needs.shading.uv);
  line("alpha masks", has(kHasAlpha));
  line("motion: rays with times", has(kHasMotion) || needs.moving_camera);
  line("instances: second transforms", has(kHasInstances));
  line("quadrics", has(kHasQuadrics));
  line("curves", has(kHasCurves));
  line("lens: rays that start on it", needs.lens);
  line("media", needs.media);
  line("scattering below surfaces", needs.shading.subsurface);
  line("surfaces that are passed through", needs.shading.null);
  line("light from infinity", needs.infinite_light);
  line("lights that rays find (weights of two samples)", needs.infinite_light || shapes.emissive > 0);
}

int info_of_split(const std::string& folder) {
  const Manifest m = open_split(folder);
  Warnings warnings;
  fmt::print("{:<12}{} (split of {})\n", "scene", folder, m.scene.source);
  const JobSettings job = job_settings(m.scene, {}, warnings);
  print_description(m.scene, job, m.scene.dialect);
  std::uint64_t bytes = 0, largest = 0;
  for (const PartInfo& p : m.parts) {
    bytes += p.loaded_bytes;
    largest = std::max(largest, p.loaded_bytes);
  }
  std::uint64_t prototype_bytes = 0;
  for (const PrototypeInfo& p : m.prototypes) prototype_bytes += p.loaded_bytes;
  fmt::print("{:<12}{}\n", "emissive", m.shape_lights.size());
  fmt::print("{:<12}{}\n", "triangles", m.total_triangles);
  fmt::print("{:<12}{}, {} when loaded, the largest {}\n", "parts", m.parts.size(),
             format_size(bytes), format_size(largest));
  fmt::print("{:<12}{}, {} when loaded\n", "prototypes", m.prototypes.size(),
             format_size(prototype_bytes));
  fmt::print("{:<12}({}, {}, {}) to ({}, {}, {})\n", "bounds", m.bounds.min.x, m.bounds.min.y,
             m.bounds.min.z, m.bounds.max.x, m.bounds.max.y, m.bounds.max.z);
  for (std::size_t i = 0; i < m.parts.size(); ++i)
    fmt::print("  part {:<5} {:>10} triangles {:>12} {} boxes, {} prototypes\n", i,
               m.parts[i].triangles, format_size(m.parts[i].loaded_bytes), m.parts[i].boxes.size(),
               m.parts[i].prototypes.size());
  ShapeNeeds shapes{0, m.shape_lights.size()};
  for (const PartInfo& p : m.parts) shapes.features |= p.features;
  const SceneNeeds needs = scene_needs(m.scene, job, warnings);
  print_model(needs, shapes);
  fmt::print("{:<12}{} bytes on the wire, radiance left out\n", "path", wire::segment_bytes(columns_of(m, needs), 0));
  print_warnings(warnings.list());
  return kDone;
}

int info_of_scene(const InfoOptions& options) {
  Warnings warnings;
  CountingSink sink(warnings);
  ParseOptions parse;
  parse.dialect = options.dialect;
  parse.confine = options.confine;
  LanguageUse use;
  parse.use = &use;
  const SceneDescription scene = parse_scene(options.scene, parse, sink, warnings);
  fmt::print("{:<12}{}\n", "scene", options.scene);
  const JobSettings job = job_settings(scene, {}, warnings);
  print_description(scene, job, use.dialect());
  fmt::print("{:<12}{}\n", "emissive", sink.emissive);
  print_counts("shapes", sink.shapes);
  const SceneNeeds needs = scene_needs(scene, job, warnings);
  fmt::print("{:<12}{} instances of {} objects\n", "instancing", sink.instances, sink.objects);
  if (sink.moving || scene.camera.motion)
    fmt::print("{:<12}{} shapes and instances{}\n", "moving", sink.moving, scene.camera.motion ? ", the camera" : "");
  print_model(needs, shape_needs(sink));
  print_use(use);
  fmt::print("{:<12}{}\n", "warnings", warnings.list().size());
  print_warnings(warnings.list());
  if (sink.error) throw SceneError(*sink.error);
  return kDone;
}

}  // namespace

int run_info(const InfoOptions& options) {
  if (options.language) {
    fmt::print("{}", language_page());
    return kDone;
  }
  if (!std::filesystem::exists(options.scene))
    throw SceneError({}, options.scene + ": there is no such file");
  return is_split_folder(options.scene) ? info_of_split(options.scene) : info_of_scene(options);
}

}  // namespace cloudrenderer
