#include "service/elastic_input.h"

#include <algorithm>
#include <cmath>

namespace cloudrenderer {
namespace {

constexpr double kGuessedCost = 2e-6;    // processor seconds of a path; simple scenes take a fifth of it
constexpr double kGuessedPaths = 1e8;    // of a frame that has not been split yet
constexpr double kEnoughPaths = 200'000; // done, so that what loading took is no longer most of their cost
constexpr double kPathsOfAThread = 16'384;  // a batch: a thread with less to do is not kept busy
constexpr std::size_t kFramesOfAJob = 2;    // that run at once

struct Cost {
  double cpu_s = 0, paths = 0;
  bool known() const { return paths >= kEnoughPaths && cpu_s > 0; }
  double of_a_path() const { return cpu_s / paths; }
  void add(const Cost& o) { cpu_s += o.cpu_s, paths += o.paths; }
};

const FrameProgress* progress_of(const ProgressOf& all, FrameRef ref) {
  const auto found = all.find(ref);
  return found == all.end() ? nullptr : &found->second;
}

Cost cost_of(const Job& job, const ProgressOf& progress) {
  Cost sum;
  for (std::uint32_t i = 0; i < job.frames.size(); ++i) {
    const JobFrame& f = job.frames[i];
    if (f.state == FrameState::done && f.needs)
      sum.add({f.usage.cpu_s, paths_of(job.request.settings, *f.needs).value_or(0)});
    else if (const FrameProgress* p = f.state == FrameState::running ? progress_of(progress, {job.id, i}) : nullptr)
      sum.add({f.usage.cpu_s, p->paths_done});
  }
  return sum;
}

}  // namespace

std::optional<double> paths_of(const RenderSettings& s, const FrameNeeds& needs) {
  if (needs.pixels == 0 || needs.spp == 0) return std::nullopt;
  double pixels = s.width && s.height ? static_cast<double>(*s.width) * *s.height : static_cast<double>(needs.pixels);
  if (s.crop) pixels *= ((*s.crop)[1] - (*s.crop)[0]) * ((*s.crop)[3] - (*s.crop)[2]);
  return pixels * s.spp.value_or(needs.spp);
}

std::vector<ElasticJob> elastic_jobs(const std::map<std::uint64_t, Job>& jobs, const ProgressOf& progress,
                                     const std::map<std::string, UserLimits>& limits, std::uint32_t frames_at_once) {
  Cost all;
  std::map<std::uint64_t, Cost> by_job;
  std::map<std::string, Cost> by_scene;
  std::map<std::string, double> money;  // that users have spent
  for (const auto& [id, job] : jobs) {
    const Cost cost = by_job[id] = cost_of(job, progress);
    by_scene[job.request.scene].add(cost);
    all.add(cost);
    money[job.request.user] += job.usage().cost;
  }
  std::vector<ElasticJob> out;
  for (const auto& [id, job] : jobs) {
    if (is_final(job.state) || job.state == JobState::paused) continue;
    const Cost &own = by_job[id], &scene = by_scene[job.request.scene];
    const double each = own.known() ? own.of_a_path() : scene.known() ? scene.of_a_path() : all.known() ? all.of_a_path() : kGuessedCost;
    ElasticJob e;
    e.id = id;
    e.measured = own.known() || scene.known();
    e.deadline = job.deadline;
    e.memory_part = 1.0 / std::max(1u, frames_at_once);
    e.most_threads = 0;
    std::size_t open = 0;
    std::optional<double> others;  // paths of a frame of the job
    for (const JobFrame& f : job.frames)
      if (f.needs && !others) others = paths_of(job.request.settings, *f.needs);
    for (std::uint32_t i = 0; i < job.frames.size(); ++i) {
      const JobFrame& f = job.frames[i];
      if (is_final(f.state)) continue;
      const FrameProgress* p = f.state == FrameState::running ? progress_of(progress, {id, i}) : nullptr;
      const auto said = f.needs ? paths_of(job.request.settings, *f.needs) : others;
      const double paths = p && p->paths_total > 0 ? std::max(0.0, p->paths_total - p->paths_done) : said.value_or(kGuessedPaths);
      e.work += paths * each;
      if (open++ < kFramesOfAJob) e.most_threads += std::max(1.0, paths / kPathsOfAThread);
      if (!f.needs) continue;
      e.least_memory = std::max(e.least_memory, f.needs->least());
      if (f.needs->bytes > e.bytes) e.bytes = f.needs->bytes, e.main_bytes = f.needs->main_bytes;
    }
    if (open == 0) continue;
    const auto user = limits.find(job.request.user);
    const UserLimits none, &l = user == limits.end() ? none : user->second;
    e.weight = l.share * std::exp2(job.request.priority);
    if (job.request.budget) e.money = *job.request.budget - job.usage().cost;
    if (l.budget) e.money = std::min(e.money.value_or(std::numeric_limits<double>::infinity()), *l.budget - money[job.request.user]);
    out.push_back(e);
  }
  std::ranges::stable_sort(out, [&](const ElasticJob& a, const ElasticJob& b) {
    const auto key = [&](const ElasticJob& e) {
      const Job& j = jobs.at(e.id);
      return std::pair(j.state != JobState::running, -j.request.priority);
    };
    return key(a) < key(b);
  });
  return out;
}

std::vector<ElasticHost> elastic_hosts(const std::map<std::uint64_t, ServiceHost>& hosts, const ProgressOf& progress) {
  std::map<std::string, std::uint64_t> lone;
  for (const auto& [ref, p] : progress)
    for (const auto& [name, parts] : p.lone_parts) lone[name] += parts;
  std::vector<ElasticHost> out;
  for (const auto& [id, h] : hosts) {
    if (!h.here) continue;
    ElasticHost e{id, h.kind, h.threads, h.memory, 0, h.working, h.memory_used};
    if (const auto found = lone.find(h.name); found != lone.end()) e.lone_parts = found->second;
    out.push_back(e);
  }
  return out;
}

std::vector<HostKind> host_kinds(const std::optional<PriceTable>& prices, const std::map<std::uint64_t, ServiceHost>& hosts,
                                 std::map<std::string, HostKind>& seen) {
  for (const auto& [id, h] : hosts) {
    const auto [at, is_new] = seen.try_emplace(h.kind);
    if (!is_new) continue;
    at->second.name = h.kind;
    at->second.threads = h.threads;
    at->second.memory = h.memory;
    at->second.price = prices ? prices->an_hour(h.kind) : 0;
  }
  std::vector<HostKind> out;
  if (prices)
    for (const auto& [name, said] : prices->kinds()) {
      const auto found = seen.find(name);
      HostKind kind = found == seen.end() ? HostKind{} : found->second;
      kind.name = name;
      kind.price = said.price;
      kind.threads = said.threads.value_or(kind.threads);
      kind.memory = said.memory.value_or(kind.memory);
      kind.speed = said.speed;
      kind.least = said.least;
      kind.most = said.most.value_or(kind.most);
      out.push_back(kind);
    }
  if (out.empty())
    for (const auto& [name, kind] : seen) out.push_back(kind);
  if (out.empty()) out.emplace_back();  // any
  return out;
}

}  // namespace cloudrenderer
