#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "scene/voxels.h"

namespace cloudrenderer {

// Grids of a NanoVDB file (Museth, "NanoVDB: A GPU-Friendly and Portable VDB Data Structure", 2021), of floats, with the
// format's major version 32, plain or zipped. A sparse tree that is read where it lies: boxes of samples cost what is in
// them. No file crashes the reader: what points out of the file is 0.
class NanoVdb final : public Voxels {
 public:
  // The grids called `names`, a channel each; those that the file does not have, but for the first one, are left out.
  // Those after the first are sampled where the first one's samples are. Throws SceneError at `where`, which names the
  // file.
  static std::shared_ptr<const NanoVdb> open(const std::string& path, const std::vector<std::string>& names,
                                             const FileLocation& where);

  bool has(std::size_t name) const { return channel_of_[name] >= 0; }
  std::uint32_t channels() const { return static_cast<std::uint32_t>(grids_.size()); }
  const glm::ivec3& first() const { return first_; }  // the first grid's active samples begin here
  const glm::uvec3& size() const { return size_; }
  const Transform& index_to_world() const { return index_to_world_; }

  // Coordinates count from first().
  void read(std::uint32_t channel, const glm::ivec3& begin, const glm::ivec3& end, float* out) const override;

 private:
  struct Grid {
    BulkArray<std::uint32_t> words;
    Transform index_to_world;
    glm::ivec3 low{0}, high{-1};  // of active samples, both included
  };

  static std::optional<Grid> find(const std::string& path, const std::string& name, const FileLocation& where);
  static void read_blocks(const Grid& grid, const glm::ivec3& begin, const glm::ivec3& end, float* out);
  static float value(const Grid& grid, const glm::ivec3& at);

  std::vector<int> channel_of_;
  std::vector<Grid> grids_;
  std::vector<bool> aligned_;  // by channel: samples lie where the first one's do
  glm::ivec3 first_{0};
  glm::uvec3 size_{1};
  Transform index_to_world_;
};

}  // namespace cloudrenderer
