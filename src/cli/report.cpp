#include "cli/report.h"

#include <algorithm>
#include <cmath>

namespace cloudrenderer {
namespace {

using Json = nlohmann::ordered_json;

double per(double amount, double of) { return of > 0 ? amount / of : 0; }

Json report_host(const ManagerCore::HostReport& host, double render_s) {
  const wire::Counters& c = host.last.counters();
  const wire::Hello& hello = host.hello;
  return {{"name", hello.name()},
          {"threads", hello.threads()},
          {"memory_budget", hello.memory()},
          {"memory_peak", c.memory_peak()},
          {"memory_used", c.memory_used()},
          {"peak_rss", c.peak_rss()},
          {"parts_loaded", c.parts_loaded()},
          {"paged_in", c.paged_in()},
          {"paging_s", c.paging_s()},
          {"busy", per(c.busy_s(), render_s * hello.threads())},
          {"cpu_s", c.cpu_s()},
          {"bytes_sent", c.bytes_sent()},
          {"bytes_received", c.bytes_received()},
          {"tasks",
           {{"loader", c.tasks_loader()},
            {"unloader", c.tasks_unloader()},
            {"renderer", c.tasks_renderer()},
            {"tracer", c.tasks_tracer()},
            {"aggregator", c.tasks_aggregator()},
            {"intersection", c.tasks_intersection()}}},
          {"blocks_sent", c.blocks_sent()},
          {"load_s", c.load_s()},
          {"retries", c.retries()},
          {"paths_done", host.paths_done},
          {"joined_s", host.joined},
          {"left_s", host.left ? Json(*host.left) : Json(nullptr)},
          {"lost", host.lost}};
}

// Numbers one after the other, as sim::read_model() takes them.
Json path_numbers(const sim::PathSample& path) {
  Json out = Json::array();
  const auto part = [&](std::uint32_t p) {
    if (p == sim::PathVertex::kNone)
      out.push_back(-1);
    else
      out.push_back(p);
  };
  const auto list = [&](const std::vector<std::uint32_t>& parts) {
    out.push_back(parts.size());
    for (const std::uint32_t p : parts) out.push_back(p);
  };
  for (const sim::PathVertex& v : path) {
    list(v.parts);
    part(v.hit);
    out.push_back(v.shadow ? 1 : 0);
    if (!v.shadow) continue;
    list(v.shadow_parts);
    part(v.blocker);
  }
  return out;
}

// What `simulate` needs beside the rest.
Json report_model(const RenderOutcome& o) {
  const sim::SceneModel& m = *o.model;
  Json parts = Json::array();
  for (const sim::ModelPart& p : m.parts) {
    parts.push_back({{"bytes", p.placement.bytes},
                     {"build", p.placement.build},
                     {"page", p.placement.page},
                     {"visits", p.placement.visits},
                     {"file_bytes", p.file_bytes},
                     {"triangles", p.triangles}});
    if (!p.placement.prototypes.empty()) parts.back()["prototypes"] = p.placement.prototypes;
  }
  Json paths = Json::array();
  for (const sim::PathSample& p : m.samples.paths) paths.push_back(path_numbers(p));
  return {{"load_cpu_s", o.load_cpu_s},
          {"render_cpu_s", o.render_cpu_s},
          {"columns", m.columns},
          {"manifest_bytes", m.manifest_bytes},
          {"parts", std::move(parts)},
          {"prototype_bytes", m.prototype_bytes},
          {"path_samples",
           {{"columns", m.samples.columns},
            {"rows", m.samples.rows},
            {"per_cell", m.samples.per_cell},
            {"paths", std::move(paths)}}}};
}

}  // namespace

Json make_report(const RenderOutcome& o, const std::string& scene,
                 const std::optional<ImageDifference>& difference) {
  const FilmFrame& frame = o.facts.settings.film.frame;
  std::uint64_t camera = 0, bounce = 0, shadow = 0, moved = 0, asked = 0, nearest_asked = 0, wasted = 0, copied = 0, dropped = 0;
  Json hosts = Json::array();
  for (const auto& [id, host] : o.hosts) {
    const wire::Counters& c = host.last.counters();
    camera += c.camera();
    bounce += c.bounce();
    shadow += c.shadow();
    moved += c.moved();
    asked += c.shadow_asked();
    nearest_asked += c.nearest_asked();
    wasted += c.wasted_paths();
    copied += c.copied_paths();
    dropped += c.dropped_messages();
    hosts.push_back(report_host(host, o.render_s));
  }
  const auto paths = static_cast<double>(o.paths_done - o.paths_restored);  // of this run
  Json error = {{"estimated_relmse", o.estimate.relmse},
                {"estimated_relmse_low", o.estimate.low},
                {"estimated_relmse_high", o.estimate.high},
                {"estimated_relmse_trimmed", o.estimate.trimmed}};
  if (difference) {
    error["relmse"] = difference->relmse;
    error["relmse_trimmed"] = difference->relmse_trimmed;
    error["mse"] = difference->mse;
  }
  Json convergence = Json::array();
  for (const ConvergencePoint& p : o.convergence) {
    Json point = {{"render_s", p.render_s},
                  {"spp", p.spp},
                  {"estimated_relmse", p.estimate.relmse},
                  {"estimated_relmse_low", p.estimate.low},
                  {"estimated_relmse_high", p.estimate.high}};
    if (p.relmse) point["relmse"] = *p.relmse;
    convergence.push_back(std::move(point));
  }
  Json out = {
      {"version", 1},
      {"scene", scene},
      {"width", frame.crop_width()},
      {"height", frame.crop_height()},
      {"spp", std::llround(o.spp_mean)},
      {"parts",
       {{"count", o.facts.parts},
        {"bytes", o.facts.predicted_bytes},
        {"triangles", o.facts.triangles}}},
      {"time",
       {{"wall_s", o.wall_s}, {"load_s", o.load_s}, {"render_s", o.render_s}, {"cpu_s", o.cpu_s}}},
      {"rays",
       {{"camera", camera},
        {"bounce", bounce},
        {"shadow", shadow},
        {"moved", moved},
        {"shadow_asked", asked},
        {"nearest_asked", nearest_asked}}},
      {"wire",
       {{"bytes", o.wire_bytes},
        {"bytes_per_path", per(static_cast<double>(o.wire_bytes), paths)}}},
      {"invalid_samples", o.invalid_samples},
      {"clamped_samples", o.clamped_samples},
      {"bit_exact", o.bit_exact},
      {"wasted_paths", wasted},
      {"error", std::move(error)},
      {"convergence", std::move(convergence)},
      {"hosts", std::move(hosts)},
      {"spp_asked", o.facts.settings.spp},
      {"spp_done", o.spp_done},
      {"samples_per_ray", o.samples_per_ray},
      {"paths", o.paths_done},
      {"paths_restored", o.paths_restored},
      {"checkpoint", o.checkpoint},
      {"tail", o.tail},
      {"copied_paths", copied},
      {"samples_per_s", per(paths, o.render_s)},
      {"pixels_per_s", per(static_cast<double>(frame.pixels()), o.render_s)},
      {"moves_per_path", per(static_cast<double>(moved), paths)},
      {"asks_per_path", per(static_cast<double>(asked), paths)},
      {"dropped_messages", dropped},
      {"interrupted", o.interrupted}};
  if (o.shared_variance) out["shared_variance"] = *o.shared_variance;
  // Processor seconds of rendering, and of the engine in it, when the host was this process.
  const auto& e = o.engine_s;
  if (std::any_of(e.begin(), e.end(), [](double s) { return s > 0; })) {
    out["time"]["render_cpu_s"] = o.render_cpu_s;
    out["engine_cpu_s"] = {{"camera", e[0]}, {"trace", e[1]}, {"shade", e[2]}, {"occlusion", e[3]}};
  }
  if (o.model) out["model"] = report_model(o);
  return out;
}

}  // namespace cloudrenderer
