#pragma once
#include <asio/io_context.hpp>
#include <functional>
#include <memory>

#include "net/stream.h"

namespace cloudrenderer {

// Accepts connections until it is destroyed. Works on the I/O thread.
class Listener {
 public:
  // Port 0 takes a free one. Throws ClusterError when the address cannot be listened on. Without
  // `tls` never encrypted.
  Listener(asio::io_context& io, const Address& address,
           std::function<void(std::unique_ptr<Stream>)> on_accept,
           std::shared_ptr<const Tls> tls = nullptr);
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  Address address() const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace cloudrenderer
