#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "cli/commands.h"
#include "cli/size.h"
#include "scene/language.h"
#include "shading/lights.h"
#include "shading/material.h"
#include "shading/media.h"

namespace cloudrenderer {
namespace {

using Counts = std::map<std::string, std::uint64_t>;

// Counts what streams by; keeps nothing.
class CountingSink final : public SceneSink {
 public:
  void begin_object(ObjectId, const std::string&) override { ++objects; }
  void end_object(ObjectId) override {}
  void shape(ShapeDesc&& shape, const SceneDescription&) override {
    ++shapes[shape.type];
    if (shape.area_light) ++emissive;
    if (shape.motion) ++moving;
  }
  void instance(const InstanceDesc& instance, const SceneDescription&) override {
    ++instances;
    if (instance.motion) ++moving;
  }

  Counts shapes;
  std::uint64_t objects = 0, instances = 0, emissive = 0, moving = 0;
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

void print_description(const SceneDescription& scene, Dialect dialect, Warnings& warnings) {
  fmt::print("{:<12}{}\n", "dialect", dialect_name(dialect));
  fmt::print("{:<12}{}\n", "camera", scene.camera.type);
  const JobSettings job = job_settings(scene, {}, warnings);
  const FilmFrame& f = job.film.frame;
  fmt::print("{:<12}{} x {}, window [{}, {}) x [{}, {}), {}\n", "film", f.width, f.height, f.x0,
             f.x1, f.y0, f.y1, job.film.filename);
  fmt::print("{:<12}{}, {} samples a pixel\n", "sampler", scene.sampler.type, job.spp);
  fmt::print("{:<12}{}\n", "filter", scene.filter.type);
  fmt::print("{:<12}{}, light gathered at {} vertices\n", "integrator", scene.integrator.type,
             job.light_vertices);
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

// What hosts would find wrong, or not have, when they build materials and lights.
void check(const SceneDescription& scene, Warnings& warnings) {
  Shading::check(scene, warnings);
  Lights::check(scene, warnings);
  Media::check(scene, warnings);
}

int info_of_split(const std::string& folder) {
  const Manifest m = open_split(folder);
  Warnings warnings;
  fmt::print("{:<12}{} (split of {})\n", "scene", folder, m.scene.source);
  print_description(m.scene, m.scene.dialect, warnings);
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
  check(m.scene, warnings);
  print_warnings(warnings.list());
  return kDone;
}

int info_of_scene(const InfoOptions& options) {
  Warnings warnings;
  CountingSink sink;
  ParseOptions parse;
  parse.dialect = options.dialect;
  LanguageUse use;
  parse.use = &use;
  const SceneDescription scene = parse_scene(options.scene, parse, sink, warnings);
  fmt::print("{:<12}{}\n", "scene", options.scene);
  print_description(scene, use.dialect(), warnings);
  fmt::print("{:<12}{}\n", "emissive", sink.emissive);
  print_counts("shapes", sink.shapes);
  check(scene, warnings);
  fmt::print("{:<12}{} instances of {} objects\n", "instancing", sink.instances, sink.objects);
  if (sink.moving || scene.camera.motion)
    fmt::print("{:<12}{} shapes and instances{}\n", "moving", sink.moving, scene.camera.motion ? ", the camera" : "");
  print_use(use);
  fmt::print("{:<12}{}\n", "warnings", warnings.list().size());
  print_warnings(warnings.list());
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
