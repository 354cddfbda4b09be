#include "service/port_range.h"

#include "base/error.h"
#include "net/listener.h"

namespace cloudrenderer {

std::optional<std::uint16_t> free_port(const PortRange& range, const std::string& host, const std::function<bool(std::uint16_t)>& taken) {
  asio::io_context io;
  for (std::uint32_t port = range.first; port <= range.last; ++port) {
    const auto p = static_cast<std::uint16_t>(port);
    if (taken(p)) continue;
    try {
      const Listener listener(io, {host, p}, [](std::unique_ptr<Stream>) {});
      return p;
    } catch (const ClusterError&) {  // somebody else listens there
    }
  }
  return std::nullopt;
}

}  // namespace cloudrenderer
