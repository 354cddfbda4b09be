#include "cluster/compute_gate.h"

#include <algorithm>

#include "cluster/usage.h"

namespace cloudrenderer {
namespace {

// Processor seconds that a job may lag behind when it comes back: who has nothing to do for a
// moment, while answers are on their way, is not idle.
constexpr double kMayLag = 0.1;
constexpr double kNewest = 0.25;  // weight of the last turn in what a turn takes

}  // namespace

GateCore::Job GateCore::add(double weight) {
  State& s = jobs_[++last_];
  s.weight = weight;
  s.pass = now_;
  return last_;
}

void GateCore::set_weight(Job job, double weight) { jobs_.at(job).weight = weight; }
void GateCore::remove(Job job) { jobs_.erase(job); }

void GateCore::want(Job job) {
  State& s = jobs_.at(job);
  if (s.waiting++ == 0 && s.running == 0) s.pass = std::max(s.pass, now_ - kMayLag / s.weight);
}

std::optional<GateCore::Job> GateCore::next() {
  if (busy_ == slots_) return std::nullopt;
  auto best = jobs_.end();
  for (auto it = jobs_.begin(); it != jobs_.end(); ++it)
    if (it->second.waiting != 0 &&
        (best == jobs_.end() || it->second.foreseen() < best->second.foreseen()))
      best = it;
  if (best == jobs_.end()) return std::nullopt;
  State& s = best->second;
  now_ = std::max(now_, s.foreseen());
  --s.waiting;
  ++s.running;
  ++busy_;
  return best->first;
}

void GateCore::done(Job job, double cpu_s) {
  State& s = jobs_.at(job);
  --s.running;
  --busy_;
  s.pass += cpu_s / s.weight;
  s.turn_s += kNewest * (cpu_s - s.turn_s);
}

void GateCore::charge(Job job, double cpu_s) {
  State& s = jobs_.at(job);
  s.pass += cpu_s / s.weight;
}

ComputeGate::Job ComputeGate::add(double weight) {
  const std::lock_guard lock(mutex_);
  const Job job = core_.add(weight);
  waiting_.try_emplace(job);
  return job;
}

void ComputeGate::set_weight(Job job, double weight) {
  const std::lock_guard lock(mutex_);
  core_.set_weight(job, weight);
}

void ComputeGate::remove(Job job) {
  const std::lock_guard lock(mutex_);
  core_.remove(job);
  waiting_.erase(job);
}

void ComputeGate::charge(Job job, double cpu_s) {
  const std::lock_guard lock(mutex_);
  core_.charge(job, cpu_s);
}

void ComputeGate::hand_out() {
  while (const auto job = core_.next()) {
    Waiting& w = waiting_.at(*job);
    ++w.granted;
    w.turn.notify_one();
  }
}

void ComputeGate::Slot::take() {
  if (gate_ == nullptr) return;
  std::unique_lock lock(gate_->mutex_);
  if (held_) gate_->core_.done(job_, thread_cpu_seconds() - since_);
  gate_->core_.want(job_);
  gate_->hand_out();
  Waiting& w = gate_->waiting_.at(job_);
  w.turn.wait(lock, [&] { return w.granted != 0; });
  --w.granted;
  held_ = true;
  since_ = thread_cpu_seconds();
}

void ComputeGate::Slot::give_back() {
  if (!held_) return;
  const std::lock_guard lock(gate_->mutex_);
  gate_->core_.done(job_, thread_cpu_seconds() - since_);
  held_ = false;
  gate_->hand_out();
}

}  // namespace cloudrenderer
