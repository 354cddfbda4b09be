#include "cluster/pool.h"

#include <algorithm>

#include "base/log.h"
#include "cluster/fingerprint.h"
#include "cluster/introduction.h"
#include "cluster/worker.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kMaxStrangers = 256;

PoolCore::Options options_of(const Pool::Config& config, std::uint64_t incarnation) {
  PoolCore::Options o;
  o.incarnation = incarnation;
  o.lost_after_s = config.lost_after_s;
  o.heartbeat_s = std::min(o.heartbeat_s, config.lost_after_s / 3);
  o.fingerprint = numeric_fingerprint();
  o.allow_inexact = config.allow_inexact;
  return o;
}

}  // namespace

Pool::Pool(asio::io_context& io, const Clock& clock, Config config)
    : io_(io),
      clock_(clock),
      config_(std::move(config)),
      incarnation_(new_incarnation()),
      core_(options_of(config_, incarnation_)),
      strangers_(kMaxStrangers),
      ticker_(std::make_shared<Ticker>(io, clock, [this] { return tick(); })) {}

Pool::~Pool() { shut(); }

Address Pool::listen(const Address& address) {
  listener_ = std::make_unique<Listener>(
      io_, address, [this](std::unique_ptr<Stream> s) { accept(std::move(s)); }, config_.tls);
  return listener_->address();
}

void Pool::order(std::vector<PoolOrder> orders) {
  core_.order(std::move(orders));
  drain();
}

void Pool::order(std::uint64_t host, std::vector<PoolOrder> orders) {
  core_.order(host, std::move(orders));
  drain();
}

void Pool::accept(std::unique_ptr<Stream> stream) {
  GreetingHandlers h;
  h.proved = [](const auto&) {};
  h.introduced = [this](const auto& s, wire::Message&& m) { return introduce(s, std::move(m)); };
  h.frame = [this](const auto& s, WireFrame f) { receive(s, std::move(f)); };
  h.closed = [this](const auto& s, const std::string& reason) { closed(s, reason); };
  auto session = greet(std::move(stream), Handshake::Role::accepts, config_.token, std::move(h));
  strangers_.add(session);
  sessions_.insert(std::move(session));
}

bool Pool::introduce(const std::shared_ptr<Session>& session, wire::Message&& message) {
  strangers_.remove(session);
  const wire::Hello* const hello = hello_of(*session, message);
  if (hello == nullptr) return false;
  const bool forgotten =
      hello->manager() == incarnation_ && !peers_.contains(hello->incarnation());
  const Result<std::uint64_t> id =
      forgotten ? Result<std::uint64_t>::failure("this host is not known here any more; it may come "
                                                 "as a new one")
                : core_.join(*hello, clock_.now());
  if (!id) {
    refuse(*session, *hello, id.error());
    return false;
  }
  Peer& peer = peers_[*id];
  if (!peer.link) spdlog::info("host {} at {} joins the pool", hello->name(), session->peer());
  if (hello->manager() != incarnation_)  // else it goes on where it was
    peer.link = std::make_shared<PeerLink>(io_, incarnation_, *id, [this] { return clock_.now(); });
  peer.session = session;
  session_hosts_[session.get()] = *id;
  after();
  return true;
}

void Pool::receive(const std::shared_ptr<Session>& session, WireFrame frame) {
  const auto host = session_hosts_.find(session.get());
  if (host == session_hosts_.end()) return;
  const std::uint64_t id = host->second;
  const auto peer = peers_.find(id);
  if (peer == peers_.end() || peer->second.session != session)
    return session->close("its host has left the pool");
  for (const wire::Bytes& payload : peer->second.link->receive(std::move(frame))) {
    const Result<wire::Message> message = wire::decode(*payload);
    if (!message) return session->close(message.error());
    core_.receive(id, *message, clock_.now());
  }
  after();
}

void Pool::closed(const std::shared_ptr<Session>& session, const std::string& reason) {
  sessions_.erase(session);
  strangers_.remove(session);
  const auto host = session_hosts_.find(session.get());
  if (host == session_hosts_.end()) {
    if (!reason.empty())
      spdlog::warn("the connection of {} was closed: {}", session->peer(), reason);
    return;
  }
  const std::uint64_t id = host->second;
  session_hosts_.erase(host);
  const auto peer = peers_.find(id);
  if (peer == peers_.end() || peer->second.session != session) return;
  peer->second.link->detach(session.get());
  peer->second.session.reset();
  if (shut_) return;
  core_.connection_ended(id, clock_.now());
  after();
}

double Pool::tick() {
  core_.tick(clock_.now());
  after();
  return core_.deadline();
}

void Pool::drain() {
  if (shut_) return;
  for (auto& [to, message] : core_.take_outbox()) {
    const auto peer = peers_.find(to);
    if (peer == peers_.end()) continue;
    if (!std::holds_alternative<wire::PoolWelcome>(message)) {
      peer->second.link->send(wire::encode(message));
    } else if (peer->second.session) {
      // Before everything else: the host does not know yet whose sequence it is to check.
      send_unsequenced(*peer->second.session, message);
      peer->second.link->attach(peer->second.session);
    }
  }
  for (const std::uint64_t gone : core_.take_gone()) {
    spdlog::info("host {} has left the pool", core_.hosts().at(gone).name);
    peers_.at(gone).link->close_when_sent();
  }
  std::erase_if(peers_, [&](const auto& p) { return !core_.hosts().contains(p.first); });
  ticker_->at(core_.deadline());
}

void Pool::after() {
  drain();
  if (!shut_ && config_.changed) config_.changed();
}

void Pool::shut() {
  if (shut_) return;
  shut_ = true;
  listener_.reset();
  ticker_->stop();
  for (auto& [id, peer] : peers_) peer.link->close_when_sent();
  for (const auto& session : sessions_)
    if (!session_hosts_.contains(session.get())) session->close("the pool is closing");
}

}  // namespace cloudrenderer
