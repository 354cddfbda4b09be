#pragma once
#include <asio/io_context.hpp>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/id.h"
#include "net/greeting.h"
#include "net/peer_link.h"
#include "net/strangers.h"

namespace cloudrenderer {

// A worker's connections to the other workers. Whoever has something for another one connects, as thousands need not all
// know each other. If two do so at the same time they keep the connection of the one with the larger number.
class Peers {
 public:
  struct Self {
    HostId host;
    std::uint64_t incarnation = 0;
    std::string token;
    std::shared_ptr<const Tls> tls;
  };
  struct Callbacks {
    std::function<void(HostId, wire::Message&&)> received;
    std::function<void(HostId)> unreachable, reachable;
  };
  Peers(asio::io_context& io, Self self, PeerLink::Now now, Callbacks callbacks);

  bool send(HostId to, const wire::Bytes& payload);        // any thread; false: unknown host
  void update(const std::vector<wire::HostEntry>& hosts);  // any thread: who is there now
  std::pair<std::uint64_t, std::uint64_t> bytes() const;   // any thread: sent and received
  bool drained() const;                         // any thread: all that was sent is acknowledged
  void accept(std::unique_ptr<Stream> stream);  // on the I/O thread, as what follows
  void close_silent(double seconds);            // see PeerLink::close_if_silent

 private:
  struct Peer {
    Address address;
    std::uint64_t incarnation = 0;
    std::shared_ptr<PeerLink> link;
    bool connecting = false;  // a coroutine tries
    double since = 0;         // the last connection began
    bool by_larger = false;   // it is that of the larger number
  };
  // `to`: whom we have called, if it was us.
  void open(std::unique_ptr<Stream> stream, Handshake::Role role, std::optional<HostId> to);
  asio::awaitable<void> keep_connected(HostId host, std::shared_ptr<PeerLink> link, Address address,
                                       std::chrono::milliseconds first_pause);
  bool needs_connection(HostId host, const std::shared_ptr<PeerLink>& link);
  bool introduced(const std::shared_ptr<Session>& session, Handshake::Role role, const wire::Message& message);
  void receive(const std::shared_ptr<Session>& session, WireFrame frame);
  void closed(const std::shared_ptr<Session>& session, const std::string& reason);
  void spawn_connector(HostId host, Peer& peer, std::chrono::milliseconds first_pause);  // unless there is one
  std::shared_ptr<PeerLink> link_of(HostId host) const;

  asio::io_context& io_;
  const Self self_;
  const PeerLink::Now now_;
  const Callbacks callbacks_;
  mutable std::mutex mutex_;  // guards what follows
  std::map<HostId, Peer> peers_;
  std::set<std::shared_ptr<Session>> sessions_;
  std::uint64_t closed_sent_ = 0, closed_received_ = 0;
  std::map<const Session*, HostId> session_hosts_;  // I/O thread only, as what follows
  Strangers strangers_;
};

}  // namespace cloudrenderer
