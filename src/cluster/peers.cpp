#include "cluster/peers.h"

#include <algorithm>
#include <asio/co_spawn.hpp>
#include <asio/post.hpp>
#include <asio/steady_timer.hpp>
#include <asio/use_awaitable.hpp>

#include "base/log.h"

namespace cloudrenderer {
namespace {

using namespace std::chrono_literals;
constexpr auto kAttempt = 3s;  // of one connection
constexpr auto kBetweenAttempts = 1s;
// A host that the others have lost does not know it yet: they close what it opens, and it must not
// spend its time on that.
constexpr auto kBeforeAgain = 200ms;
// A connection of the larger number that is no older is not replaced: the other end has made one at the same time.
constexpr double kSameTime = 3;  // seconds
constexpr std::size_t kMaxStrangers = 64;

}  // namespace

Peers::Peers(asio::io_context& io, Self self, PeerLink::Now now, Callbacks callbacks)
    : io_(io),
      self_(std::move(self)),
      now_(std::move(now)),
      callbacks_(std::move(callbacks)),
      strangers_(kMaxStrangers) {}

std::shared_ptr<PeerLink> Peers::link_of(HostId host) const {
  const std::lock_guard lock(mutex_);
  const auto peer = peers_.find(host);
  return peer == peers_.end() ? nullptr : peer->second.link;
}

bool Peers::send(HostId to, const wire::Bytes& payload) {
  const auto link = link_of(to);
  if (!link) return false;
  link->send(payload);
  if (link->connected()) return true;
  const std::lock_guard lock(mutex_);
  const auto peer = peers_.find(to);
  if (peer != peers_.end() && peer->second.link == link) spawn_connector(to, peer->second, 0ms);
  return true;
}

void Peers::update(const std::vector<wire::HostEntry>& hosts) {
  const std::lock_guard lock(mutex_);
  std::set<HostId> there;
  for (const wire::HostEntry& h : hosts) {
    const HostId host(h.host());
    if (host == self_.host || host.value == 0) continue;
    there.insert(host);
    if (peers_.contains(host)) continue;
    Peer peer;
    try {
      peer.address = Address::parse(h.address());
    } catch (const UsageError& e) {
      spdlog::warn("host {} cannot be reached: {}", h.host(), e.what());
    }
    peer.incarnation = h.incarnation();
    peer.link = std::make_shared<PeerLink>(io_, self_.incarnation, h.incarnation(), now_);
    peers_[host] = std::move(peer);
  }
  std::erase_if(peers_, [&](auto& entry) {
    if (there.contains(entry.first)) return false;
    asio::post(io_, [link = entry.second.link] { link->close_when_sent(); });
    return true;
  });
}

void Peers::spawn_connector(HostId host, Peer& peer, std::chrono::milliseconds first_pause) {
  if (std::exchange(peer.connecting, true)) return;
  // Posted: the mutex is held here.
  asio::post(io_, [this, host, link = peer.link, address = peer.address, first_pause] {
    asio::co_spawn(io_, keep_connected(host, link, address, first_pause),
                   [host](std::exception_ptr error) {
                     if (error) spdlog::warn("no more attempts to connect to host {}", host.value);
                   });
  });
}

// False: the connector's work is done.
bool Peers::needs_connection(HostId host, const std::shared_ptr<PeerLink>& link) {
  const std::lock_guard lock(mutex_);
  const auto peer = peers_.find(host);
  if (peer == peers_.end() || peer->second.link != link) return false;
  return peer->second.connecting = !link->connected() && link->queued() != 0;
}

asio::awaitable<void> Peers::keep_connected(HostId host, std::shared_ptr<PeerLink> link,
                                            Address address,
                                            std::chrono::milliseconds first_pause) {
  asio::steady_timer timer(io_);
  if (first_pause > 0ms) {
    timer.expires_after(first_pause);
    co_await timer.async_wait(asio::use_awaitable);
  }
  while (needs_connection(host, link)) {
    std::string why;
    try {
      open(co_await connect(io_, address, kAttempt, self_.tls), Handshake::Role::connects, host);
    } catch (const ClusterError& e) {
      why = e.what();
    }
    if (!why.empty()) {
      spdlog::warn("host {}: {}", host.value, why);
      callbacks_.unreachable(host);
    }
    timer.expires_after(kBetweenAttempts);
    co_await timer.async_wait(asio::use_awaitable);
  }
}

void Peers::accept(std::unique_ptr<Stream> stream) {
  open(std::move(stream), Handshake::Role::accepts, std::nullopt);
}

void Peers::open(std::unique_ptr<Stream> stream, Handshake::Role role, std::optional<HostId> to) {
  GreetingHandlers h;
  const auto proved = std::make_shared<bool>(false);
  h.proved = [this, proved](const auto& session) {
    *proved = true;
    wire::PeerHello hello;
    hello.set_protocol(wire::kProtocolVersion);
    hello.set_host(self_.host.value);
    hello.set_incarnation(self_.incarnation);
    send_unsequenced(*session, hello);
  };
  h.introduced = [this, role](const auto& session, wire::Message&& m) { return introduced(session, role, m); };
  h.frame = [this](const auto& session, WireFrame f) { receive(session, std::move(f)); };
  h.closed = [this, to, proved](const auto& session, const std::string& reason) {
    // Who has another secret, or another --tls, is out of reach like who does not answer.
    if (!*proved && !reason.empty() && to) callbacks_.unreachable(*to);
    if (!session_hosts_.contains(session.get()) && !reason.empty())
      spdlog::log(*proved ? spdlog::level::info : spdlog::level::warn,
                  "the connection {} {} was closed: {}", to ? "to" : "of", session->peer(), reason);
    closed(session, reason);
  };
  auto session = greet(std::move(stream), role, self_.token, std::move(h));
  if (role == Handshake::Role::accepts) strangers_.add(session);
  const std::lock_guard lock(mutex_);
  sessions_.insert(std::move(session));
}

bool Peers::introduced(const std::shared_ptr<Session>& session, Handshake::Role role, const wire::Message& message) {
  const auto* hello = std::get_if<wire::PeerHello>(&message);
  if (hello == nullptr) {
    session->close(std::string("it sent ") + wire::message_name(message) + " instead of PeerHello");
    return false;
  }
  const HostId host(hello->host());
  const bool by_larger = (role == Handshake::Role::connects) == (host < self_.host);
  std::shared_ptr<PeerLink> link;
  bool twice = false;
  {
    const std::lock_guard lock(mutex_);
    const auto peer = peers_.find(host);
    if (peer != peers_.end() && peer->second.incarnation == hello->incarnation()) {
      link = peer->second.link;
      twice = !by_larger && peer->second.by_larger && link->connected() && now_() < peer->second.since + kSameTime;
      if (!twice) {
        peer->second.since = now_();
        peer->second.by_larger = by_larger;
      }
    }
  }
  if (!link) {  // our list may be older than its: it tries again
    session->close("it says that it is host " + std::to_string(host.value) +
                   ", which is not known");
    return false;
  }
  if (twice) {
    session->close("there is another one with host " + std::to_string(host.value));
    return false;
  }
  strangers_.remove(session);
  session_hosts_[session.get()] = host;
  link->attach(session);
  callbacks_.reachable(host);
  return true;
}

void Peers::receive(const std::shared_ptr<Session>& session, WireFrame frame) {
  const auto host = session_hosts_.find(session.get());
  const auto link = host == session_hosts_.end() ? nullptr : link_of(host->second);
  if (!link) return session->close("its host has left the job");
  const HostId from = host->second;
  for (const wire::Bytes& payload : link->receive(std::move(frame))) {
    Result<wire::Message> message = wire::decode(*payload);
    if (!message) return session->close(message.error());
    callbacks_.received(from, std::move(*message));
  }
}

void Peers::closed(const std::shared_ptr<Session>& session, const std::string& reason) {
  const auto known = session_hosts_.find(session.get());
  strangers_.remove(session);
  const std::lock_guard lock(mutex_);
  closed_sent_ += session->bytes_sent();
  closed_received_ += session->bytes_received();
  sessions_.erase(session);
  if (known == session_hosts_.end()) return;
  const HostId host = known->second;
  session_hosts_.erase(known);
  const auto peer = peers_.find(host);
  if (peer == peers_.end()) return;
  peer->second.link->detach(session.get());
  if (peer->second.link->connected()) return;
  spdlog::info("the connection to host {} has ended: {}", host.value, reason);
  if (peer->second.link->queued() != 0) spawn_connector(host, peer->second, kBeforeAgain);
}

void Peers::close_silent(double seconds) {
  const std::lock_guard lock(mutex_);
  for (const auto& [host, peer] : peers_) peer.link->close_if_silent(seconds);
}

bool Peers::drained() const {
  const std::lock_guard lock(mutex_);
  return std::all_of(peers_.begin(), peers_.end(),
                     [](const auto& p) { return p.second.link->queued() == 0; });
}

std::pair<std::uint64_t, std::uint64_t> Peers::bytes() const {
  const std::lock_guard lock(mutex_);
  std::uint64_t sent = closed_sent_, received = closed_received_;
  for (const auto& s : sessions_) {
    sent += s->bytes_sent();
    received += s->bytes_received();
  }
  return {sent, received};
}

}  // namespace cloudrenderer
