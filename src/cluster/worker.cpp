#include "cluster/worker.h"

#include <spdlog/fmt/fmt.h>

#include <asio/co_spawn.hpp>
#include <asio/post.hpp>
#include <asio/steady_timer.hpp>
#include <asio/use_awaitable.hpp>
#include <random>

#include "base/log.h"
#include "cluster/fingerprint.h"
#include "cluster/peers.h"
#include "cluster/pool_member.h"
#include "cluster/spawn.h"
#include "cluster/ticker.h"
#include "cluster/usage.h"
#include "cluster/worker_node.h"
#include "net/listener.h"
#include "parts/features.h"

namespace cloudrenderer {
namespace {

constexpr HostId kManager{0};
constexpr auto kPause = std::chrono::milliseconds(200);  // before coming back
constexpr double kMissed = 1;  // seconds; a manager that was gone for longer need not know who leaves
constexpr int kIntroductions = 4;  // attempts, when connections break before the manager's answer
constexpr double kLooksForSilence = 8;  // in the time after which a silent peer is given up

// A worker on this machine that talks to its manager and peers over TCP. Everything on the I/O
// thread unless said.
class Worker {
 public:
  explicit Worker(const WorkerConfig& config)
      : config_(config),
        tls_(std::make_shared<const Tls>(config.tls)),
        incarnation_(new_incarnation()),
        fetcher_(std::make_shared<BlobFetcher>(
            [this](wire::Message m) { deliver(kManager, std::move(m)); })),
        loader_(config.threads, config.memory, {nullptr, config.parts, fetcher_, config.seat}) {
    if (config_.seat) {
      config_.seat->set_memory([this] { return loader_.own_bytes(); });
      began_cpu_s_ = config_.seat->host().meter.cpu_s(config_.seat->account());
    }
  }
  ~Worker() {
    if (config_.seat) config_.seat->set_memory(nullptr);
  }

  // Again: there is a manager that does not know this host; a new one is to be made.
  enum class End { over, again, pool };
  End run() {
    spawn(join(config_.patience));
    io_.run();
    fetcher_->fail("this host is going");
    if (node_ && config_.seat) counters();  // the last bytes
    node_.reset();
    if (!error_.empty()) throw ClusterError(error_);
    return end_;
  }
  std::uint64_t incarnation() const { return incarnation_; }

  void leave() {  // any thread
    asio::post(io_, [this] {
      if (node_ && alone()) return end({});
      if (!node_ || leaving_) return end(node_ ? "" : "interrupted before a manager was found");
      leaving_ = true;
      node_->leave("asked to leave");
    });
  }

 private:
  // Nobody is there to be told anything; a connection alone is not somebody who answers.
  bool alone() const {
    return !manager_session_ || (gone_since_ && clock_.now() - *gone_since_ > kMissed);
  }

  void spawn(asio::awaitable<void> work) {
    cloudrenderer::spawn(io_, std::move(work), [this](const std::string& why) { end(why); });
  }

  void end(const std::string& error) {
    if (error_.empty()) error_ = error;
    io_.stop();
  }

  asio::awaitable<void> join(std::chrono::duration<double> patience) {
    auto stream = co_await connect(
        io_, config_.manager,
        std::chrono::duration_cast<std::chrono::steady_clock::duration>(patience), tls_);
    if (!listener_) {
      const Address here = config_.listen.value_or(Address{stream->local().host, 0});
      const auto accept = [this](std::unique_ptr<Stream> s) {
        if (peers_) return peers_->accept(std::move(s));
        spdlog::info("the connection of {} was closed: this host is in no cluster yet", s->peer());
        s->close();
      };
      listener_ = std::make_unique<Listener>(io_, here, accept, tls_);
      advertised_ = config_.advertise.value_or(listener_->address());
      if (advertised_.port == 0) advertised_.port = listener_->address().port;
      // Told as it is, an address of all interfaces leads nowhere.
      if (advertised_.host == "0.0.0.0" || advertised_.host == "::")
        advertised_.host = stream->local().host;
    }
    GreetingHandlers h;
    h.proved = [this](const auto& session) {
      wire::Hello hello = make_hello(incarnation_, config_.name, config_.memory, config_.threads,
                                     options_, config_.only_intersect);
      hello.set_kind(config_.kind);
      hello.set_listen(advertised_.to_string());
      hello.set_allow_inexact(config_.allow_inexact);
      if (node_) hello.set_manager(manager_incarnation_);
      send_unsequenced(*session, hello);
    };
    h.introduced = [this](const auto& session, wire::Message&& m) {
      return welcomed(session, std::move(m));
    };
    h.frame = [this](const auto& session, WireFrame f) { receive(session, std::move(f)); };
    h.closed = [this](const auto& session, const std::string& reason) { closed(session, reason); };
    manager_session_ =
        greet(std::move(stream), Handshake::Role::connects, config_.token, std::move(h));
  }

