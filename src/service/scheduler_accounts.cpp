// What users have used, what is theirs, and what is kept of jobs that are gone.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "service/scheduler.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kRemembered = 4096;  // jobs that were removed
constexpr double kStepsOfAWeight = 8;  // to twice of it; so that hosts do not get new orders all the time

bool over(const std::optional<double>& budget, double cost) { return budget && cost > *budget; }

}  // namespace

// How much of its share a user has used lately: who has least is next.
double Scheduler::turn(const std::string& user, double now) const {
  const auto found = accounts_.find(user);
  if (found == accounts_.end()) return 0;
  return found->second.used_lately * std::exp2((found->second.at - now) / options_.half_life_s) / limits(user).share;
}

void Scheduler::used(FrameRef ref, const Usage& usage) {
  const auto found = jobs_.find(ref.job);
  if (found == jobs_.end()) {  // the last words of hosts about a job that its user has removed at once
    if (const auto owner = removed_.find(ref.job); owner != removed_.end()) accounts_[owner->second].past.add(usage);
    return;
  }
  found->second.frames.at(ref.frame).usage.add(usage);
  changed_.insert(ref.job);
  accounts_[found->second.request.user].used_lately += usage.cpu_s + usage.service_cpu_s;
  fair_.used(found->second.request.user, usage.cpu_s);
}

void Scheduler::restore(std::map<std::string, UserAccount> accounts, std::uint64_t next_id) {
  accounts_ = std::move(accounts);
  next_id_ = std::max(next_id_, next_id);
}

bool Scheduler::has_ended(std::uint64_t id) const {
  return is_final(jobs_.at(id).state) && std::ranges::all_of(jobs_.at(id).frames, [](const JobFrame& f) {
           return f.state != FrameState::running && f.state != FrameState::splitting;
         });
}

void Scheduler::remove(std::uint64_t id) {
  const Job& job = jobs_.at(id);
  accounts_[job.request.user].past.add(job.usage());
  removed_[id] = job.request.user;
  if (removed_.size() > kRemembered) removed_.erase(removed_.begin());
  changed_.erase(id);
  jobs_.erase(id);
}

void Scheduler::age_accounts(double now) {
  for (auto& [user, a] : accounts_) {
    if (a.at > 0) a.used_lately *= std::exp2((a.at - now) / options_.half_life_s);
    a.at = now;
  }
}

void Scheduler::look_at_budgets(double now) {
  const std::map<std::string, Usage> users = usage();
  for (auto& [id, job] : jobs_) {
    if (is_final(job.state) || job.state == JobState::paused) continue;
    const double cost = job.usage().cost;
    const bool own = over(job.request.budget, cost);
    const auto& budget = limits(job.request.user).budget;
    if (!own && !over(budget, users.at(job.request.user).cost)) continue;
    const std::string reason = own ? fmt::format("the job's budget of {:.6g} is used up", *job.request.budget)
                                   : fmt::format("the budget of {}, {:.6g}, is used up", job.request.user, *budget);
    job.over_budget = true;
    job.state = job.request.ask ? JobState::paused : JobState::failed;
    if (!job.request.ask) job.ended = now;
    job.reason = reason + "; the job can be resumed when it is raised";
    changed_.insert(id);
    for (std::uint32_t i = 0; i < job.frames.size(); ++i) {
      const FrameRef ref{id, i};
      if (running_.contains(ref)) stop(ref, Stop::budget);
    }
  }
}

// Of the processors, of users with frames that run or could: the share times what their priorities make of it.
std::map<std::string, double> Scheduler::parts() const {
  struct Frames {
    double running = 0, ready = 0, weight = 0, weight_ready = 0;
  };
  std::map<std::string, Frames> users;
  for (const auto& [id, job] : jobs_) {
    if (is_final(job.state) || job.state == JobState::paused) continue;
    Frames& u = users[job.request.user];
    const double weight = std::exp2(job.request.priority);
    for (const JobFrame& f : job.frames) {
      u.running += f.state == FrameState::running;
      u.weight += f.state == FrameState::running ? weight : 0;
      u.ready += f.state == FrameState::ready;
      u.weight_ready += f.state == FrameState::ready ? weight : 0;
    }
  }
  std::map<std::string, double> out;
  for (const auto& [user, u] : users)
    if (u.running + u.ready > 0) out[user] = limits(user).share * (u.running > 0 ? u.weight / u.running : u.weight_ready / u.ready);
  return out;
}

std::map<FrameRef, Scheduler::Portion> Scheduler::portions(const std::set<FrameRef>* at_work) const {
  const auto counts = [&](FrameRef ref) { return !at_work || at_work->contains(ref); };
  std::map<std::string, std::uint32_t> frames;
  for (const auto& [ref, run] : running_)
    if (counts(ref)) ++frames[jobs_.at(ref.job).request.user];
  std::map<FrameRef, Portion> out;
  for (const auto& [ref, run] : running_) {
    if (!counts(ref)) continue;
    const JobRequest& r = jobs_.at(ref.job).request;
    const double factor = std::exp2(std::round(kStepsOfAWeight * std::log2(fair_.factor(r.user))) / kStepsOfAWeight);
    out[ref] = {factor * limits(r.user).share * std::exp2(r.priority) / frames.at(r.user), static_cast<double>(run.slots) / options_.slots,
                jobs_.at(ref.job).frames.at(ref.frame).needs->least()};
  }
  return out;
}

std::map<std::string, Usage> Scheduler::usage() const {
  std::map<std::string, Usage> out;
  for (const auto& [user, limit] : users_) out[user];
  for (const auto& [user, account] : accounts_) out[user].add(account.past);
  for (const auto& [id, job] : jobs_) out[job.request.user].add(job.usage());
  return out;
}

}  // namespace cloudrenderer
