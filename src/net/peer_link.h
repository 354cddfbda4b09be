#pragma once
#include <asio/io_context.hpp>
#include <asio/steady_timer.hpp>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "net/session.h"
#include "tasks/link.h"

namespace cloudrenderer {

// The way to one other host: delivery exactly once and in order over whatever session there is at
// the moment. Sessions come and go; what was not acknowledged is sent again over the next one.
class PeerLink : public std::enable_shared_from_this<PeerLink> {
 public:
  using Now = std::function<double()>;
  PeerLink(asio::io_context& io, std::uint64_t own_incarnation, std::uint64_t peer_incarnation,
           Now now);

  void send(wire::Bytes payload);  // any thread
  // The rest on the I/O thread.
  void attach(std::shared_ptr<Session> session);
  void detach(const Session* session);  // nothing when another one has taken its place
  // From time to time: closes a session over which nothing comes although something has waited for
  // an answer for so many seconds. A cut cable ends no TCP connection.
  void close_if_silent(double seconds);
  std::vector<wire::Bytes> receive(WireFrame frame);  // payloads whose turn it is
  void close_when_sent();                             // and no session any more
  bool connected() const;
  std::size_t queued() const;
  std::shared_ptr<Session> session() const;

 private:
  void pump();  // with the mutex held
  void arm();   // for acknowledgements that may wait a little

  const Now now_;
  mutable std::mutex mutex_;
  Link link_;
  std::shared_ptr<Session> session_;
  asio::steady_timer timer_;
  bool armed_ = false;
  // Of close_if_silent(): when it looked last, and when something had come, or nothing was awaited.
  double looked_ = 0, heard_ = 0;
  std::uint64_t heard_bytes_ = 0;
};

}  // namespace cloudrenderer