  // The manager may be gone for good, or its place is taken by one that does not want this host.
  asio::awaitable<void> come_back() {
    asio::steady_timer pause(io_, kPause);
    co_await pause.async_wait(asio::use_awaitable);
    if (!manager_) co_return co_await join(config_.patience);
    const auto patience = std::max(lost_after_, config_.patience);
    const auto left = patience - std::chrono::duration<double>(clock_.now() - *gone_since_);
    const std::string gone = "the manager at " + config_.manager.to_string() + " has gone";
    if (left.count() <= 0) throw ClusterError(gone + " and does not take this host back");
    try {
      co_await join(left);
    } catch (const ClusterError& e) {
      throw ClusterError(fmt::format("{}, and nobody has taken its place in {:.0f} seconds: {}", gone,
                                     patience.count(), e.what()));
    }
  }

  // Cut cables and stopped machines: no connection ends by itself then.
  asio::awaitable<void> watch() {
    asio::steady_timer pause(io_);
    for (;;) {
      pause.expires_after(std::chrono::duration_cast<std::chrono::nanoseconds>(lost_after_ / kLooksForSilence));
      co_await pause.async_wait(asio::use_awaitable);
      manager_->close_if_silent(lost_after_.count());
      peers_->close_silent(lost_after_.count());
    }
  }

  bool welcomed(const std::shared_ptr<Session>& session, wire::Message&& message) {
    if (const auto* refused = std::get_if<wire::Refused>(&message)) {
      if (node_) {
        come_as_new();
        return false;
      }
      end("the manager refuses this host: " + refused->reason());
      return false;
    }
    if (std::holds_alternative<wire::PoolWelcome>(message) && !node_ && !config_.seat) {
      end_ = End::pool;
      end({});
      return false;
    }
    const auto* welcome = std::get_if<wire::Welcome>(&message);
    if (welcome == nullptr) {
      end(std::string("the manager sent ") + wire::message_name(message) + " instead of Welcome");
      return false;
    }
    const HostId self(welcome->host());
    if (node_ && (self != self_ || welcome->incarnation() != manager_incarnation_)) {
      come_as_new();
      return false;
    }
    gone_since_.reset();
    manager_incarnation_ = welcome->incarnation();
    lost_after_ = std::chrono::duration<double>(welcome->lost_after_s());
    if (!node_) start(self, *welcome);
    manager_->attach(session);
    return true;
  }

  void come_as_new() {
    spdlog::info("the manager does not know this host any more");
    if (!leaving_) end_ = End::again;
    end({});
  }

