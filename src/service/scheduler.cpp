#include "service/scheduler.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <tuple>

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kFramesOfAJob = 2;  // at once: the parts that they share stay loaded

std::string gigabytes(std::uint64_t bytes) { return fmt::format("{:.4g} MiB", static_cast<double>(bytes) / (1 << 20)); }

}  // namespace

const Job* Scheduler::find(std::uint64_t id) const {
  const auto found = jobs_.find(id);
  return found == jobs_.end() ? nullptr : &found->second;
}

const UserLimits& Scheduler::limits(const std::string& user) const {
  static const UserLimits kGone{1, 0, {}, 0};  // no longer in the list: jobs end as others do
  const auto found = users_.find(user);
  return found == users_.end() ? kGone : found->second;
}

void Scheduler::restore(Job job) {
  for (JobFrame& f : job.frames) {
    if (f.state == FrameState::splitting) f.state = FrameState::waiting;
    if (f.state == FrameState::running) {
      f.state = FrameState::ready;
      f.attempts -= f.attempts > 0;  // the service's end is not the frame's fault
      f.not_before = 0;
    }
  }
  if (job.state == JobState::running) job.state = JobState::queued;
  next_id_ = std::max(next_id_, job.id + 1);
  jobs_[job.id] = std::move(job);
}

Result<std::uint64_t> Scheduler::submit(JobRequest request, double now) {
  using Submitted = Result<std::uint64_t>;
  const UserLimits& user = limits(request.user);
  if (const auto wrong = refuse_priority(request.priority, request.user)) return Submitted::failure(*wrong);
  const auto open = std::ranges::count_if(jobs_, [&](const auto& j) {
    return j.second.request.user == request.user && !is_final(j.second.state);
  });
  if (open >= user.jobs) return Submitted::failure(fmt::format("you have {} jobs that have not ended; more are not taken", open));
  Job job;
  job.id = next_id_++;
  job.submitted = now;
  for (const std::string& file : request.files) {
    job.frames.emplace_back();
    job.frames.back().file = file;
  }
  if (request.deadline) job.deadline = request.deadline->at(now);
  job.request = std::move(request);
  changed_.insert(job.id);
  const std::uint64_t id = job.id;
  jobs_[id] = std::move(job);
  return id;
}

std::optional<std::string> Scheduler::refuse_priority(int priority, const std::string& user) const {
  const int most = std::min(limits(user).priority_limit, kHighestPriority);
  if (priority > most) return fmt::format("your jobs may have a priority of {} at most, got {}", most, priority);
  if (priority < kLowestPriority) return fmt::format("the priority must be {} to {}, got {}", kLowestPriority, kHighestPriority, priority);
  return std::nullopt;
}

std::optional<std::string> Scheduler::set_priority(std::uint64_t id, int priority, const std::string& user) {
  if (auto wrong = refuse_priority(priority, user)) return wrong;
  jobs_.at(id).request.priority = priority;
  changed_.insert(id);
  return std::nullopt;
}

bool Scheduler::cancel(std::uint64_t id, double now) {
  Job& job = jobs_.at(id);
  if (is_final(job.state)) return false;
  job.state = JobState::cancelled;
  job.reason = "cancelled";
  end_job(job, now);
  return true;
}

// Nothing of the job runs on. Frames that do not run end here; the others when their process has.
void Scheduler::end_job(Job& job, double now) {
  job.ended = now;
  changed_.insert(job.id);
  for (std::uint32_t i = 0; i < job.frames.size(); ++i) {
    JobFrame& f = job.frames[i];
    const FrameRef ref{job.id, i};
    if (f.state == FrameState::running || f.state == FrameState::splitting)
      stop(ref, Stop::cancel);
    else if (!is_final(f.state))
      f.state = FrameState::cancelled;
  }
}

void Scheduler::fail_job(Job& job, const std::string& reason, double now) {
  job.state = JobState::failed;
  job.reason = reason;
  end_job(job, now);
}

bool Scheduler::resume(std::uint64_t id, std::optional<double> budget) {
  Job& job = jobs_.at(id);
  if (!job.over_budget || job.state == JobState::cancelled) return false;
  job.over_budget = false;
  if (budget) job.request.budget = budget;
  job.ended.reset();
  job.state = JobState::queued;
  job.reason.clear();
  changed_.insert(id);
  return true;
}

void Scheduler::stop(FrameRef ref, Stop why) {
  if (splitting_.contains(ref)) {
    actions_.push_back({Action::What::kill, ref});
    return;
  }
  const auto found = running_.find(ref);
  if (found == running_.end()) return;
  Run& run = found->second;
  // A stronger reason takes the place of a weaker one.
  if (run.stop == Stop::no || why == Stop::cancel) run.stop = why;
  actions_.push_back({why == Stop::timeout ? Action::What::kill : Action::What::stop, ref});
}

