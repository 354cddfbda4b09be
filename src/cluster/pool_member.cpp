#include "cluster/pool_member.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <asio/co_spawn.hpp>
#include <asio/post.hpp>
#include <asio/steady_timer.hpp>
#include <asio/use_awaitable.hpp>
#include <limits>
#include <map>
#include <set>

#include "base/log.h"
#include "cluster/clock.h"
#include "cluster/pool_order.h"
#include "cluster/spawn.h"
#include "cluster/usage.h"
#include "net/greeting.h"
#include "net/peer_link.h"

namespace cloudrenderer {
namespace {

constexpr auto kPause = std::chrono::milliseconds(200);  // before coming back
constexpr std::size_t kMostOrders = 256;     // each has its threads
constexpr std::size_t kRemembered = 4096;    // jobs that have ended: a new service wants to hear of them
constexpr int kInOneStatus = 256;
constexpr auto kMeterEvery = std::chrono::milliseconds(100);

// Everything on the I/O thread unless said.
class PoolMember {
 public:
  PoolMember(const WorkerConfig& config, std::uint64_t incarnation)
      : config_(config),
        tls_(std::make_shared<const Tls>(config.tls)),
        incarnation_(incarnation),
        host_(std::make_shared<SharedHost>(config.threads, config.memory)),
        metered_(host_->meter, nullptr) {}

  void run() {
    spawn(keep_connected());
    spawn(report());
    io_.run();
    for (auto& [key, order] : orders_) order.run->stop();  // all at a time
    orders_.clear();
    leaving_orders_.clear();
    if (!error_.empty()) throw ClusterError(error_);
  }

  void leave() {  // any thread
    asio::post(io_, [this] {
      if (std::exchange(leaving_, true)) return end({});
      if (link_) link_->send(wire::encode(wire::Leave()));
      take_orders({});
    });
  }

 private:
  using Key = std::pair<std::string, std::string>;  // job, manager
  struct Order {
    std::unique_ptr<OrderRun> run;
    std::string job;
  };
  struct Job {
    std::shared_ptr<Meter::Account> account = std::make_shared<Meter::Account>();
    double memory_byte_s = 0, host_s = 0;
    double own_cpu_s = 0;   // its part of what the host does for all jobs
    double memory = 0;  // when it was last looked at
    double ended = 0;
    bool working = false;
    bool told_all = false;  // it has ended, and that was told: nothing changes any more
    std::string told;       // the last PoolUse
  };

  void spawn(asio::awaitable<void> work) {
    cloudrenderer::spawn(io_, std::move(work), [this](const std::string& why) { end(why); });
  }

  void end(const std::string& error) {
    if (error_.empty()) error_ = error;
    io_.stop();
  }

  // As long as there are jobs the pool may be away: they go on, and what they use is told later.
  asio::awaitable<void> keep_connected() {
    asio::steady_timer pause(io_);
    double alone_since = clock_.now();
    for (;;) {
      if (!orders_.empty() || !leaving_orders_.empty()) alone_since = clock_.now();
      if (session_) {
        alone_since = clock_.now();
      } else {
        const double left = alone_since + config_.patience.count() - clock_.now();
        if (left <= 0)
          throw ClusterError("the pool at " + config_.manager.to_string() +
                             " has gone, and there is no job left to work for");
        try {
          open(co_await connect(io_, config_.manager, std::chrono::seconds(1), tls_));
        } catch (const ClusterError& e) {
          spdlog::debug("the pool: {}", e.what());
        }
      }
      pause.expires_after(kPause);
      co_await pause.async_wait(asio::use_awaitable);
    }
  }

  void open(std::unique_ptr<Stream> stream) {
    GreetingHandlers h;
    h.proved = [this](const auto& session) {
      wire::Hello hello = make_hello(incarnation_, config_.name, config_.memory, config_.threads,
                                     WorkerOptions(), config_.only_intersect);
      hello.set_kind(config_.kind);
      hello.set_allow_inexact(config_.allow_inexact);
      hello.set_manager(pool_);
      send_unsequenced(*session, hello);
    };
    h.introduced = [this](const auto& session, wire::Message&& m) { return welcomed(session, m); };
    h.frame = [this](const auto& session, WireFrame f) { receive(session, std::move(f)); };
    h.closed = [this](const auto& session, const std::string& reason) { closed(session, reason); };
    session_ = greet(std::move(stream), Handshake::Role::connects, config_.token, std::move(h));
  }

