#pragma once
#include <array>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "cluster/blob.h"
#include "cluster/job_seat.h"
#include "cluster/temp_folder.h"
#include "integrator/path_tracer.h"
#include "tasks/work.h"

namespace cloudrenderer {

// Where a host looks for the files of a split, in this order.
struct SceneSources {
  std::shared_ptr<const Manifest>
      manifest;        // of the folder that the job names: the manager's own process
  std::string folder;  // --parts
  std::shared_ptr<BlobFetcher> fetcher;  // the manager; null: not possible
  std::shared_ptr<JobSeat> seat = nullptr;  // parts are shared with the process's other jobs
};

// A host's scene: fetches files, loads and drops parts, and makes the engine. The loader calls come
// from one thread.
class SceneLoader final : public PartLoader {
 public:
  // `memory`: what parts, prototypes, textures and lights may take, builds included.
  SceneLoader(unsigned build_threads, std::uint64_t memory, SceneSources sources);
  ~SceneLoader() override;

  std::string start_job(const wire::JobStart& job) override;
  bool has_room(PartId part, BvhForm form) const override;
  std::string load(PartId part, BvhForm form) override;
  void unload(PartId part) override;
  void end_job() override;
  std::uint64_t bytes_used() const override;

  // Any thread. The engine is null outside of a job; whoever holds it keeps the whole scene alive.
  std::shared_ptr<const PathEngine> engine() const;
  std::uint64_t peak_bytes() const;
  double own_bytes() const;  // what is loaded, shared parts divided by their users
  // Processor seconds of the engine so far: camera, trace, shade, occlusion.
  std::array<double, 4> engine_seconds() const;

 private:
  struct Scene;
  std::unique_ptr<Scene> open(const wire::JobStart& job);
  Part read(Scene& scene, wire::BlobKind kind, std::uint32_t index);
  void load_prototypes(Scene& scene, std::uint32_t part);
  void count(bool shared, std::uint64_t bytes);
  std::vector<PartCache::Need> needs(const Scene& scene, std::uint32_t part, BvhForm form) const;
  bool reserve(const Scene& scene, std::uint32_t part, BvhForm form) const;
  PartCache* cache() const { return sources_.seat ? sources_.seat->host().cache.get() : nullptr; }
  std::shared_ptr<Scene> scene() const;

  const unsigned build_threads_;
  const std::uint64_t memory_;
  const SceneSources sources_;
  mutable std::mutex mutex_;  // guards the pointer
  std::shared_ptr<Scene> scene_;
};

}  // namespace cloudrenderer
