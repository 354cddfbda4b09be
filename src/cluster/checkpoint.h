#pragma once
#include <memory>
#include <string>

#include "cluster/checkpoint_file.h"
#include "tasks/manager_core.h"

namespace cloudrenderer {

// The checkpoint of a render while it runs: what an earlier run has left goes into the core, what
// the core has done goes to the file.
class Checkpoint {
 public:
  // Without `resume` the file may not be there yet, or is empty. `job` is this render's. Throws
  // UsageError when the file is another job's, or no checkpoint.
  Checkpoint(const std::string& path, bool resume, const CheckpointJob& job);

  bool resumed() const { return made_.has_value(); }
  // Of the run that made the file; with resumed().
  const CheckpointJob& made() const { return *made_; }
  // Options that let a core go on.
  void prepare(ManagerOptions& options) const;
  // Before the first host joins. Throws UsageError when there are more samples than the render has.
  void restore(ManagerCore& core, std::uint32_t spp);

  // What the core has merged since the last time.
  void record(ManagerCore& core);
  // Everything is on the disk, or there is an error.
  void close(ManagerCore& core);
  std::string error() const { return file_.error(); }
  const std::string& path() const { return file_.path(); }

 private:
  void rewrite(const ManagerCore& core);

  CheckpointFile file_;
  CheckpointJob job_;
  std::optional<CheckpointJob> made_;
  std::uint64_t header_checksum_ = 0;  // 0: not written yet
  std::uint64_t compact_bytes_ = 0;    // of the film as one record a tile, about
  std::uint32_t decisions_ = 0;        // of the core that are written
};

// The state of the film as a file of its own.
Bytes whole_checkpoint(const ManagerCore& core, CheckpointJob job);

}  // namespace cloudrenderer