  bool welcomed(const std::shared_ptr<Session>& session, const wire::Message& message) {
    if (const auto* refused = std::get_if<wire::Refused>(&message)) {
      if (pool_ == 0) end("the pool refuses this host: " + refused->reason());
      pool_ = 0;  // the next time as a new one
      return false;
    }
    const auto* welcome = std::get_if<wire::PoolWelcome>(&message);
    if (welcome == nullptr) {
      session->close(std::string("it sent ") + wire::message_name(message) +
                     " instead of PoolWelcome");
      return false;
    }
    if (welcome->incarnation() != pool_) {
      if (pool_ != 0) spdlog::info("there is another pool at {}", config_.manager.to_string());
      pool_ = welcome->incarnation();
      link_ = std::make_shared<PeerLink>(io_, incarnation_, pool_, [this] { return clock_.now(); });
      for (auto& [name, job] : jobs_) {
        job.told.clear();
        job.told_all = false;
      }
    }
    heartbeat_s_ = std::clamp(welcome->heartbeat_s(), 0.05, 60.0);
    lost_after_s_ = std::max(welcome->lost_after_s(), heartbeat_s_);
    link_->attach(session);
    if (leaving_) link_->send(wire::encode(wire::Leave()));
    tell();
    return true;
  }

  void receive(const std::shared_ptr<Session>& session, WireFrame frame) {
    for (const wire::Bytes& payload : link_->receive(std::move(frame))) {
      const Result<wire::Message> message = wire::decode(*payload);
      if (!message) return session->close(message.error());
      if (const auto* orders = std::get_if<wire::PoolOrders>(&*message); orders && !leaving_)
        take_orders(*orders);
    }
  }

  void closed(const std::shared_ptr<Session>& session, const std::string& reason) {
    if (link_) link_->detach(session.get());
    if (session_ == session) session_.reset();
    if (ending_) return end({});
    spdlog::log(leaving_ ? spdlog::level::info : spdlog::level::warn,
                "the connection to the pool has ended: {}; jobs go on", reason);
  }

  void take_orders(const wire::PoolOrders& list) {
    meter();
    std::map<Key, const wire::PoolJob*> wanted;
    for (const wire::PoolJob& j : list.jobs()) wanted[{j.job(), j.manager()}] = &j;
    for (auto it = orders_.begin(); it != orders_.end();) {
      if (!wanted.contains(it->first)) leave_order(std::move(it->second));
      it = wanted.contains(it->first) ? std::next(it) : orders_.erase(it);
    }
    for (const auto& [key, order] : wanted) {
      const auto known = orders_.find(key);
      if (known != orders_.end())
        known->second.run->seat().set_weight(order->weight());
      else
        begin(key, *order);
    }
    if (leaving_ && leaving_orders_.empty()) finish();
  }

  void begin(const Key& key, const wire::PoolJob& order) {
    if (orders_.size() + leaving_orders_.size() >= kMostOrders) {
      spdlog::warn("job {}: this host has {} others already", order.job(), kMostOrders);
      return;
    }
    WorkerConfig config = config_;
    try {
      config.manager = Address::parse(order.manager());
    } catch (const UsageError& e) {
      spdlog::warn("job {}: {}", order.job(), e.what());
      return;
    }
    // Every job has a listener of its own, so that one port cannot serve them.
    if (config.listen) config.listen->port = 0;
    if (config.advertise) config.advertise->port = 0;
    if (order.memory() != 0) config.memory = std::min(config.memory, order.memory());
    Job& job = jobs_[order.job()];
    job.working = true;
    job.told_all = false;
    config.seat = std::make_shared<JobSeat>(host_, job.account, order.weight());
    spdlog::info("job {}: works for the manager at {}", order.job(), order.manager());
    orders_[key] = {std::make_unique<OrderRun>(std::move(config),
                                               [this] { asio::post(io_, [this] { ended(); }); }),
                    order.job()};
  }

  void leave_order(Order&& order) {
    if (!order.run->working()) return;  // through already
    order.run->stop();
    leaving_orders_.push_back(std::move(order.run));
    leaving_jobs_.push_back(order.job);
  }

  // Some order's thread is through. Those whose job has ended stay in the list as long as the pool
  // names them, so that they are not begun again.
  void ended() {
    meter();
    for (std::size_t i = leaving_orders_.size(); i-- > 0;) {
      if (leaving_orders_[i]->working()) continue;
      leaving_orders_.erase(leaving_orders_.begin() + static_cast<std::ptrdiff_t>(i));
      leaving_jobs_.erase(leaving_jobs_.begin() + static_cast<std::ptrdiff_t>(i));
    }
    look_who_works();
    host_->cache->tidy();
    tell();
    if (leaving_ && leaving_orders_.empty()) finish();
  }

  void look_who_works() {
    std::set<std::string> working(leaving_jobs_.begin(), leaving_jobs_.end());
    for (const auto& [key, order] : orders_)
      if (order.run->working()) working.insert(order.job);
    for (auto& [name, job] : jobs_) {
      const bool works = working.contains(name);
      if (job.working && !works) job.ended = clock_.now();
      job.working = works;
    }
  }

  void finish() {
    tell();
    ending_ = true;
    if (!session_) return end({});
    link_->close_when_sent();
  }

  asio::awaitable<void> report() {
    asio::steady_timer pause(io_);
    for (;;) {
      pause.expires_after(kMeterEvery);
      co_await pause.async_wait(asio::use_awaitable);
      meter();
      host_->cache->tidy();
      if (clock_.now() >= tell_at_) tell();
      if (link_) link_->close_if_silent(lost_after_s_);
    }
  }

