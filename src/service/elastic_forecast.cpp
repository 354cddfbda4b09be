#include <algorithm>

#include "service/elastic.h"

namespace cloudrenderer {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

double weight_of(const ElasticJob& job) { return std::max(job.weight, 1e-9); }

struct Active {
  std::size_t job = 0;
  double left = 0, rate = 0;
};

// Shares `capacity` by weight; who has use for less leaves the rest to the others.
void share_out(std::vector<Active>& active, const std::vector<ElasticJob>& jobs, const std::vector<double>& most, double capacity) {
  std::vector<Active*> open;
  for (Active& a : active) {
    a.rate = 0;
    open.push_back(&a);
  }
  while (!open.empty()) {
    double weights = 0;
    for (const Active* a : open) weights += weight_of(jobs[a->job]);
    const double part = capacity / weights;
    const auto full = std::partition(open.begin(), open.end(), [&](const Active* a) { return weight_of(jobs[a->job]) * part < most[a->job]; });
    if (full == open.end()) {
      for (Active* a : open) a->rate = weight_of(jobs[a->job]) * part;
      return;
    }
    for (auto it = full; it != open.end(); ++it) {
      (*it)->rate = most[(*it)->job];
      capacity = std::max(0.0, capacity - (*it)->rate);
    }
    open.erase(full, open.end());
  }
}

}  // namespace

std::vector<double> forecast(const std::vector<ElasticJob>& jobs, const std::vector<HostGroup>& groups, std::uint32_t at_once) {
  std::vector<double> ends(jobs.size(), kNever), most(jobs.size(), 0), starts{0};
  for (const HostGroup& g : groups) starts.push_back(g.from_s);
  std::ranges::sort(starts);
  starts.erase(std::unique(starts.begin(), starts.end()), starts.end());
  double now = 0, capacity = 0;
  std::size_t next_start = 0, next_job = 0;
  std::vector<Active> active;
  const auto hosts_come = [&] {
    for (; next_start < starts.size() && starts[next_start] <= now; ++next_start)
      for (const HostGroup& g : groups)
        if (g.from_s == starts[next_start]) capacity += g.capacity;
    for (std::size_t i = 0; i < jobs.size(); ++i) {
      most[i] = 0;
      for (const HostGroup& g : groups)
        if (g.from_s <= now && jobs[i].fits(g.memory)) most[i] += g.capacity;
      most[i] = std::min(most[i], jobs[i].most_threads);
    }
  };
  const auto never = [&](const ElasticJob& job) {
    return std::ranges::none_of(groups, [&](const HostGroup& g) { return g.capacity > 0 && job.fits(g.memory); });
  };
  hosts_come();
  for (;;) {
    while (active.size() < at_once && next_job < jobs.size()) {
      if (!never(jobs[next_job])) active.push_back({next_job, std::max(0.0, jobs[next_job].work), 0});
      ++next_job;
    }
    if (active.empty()) return ends;
    share_out(active, jobs, most, capacity);
    double step = next_start < starts.size() ? starts[next_start] - now : kNever;
    for (const Active& a : active)
      if (a.left <= 0)
        step = 0;
      else if (a.rate > 0)
        step = std::min(step, a.left / a.rate);
    if (step == kNever) return ends;  // nobody has anything to work with
    now += step;
    for (Active& a : active) {
      // What is left of rounding is nothing.
      const bool done = a.left <= 0 || (a.rate > 0 && a.left / a.rate <= step * (1 + 1e-12));
      a.left = done ? 0 : a.left - a.rate * step;
      if (done) ends[a.job] = now;
    }
    std::erase_if(active, [&](const Active& a) { return ends[a.job] < kNever; });
    if (next_start < starts.size() && starts[next_start] <= now) hosts_come();
  }
}

}  // namespace cloudrenderer
