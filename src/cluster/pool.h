#pragma once
#include <asio/io_context.hpp>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "cluster/clock.h"
#include "cluster/pool_core.h"
#include "cluster/ticker.h"
#include "net/greeting.h"
#include "net/listener.h"
#include "net/peer_link.h"
#include "net/strangers.h"

namespace cloudrenderer {

// The hosts of a service that runs many jobs: PoolCore with its connections. `worker --manager` leads
// here as to any manager; the hosts then work for the managers that the orders name. Everything on
// the thread that runs the io_context.
class Pool {
 public:
  struct Config {
    std::string token;
    std::shared_ptr<const Tls> tls;  // null: never encrypted
    double lost_after_s = 3;
    bool allow_inexact = false;
    std::function<void()> changed;  // after hosts() or usage() may have changed; may call order()
  };
  Pool(asio::io_context& io, const Clock& clock, Config config);
  ~Pool();

  // Hosts may come from now on. Port 0 takes a free one. Throws ClusterError.
  Address listen(const Address& address);
  // The complete list, for all hosts and those to come; see PoolCore::order().
  void order(std::vector<PoolOrder> orders);
  void order(std::uint64_t host, std::vector<PoolOrder> orders);  // for one host only

  const std::map<std::uint64_t, PoolHost>& hosts() const { return core_.hosts(); }  // by incarnation
  std::map<std::string, PoolUsage> usage() const { return core_.usage(); }          // by job
  // Closes every connection when what is queued has left; the io_context runs dry then. Hosts look
  // for another service at the same address.
  void shut();

 private:
  struct Peer {
    std::shared_ptr<PeerLink> link;  // for as long as the core remembers the host: it may come back
    std::shared_ptr<Session> session;  // the newest
  };
  void accept(std::unique_ptr<Stream> stream);
  bool introduce(const std::shared_ptr<Session>& session, wire::Message&& message);
  void receive(const std::shared_ptr<Session>& session, WireFrame frame);
  void closed(const std::shared_ptr<Session>& session, const std::string& reason);
  void drain();
  void after();  // of what the network or the clock has brought
  double tick();

  asio::io_context& io_;
  const Clock& clock_;
  const Config config_;
  const std::uint64_t incarnation_;
  PoolCore core_;
  std::map<std::uint64_t, Peer> peers_;
  std::map<const Session*, std::uint64_t> session_hosts_;
  std::set<std::shared_ptr<Session>> sessions_;  // all that are open, strangers too
  Strangers strangers_;
  std::unique_ptr<Listener> listener_;
  std::shared_ptr<Ticker> ticker_;
  bool shut_ = false;
};

}  // namespace cloudrenderer
