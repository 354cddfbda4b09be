#include "cluster/render.h"

#include <sys/stat.h>
#include <unistd.h>

#include <asio/post.hpp>
#include <asio/steady_timer.hpp>
#include <filesystem>
#include <fstream>

#include "base/log.h"
#include "cluster/checkpoint.h"
#include "cluster/fingerprint.h"
#include "cluster/job_start.h"
#include "cluster/local_host.h"
#include "cluster/path_samples.h"
#include "cluster/processes.h"
#include "cluster/usage.h"
#include "cluster/worker.h"
#include "film/camera.h"
#include "film/sample_plan.h"

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;
constexpr auto kLook = 250ms;         // progress, bounds, children
constexpr double kEstimateEvery = 2;  // seconds between error estimates for the progress line
constexpr auto kChildrenEnd = 5s;
constexpr auto kInterruptedChildrenEnd = 500ms;  // they may still be looking for us
constexpr std::uint32_t kBoundedSpp =
    1u << 16;  // samples at most when only an error or a time ends the render
constexpr std::uint32_t kAdaptiveTile = 8;  // pixels, each with the same number of samples

// A secret that only hosts started by this process know.
std::string write_token(const std::string& path) {
  const std::string token = std::to_string(new_incarnation()) + std::to_string(new_incarnation());
  std::ofstream(path) << token << "\n";
  chmod(path.c_str(), S_IRUSR | S_IWUSR);
  return token;
}

class RenderRun {
 public:
  RenderRun(const RenderRequest& request, const RenderObserver& observer, Interrupts& interrupts)
      : request_(request), observer_(observer), interrupts_(interrupts), timer_(io_) {
    if (!in_process()) tls_ = std::make_shared<const Tls>(request.tls);
  }

  RenderOutcome run() {
    open_scene();
    open_checkpoint();
    start_manager();
    if (manager_->core().finished()) {  // all of it was in the checkpoint
      manager_->shut();
      return finish();
    }
    start_hosts();
    interrupts_.set_handler([this] { asio::post(io_, [this] { interrupt(); }); });
    look();
    io_.run();
    interrupts_.set_handler(nullptr);
    children_.wait(children_patience_);
    if (!error_.empty()) {
      if (checkpoint_) checkpoint_->close(manager_->core());
      throw ClusterError(error_);
    }
    return finish();
  }

 private:
  // While the scene is read nothing is worth waiting for: an interrupt removes the temporary folder
  // and ends.
  void open_scene() {
    if (is_split_folder(request_.scene)) {
      folder_ = request_.scene;
      manifest_ = std::make_shared<Manifest>(open_split(folder_));
      check_part_files(folder_, *manifest_);
    } else {
      temporary_ = std::make_unique<TemporaryFolder>();
      folder_ = temporary_->path();
      interrupts_.set_handler([this] {
        temporary_.reset();
        spdlog::warn("interrupted while the scene was read: there is nothing to write yet");
        _exit(5);
      });
      SplitOptions split = request_.split;
      split.tells_missing_files = false;
      manifest_ = std::make_shared<Manifest>(split_scene(request_.scene, folder_, split, warnings_));
      interrupts_.set_handler(nullptr);
    }
    cpu_opened_ = cpu_seconds();
    overrides_ = request_.overrides;
    if ((request_.max_error || request_.max_time_s) && !overrides_.spp) overrides_.spp = kBoundedSpp;
    facts_.settings = job_settings(manifest_->scene, overrides_, warnings_);
    facts_.settings.features = request_.features;
    facts_.settings.length_k = feature_length_k(manifest_->bounds);
    needs_ = scene_needs(manifest_->scene, facts_.settings, warnings_);  // here, as hosts warn nobody
    facts_.camera_matrices = camera_matrices(manifest_->scene.camera);
    const FilmFrame& frame = facts_.settings.film.frame;
    if (const auto& r = request_.reference;
        r && (r->width != frame.crop_width() || r->height != frame.crop_height()))
      throw UsageError("the reference has " + std::to_string(r->width) + " x " +
                       std::to_string(r->height) + " pixels, the picture " +
                       std::to_string(frame.crop_width()) + " x " +
                       std::to_string(frame.crop_height()));
    facts_.warnings = warnings_.list();
    facts_.parts = static_cast<std::uint32_t>(manifest_->parts.size());
    facts_.triangles = manifest_->total_triangles;
    for (const PartInfo& p : manifest_->parts) facts_.predicted_bytes += p.loaded_bytes;
    for (const PrototypeInfo& p : manifest_->prototypes) facts_.predicted_bytes += p.loaded_bytes;
    if (observer_.scene_ready) observer_.scene_ready(facts_);
  }

