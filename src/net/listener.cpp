#include "net/listener.h"

#include <asio/co_spawn.hpp>
#include <asio/redirect_error.hpp>
#include <asio/steady_timer.hpp>
#include <asio/use_awaitable.hpp>

#include "base/error.h"
#include "base/log.h"
#include "net/tls.h"

namespace cloudrenderer {

using asio::ip::tcp;

struct Listener::State {
  explicit State(asio::io_context& io_) : io(io_), acceptor(io_) {}
  asio::io_context& io;
  tcp::acceptor acceptor;
  std::function<void(std::unique_ptr<Stream>)> on_accept;
  std::shared_ptr<const Tls> tls;
  bool closed = false;
};

namespace {

// Out of file descriptors, for example: accepting again at once would only burn the processor.
constexpr auto kPauseAfterError = std::chrono::milliseconds(100);

}  // namespace

Listener::Listener(asio::io_context& io, const Address& address,
                   std::function<void(std::unique_ptr<Stream>)> on_accept,
                   std::shared_ptr<const Tls> tls)
    : state_(std::make_shared<State>(io)) {
  state_->tls = std::move(tls);
  state_->on_accept = std::move(on_accept);
  try {
    tcp::resolver resolver(io);
    const std::string host = address.host.empty() ? "0.0.0.0" : address.host;
    const auto found = resolver.resolve(host, std::to_string(address.port), tcp::resolver::passive);
    const tcp::endpoint endpoint = found.begin()->endpoint();
    state_->acceptor.open(endpoint.protocol());
    state_->acceptor.set_option(asio::socket_base::reuse_address(true));
    state_->acceptor.bind(endpoint);
    state_->acceptor.listen();
  } catch (const std::system_error& e) {
    throw ClusterError("cannot listen on " + address.to_string() + ": " + e.code().message());
  }
  const auto accept = [](std::shared_ptr<State> state) -> asio::awaitable<void> {
    while (!state->closed) {
      std::error_code error;
      tcp::socket socket =
          co_await state->acceptor.async_accept(asio::redirect_error(asio::use_awaitable, error));
      if (state->closed) co_return;
      if (!error) {
        state->on_accept(state->tls ? state->tls->accepted(std::move(socket))
                                    : make_tcp_stream(std::move(socket)));
        continue;
      }
      spdlog::warn("cannot accept a connection: {}", error.message());
      asio::steady_timer pause(state->io, kPauseAfterError);
      co_await pause.async_wait(asio::use_awaitable);
    }
  };
  asio::co_spawn(io, accept(state_), [](std::exception_ptr error) {
    if (!error) return;
    try {
      std::rethrow_exception(error);
    } catch (const std::exception& e) {
      spdlog::error("the listener has ended: {}", e.what());
    }
  });
}

Listener::~Listener() {
  state_->closed = true;
  std::error_code ignored;
  state_->acceptor.close(ignored);
}

Address Listener::address() const {
  const tcp::endpoint e = state_->acceptor.local_endpoint();
  return {e.address().to_string(), e.port()};
}

}  // namespace cloudrenderer
