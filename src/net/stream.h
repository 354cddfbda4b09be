#pragma once
#include <asio/any_io_executor.hpp>
#include <asio/awaitable.hpp>
#include <asio/buffer.hpp>
#include <asio/io_context.hpp>
#include <asio/ip/tcp.hpp>
#include <chrono>
#include <memory>
#include <span>
#include <string>

#include "net/address.h"

namespace cloudrenderer {

class Tls;

// A connection that carries bytes both ways. Sessions see only this, so that an encrypted
// connection can take the place of a plain one. All calls on the thread that runs the executor.
class Stream {
 public:
  virtual ~Stream() = default;
  virtual asio::any_io_executor executor() = 0;
  // Once, before the first bytes: what both ends must agree on first. Throws when they do not.
  virtual asio::awaitable<void> open() = 0;
  // At least one byte; throws std::system_error at the end of the stream and on errors.
  virtual asio::awaitable<std::size_t> read_some(asio::mutable_buffer to) = 0;
  // Everything, gathered into as few system calls as possible. The buffers live until it is done.
  virtual asio::awaitable<void> write(std::span<const asio::const_buffer> buffers) = 0;
  virtual void close() noexcept = 0;  // pending calls fail
  // After open(): bytes that only the two ends of this very connection have. "": not encrypted.
  virtual std::string channel_binding() = 0;
  virtual std::string peer() const = 0;  // "1.2.3.4:567"
  virtual Address local() const = 0;
};

// Both ends of a socket, by name; sets TCP_NODELAY and keep-alive.
struct TcpEnds {
  std::string peer;
  Address local;
};
TcpEnds tcp_ends(asio::ip::tcp::socket& socket);

// Plain TCP.
std::unique_ptr<Stream> make_tcp_stream(asio::ip::tcp::socket socket);

// Connects, trying again with growing pauses until `patience` has passed: hosts start in any order,
// and a fresh container may have no route for a while. Throws ClusterError with the last reason.
// Without `tls` never encrypted.
asio::awaitable<std::unique_ptr<Stream>> connect(asio::io_context& io, Address address,
                                                 std::chrono::steady_clock::duration patience,
                                                 std::shared_ptr<const Tls> tls = nullptr);

}  // namespace cloudrenderer
