#include "cluster/manager.h"

#include <asio/post.hpp>
#include <asio/steady_timer.hpp>

#include "base/log.h"
#include "cluster/introduction.h"

namespace cloudrenderer {
namespace {

// A host whose connection broke may be back in a moment; one that was killed is not missed for
// long.
constexpr auto kComeBack = std::chrono::milliseconds(1500);
constexpr std::size_t kMaxStrangers = 256;

}  // namespace

Manager::Manager(asio::io_context& io, const Clock& clock, Config config)
    : io_(io),
      clock_(clock),
      config_(std::move(config)),
      core_(config_.core, config_.job),
      blobs_(config_.folder),
      strangers_(kMaxStrangers) {
  ticker_ = std::make_shared<Ticker>(io, clock, [this] { return tick(); });
}

Manager::~Manager() { shut(); }

Address Manager::listen(const Address& address) {
  listener_ = std::make_unique<Listener>(
      io_, address, [this](std::unique_ptr<Stream> s) { accept(std::move(s)); }, config_.tls);
  return listener_->address();
}

void Manager::accept(std::unique_ptr<Stream> stream) {
  GreetingHandlers h;
  h.proved = [](const auto&) {};
  h.introduced = [this](const auto& s, wire::Message&& m) { return introduce(s, std::move(m)); };
  h.frame = [this](const auto& s, WireFrame f) { receive(s, std::move(f)); };
  h.closed = [this](const auto& s, const std::string& reason) { closed(s, reason); };
  auto session = greet(std::move(stream), Handshake::Role::accepts, config_.token, std::move(h));
  strangers_.add(session);
  sessions_.insert(std::move(session));
}

bool Manager::introduce(const std::shared_ptr<Session>& session, wire::Message&& message) {
  strangers_.remove(session);
  const wire::Hello* const hello = hello_of(*session, message);
  if (hello == nullptr) return false;
  if (join_again(session, *hello)) return true;
  if (hello->manager() != 0) {  // of a manager before this one, or given up by this one
    refuse(*session, *hello, "this host is not known here any more; it may come as a new one", "was with another manager");
    return false;
  }
  const Result<HostId> id = core_.join(*hello, clock_.now());
  if (!id) {
    refuse(*session, *hello, id.error());
    drain();
    return false;
  }
  spdlog::info("host {} is {} at {}", id->value, hello->name(), session->peer());
  Peer& peer = peers_[*id];
  peer.incarnation = hello->incarnation();
  peer.link = std::make_shared<PeerLink>(io_, config_.core.incarnation, hello->incarnation(),
                                         [this] { return clock_.now(); });
  peer.connection = 1;
  peer.link->attach(session);
  session_hosts_[session.get()] = *id;
  drain();
  return true;
}

bool Manager::join_again(const std::shared_ptr<Session>& session, const wire::Hello& hello) {
  for (auto& [id, peer] : peers_) {
    if (peer.incarnation != hello.incarnation() || !peer.link) continue;
    spdlog::info("host {} has connected again", id.value);
    wire::Welcome welcome;
    welcome.set_host(id.value);
    welcome.set_incarnation(config_.core.incarnation);
    welcome.set_heartbeat_s(config_.core.heartbeat_s);
    welcome.set_lost_after_s(config_.core.lost_after_s);
    send_unsequenced(*session, welcome);
    ++peer.connection;
    session_hosts_[session.get()] = id;
    peer.link->attach(session);
    return true;
  }
  return false;
}

void Manager::receive(const std::shared_ptr<Session>& session, WireFrame frame) {
  const auto host = session_hosts_.find(session.get());
  if (host == session_hosts_.end()) return;
  const HostId id = host->second;
  const auto peer = peers_.find(id);
  if (peer == peers_.end()) return session->close("its host has left the job");
  for (const wire::Bytes& payload : peer->second.link->receive(std::move(frame))) {
    Result<wire::Message> message = wire::decode(*payload);
    if (!message) return session->close(message.error());
    handle(id, std::move(*message));
  }
  drain();
}

void Manager::handle(HostId from, wire::Message&& message) {
  if (const auto* request = std::get_if<wire::BlobRequest>(&message)) {
    const auto peer = peers_.find(from);
    if (peer == peers_.end() || !peer->second.link) return;
    const wire::Bytes bytes = wire::encode(blobs_.answer(*request));
    blob_bytes_ += bytes->size();
    return peer->second.link->send(bytes);
  }
  if (const auto* error = std::get_if<wire::Error>(&message)) {
    spdlog::error("host {} cannot go on: {}", from.value, error->text());
    return core_.host_lost(from, clock_.now());
  }
  core_.receive(from, std::move(message), clock_.now());
}

void Manager::closed(const std::shared_ptr<Session>& session, const std::string& reason) {
  closed_sent_ += session->bytes_sent();
  closed_received_ += session->bytes_received();
  sessions_.erase(session);
  strangers_.remove(session);
  const auto host = session_hosts_.find(session.get());
  if (host == session_hosts_.end()) {
    if (!reason.empty())
      spdlog::warn("the connection of {} was closed: {}", session->peer(), reason);
    return;
  }
  const HostId id = host->second;
  session_hosts_.erase(host);
  const auto peer = peers_.find(id);
  if (peer == peers_.end() || shut_) return;
  peer->second.link->detach(session.get());
  if (peer->second.link->connected()) return;
  spdlog::info("the connection of host {} has ended: {}", id.value, reason);
  const auto timer = std::make_shared<asio::steady_timer>(io_, kComeBack);
  timer->async_wait(
      [this, id, timer, connection = peer->second.connection](const std::error_code&) {
        const auto p = peers_.find(id);
        if (shut_ || p == peers_.end() || p->second.connection != connection) return;
        core_.host_lost(id, clock_.now());
        drain();
      });
}

Result<HostId> Manager::join_local(const wire::Hello& hello,
                                   std::function<void(wire::Message&&)> deliver) {
  const Result<HostId> id = core_.join(hello, clock_.now());
  if (!id) return id;
  Peer& peer = peers_[*id];
  peer.deliver_local = std::move(deliver);
  peer.incarnation = hello.incarnation();
  return id;
}

void Manager::receive_local(HostId from, wire::Message&& message) {
  // Shared because a handler must be copyable; the message itself is never copied.
  auto held = std::make_shared<wire::Message>(std::move(message));
  asio::post(io_, [this, from, held] {
    if (shut_) return;
    handle(from, std::move(*held));
    drain();
  });
}

double Manager::tick() {
  core_.tick(clock_.now());
  drain();
  return core_.deadline();
}

void Manager::drain() {
  if (draining_ || shut_) return;
  draining_ = true;
  for (auto sendings = core_.take_sendings(); !sendings.empty(); sendings = core_.take_sendings())
    for (ManagerCore::Sending& s : sendings) send(s);
  for (const HostId gone : core_.take_gone()) {
    const auto peer = peers_.find(gone);
    if (peer == peers_.end()) continue;
    const ManagerCore::HostReport& report = core_.hosts().at(gone);
    if (report.lost) {
      spdlog::warn("host {} is lost", gone.value);
    } else if (!report.last.final()) {
      spdlog::warn("host {} has not said what it has used in all: the report has its last status", gone.value);
    }
    if (peer->second.link) peer->second.link->close_when_sent();
    peers_.erase(peer);
  }
  tell_paging();
  draining_ = false;
  ticker_->at(core_.deadline());
  if (config_.changed) config_.changed();
}

void Manager::send(ManagerCore::Sending& s) {
  wire::Bytes encoded;  // once for all of them
  for (const HostId to : s.to) {
    const auto peer = peers_.find(to);
    if (peer == peers_.end()) continue;
    if (peer->second.deliver_local) {
      peer->second.deliver_local(wire::Message(s.message));
    } else if (std::holds_alternative<wire::Welcome>(s.message)) {
      // A host cannot check the sequence of a manager whose incarnation it does not know yet.
      if (const auto session = peer->second.link->session()) send_unsequenced(*session, s.message);
    } else {
      if (!encoded) encoded = wire::encode(s.message);
      peer->second.link->send(encoded);
    }
  }
}

void Manager::tell_paging() {
  const std::uint32_t parts = core_.progress().paged_parts;
  if (parts == paged_parts_) return;
  if (parts > paged_parts_)
    spdlog::warn("the memory of all hosts is too small for the scene: {} parts are loaded whenever rays need them", parts);
  else if (parts == 0)
    spdlog::info("there is memory for all parts now");
  paged_parts_ = parts;
}

void Manager::shut() {
  if (shut_) return;
  shut_ = true;
  listener_.reset();
  ticker_->stop();
  for (auto& [id, peer] : peers_)
    if (peer.link) peer.link->close_when_sent();
  for (const auto& session : sessions_)
    if (!session_hosts_.contains(session.get())) session->close("the job is over");
}

std::uint64_t Manager::bytes_sent() const {
  std::uint64_t n = closed_sent_;
  for (const auto& s : sessions_) n += s->bytes_sent();
  return n - std::min(n, blob_bytes_);
}

std::uint64_t Manager::bytes_received() const {
  std::uint64_t n = closed_received_;
  for (const auto& s : sessions_) n += s->bytes_received();
  return n;
}

}  // namespace cloudrenderer
