#pragma once
#include <asio/io_context.hpp>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "cluster/blob.h"
#include "cluster/clock.h"
#include "cluster/ticker.h"
#include "net/greeting.h"
#include "net/listener.h"
#include "net/peer_link.h"
#include "net/strangers.h"
#include "tasks/manager_core.h"

namespace cloudrenderer {

// The manager's core with its connections. Everything on the thread that runs the io_context, but
// receive_local().
class Manager {
 public:
  struct Config {
    ManagerOptions core;
    JobSpec job;
    std::string folder;  // of the split: served to hosts that ask
    std::string token;
    std::shared_ptr<const Tls> tls;  // null: never encrypted
    std::function<void()> changed;   // after everything that may have moved the job on
  };
  Manager(asio::io_context& io, const Clock& clock, Config config);
  ~Manager();

  // Hosts may come from now on. Port 0 takes a free one.
  Address listen(const Address& address);
  // A host in this process; `deliver` gets what the core has to say to it.
  Result<HostId> join_local(const wire::Hello& hello, std::function<void(wire::Message&&)> deliver);
  void receive_local(HostId from, wire::Message&& message);  // any thread

  ManagerCore& core() { return core_; }
  // To be called after using core() in a way that may have filled its outbox.
  void drain();
  void send(ManagerCore::Sending& s);
  void tell_paging();
  // The job is over: every connection is closed when what is queued has left. The io_context runs
  // dry then.
  void shut();

  std::uint64_t bytes_sent() const;  // over all connections; parts and files served left out
  std::uint64_t bytes_received() const;
  std::size_t joined_ever() const { return core_.hosts().size(); }

 private:
  struct Peer {
    std::shared_ptr<PeerLink> link;  // null for the local host
    std::function<void(wire::Message&&)> deliver_local;
    std::uint64_t incarnation = 0;
    std::uint64_t connection = 0;  // grows with every session
  };
  void accept(std::unique_ptr<Stream> stream);
  bool introduce(const std::shared_ptr<Session>& session, wire::Message&& message);
  bool join_again(const std::shared_ptr<Session>& session, const wire::Hello& hello);
  void receive(const std::shared_ptr<Session>& session, WireFrame frame);
  void closed(const std::shared_ptr<Session>& session, const std::string& reason);
  void handle(HostId from, wire::Message&& message);
  double tick();

  asio::io_context& io_;
  const Clock& clock_;
  const Config config_;
  ManagerCore core_;
  BlobServer blobs_;
  std::map<HostId, Peer> peers_;
  std::map<const Session*, HostId> session_hosts_;
  std::set<std::shared_ptr<Session>> sessions_;  // all that are open, strangers too
  Strangers strangers_;
  std::unique_ptr<Listener> listener_;
  std::shared_ptr<Ticker> ticker_;
  std::uint64_t closed_sent_ = 0, closed_received_ = 0, blob_bytes_ = 0;
  bool draining_ = false, shut_ = false;
  std::uint32_t paged_parts_ = 0;  // that the user knows of
};

}  // namespace cloudrenderer
