#pragma once
// Reads scenes as `render` does, up to the point where hosts would begin.
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "cluster/render.h"
#include "film/camera.h"
#include "film/film.h"
#include "integrator/scene_needs.h"
#include "parts/split.h"
#include "parts_support.h"
#include "shapes/geometry.h"

namespace cloudrenderer {

inline void write_file(const std::string& path, const std::string& bytes) {
  std::filesystem::remove(path);
  std::ofstream(path, std::ios::binary) << bytes;
}

struct ReadScene {
  std::string error;  // what() of the SceneError, or ""
  std::string warnings;
  bool warns(const std::string& part) const { return warnings.find(part) != std::string::npos; }
};

inline void check_scene(const SceneDescription& scene, Warnings& warnings) {
  const JobSettings job = job_settings(scene, {}, warnings);
  scene_needs(scene, job, warnings);
}

inline ReadScene read_scene(const std::string& scene, const std::string& split_folder,
                            std::optional<Dialect> dialect) {
  ReadScene out;
  Warnings warnings;
  try {
    SplitOptions options;
    options.dialect = dialect;
    check_scene(split_scene(scene, split_folder, options, warnings).scene, warnings);
  } catch (const SceneError& e) {
    out.error = e.what();
  }
  for (const std::string& w : warnings.list()) out.warnings += w + "\n";
  return out;
}

// The same without a split: quick, for thousands of scenes.
inline ReadScene read_text(const std::string& scene, Dialect dialect) {
  struct Sink final : SceneSink {
    explicit Sink(Warnings& w) : warnings(w) {}
    void begin_object(ObjectId, const std::string&) override {}
    void end_object(ObjectId) override {}
    void shape(ShapeDesc&& s, const SceneDescription& description) override {
      make_geometry(s, description.dialect, warnings);
    }
    void instance(const InstanceDesc&, const SceneDescription&) override {}
    Warnings& warnings;
  };
  ReadScene out;
  Warnings warnings;
  try {
    Sink sink(warnings);
    ParseOptions options;
    options.dialect = dialect;
    check_scene(parse_scene(scene, options, sink, warnings), warnings);
  } catch (const SceneError& e) {
    out.error = e.what();
  }
  for (const std::string& w : warnings.list()) out.warnings += w + "\n";
  return out;
}

struct RenderedScene : ReadScene {
  std::vector<float> pixels;
};

// The picture that `render` makes.
inline RenderedScene render_scene(const std::string& scene, std::optional<Dialect> dialect,
                                  JobOverrides overrides = {}) {
  static Interrupts interrupts;
  RenderedScene out;
  RenderRequest request;
  request.scene = scene;
  request.split.dialect = dialect;
  request.overrides = std::move(overrides);
  request.memory = std::uint64_t{512} << 20;
  try {
    const RenderOutcome outcome = render(request, {}, interrupts);
    for (const std::string& w : outcome.facts.warnings) out.warnings += w + "\n";
    for (const Rgb& p : outcome.film->image(outcome.facts.settings.film.scale).pixels)
      out.pixels.insert(out.pixels.end(), {p.x, p.y, p.z});
  } catch (const SceneError& e) {
    out.error = e.what();
  }
  return out;
}

}  // namespace cloudrenderer
