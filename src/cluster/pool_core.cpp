#include "cluster/pool_core.h"

#include <algorithm>
#include <cmath>

#include "tasks/admission.h"

namespace cloudrenderer {
namespace {

constexpr double kLook = 0.25;  // how often, in the time after which a host is lost
constexpr std::size_t kMostHosts = 1u << 16;
constexpr std::size_t kMostLeft = 1024;   // that are remembered one by one
constexpr std::size_t kMostForeign = 4096;  // jobs that a host speaks of and nobody here has ordered

wire::PoolOrders message_of(const std::vector<PoolOrder>& orders) {
  wire::PoolOrders m;
  for (const PoolOrder& o : orders) {
    wire::PoolJob* j = m.add_jobs();
    j->set_job(o.job);
    j->set_manager(o.manager.to_string());
    j->set_weight(o.weight);
    j->set_memory(o.memory);
  }
  return m;
}

// A sum never becomes less: an older word may come after a newer one when a host has come back.
template <class T>
void grow(T& sum, T said) {
  sum = std::max(sum, said);
}

}  // namespace

void PoolUsage::add(const PoolUsage& o) {
  cpu_s += o.cpu_s;
  memory_byte_s += o.memory_byte_s;
  host_s += o.host_s;
  bytes_sent += o.bytes_sent;
  bytes_received += o.bytes_received;
  batches += o.batches;
  loaded_bytes += o.loaded_bytes;
  shared_bytes += o.shared_bytes;
  memory_used += o.memory_used;
  working = working || o.working;
}

Result<std::uint64_t> PoolCore::join(const wire::Hello& hello, double now) {
  const auto refuse = [](const std::string& why) { return Result<std::uint64_t>::failure(why); };
  if (const auto why = unbelievable(hello)) return refuse(*why);
  if (static_cast<std::uint32_t>(hello.incarnation()) == 0)
    return refuse("the low half of the host's incarnation is 0");
  if (options_.fingerprint != 0 && hello.fingerprint() != options_.fingerprint &&
      !options_.allow_inexact)
    return refuse("the host computes other bits than the pool (numeric fingerprint); "
                  "--allow-inexact lets it join");
  const std::uint64_t id = hello.incarnation();
  if (!present_.contains(id) && present_.size() >= kMostHosts)
    return refuse("the pool has too many hosts");
  const auto [at, is_new] = hosts_.try_emplace(id);
  PoolHost& host = at->second;
  host.incarnation = id;
  host.name = hello.name();
  host.kind = hello.kind();
  host.threads = hello.threads();
  host.memory = hello.memory();
  if (is_new) host.joined_s = now;
  if (host.left_s) {
    host.left_s.reset();
    std::erase(left_, id);
  }
  Presence& presence = present_[id];
  presence.heard = now;
  presence.connected = true;

  wire::PoolWelcome welcome;
  welcome.set_incarnation(options_.incarnation);
  welcome.set_heartbeat_s(options_.heartbeat_s);
  welcome.set_lost_after_s(options_.lost_after_s);
  outbox_.emplace_back(id, std::move(welcome));
  send_orders(id, presence);
  return id;
}

void PoolCore::receive(std::uint64_t from, const wire::Message& message, double now) {
  const auto presence = present_.find(from);
  if (presence == present_.end()) return;
  presence->second.heard = now;
  PoolHost& host = hosts_.at(from);
  if (const auto* status = std::get_if<wire::PoolStatus>(&message)) take_usage(host, *status);
  if (std::holds_alternative<wire::Leave>(message)) host.leaving = true;
}

void PoolCore::take_usage(PoolHost& host, const wire::PoolStatus& status) {
  ++host.words;
  grow(host.cpu_s, status.cpu_s());
  host.memory_used = status.memory_used();
  grow(host.memory_peak, std::uint64_t{status.memory_peak()});
  for (const wire::PoolUse& said : status.jobs()) {
    if (!host.jobs.contains(said.job()) && !ordered_.contains(said.job()) &&
        host.jobs.size() >= kMostForeign)
      continue;
    PoolUsage& u = host.jobs[said.job()];
    grow(u.cpu_s, said.cpu_s());
    grow(u.memory_byte_s, said.memory_byte_s());
    grow(u.host_s, said.host_s());
    grow(u.bytes_sent, std::uint64_t{said.bytes_sent()});
    grow(u.bytes_received, std::uint64_t{said.bytes_received()});
    grow(u.batches, std::uint64_t{said.batches()});
    grow(u.loaded_bytes, std::uint64_t{said.loaded_bytes()});
    grow(u.shared_bytes, std::uint64_t{said.shared_bytes()});
    u.memory_used = said.memory_used();
    u.working = said.working();
  }
}

void PoolCore::connection_ended(std::uint64_t host, double now) {
  const auto presence = present_.find(host);
  if (presence == present_.end()) return;
  if (hosts_.at(host).leaving) return leave(host, now);
  presence->second.connected = false;
}

void PoolCore::order(std::vector<PoolOrder> orders) {
  for (const PoolOrder& o : orders) ordered_.insert(o.job);
  const bool same = orders == orders_;
  orders_ = std::move(orders);
  for (auto& [host, presence] : present_) {
    if (!presence.orders && same) continue;
    presence.orders.reset();
    send_orders(host, presence);
  }
}

void PoolCore::order(std::uint64_t host, std::vector<PoolOrder> orders) {
  const auto presence = present_.find(host);
  if (presence == present_.end()) return;
  for (const PoolOrder& o : orders) ordered_.insert(o.job);
  if (presence->second.orders == orders) return;
  presence->second.orders = std::move(orders);
  send_orders(host, presence->second);
}

void PoolCore::send_orders(std::uint64_t host, const Presence& presence) {
  outbox_.emplace_back(host, message_of(presence.orders ? *presence.orders : orders_));
}

void PoolCore::tick(double now) {
  // Who was stopped itself has not listened meanwhile.
  const bool was_away = now - ticked_ > 3 * kLook * options_.lost_after_s;
  ticked_ = now;
  std::vector<std::uint64_t> lost;
  for (auto& [host, presence] : present_) {
    if (was_away) presence.heard = now;
    if (now - presence.heard > options_.lost_after_s) lost.push_back(host);
  }
  for (const std::uint64_t host : lost) leave(host, now);
}

double PoolCore::deadline() const {
  return present_.empty() ? std::numeric_limits<double>::infinity()
                          : ticked_ + kLook * options_.lost_after_s;
}

void PoolCore::leave(std::uint64_t host, double now) {
  PoolHost& h = hosts_.at(host);
  h.left_s = now;
  h.memory_used = 0;
  for (auto& [job, usage] : h.jobs) {
    usage.memory_used = 0;
    usage.working = false;
  }
  present_.erase(host);
  gone_.push_back(host);
  left_.push_back(host);
  if (left_.size() > kMostLeft) forget_oldest();
}

void PoolCore::forget_oldest() {
  const auto host = hosts_.find(left_.front());
  for (const auto& [job, usage] : host->second.jobs) past_[job].add(usage);
  hosts_.erase(host);
  left_.erase(left_.begin());
}

std::map<std::string, PoolUsage> PoolCore::usage() const {
  std::map<std::string, PoolUsage> sum = past_;
  for (const auto& [id, host] : hosts_)
    for (const auto& [job, usage] : host.jobs) sum[job].add(usage);
  return sum;
}

}  // namespace cloudrenderer
