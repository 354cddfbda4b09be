#include "cluster/meter.h"

#include <pthread.h>

#include "cluster/usage.h"

namespace cloudrenderer {

Meter::Thread::Thread(Meter& meter, Account* account) : meter_(meter) {
  Known known{account, {}, thread_cpu_seconds()};
  pthread_getcpuclockid(pthread_self(), &known.clock);
  const std::lock_guard lock(meter_.mutex_);
  meter_.threads_.emplace(this, known);
}

Meter::Thread::~Thread() {
  const std::lock_guard lock(meter_.mutex_);
  const Known& known = meter_.threads_.at(this);
  const double used = thread_cpu_seconds() - known.since;
  meter_.finished_cpu_s_ += used;
  if (known.account) {
    known.account->finished_cpu_s += used;
    meter_.accounted_cpu_s_ += used;
  }
  meter_.threads_.erase(this);
}

Meter::Loading::Loading(Meter& meter, Account& account) : meter_(meter), account_(account) {
  const std::lock_guard lock(meter_.mutex_);
  meter_.share_libraries_time();
  meter_.loading_.insert(&account_);
}

Meter::Loading::~Loading() {
  const std::lock_guard lock(meter_.mutex_);
  meter_.share_libraries_time();
  meter_.loading_.erase(meter_.loading_.find(&account_));
}

double Meter::known_cpu_s() const {
  double sum = finished_cpu_s_;
  for (const auto& [thread, known] : threads_) sum += clock_seconds(known.clock) - known.since;
  return sum;
}

void Meter::share_libraries_time() {
  const double known = known_cpu_s();  // first: what comes meanwhile is not shared out
  const double others = clock_seconds(CLOCK_PROCESS_CPUTIME_ID) - known, more = others - others_cpu_s_;
  others_cpu_s_ = others;
  if (loading_.empty() || more <= 0) return;
  for (Account* a : loading_) a->libraries_cpu_s += more / static_cast<double>(loading_.size());
  finished_cpu_s_ += more;
  accounted_cpu_s_ += more;
  others_cpu_s_ -= more;
}

double Meter::unaccounted_cpu_s() {
  const std::lock_guard lock(mutex_);
  share_libraries_time();
  double accounted = accounted_cpu_s_;
  for (const auto& [thread, known] : threads_)
    if (known.account) accounted += clock_seconds(known.clock) - known.since;
  return clock_seconds(CLOCK_PROCESS_CPUTIME_ID) - accounted;
}

double Meter::loading_cpu_s(const Account& account) const {
  const std::lock_guard lock(mutex_);
  return account.libraries_cpu_s + thread_cpu_seconds();
}

double Meter::cpu_s(const Account& account) const {
  const std::lock_guard lock(mutex_);
  double sum = account.finished_cpu_s + account.libraries_cpu_s;
  for (const auto& [thread, known] : threads_)
    if (known.account == &account) sum += clock_seconds(known.clock) - known.since;
  return sum;
}

}  // namespace cloudrenderer
