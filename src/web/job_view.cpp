#include "web/job_view.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tasks/task.h"

namespace cloudrenderer {
namespace {

using Json = nlohmann::ordered_json;
constexpr std::size_t kHistory = 512;
constexpr std::size_t kHostsShown = 1000;  // beyond that only the sums are told

const char* phase_name(ManagerCore::Phase phase) {
  switch (phase) {
    case ManagerCore::Phase::gathering:
      return "gathering";
    case ManagerCore::Phase::loading:
      return "loading";
    case ManagerCore::Phase::rendering:
      return "rendering";
    case ManagerCore::Phase::ending:
      return "ending";
    case ManagerCore::Phase::done:
      return "done";
    case ManagerCore::Phase::failed:
      return "failed";
  }
  return "";
}

double seconds_there(const HostView& h, double now) { return std::max(0.0, h.left_s.value_or(now) - h.joined_s); }

Json host_json(const HostView& h, double now) {
  const wire::Counters& c = h.status.counters();
  const double there = seconds_there(h, now);
  return {{"id", h.id},
          {"name", h.name},
          {"address", h.address},
          {"version", h.version},
          {"threads", h.threads},
          {"memory_budget", h.memory_budget},
          {"memory_used", c.memory_used()},
          {"joined_s", h.joined_s},
          {"left_s", h.left_s ? Json(*h.left_s) : Json(nullptr)},
          {"lost", h.lost},
          {"paths_done", h.paths_done},
          {"live_paths", h.status.live_paths()},
          {"load_s", h.status.load_s()},
          {"busy", there > 0 ? c.busy_s() / (there * std::max(1u, h.threads)) : 0.0},
          {"cpu_s", c.cpu_s()},
          {"bytes_sent", c.bytes_sent()},
          {"bytes_received", c.bytes_received()},
          {"parts", h.parts}};
}

}  // namespace

JobView job_view(const std::string& scene, const RenderView& view) {
  const FilmFrame& frame = view.facts.settings.film.frame;
  JobView job;
  job.scene = scene;
  job.phase = phase_name(view.progress.phase);
  job.waiting_for = view.core.waiting_for();
  job.width = frame.crop_width();
  job.height = frame.crop_height();
  job.spp = view.facts.settings.spp;
  job.parts = view.facts.parts;
  job.triangles = view.facts.triangles;
  job.progress = view.progress;
  job.core = view.core.progress();
  job.bit_exact = view.core.bit_exact();
  for (const auto& [id, report] : view.core.hosts()) {
    HostView h;
    h.id = id.value;
    h.name = report.hello.name();
    h.address = report.hello.listen();
    h.version = report.hello.version();
    h.threads = report.hello.threads();
    h.memory_budget = report.hello.memory();
    h.joined_s = report.joined;
    h.left_s = report.left;
    h.lost = report.lost;
    h.paths_done = report.paths_done;
    h.status = report.last;
    for (const PartId part : view.core.held_by(id)) h.parts.push_back(part.value);
    job.hosts.push_back(std::move(h));
  }
  return job;
}

CostPoint cost_point(const JobView& job) {
  CostPoint p;
  p.render_s = job.progress.render_s;
  p.spp = static_cast<double>(job.progress.paths_done) / std::max(1.0, static_cast<double>(job.width) * job.height);
  if (job.progress.estimate) p.estimated_relmse = job.progress.estimate->relmse;
  for (const HostView& h : job.hosts) {
    p.host_s += seconds_there(h, job.progress.elapsed_s);
    p.cpu_s += h.status.counters().cpu_s();
  }
  return p;
}

void add_point(std::vector<CostPoint>& history, const CostPoint& point) {
  if (history.size() >= kHistory) {
    for (std::size_t i = 0; 2 * i < history.size(); ++i) history[i] = history[2 * i];
    history.resize((history.size() + 1) / 2);
  }
  history.push_back(point);
}

Json to_json(const JobView& job) {
  const double now = job.progress.elapsed_s;
  std::array<std::uint64_t, kTaskStates> states{};
  Json hosts = Json::array();
  std::uint32_t threads = 0;
  for (const HostView& h : job.hosts) {
    for (int i = 0; i < std::min<int>(h.status.tasks_in_state_size(), kTaskStates); ++i)
      states[static_cast<std::size_t>(i)] += h.left_s ? 0 : h.status.tasks_in_state(i);
    if (!h.left_s) threads += h.threads;
    if (hosts.size() < kHostsShown) hosts.push_back(host_json(h, now));
  }
  Json tasks;
  for (std::size_t s = 0; s + 1 < kTaskStates; ++s) tasks[name(static_cast<TaskState>(s))] = states[s];
  Json history = Json::array();
  for (const CostPoint& p : job.history)
    history.push_back({p.render_s, p.spp, p.host_s, p.cpu_s, p.estimated_relmse});
  const CostPoint cost = cost_point(job);
  const auto& estimate = job.progress.estimate;
  return {{"id", 1},
          {"scene", job.scene},
          {"phase", job.phase},
          {"waiting_for", job.waiting_for},
          {"width", job.width},
          {"height", job.height},
          {"spp", job.spp},
          {"parts", job.parts},
          {"triangles", job.triangles},
          {"elapsed_s", now},
          {"render_s", job.progress.render_s},
          {"paths_done", job.progress.paths_done},
          {"paths_total", job.progress.paths_total},
          {"estimated_relmse", estimate ? Json(estimate->relmse) : Json(nullptr)},
          {"estimated_relmse_low", estimate ? Json(estimate->low) : Json(nullptr)},
          {"estimated_relmse_high", estimate ? Json(estimate->high) : Json(nullptr)},
          {"invalid_samples", job.core.invalid_samples},
          {"paged_parts", job.core.paged_parts},
          {"bit_exact", job.bit_exact},
          {"threads", threads},
          {"host_s", cost.host_s},
          {"cpu_s", cost.cpu_s},
          {"tasks", std::move(tasks)},
          {"hosts", std::move(hosts)},
          {"hosts_ever", job.hosts.size()},
          {"history", std::move(history)}};
}

}  // namespace cloudrenderer
