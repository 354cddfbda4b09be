#pragma once
#include <memory>
#include <string>

#include "base/log.h"
#include "parts/part.h"
#include "parts/split.h"
#include "scene/description.h"

namespace cloudrenderer {

// The two halves of split_scene, for scenes that do not come from a file: feed sink(), then finish.
// Makes the folder, and removes the files of an earlier split from it. Temporary files go away with
// the splitter.
class SceneSplitter {
 public:
  SceneSplitter(const std::string& out_folder, const SplitOptions& options, Warnings& warnings);
  ~SceneSplitter();

  SceneSink& sink();
  // `scene` is what the parser returned. Returns the manifest with absolute file names.
  Manifest finish(SceneDescription scene);

 private:
  class Work;
  std::unique_ptr<Work> work_;
};

}  // namespace cloudrenderer