  // Whenever somebody begins or ends, and in between: memory is what it was the last time, or is now.
  void meter() {
    const double now = clock_.now(), seconds = now - std::exchange(metered_at_, now);
    // Orders, beats and this meter: what no job is to blame for is shared by all that work.
    const auto at_work = static_cast<double>(std::ranges::count_if(jobs_, [](const auto& j) { return j.second.working; }));
    const double own_cpu_s = host_->meter.unaccounted_cpu_s();
    const double more_cpu_s = std::max(0.0, own_cpu_s - std::exchange(own_cpu_s_, std::max(own_cpu_s, own_cpu_s_)));
    for (auto& [name, job] : jobs_) {
      if (!job.working) continue;
      job.own_cpu_s += more_cpu_s / at_work;
      const double memory = memory_of(name);
      job.host_s += seconds;
      job.memory_byte_s += seconds * std::max(std::exchange(job.memory, memory), memory);
    }
    look_who_works();
    while (jobs_.size() > kRemembered) {
      const auto oldest = std::ranges::min_element(jobs_, {}, [](const auto& j) {
        return j.second.working ? std::numeric_limits<double>::infinity() : j.second.ended;
      });
      if (oldest->second.working) return;
      jobs_.erase(oldest);
    }
  }

  double memory_of(const std::string& job) const {
    double bytes = 0;
    for (const auto& [key, order] : orders_)
      if (order.job == job) bytes += order.run->seat().memory();
    for (std::size_t i = 0; i < leaving_orders_.size(); ++i)
      if (leaving_jobs_[i] == job) bytes += leaving_orders_[i]->seat().memory();
    return bytes;
  }

  wire::PoolUse use_of(const std::string& name, const Job& job) const {
    wire::PoolUse use;
    use.set_job(name);
    use.set_cpu_s(host_->meter.cpu_s(*job.account) + job.own_cpu_s);
    use.set_memory_byte_s(job.memory_byte_s);
    use.set_host_s(job.host_s);
    use.set_bytes_sent(job.account->bytes_sent);
    use.set_bytes_received(job.account->bytes_received);
    use.set_batches(job.account->batches);
    use.set_loaded_bytes(job.account->loaded_bytes);
    use.set_shared_bytes(job.account->shared_bytes);
    use.set_memory_used(static_cast<std::uint64_t>(memory_of(name)));
    use.set_working(job.working);
    return use;
  }

  // What has changed since it was last told.
  void tell() {
    if (!session_ || !link_ || !link_->connected()) return;
    tell_at_ = clock_.now() + 0.9 * heartbeat_s_;
    wire::PoolStatus status;
    const auto send = [&] {
      status.set_cpu_s(clock_seconds(CLOCK_PROCESS_CPUTIME_ID) - began_cpu_s_);
      status.set_memory_used(host_->cache->bytes());
      status.set_memory_peak(host_->cache->peak_bytes());
      link_->send(wire::encode(status));
      status.clear_jobs();
    };
    for (auto& [name, job] : jobs_) {
      if (job.told_all) continue;  // there may be thousands of them
      job.told_all = !job.working;
      wire::PoolUse use = use_of(name, job);
      std::string bytes = use.SerializeAsString();
      if (bytes == job.told) continue;
      job.told = std::move(bytes);
      *status.add_jobs() = std::move(use);
      if (status.jobs_size() == kInOneStatus) send();
    }
    send();
  }

  const WorkerConfig config_;
  const std::shared_ptr<const Tls> tls_;
  const std::uint64_t incarnation_;
  const double began_cpu_s_ = clock_seconds(CLOCK_PROCESS_CPUTIME_ID);
  Clock clock_;
  asio::io_context io_{1};
  const std::shared_ptr<SharedHost> host_;
  const Meter::Thread metered_;
  std::shared_ptr<PeerLink> link_;
  std::shared_ptr<Session> session_;
  std::uint64_t pool_ = 0;  // its incarnation
  double heartbeat_s_ = 1, lost_after_s_ = 3, tell_at_ = 0, metered_at_ = 0;
  double own_cpu_s_ = clock_seconds(CLOCK_PROCESS_CPUTIME_ID);  // that has been shared out
  std::map<std::string, Job> jobs_;
  std::map<Key, Order> orders_;
  std::vector<std::unique_ptr<OrderRun>> leaving_orders_;  // that are ordered no more
  std::vector<std::string> leaving_jobs_;                  // of these, one each
  bool leaving_ = false, ending_ = false;
  std::string error_;
};

}  // namespace

void run_pool_member(const WorkerConfig& config, std::uint64_t incarnation,
                     const std::function<void(std::function<void()>)>& on_leave) {
  PoolMember member(config, incarnation);
  on_leave([&member] { member.leave(); });
  try {
    member.run();
  } catch (...) {
    on_leave(nullptr);
    throw;
  }
  on_leave(nullptr);
}

}  // namespace cloudrenderer
