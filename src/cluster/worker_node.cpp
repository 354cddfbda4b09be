#include "cluster/worker_node.h"

#include <limits>

#include "base/log.h"

namespace cloudrenderer {
namespace {

constexpr double kCountEvery = 0.2;

std::optional<Meter::Thread> metered(const std::shared_ptr<JobSeat>& seat) {
  return seat ? std::optional<Meter::Thread>(std::in_place, seat->host().meter, &seat->account())
              : std::nullopt;
}

}  // namespace

WorkerNode::WorkerNode(HostId self, std::uint64_t incarnation, const WorkerOptions& options,
                       SceneLoader& loader, const Clock& clock, Callbacks callbacks,
                       std::shared_ptr<JobSeat> seat)
    : loader_(loader),
      clock_(clock),
      callbacks_(std::move(callbacks)),
      seat_(std::move(seat)),
      core_(self, incarnation, options),
      announced_(std::numeric_limits<double>::infinity()) {
  for (std::uint32_t i = 0; i < options.threads; ++i) threads_.emplace_back([this] { compute(); });
  threads_.emplace_back([this] { load(); });
}

WorkerNode::~WorkerNode() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_.notify_all();
  load_work_.notify_all();
  for (std::thread& t : threads_) t.join();
}

void WorkerNode::receive(HostId from, wire::Message message) {
  std::unique_lock lock(mutex_);
  // The report that ends a job carries the driver's counters of this moment.
  if (std::holds_alternative<wire::JobEnd>(message) ||
      std::holds_alternative<wire::CancelJob>(message))
    count();
  core_.receive(from, std::move(message), clock_.now());
  after(lock);
}

double WorkerNode::tick() {
  std::unique_lock lock(mutex_);
  const double now = clock_.now();
  if (now > counted_ + kCountEvery) {
    counted_ = now;
    count();
  }
  core_.tick(now);
  announced_ = std::numeric_limits<double>::infinity();
  const double deadline = core_.deadline();
  announced_ = deadline;
  after(lock);
  return deadline;
}

void WorkerNode::peer_unreachable(HostId peer) {
  std::unique_lock lock(mutex_);
  core_.peer_unreachable(peer);
  after(lock);
}

void WorkerNode::peer_reachable(HostId peer) {
  std::unique_lock lock(mutex_);
  core_.peer_reachable(peer);
  after(lock);
}

void WorkerNode::leave(const std::string& reason) {
  std::unique_lock lock(mutex_);
  core_.leave(reason);
  after(lock);
}

bool WorkerNode::left() const {
  const std::lock_guard lock(mutex_);
  return core_.left();
}

bool WorkerNode::new_hosts(std::uint64_t& version, std::vector<wire::HostEntry>& hosts) const {
  const std::lock_guard lock(mutex_);
  if (core_.hosts_version() == version) return false;
  version = core_.hosts_version();
  hosts = core_.hosts();
  return true;
}

void WorkerNode::after(std::unique_lock<std::mutex>& lock) {
  if (core_.has_work()) work_.notify_one();
  if (core_.has_load_work()) load_work_.notify_one();
  WorkerCore::Outbox more = core_.take_outbox();
  std::move(more.begin(), more.end(), std::back_inserter(outgoing_));
  const double deadline = core_.deadline();
  const bool earlier = deadline < announced_;
  if (earlier) announced_ = deadline;
  if (!draining_ && !outgoing_.empty()) {
    draining_ = true;
    while (!outgoing_.empty()) {
      WorkerCore::Outbox batch = std::exchange(outgoing_, {});
      lock.unlock();
      for (auto& [to, message] : batch) callbacks_.deliver(to, std::move(message));
      batch.clear();
      lock.lock();
    }
    draining_ = false;
  }
  if (earlier) {
    lock.unlock();
    callbacks_.deadline(deadline);
    lock.lock();
  }
}

void WorkerNode::count() {
  DriverCounters c = callbacks_.counters();
  c.drained = c.drained && outgoing_.empty() && !draining_;
  core_.set_driver_counters(c);
}

void WorkerNode::compute() {
  prepare_compute_thread();
  const auto meter = metered(seat_);
  std::optional<ComputeGate::Slot> slot;
  if (seat_) slot.emplace(seat_->host().gate, seat_->gate_job());
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    // What is taken is not left waiting for a slot: by then there may be deeper work.
    if (slot && core_.has_work()) {
      lock.unlock();
      slot->take();
      lock.lock();
      if (stopping_) break;
    }
    std::optional<Work> work = core_.take(clock_.now());
    if (!work) {
      if (slot) slot->give_back();
      work_.wait(lock);
      continue;
    }
    if (seat_) ++seat_->account().batches;
    if (core_.has_work()) work_.notify_one();
    run(*work, lock);
  }
}

// Loading needs no slot, but is use of its job.
WorkResult WorkerNode::load_metered(Work& work) {
  if (!seat_) return execute(loader_, work);
  const double before = seat_->host().meter.loading_cpu_s(seat_->account());
  WorkResult result;
  {
    const Meter::Loading loading(seat_->host().meter, seat_->account());
    result = execute(loader_, work);
  }
  seat_->host().gate.charge(seat_->gate_job(),
                            seat_->host().meter.loading_cpu_s(seat_->account()) - before);
  return result;
}

void WorkerNode::load() {
  prepare_compute_thread();
  const auto meter = metered(seat_);
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    std::optional<Work> work = core_.take_load(clock_.now());
    if (!work) {
      load_work_.wait(lock);
      continue;
    }
    run(*work, lock);
  }
}

void WorkerNode::run(Work& work, std::unique_lock<std::mutex>& lock) {
  lock.unlock();
  std::string failure;
  try {
    WorkResult result;
    if (is_loader_work(work)) {
      result = load_metered(work);
    } else {
      const std::shared_ptr<const PathEngine> engine = loader_.engine();
      if (!engine) throw ClusterError("there are paths to trace, but no scene");
      result = execute(*engine, work);
    }
    lock.lock();
    if (is_loader_work(work)) count();
    core_.finish(work, result, clock_.now());
    after(lock);
    lock.unlock();
    work.what = CameraWork{};  // what is left of the batch is freed outside of the lock
  } catch (const std::exception& e) {
    if (lock.owns_lock()) lock.unlock();
    failure = e.what();
  }
  if (!failure.empty()) callbacks_.failed(failure);
  lock.lock();
  if (failure.empty()) return;
  stopping_ = true;
  work_.notify_all();
  load_work_.notify_all();
}

}  // namespace cloudrenderer