  void start(HostId self, const wire::Welcome& welcome) {
    self_ = self;
    spdlog::info("this is host {}", self.value);
    const auto now = [this] { return clock_.now(); };
    manager_ = std::make_shared<PeerLink>(io_, incarnation_, welcome.incarnation(), now);
    peers_ = std::make_unique<Peers>(
        io_, Peers::Self{self, incarnation_, config_.token, tls_}, now,
        Peers::Callbacks{
            [this](HostId from, wire::Message&& m) { node_->receive(from, std::move(m)); },
            [this](HostId peer) { node_->peer_unreachable(peer); },
            [this](HostId peer) { node_->peer_reachable(peer); }});
    options_.threads = config_.threads;
    options_.alpha = config_.alpha;
    options_.status_every_s = std::max(0.05, welcome.heartbeat_s());
    ticker_ = std::make_shared<Ticker>(io_, clock_, [this] { return node_->tick(); });
    WorkerNode::Callbacks c;
    c.deliver = [this](HostId to, wire::Message&& m) { deliver(to, std::move(m)); };
    c.deadline = [this](double t) { ticker_->at(t); };
    c.failed = [this](const std::string& why) { asio::post(io_, [this, why] { give_up(why); }); };
    c.counters = [this] { return counters(); };
    node_ =
        std::make_unique<WorkerNode>(self, incarnation_, options_, loader_, clock_, std::move(c), config_.seat);
    ticker_->at(clock_.now());
    spawn(watch());
  }

  void receive(const std::shared_ptr<Session>& session, WireFrame frame) {
    for (const wire::Bytes& payload : manager_->receive(std::move(frame))) {
      Result<wire::Message> message = wire::decode(*payload);
      if (!message) return session->close(message.error());
      if (auto* chunk = std::get_if<wire::BlobChunk>(&*message)) {
        fetcher_->receive(std::move(*chunk));
        continue;
      }
      if (std::holds_alternative<wire::JobEnd>(*message) ||
          std::holds_alternative<wire::CancelJob>(*message))
        job_over_ = true;
      node_->receive(kManager, std::move(*message));
    }
    sync_peers();
  }

  void closed(const std::shared_ptr<Session>& session, const std::string& reason) {
    closed_sent_ += session->bytes_sent();
    closed_received_ += session->bytes_received();
    if (manager_session_ == session) manager_session_.reset();
    if (!manager_ && ++introductions_ < kIntroductions) return spawn(come_back());
    if (!manager_)
      return end("the manager at " + config_.manager.to_string() + " has ended the connection (" +
                 reason + "); do both have the same token and --tls?");
    manager_->detach(session.get());
    if (job_over_ || leaving_ || node_->left()) return end({});
    if (!gone_since_) {
      gone_since_ = clock_.now();
      spdlog::warn("the connection to the manager has ended: {}; waiting for it", reason);
    }
    spawn(come_back());
  }

  // Any thread.
  void deliver(HostId to, wire::Message&& message) {
    if (to == kManager) return manager_->send(wire::encode(message));
    const auto bytes = wire::encode(message);
    if (peers_->send(to, bytes)) return;
    sync_peers();  // the core has heard of a new host a moment ago
    if (!peers_->send(to, bytes)) spdlog::debug("a message for host {}, which has gone", to.value);
  }

  void sync_peers() {  // any thread
    const std::lock_guard lock(sync_mutex_);
    std::vector<wire::HostEntry> hosts;
    if (node_->new_hosts(hosts_version_, hosts)) peers_->update(hosts);
  }

  void give_up(const std::string& why) {
    wire::Error error;
    error.set_text(why);
    manager_->send(wire::encode(error));
    manager_->close_when_sent();
    job_over_ = true;
    error_ = why;
  }

  DriverCounters counters() {  // any thread
    DriverCounters c = process_counters();
    std::uint64_t sent = closed_sent_, received = closed_received_;
    if (const auto s = manager_ ? manager_->session() : nullptr) {
      sent += s->bytes_sent();
      received += s->bytes_received();
    }
    const auto [peer_sent, peer_received] = peers_->bytes();
    c.bytes_sent = sent + peer_sent;
    c.bytes_received = received + peer_received;
    if (config_.seat) {
      const std::lock_guard lock(told_mutex_);
      Meter::Account& account = config_.seat->account();
      c.cpu_s = config_.seat->host().meter.cpu_s(account) - began_cpu_s_;  // not the other orders'
      account.bytes_sent += c.bytes_sent - std::exchange(told_sent_, c.bytes_sent);
      account.bytes_received += c.bytes_received - std::exchange(told_received_, c.bytes_received);
    }
    c.drained = peers_->drained();
    c.memory_used = loader_.bytes_used();
    c.memory_peak = memory_peak_ = std::max<std::uint64_t>(memory_peak_, loader_.peak_bytes());
    return c;
  }

