#pragma once
// What the service knows of its jobs and hosts, in the terms of service/elastic.h.
#include <map>
#include <set>
#include <string>
#include <vector>

#include "service/elastic.h"
#include "service/frame_hosts.h"
#include "service/job.h"
#include "service/prices.h"
#include "service/scheduler.h"

namespace cloudrenderer {

// How far a running frame is, as its manager says.
struct FrameProgress {
  double paths_done = 0, paths_total = 0;
  std::map<std::string, std::uint64_t> lone_parts;  // by name of a host: parts that no other host holds
  std::string phase = {};
  std::uint32_t hosts = 0;
  std::optional<double> estimated_relmse = {};
  double share() const { return paths_total > 0 ? paths_done / paths_total : 0; }
  bool operator==(const FrameProgress&) const = default;
};
using ProgressOf = std::map<FrameRef, FrameProgress>;

// Paths of a frame of which nothing is done; none: its picture's size is not known yet.
std::optional<double> paths_of(const RenderSettings& settings, const FrameNeeds& needs);

// The jobs that have not ended, as they will be served: those that run first, then by priority and age. Work is what is
// left of the paths, times what a path has cost so far: in this job, in other jobs of the scene, in all that is known, or
// (before anything is) a guess. `limits` of the users, for budgets and weights.
std::vector<ElasticJob> elastic_jobs(const std::map<std::uint64_t, Job>& jobs, const ProgressOf& progress,
                                     const std::map<std::string, UserLimits>& limits, std::uint32_t frames_at_once);

std::vector<ElasticHost> elastic_hosts(const std::map<std::uint64_t, ServiceHost>& hosts, const ProgressOf& progress);

// Kinds that can be had: those of the price table, or else all that have ever been there, of which `seen` is the memory.
std::vector<HostKind> host_kinds(const std::optional<PriceTable>& prices, const std::map<std::uint64_t, ServiceHost>& hosts,
                                 std::map<std::string, HostKind>& seen);

}  // namespace cloudrenderer
