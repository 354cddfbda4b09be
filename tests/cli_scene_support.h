#pragma once
// Reads scenes as `render` does, up to the point where hosts would begin.
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>

#include "film/camera.h"
#include "film/film.h"
#include "integrator/job.h"
#include "parts/split.h"
#include "parts_support.h"
#include "shading/lights.h"
#include "shading/material.h"

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

inline ReadScene read_scene(const std::string& scene, const std::string& split_folder,
                            std::optional<Dialect> dialect) {
  ReadScene out;
  Warnings warnings;
  try {
    SplitOptions options;
    options.dialect = dialect;
    const Manifest manifest = split_scene(scene, split_folder, options, warnings);
    const JobSettings job = job_settings(manifest.scene, {}, warnings);
    Camera::build(manifest.scene.camera, job.film.frame, manifest.scene.dialect, warnings);
    Filter::build(manifest.scene.filter, warnings, manifest.scene.dialect);
    Shading::check(manifest.scene, warnings);
    Lights::check(manifest.scene, warnings);
  } catch (const SceneError& e) {
    out.error = e.what();
  }
  for (const std::string& w : warnings.list()) out.warnings += w + "\n";
  return out;
}

}  // namespace cloudrenderer
