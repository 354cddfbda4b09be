#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cluster/render.h"

namespace cloudrenderer {

// What viewers may know of a host.
struct HostView {
  std::uint32_t id = 0;
  std::string name, address, version;
  std::uint32_t threads = 0;
  std::uint64_t memory_budget = 0;  // bytes
  double joined_s = 0;              // since the render's start
  std::optional<double> left_s;
  bool lost = false;
  double paths_done = 0;
  std::vector<std::uint32_t> parts;  // that it holds, ascending
  wire::Status status;               // its last one
};

// The error, and what it has cost, at one time.
struct CostPoint {
  double render_s = 0, spp = 0;
  double host_s = 0;  // hosts times the time that they were there
  double cpu_s = 0;   // processor time of the hosts
  double estimated_relmse = 0;
};

// A job as it was at one time: plain values, which any thread may read.
struct JobView {
  std::string scene, phase, waiting_for;
  std::uint32_t width = 0, height = 0, spp = 0, parts = 0;
  std::uint64_t triangles = 0;
  RenderProgress progress;
  ManagerCore::Progress core;
  bool bit_exact = true;
  std::vector<HostView> hosts;
  std::vector<CostPoint> history;  // ascending in time
};

JobView job_view(const std::string& scene, const RenderView& view);
nlohmann::ordered_json to_json(const JobView& job);
nlohmann::ordered_json progress_json(const JobView& job);  // of that, what fits into a line
// In Prometheus's text format.
std::string metrics_text(const JobView& job);

// A history that stays short: when it has grown to 512 points every second one goes.
void add_point(std::vector<CostPoint>& history, const CostPoint& point);
CostPoint cost_point(const JobView& job);

}  // namespace cloudrenderer