  void open_checkpoint() {
    job_ = checkpoint_job(manifest_->content_hash, facts_.settings);
    std::string path = request_.checkpoint;
    if (path.empty() && observer_.default_checkpoint) path = observer_.default_checkpoint();
    interrupt_checkpoint_ = path;
    if (request_.checkpoint.empty() && !request_.resume) return;
    checkpoint_ = std::make_unique<Checkpoint>(path, request_.resume, job_);
    if (!checkpoint_->resumed()) return;
    job_ = checkpoint_->made();
    facts_.settings.footprint_spp = job_.footprint_spp;
    if (overrides_.samples_per_ray && (*overrides_.samples_per_ray != job_.samples_per_ray || job_.share_if_worth))
      throw UsageError("checkpoint " + path + " was made with " + std::to_string(job_.samples_per_ray) + " samples a camera ray" +
                       (job_.share_if_worth ? " if it is worth it" : "") + " (--samples-per-ray)");
    facts_.settings.samples_per_ray = job_.samples_per_ray;
    facts_.settings.share_if_worth = job_.share_if_worth;
    if (!request_.listen && !request_.allow_inexact && job_.fingerprint != 0 &&
        job_.fingerprint != numeric_fingerprint())
      throw UsageError("checkpoint " + path +
                       " was made with another numeric fingerprint: this machine computes other "
                       "bits (--allow-inexact goes on all the same)");
  }

  bool adaptive() const { return request_.adaptive && (request_.max_error || request_.max_time_s); }
  Film::Looks looks() const { return request_.max_error ? Film::Looks::until_good : Film::Looks::once; }
  bool in_process() const { return !request_.listen && request_.hosts <= 1; }

  void start_manager() {
    Manager::Config c;
    c.core.incarnation = new_incarnation();
    c.core.min_hosts = request_.listen ? request_.min_hosts : std::max(1u, request_.hosts);
    c.core.replication = request_.replication;
    c.core.lost_after_s = request_.lost_after_s;
    c.core.allow_inexact = request_.allow_inexact;
    c.core.hold_rounds = request_.max_error || adaptive();
    if (adaptive()) c.core.tile = kAdaptiveTile;  // whatever the cluster is
    if (checkpoint_) checkpoint_->prepare(c.core);
    c.job = make_job_spec(*manifest_, facts_.settings, overrides_, needs_, folder_, true);
    c.folder = folder_;
    c.token = request_.token;
    c.tls = tls_;
    c.changed = [this] { changed(); };
    if (!in_process() && !request_.listen) {
      secrets_ = std::make_unique<TemporaryFolder>();
      c.token = write_token(secrets_->path() + "/token");
    }
    parts_ = c.job.parts;
    columns_ = c.job.start.columns();
    manager_ = std::make_unique<Manager>(io_, clock_, std::move(c));
    ManagerCore& core = manager_->core();
    if (checkpoint_) checkpoint_->restore(core, facts_.settings.spp);
    // Of a picture with a part of the next round nothing can be said any more, and it has been.
    const std::uint64_t complete = core.complete_samples() * facts_.settings.film.frame.pixels();
    if (core.progress().paths_done > complete) recorded_samples_ = core.complete_samples();
  }