void Scheduler::split_ended(FrameRef ref, const FrameEnd& end, const FrameNeeds& needs, double now) {
  splitting_.erase(ref);
  Job& job = jobs_.at(ref.job);
  JobFrame& f = frame_at(ref);
  changed_.insert(ref.job);
  if (is_final(job.state) && !job.over_budget) {
    f.state = FrameState::cancelled;
    return;
  }
  if (end.how != FrameEnd::How::done) {
    f.reason = end.reason;
    ++f.attempts;
    const bool again = end.how != FrameEnd::How::hopeless && f.attempts <= job.request.retries;
    f.state = again ? FrameState::waiting : FrameState::failed;
    f.not_before = now + options_.retry_after_s * std::exp2(f.attempts - 1);
    if (!again) f.ended = now;
    update(job, now);
    return;
  }
  f.needs = needs;
  f.state = FrameState::ready;
  if (!hosts_.empty() && needs.least() > std::max(largest_host(), largest_to_come_)) {
    f.reason = fmt::format(
        "it cannot fit: the main scene takes {}, its largest part {} while it is loaded, and the largest of {} hosts has {}; smaller parts "
        "(part_size) may help",
        gigabytes(needs.main_bytes), gigabytes(needs.largest_bytes), hosts_.size(), gigabytes(largest_host()));
    f.state = FrameState::failed;
    f.ended = now;
  }
  if (job.state == JobState::checking && f.state == FrameState::ready) job.state = JobState::queued;
  update(job, now);
}

void Scheduler::frame_ended(FrameRef ref, const FrameEnd& end, double now) {
  const auto found = running_.find(ref);
  if (found == running_.end()) return;
  const Stop why = found->second.stop;
  running_.erase(found);
  Job& job = jobs_.at(ref.job);
  JobFrame& f = frame_at(ref);
  changed_.insert(ref.job);
  if (end.how == FrameEnd::How::done) {  // whatever was asked of it meanwhile
    f.state = FrameState::done;
    f.reason = end.reason;
    f.ended = now;
  } else if (why == Stop::make_room || why == Stop::budget) {
    f.state = FrameState::ready;
    --f.attempts;
  } else if (is_final(job.state)) {
    f.state = FrameState::cancelled;
    f.ended = now;
  } else {
    f.reason = why == Stop::timeout ? fmt::format("it took longer than {:g} s", *job.request.timeout_s) : end.reason;
    const bool again = end.how != FrameEnd::How::hopeless && f.attempts <= job.request.retries;
    f.state = again ? FrameState::ready : FrameState::failed;
    f.not_before = now + options_.retry_after_s * std::exp2(f.attempts - 1);
    if (!again) f.ended = now;
  }
  update(job, now);
}

// The job's state from its frames'.
void Scheduler::update(Job& job, double now) {
  if (is_final(job.state) || job.state == JobState::paused) return;
  const auto count = [&](auto wanted) { return std::ranges::count_if(job.frames, wanted); };
  const auto open = count([](const JobFrame& f) { return !is_final(f.state); });
  if (open == 0) {
    const auto failed = count([](const JobFrame& f) { return f.state == FrameState::failed; });
    job.state = failed > 0 ? JobState::failed : JobState::done;
    job.ended = now;
    job.reason.clear();
    if (failed > 0) {
      const auto first = std::ranges::find(job.frames, FrameState::failed, &JobFrame::state);
      job.reason = job.frames.size() == 1 ? first->reason : fmt::format("{} of {} frames have failed; {}: {}", failed, job.frames.size(), first->file, first->reason);
    }
  } else if (running_of(job.id) > 0) {
    job.state = JobState::running;
  } else if (job.state == JobState::running) {
    job.state = JobState::queued;
  }
  changed_.insert(job.id);
}

std::uint64_t Scheduler::largest_host() const { return hosts_.empty() ? 0 : *std::ranges::max_element(hosts_); }

std::uint32_t Scheduler::slots_for(const JobFrame& f) const {
  const double slot = static_cast<double>(largest_host()) / options_.slots;
  const double needed = f.needs ? static_cast<double>(f.needs->least()) : 0;
  return static_cast<std::uint32_t>(std::clamp(std::ceil(needed / std::max(slot, 1.0)), 1.0, options_.slots + 1.0));
}

std::uint32_t Scheduler::slots_taken(const std::string* user) const {
  std::uint32_t sum = 0;
  for (const auto& [ref, run] : running_)
    if (!user || jobs_.at(ref.job).request.user == *user) sum += run.slots;
  return sum;
}

std::uint32_t Scheduler::running_of(std::uint64_t job) const {
  return static_cast<std::uint32_t>(std::ranges::count_if(running_, [&](const auto& r) { return r.first.job == job; }));
}

std::optional<FrameRef> Scheduler::next_frame(const Job& job, FrameState state, double now) const {
  for (std::uint32_t i = 0; i < job.frames.size(); ++i)
    if (job.frames[i].state == state && job.frames[i].not_before <= now) return FrameRef{job.id, i};
  return std::nullopt;
}

