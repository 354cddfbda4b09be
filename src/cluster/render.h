#pragma once
// A whole render: scene in, film and figures out. What the command line calls; knows no command
// line.
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cluster/interrupts.h"
#include "film/film.h"
#include "integrator/job.h"
#include "net/address.h"
#include "net/tls.h"
#include "parts/split.h"
#include "simulate/scene_model.h"
#include "tasks/manager_core.h"

namespace cloudrenderer {

struct RenderRequest {
  std::string scene;  // a .pbrt file or a split folder
  JobOverrides overrides;
  SplitOptions split;
  std::uint32_t hosts = 1;        // on this machine; without `listen`
  std::optional<Address> listen;  // hosts come by themselves
  std::uint32_t min_hosts = 1;    // with `listen`
  std::uint32_t replication = 1;
  unsigned threads = 1;      // of a host on this machine
  std::uint64_t memory = 0;  // likewise
  std::string token;
  TlsOptions tls;
  bool allow_inexact = false;
  float alpha = 0.25f;
  double lost_after_s = 3;
  std::optional<double> wait_s;  // without any host
  // The error is met when the upper end of its estimate's interval is below. With either of them, and `adaptive`, samples
  // go where the error is; a time without a number of samples ends nothing before.
  std::optional<double> max_error, max_time_s;
  bool adaptive = true;
  bool features = false;  // that paths tell what they see, for RenderOutcome::features
  std::optional<Image> reference;
  std::string checkpoint;  // "": an interrupt leaves one where the observer says
  bool resume = false;
  std::uint32_t sample_paths = 0;  // to be traced for RenderOutcome::model; one host in this process only
  std::string log_level = "warn";  // of hosts that are started here
};

struct SceneFacts {
  std::vector<std::string> warnings;
  std::uint32_t parts = 0;
  std::uint64_t triangles = 0, predicted_bytes = 0;
  JobSettings settings;
  std::map<std::string, Mat4> camera_matrices;  // for the header of the picture
};

struct RenderProgress {
  ManagerCore::Phase phase = ManagerCore::Phase::gathering;
  double elapsed_s = 0, render_s = 0;
  std::uint64_t paths_done = 0, paths_total = 0, paths_restored = 0;
  std::uint32_t hosts = 0;
  std::optional<Film::ErrorEstimate> estimate;  // of the last time that it was computed
};

struct ConvergencePoint {
  double render_s = 0;
  std::uint32_t spp = 0;  // that every pixel has; with adaptive sampling of a pixel, on average
  Film::ErrorEstimate estimate;
  std::optional<double> relmse;
};

// What there is to look at while a render runs. Valid during the call only.
struct RenderView {
  const ManagerCore& core;
  const SceneFacts& facts;
  const RenderProgress& progress;
};

struct RenderObserver {
  std::function<void(const SceneFacts&)> scene_ready;
  // After scene_ready: the file of the checkpoint when the request names none.
  std::function<std::string()> default_checkpoint;
  std::function<void(const Address&)> listening;
  std::function<void(const RenderProgress&)> progress;  // a few times a second
  std::function<void(const RenderView&)> look;          // likewise, and once more at the end
};

struct RenderOutcome {
  SceneFacts facts;
  std::unique_ptr<Film> film;
  std::vector<PixelFeatures> features;  // row by row as the film; empty if not asked for
  bool interrupted = false;
  bool bound_met = true;  // --max-error
  bool bit_exact = true;
  std::string checkpoint;        // that was written; "": none
  std::string checkpoint_error;  // why it could not be: the picture is what there was by then
  double wall_s = 0, load_s = 0, render_s = 0, cpu_s = 0;
  double tail = 0;  // share of render_s that the last tenth of the paths took
  std::uint64_t paths_restored = 0;  // of those done: by earlier runs
  std::uint64_t paths_done = 0, invalid_samples = 0, clamped_samples = 0;
  std::uint64_t wire_bytes = 0;  // sent by all processes, parts and files left out
  std::uint32_t spp_done = 0;    // samples that every pixel has
  std::uint32_t samples_per_ray = 1;  // that shared what the camera saw
  std::optional<double> shared_variance;  // of such samples over that of others, as a trial before the frame found it
  double spp_mean = 0;           // samples of a pixel, on average
  std::vector<ConvergencePoint> convergence;
  Film::ErrorEstimate estimate;
  std::map<HostId, ManagerCore::HostReport> hosts;
  // Processor seconds of this process: until rendering began, from then to the last reply.
  double load_cpu_s = 0, render_cpu_s = 0;
  std::optional<sim::SceneModel> model;  // but for its costs, which follow from the rest
  std::array<double, 4> engine_s{};  // one host in this process: camera, trace, shade, occlusion
};

// Throws SceneError, UsageError, ClusterError.
RenderOutcome render(const RenderRequest& request, const RenderObserver& observer,
                     Interrupts& interrupts);

// The memory budget of a host when nothing is said: 80 % of what there is, shared by the hosts of
// this machine.
std::uint64_t default_memory(std::uint32_t hosts);

}  // namespace cloudrenderer