  void start_hosts() {
    if (in_process()) {
      LocalHost::Config c;
      c.name = "local";
      c.memory = request_.memory;
      c.threads = request_.threads;
      c.alpha = request_.alpha;
      c.manifest = manifest_;
      c.failed = [this](const std::string& why) { fail(why); };
      local_ = std::make_unique<LocalHost>(io_, clock_, *manager_, std::move(c));
      if (shut_) local_->stop();  // the job has failed already: too little memory, for example
      return;
    }
    const Address at = manager_->listen(request_.listen.value_or(Address{"127.0.0.1", 0}));
    if (request_.listen) {
      if (observer_.listening) observer_.listening(at);
      return;
    }
    for (std::uint32_t i = 1; i <= request_.hosts; ++i) {
      std::vector<std::string> arguments{"worker",
                                         "--manager",
                                         at.to_string(),
                                         "--listen",
                                         "127.0.0.1:0",
                                         "--threads",
                                         std::to_string(request_.threads),
                                         "--memory",
                                         std::to_string(request_.memory),
                                         "--name",
                                         "host" + std::to_string(i),
                                         "--token-file",
                                         secrets_->path() + "/token",
                                         "--parent",
                                         std::to_string(getpid()),
                                         "--log-level",
                                         request_.log_level,
                                         "--alpha",
                                         std::to_string(request_.alpha)};
      if (request_.tls.mode == TlsMode::on) arguments.insert(arguments.end(), {"--tls", "on"});
      children_.start(arguments);
    }
  }

  void interrupt() {
    if (shut_) return io_.stop();
    if (interrupted_) {  // the picture is kept, but no host is waited for
      children_patience_ = 0ms;
      return shut();
    }
    interrupted_ = true;
    children_patience_ = kInterruptedChildrenEnd;
    manager_->core().cancel("interrupted", clock_.now());
    manager_->drain();
  }

  void fail(const std::string& why) {
    if (error_.empty()) error_ = why;
    shut();
  }

  void shut() {
    if (shut_) return;
    shut_ = true;
    timer_.cancel();
    manager_->shut();
    if (local_) local_->stop();
  }

  // After everything that may have moved the job on: ends of rounds and of the job.
  void changed() {
    if (shut_ || !manager_) return;
    ManagerCore& core = manager_->core();
    if (checkpoint_) checkpoint_->record(core);
    if (core.phase() == ManagerCore::Phase::rendering && cpu_begin_ == 0) cpu_begin_ = cpu_seconds();
    if (core.phase() == ManagerCore::Phase::failed) return fail(core.error());
    if (core.finished()) return shut();
    const std::uint32_t samples = core.complete_samples();
    const bool held = core.round_complete();
    if (core.phase() == ManagerCore::Phase::rendering &&
        (held ? core.decisions() > recorded_decisions_ : samples > recorded_samples_ && !adaptive())) {
      recorded_samples_ = samples;
      recorded_decisions_ = core.decisions();
      const double error = record();
      if (request_.max_error && error <= *request_.max_error) bound_met_ = true;
    }
    if (!held) return;
    // next_round() and stop() come back here through drain().
    asio::post(io_, [this] {
      if (shut_ || !manager_->core().round_complete()) return;
      if (bound_met_)
        manager_->core().stop(clock_.now());
      else
        next_round();
      manager_->drain();
    });
  }

  void next_round() {
    ManagerCore& core = manager_->core();
    if (!adaptive()) return core.next_round(clock_.now());
    SamplePlan plan = plan_samples(core.film(), facts_.settings.film.scale, convergence_.back().estimate, core.tile_size(),
                                   core.goals(), request_.max_error, facts_.settings.spp);
    core.next_round(clock_.now(), std::move(plan.goals), plan.expected_paths);
  }

  // Of a picture whose pixels have different numbers of samples: on average.
  std::uint32_t samples_done() const {
    const ManagerCore& core = manager_->core();
    if (!adaptive()) return core.complete_samples();
    return static_cast<std::uint32_t>(core.progress().paths_done / facts_.settings.film.frame.pixels());
  }

  double record() {
    const Film& film = manager_->core().film();
    const float scale = facts_.settings.film.scale;
    ConvergencePoint p;
    p.render_s = clock_.now() - manager_->core().progress().render_began;
    p.spp = samples_done();
    p.estimate = film.estimated_error(scale, looks());
    if (request_.reference)
      p.relmse = compare_images(developed(film, facts_.settings.film), *request_.reference).relmse;
    convergence_.push_back(p);
    estimate_ = p.estimate;
    estimated_at_ = clock_.now();
    return p.estimate.high;
  }

  void look() {
    if (shut_) return;
    timer_.expires_after(kLook);
    timer_.async_wait([this](const std::error_code& cancelled) {
      if (cancelled || shut_) return;
      check();
      if (!shut_) look();
    });
  }