// Jobs that want something, the first to be served first: by priority, then by what their users have running and have
// used for their shares, then by age. Of the places that the jobs of one user and priority have so, the nearest deadline
// takes the first: it gives nobody a turn over other users, or everybody would have one.
std::vector<std::uint64_t> Scheduler::queue(double now) const {
  using Key = std::tuple<int, double, double, std::uint64_t>;
  std::vector<std::pair<Key, const Job*>> keyed;
  std::map<std::pair<std::string, int>, std::deque<const Job*>> equals;
  for (const auto& [id, job] : jobs_) {
    if (is_final(job.state) || job.state == JobState::paused) continue;
    const std::string& user = job.request.user;
    keyed.push_back({{-job.request.priority, slots_taken(&user) / limits(user).share, turn(user, now), id}, &job});
    equals[{user, job.request.priority}].push_back(&job);
  }
  std::ranges::sort(keyed);
  const auto deadline = [](const Job* job) { return job->deadline.value_or(std::numeric_limits<double>::infinity()); };
  for (auto& [of, jobs] : equals) std::ranges::stable_sort(jobs, {}, deadline);
  std::vector<std::uint64_t> out;
  for (const auto& [key, place] : keyed) {
    auto& jobs = equals.at({place->request.user, place->request.priority});
    out.push_back(jobs.front()->id);
    jobs.pop_front();
  }
  return out;
}

void Scheduler::start_splits(double now) {
  // One frame ahead of what runs, so that hosts need not wait.
  for (const std::uint64_t id : queue(now)) {
    if (splitting_.size() >= options_.splits) return;
    Job& job = jobs_.at(id);
    const bool ahead = std::ranges::any_of(job.frames, [](const JobFrame& f) { return f.state == FrameState::ready || f.state == FrameState::splitting; });
    const auto ref = next_frame(job, FrameState::waiting, now);
    if (!ref || ahead) continue;
    frame_at(*ref).state = FrameState::splitting;
    splitting_.insert(*ref);
    changed_.insert(id);
    actions_.push_back({Action::What::split, *ref});
  }
}

void Scheduler::start_frames(double now) {
  if (hosts_.empty()) return;
  for (bool started = true; started;) {
    started = false;
    for (const std::uint64_t id : queue(now)) {
      Job& job = jobs_.at(id);
      const auto ref = next_frame(job, FrameState::ready, now);
      if (!ref || running_of(id) >= kFramesOfAJob) continue;
      JobFrame& f = frame_at(*ref);
      const std::uint32_t slots = slots_for(f);
      if (slots > options_.slots) {
        const std::string why = fmt::format("waits for a host with {} of memory; the largest of {} has {}", gigabytes(f.needs->least()),
                                            hosts_.size(), gigabytes(largest_host()));
        if (f.reason != why) changed_.insert(id);
        f.reason = why;
        continue;
      }
      // Nobody smaller slips past who is first, or large frames would wait for ever.
      if (slots_taken() + slots > options_.slots) return;
      f.state = FrameState::running;
      f.started = now;
      f.reason.clear();
      ++f.attempts;
      if (!job.started) job.started = now;
      running_[*ref] = {slots, Stop::no, false};
      actions_.push_back({Action::What::start, *ref});
      update(job, now);
      started = true;
      break;  // the order has changed
    }
  }
}

// A user with nothing running has waited long enough, and another one has more than one frame, or of a lower priority:
// one of these is set aside, and goes on from its checkpoint later.
void Scheduler::make_room(double now) {
  std::map<std::string, FrameRef> wanting;  // users without a running frame
  for (const std::uint64_t id : queue(now)) {
    const Job& job = jobs_.at(id);
    const auto ref = next_frame(job, FrameState::ready, now);
    if (ref && slots_for(frame_at(*ref)) <= options_.slots && slots_taken(&job.request.user) == 0) wanting.try_emplace(job.request.user, *ref);
  }
  std::erase_if(waits_since_, [&](const auto& w) { return !wanting.contains(w.first); });
  const bool leaving = std::ranges::any_of(running_, [](const auto& r) { return r.second.stop != Stop::no; });
  for (const auto& [user, ref] : wanting) {
    double& since = waits_since_.try_emplace(user, now).first->second;
    if (leaving || hosts_.empty() || now < since + options_.patience_s) continue;
    const int priority = jobs_.at(ref.job).request.priority;
    std::optional<std::pair<double, FrameRef>> worst;
    for (const auto& [other, run] : running_) {
      const JobRequest& r = jobs_.at(other.job).request;
      const bool has_more = slots_taken(&r.user) > run.slots;
      if (r.priority > priority || (r.priority == priority && !has_more)) continue;
      const double excess = slots_taken(&r.user) / limits(r.user).share;
      if (!worst || excess >= worst->first) worst = {excess, other};  // of equals the latest frame
    }
    if (!worst) continue;
    stop(worst->second, Stop::make_room);
    since = now;
    return;
  }
}

void Scheduler::tick(double now) {
  age_accounts(now);
  for (auto& [ref, run] : running_) {
    const Job& job = jobs_.at(ref.job);
    const JobFrame& f = job.frames.at(ref.frame);
    if (run.stop == Stop::no && job.request.timeout_s && now > *f.started + *job.request.timeout_s) stop(ref, Stop::timeout);
  }
  look_at_budgets(now);
  start_splits(now);
  start_frames(now);
  make_room(now);
  fair_.tick(now, parts());
}

}  // namespace cloudrenderer
