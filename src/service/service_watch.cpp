// What the service tells those who look on: rows of jobs as they change, pictures as they are.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>

#include "service/service.h"

namespace cloudrenderer {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kEndedShown = 500;  // jobs that have ended; older ones are in GET /v1/jobs
constexpr std::size_t kRunningShown = 16;

}  // namespace

Json Service::watch_row(const Job& job) const {
  std::array<std::size_t, static_cast<std::size_t>(FrameState::cancelled) + 1> states{};
  Json running = Json::array();
  double share = 0;  // of the frames that are under way, in frames
  std::optional<FrameProgress> one;
  for (std::size_t i = 0; i < job.frames.size(); ++i) {
    const FrameState state = job.frames[i].state;
    ++states[static_cast<std::size_t>(state)];
    if (state != FrameState::running) continue;
    if (running.size() < kRunningShown) running.push_back(i);
    const auto found = progress_.find({job.id, static_cast<std::uint32_t>(i)});
    if (found == progress_.end()) continue;
    share += found->second.share();
    if (!one) one = found->second;
  }
  Json frames = Json::object();
  for (std::size_t i = 0; i < states.size(); ++i)
    if (states[i] > 0) frames[name(static_cast<FrameState>(i))] = states[i];
  const Usage used = job.usage();
  const auto or_null = [](const auto& value) { return value ? Json(*value) : Json(nullptr); };
  return {{"id", job.id},
          {"name", job.request.name},
          {"file", job.request.files.empty() ? "" : job.request.files.front()},
          {"user", job.request.user},
          {"state", name(job.state)},
          {"reason", job.reason},
          {"over_budget", job.over_budget},
          {"priority", job.request.priority},
          {"frames", job.frames.size()},
          {"frame_states", std::move(frames)},
          {"running", std::move(running)},
          {"progress", job.frames.empty() ? 0 : (static_cast<double>(states[static_cast<std::size_t>(FrameState::done)]) + share) / static_cast<double>(job.frames.size())},
          {"phase", one ? one->phase : ""},
          {"hosts", one ? one->hosts : 0},
          {"estimated_relmse", one ? or_null(one->estimated_relmse) : Json(nullptr)},
          {"submitted_at", job.submitted},
          {"started_at", or_null(job.started)},
          {"ended_at", or_null(job.ended)},
          {"cpu_s", used.cpu_s},
          {"host_s", used.host_s},
          {"cost", used.cost},
          {"budget", or_null(job.request.budget)}};
}

Json Service::changed_jobs(const Caller& caller, WatchedJobs& seen, std::size_t bytes) const {
  const std::lock_guard lock(mutex_);
  struct Candidate {
    std::uint64_t seen, id, version;
  };
  std::vector<Candidate> candidates;
  std::set<std::uint64_t> there;
  std::size_t ended = 0;
  const auto& jobs = scheduler_.jobs();
  for (auto it = jobs.rbegin(); it != jobs.rend(); ++it) {
    const auto& [id, job] = *it;
    if (job.request.user != caller.name && !caller.admin) continue;
    if (is_final(job.state) && ++ended > kEndedShown) continue;
    there.insert(id);
    const auto found = versions_.find(id);
    const std::uint64_t version = found == versions_.end() ? 1 : found->second;
    const auto known = seen.versions.find(id);
    if (known == seen.versions.end() || known->second != version) candidates.push_back({known == seen.versions.end() ? 0 : known->second, id, version});
  }
  // New ones first, the latest of them before the others; then who has waited longest.
  std::ranges::stable_sort(candidates, {}, &Candidate::seen);
  Json rows = Json::array(), gone = Json::array();
  std::size_t sum = 0;
  for (const Candidate& c : candidates) {
    Json row = watch_row(jobs.at(c.id));
    sum += dump(row).size();
    if (sum > bytes && !rows.empty()) break;
    rows.push_back(std::move(row));
    seen.versions[c.id] = c.version;
  }
  std::erase_if(seen.versions, [&](const auto& v) {
    if (there.contains(v.first)) return false;
    gone.push_back(v.first);
    return true;
  });
  return {{"jobs", std::move(rows)}, {"gone", std::move(gone)}};
}

void Service::look_at_frames() {
  std::map<FrameRef, std::string> windows;
  for (const auto& [ref, child] : children_)
    if (!child.splits && !child.window.empty()) windows[ref] = child.window;
  watch_.set_windows(std::move(windows));
  ProgressOf progress = watch_.progress();
  for (const auto& [ref, p] : progress) {
    const auto old = progress_.find(ref);
    if (old == progress_.end() || old->second != p) versions_[ref.job] = ++version_;
  }
  progress_ = std::move(progress);
}

FrameView Service::frame_view(const Caller& caller, std::uint64_t id, std::uint64_t frame) const {
  const std::lock_guard lock(mutex_);
  const Job& job = job_of(caller, id);
  if (frame >= job.frames.size()) throw ApiError(404, fmt::format("the job has no frame {}", frame));
  const FrameRef ref{id, static_cast<std::uint32_t>(frame)};
  const JobFrame& f = job.frames[frame];
  if (const auto child = children_.find(ref); f.state == FrameState::running && child != children_.end() && !child->second.window.empty())
    return {child->second.window, ""};
  std::string folder = frame_folder(ref);
  std::error_code none;
  if (!fs::is_regular_file(folder + "/picture.exr", none)) throw ApiError(404, fmt::format("there is no picture yet: frame {} is {}", frame, name(f.state)));
  return {"", std::move(folder)};
}

}  // namespace cloudrenderer
