#include "net/stream.h"

#include <algorithm>
#include <asio/connect.hpp>
#include <asio/redirect_error.hpp>
#include <asio/steady_timer.hpp>
#include <asio/this_coro.hpp>
#include <asio/use_awaitable.hpp>
#include <asio/write.hpp>

#include "base/error.h"
#include "net/tls.h"

namespace cloudrenderer {
namespace {

using asio::ip::tcp;

std::string text_of(const tcp::endpoint& e) {
  return Address{e.address().to_string(), e.port()}.to_string();
}

class TcpStream final : public Stream {
 public:
  explicit TcpStream(tcp::socket socket) : socket_(std::move(socket)), ends_(tcp_ends(socket_)) {}

  asio::any_io_executor executor() override { return socket_.get_executor(); }
  asio::awaitable<void> open() override { co_return; }
  asio::awaitable<std::size_t> read_some(asio::mutable_buffer to) override {
    return socket_.async_read_some(to, asio::use_awaitable);
  }
  asio::awaitable<void> write(std::span<const asio::const_buffer> buffers) override {
    co_await asio::async_write(socket_, buffers, asio::use_awaitable);
  }
  void close() noexcept override {
    std::error_code ignored;
    socket_.shutdown(tcp::socket::shutdown_both, ignored);
    socket_.close(ignored);
  }
  std::string channel_binding() override { return {}; }
  std::string peer() const override { return ends_.peer; }
  Address local() const override { return ends_.local; }

 private:
  tcp::socket socket_;
  const TcpEnds ends_;
};

}  // namespace

TcpEnds tcp_ends(tcp::socket& socket) {
  // A peer may be gone already; then the first read says so.
  std::error_code ignored;
  socket.set_option(tcp::no_delay(true), ignored);
  socket.set_option(asio::socket_base::keep_alive(true), ignored);
  const tcp::endpoint remote = socket.remote_endpoint(ignored);
  const tcp::endpoint local = socket.local_endpoint(ignored);
  return {text_of(remote), {local.address().to_string(), local.port()}};
}

std::unique_ptr<Stream> make_tcp_stream(tcp::socket socket) {
  return std::make_unique<TcpStream>(std::move(socket));
}

asio::awaitable<std::unique_ptr<Stream>> connect(asio::io_context& io, Address address,
                                                 std::chrono::steady_clock::duration patience,
                                                 std::shared_ptr<const Tls> tls) {
  using namespace std::chrono_literals;
  using Clock = std::chrono::steady_clock;
  constexpr auto kAttempt = 5s;
  const auto deadline = Clock::now() + patience;
  auto pause = 50ms;
  tcp::resolver resolver(io);
  for (;;) {
    std::error_code error;
    const auto found =
        co_await resolver.async_resolve(address.host, std::to_string(address.port),
                                        asio::redirect_error(asio::use_awaitable, error));
    if (!error) {
      // Shared: the timer's handler may already be queued when the attempt ends.
      const auto socket = std::make_shared<tcp::socket>(io);
      asio::steady_timer attempt(io, kAttempt);
      attempt.async_wait([socket](const std::error_code& cancelled) {
        std::error_code ignored;
        if (!cancelled) socket->close(ignored);
      });
      co_await asio::async_connect(*socket, found,
                                   asio::redirect_error(asio::use_awaitable, error));
      attempt.cancel();
      if (!error && socket->is_open())
        co_return tls ? tls->connected(std::move(*socket)) : make_tcp_stream(std::move(*socket));
      if (!error) error = asio::error::timed_out;
    }
    if (Clock::now() + pause >= deadline)
      throw ClusterError("cannot connect to " + address.to_string() + ": " + error.message());
    asio::steady_timer wait(io, pause);
    co_await wait.async_wait(asio::use_awaitable);
    pause = std::min<decltype(pause)>(pause * 2, 2000ms);
  }
}

}  // namespace cloudrenderer