  void check() {
    ManagerCore& core = manager_->core();
    const double now = clock_.now();
    const ManagerCore::Progress p = core.progress();
    const bool rendering = core.phase() == ManagerCore::Phase::rendering;
    if (checkpoint_ && !stopped_ && !checkpoint_->error().empty()) {
      stopped_ = true;
      core.cancel(checkpoint_->error(), now);
      manager_->drain();
      if (shut_) return;
    }
    if (!in_process() && !request_.listen) {
      const std::size_t alive = children_.alive();
      if (alive == 0 || (core.phase() == ManagerCore::Phase::gathering && alive < request_.hosts))
        return fail("the hosts on this machine have ended");
    }
    if (request_.listen && p.tracers > 0) {
      alone_since_ = now;
      said_alone_ = false;
    } else if (request_.listen && !said_alone_ && (rendering || core.phase() == ManagerCore::Phase::loading)) {
      said_alone_ = true;
      spdlog::warn("no worker is {}: waiting for one to join", p.hosts > 0 ? "there that traces paths" : "left");
    }
    if (request_.listen && p.tracers == 0 && request_.wait_s && now > alone_since_ + *request_.wait_s)
      return fail("no host that traces paths has come in " + std::to_string(static_cast<int>(*request_.wait_s)) +
                  " seconds");
    if (rendering && request_.max_time_s && !stopped_ &&
        now - p.render_began >= *request_.max_time_s) {
      stopped_ = true;
      core.stop(now);
      manager_->drain();
      if (shut_) return;
    }
    if (rendering && (observer_.progress || observer_.look) && now > estimated_at_ + kEstimateEvery) {
      estimate_ = core.film().estimated_error(facts_.settings.film.scale, looks());
      estimated_at_ = now;
    }
    const RenderProgress out = progress();
    if (observer_.progress) observer_.progress(out);
    if (observer_.look) observer_.look({core, facts_, out});
  }

  RenderProgress progress() const {
    const ManagerCore& core = manager_->core();
    const ManagerCore::Progress p = core.progress();
    RenderProgress out;
    out.phase = core.phase();
    out.elapsed_s = clock_.now();
    if (out.phase == ManagerCore::Phase::rendering)
      out.render_s = out.elapsed_s - p.render_began;
    else if (core.finished())
      out.render_s = std::max(0.0, p.render_ended - p.render_began);
    out.paths_done = p.paths_done;
    out.paths_total = p.paths_total;
    out.paths_restored = p.paths_restored;
    out.hosts = p.hosts;
    out.estimate = estimate_;
    return out;
  }

  RenderOutcome finish() {
    ManagerCore& core = manager_->core();
    const ManagerCore::Progress p = core.progress();
    RenderOutcome out;
    keep(core, out);
    if (observer_.look) observer_.look({core, facts_, progress()});
    const std::uint32_t samples = samples_done();
    out.render_cpu_s = cpu_begin_ > 0 ? cpu_seconds() - cpu_begin_ : 0;
    out.load_cpu_s = cpu_begin_ > 0 ? cpu_begin_ - cpu_opened_ : 0;
    out.facts = std::move(facts_);
    out.spp_done = core.complete_samples();
    out.samples_per_ray = core.samples_per_ray();
    out.shared_variance = core.shared_variance();
    out.hosts = core.hosts();
    out.bit_exact = core.bit_exact();
    out.film = std::make_unique<Film>(std::move(core.film()));
    out.features = std::move(core.features());
    out.interrupted = interrupted_;
    out.estimate = out.film->estimated_error(out.facts.settings.film.scale, looks());
    if (convergence_.empty() || convergence_.back().spp < (adaptive() ? samples : out.spp_done)) {
      ConvergencePoint last;
      last.render_s = p.render_ended - p.render_began;
      last.spp = adaptive() ? samples : out.spp_done;
      last.estimate = out.estimate;
      if (request_.reference)
        last.relmse = compare_images(developed(*out.film, out.facts.settings.film), *request_.reference).relmse;
      convergence_.push_back(last);
    }
    // A time that was asked for, too, ends a render that has not reached its error.
    out.bound_met =
        !request_.max_error || out.estimate.high <= *request_.max_error;
    out.paths_done = p.paths_done;
    out.paths_restored = p.paths_restored;
    out.spp_mean =
        static_cast<double>(p.paths_done) / static_cast<double>(out.film->frame().pixels());
    out.invalid_samples = p.invalid_samples;
    out.clamped_samples = p.clamped_samples;
    out.load_s = p.render_began;
    out.render_s = std::max(0.0, p.render_ended - p.render_began);
    out.tail = core.tail(0.1);
    out.wire_bytes = manager_->bytes_sent();
    out.cpu_s = cpu_seconds();
    for (const auto& [id, host] : out.hosts) {
      out.wire_bytes += host.last.counters().bytes_sent();
      if (!local_) out.cpu_s += host.last.counters().cpu_s();
    }
    if (local_) out.engine_s = local_->engine_seconds();
    out.convergence = std::move(convergence_);
    out.wall_s = clock_.now();
    if (request_.sample_paths != 0) out.model = model(out.facts.settings);
    return out;
  }