  const WorkerConfig config_;
  const std::shared_ptr<const Tls> tls_;
  const std::uint64_t incarnation_;
  Clock clock_;
  asio::io_context io_{1};
  WorkerOptions options_;
  std::shared_ptr<BlobFetcher> fetcher_;
  SceneLoader loader_;
  std::unique_ptr<Listener> listener_;
  Address advertised_;
  HostId self_;
  std::shared_ptr<PeerLink> manager_;
  std::shared_ptr<Session> manager_session_;
  std::unique_ptr<Peers> peers_;
  std::shared_ptr<Ticker> ticker_;
  std::mutex sync_mutex_;
  std::uint64_t hosts_version_ = 0;
  std::uint64_t manager_incarnation_ = 0;
  std::optional<double> gone_since_;  // the connection to the manager
  int introductions_ = 0;             // that came to nothing
  std::chrono::duration<double> lost_after_{3};
  std::atomic<std::uint64_t> closed_sent_ = 0, closed_received_ = 0, memory_peak_ = 0;
  bool job_over_ = false, leaving_ = false;
  End end_ = End::over;
  std::mutex told_mutex_;  // not sync_mutex_: counters() is called under the node's, which is taken under that one
  double began_cpu_s_ = 0;  // of the seat's account, which earlier tries of the frame have used too
  std::uint64_t told_sent_ = 0, told_received_ = 0;  // to the seat
  std::string error_;
  std::unique_ptr<WorkerNode> node_;  // last: its threads use the rest
};

}  // namespace

std::uint64_t new_incarnation() {
  std::random_device device;
  for (;;) {
    const std::uint64_t n = std::uint64_t{device()} << 32 | device();
    if (static_cast<std::uint32_t>(n) != 0)
      return n;  // the low half stands in frame headers; zero means none
  }
}

wire::Hello make_hello(std::uint64_t incarnation, const std::string& name, std::uint64_t memory,
                       unsigned threads, const WorkerOptions& options, bool only_intersect) {
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_incarnation(incarnation);
  h.set_name(name);
  h.set_memory(memory);
  h.set_threads(threads);
  for (int c = wire::LOADER; c <= wire::INTERSECTION; ++c)
    if (!only_intersect || c == wire::LOADER || c == wire::UNLOADER || c == wire::INTERSECTION)
      h.add_categories(static_cast<wire::Category>(c));
  if (only_intersect) {  // what PathTracer::nearest() answers for
    for (const char* feature : {kFeatureTriangles, kFeatureAlpha}) h.add_features(feature);
  } else {
    for (const auto& [bit, feature] : kPartFeatures) h.add_features(feature);
    h.add_features("paging");
    h.add_features("layers");
    h.add_features("shared rays");
  }
  h.add_features("lobes");
  h.add_features("aimed light paths");
  h.add_features("changes");
  h.set_instruction_set(kInstructionSet);
  h.set_fingerprint(numeric_fingerprint());
  h.set_path_credits(options.path_credits);
  h.set_paging_credits(options.paging_credits);
  h.set_version(CLOUDRENDERER_VERSION);
  return h;
}

DriverCounters process_counters() {
  DriverCounters c;
  c.cpu_s = cpu_seconds();
  c.peak_rss = peak_rss();
  return c;
}

void run_worker(const WorkerConfig& config,
                const std::function<void(std::function<void()>)>& on_leave) {
  using End = Worker::End;
  std::uint64_t incarnation = 0;
  for (End end = End::again; end == End::again;) {
    Worker worker(config);
    on_leave([&worker] { worker.leave(); });
    try {
      end = worker.run();
    } catch (...) {
      on_leave(nullptr);
      throw;
    }
    on_leave(nullptr);
    if (end == End::pool) incarnation = worker.incarnation();
  }
  if (incarnation != 0) run_pool_member(config, incarnation, on_leave);
}

}  // namespace cloudrenderer