  sim::SceneModel model(const JobSettings& settings) const {
    sim::SceneModel m;
    m.columns = columns_;
    m.manifest_bytes = std::filesystem::file_size(std::filesystem::path(folder_) / "manifest.bin");
    for (std::size_t p = 0; p < parts_.size(); ++p)
      m.parts.push_back({parts_[p], manifest_->parts[p].file_bytes, manifest_->parts[p].triangles});
    for (const PrototypeInfo& p : manifest_->prototypes) m.prototype_bytes.push_back(p.loaded_bytes);
    m.samples = sample_paths(folder_, *manifest_, settings, request_.sample_paths);
    return m;
  }

  // The checkpoint, as it is now, is on the disk, or there is an error.
  void keep(ManagerCore& core, RenderOutcome& out) {
    if (checkpoint_) {
      checkpoint_->close(core);
      out.checkpoint = checkpoint_->path();
      out.checkpoint_error = checkpoint_->error();
    } else if (interrupted_ && !interrupt_checkpoint_.empty()) {
      out.checkpoint = interrupt_checkpoint_;
      try {
        // That of another run, which may have got further, is not ours to lose.
        out.checkpoint = write_beside(out.checkpoint, whole_checkpoint(core, job_));
      } catch (const std::system_error& e) {
        out.checkpoint_error =
            "cannot write the checkpoint " + out.checkpoint + ": " + e.code().message();
      }
    }
  }

  const RenderRequest& request_;
  const RenderObserver& observer_;
  Interrupts& interrupts_;
  Clock clock_;
  asio::io_context io_{1};
  asio::steady_timer timer_;
  std::shared_ptr<const Tls> tls_;
  std::unique_ptr<TemporaryFolder> temporary_, secrets_;
  std::string folder_;
  std::shared_ptr<const Manifest> manifest_;
  Warnings warnings_;
  JobOverrides overrides_;
  SceneFacts facts_;
  SceneNeeds needs_;
  ChildProcesses children_;
  std::chrono::milliseconds children_patience_ = kChildrenEnd;
  CheckpointJob job_;
  std::string interrupt_checkpoint_;
  std::unique_ptr<Checkpoint> checkpoint_;
  std::unique_ptr<Manager> manager_;
  std::unique_ptr<LocalHost> local_;
  std::string error_;
  bool interrupted_ = false, shut_ = false, stopped_ = false, bound_met_ = false;
  std::uint32_t recorded_samples_ = 0, recorded_decisions_ = 0;
  std::vector<ConvergencePoint> convergence_;
  std::optional<Film::ErrorEstimate> estimate_;
  std::vector<PlacementPart> parts_;
  wire::ColumnSet columns_ = 0;
  double cpu_opened_ = 0, cpu_begin_ = 0;
  double estimated_at_ = 0, alone_since_ = 0;
  bool said_alone_ = false;
};

}  // namespace

RenderOutcome render(const RenderRequest& request, const RenderObserver& observer,
                     Interrupts& interrupts) {
  return RenderRun(request, observer, interrupts).run();
}

std::uint64_t default_memory(std::uint32_t hosts) {
  return available_memory() / 5 * 4 / std::max(1u, hosts);
}

}  // namespace cloudrenderer
