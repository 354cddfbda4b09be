#include "net/address.h"

#include <charconv>

#include "base/error.h"

namespace cloudrenderer {

Address Address::parse(const std::string& text) {
  const auto bad = [&](const char* why) {
    return UsageError("'" + text + "' is no address: " + why +
                      " (expected HOST:PORT, for example 10.0.0.1:7800)");
  };
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) throw bad("the port is missing");
  Address a;
  const char* first = text.data() + colon + 1;
  const char* last = text.data() + text.size();
  const auto [end, error] = std::from_chars(first, last, a.port);
  if (error != std::errc{} || end != last || first == last)
    throw bad("the port must be a number up to 65535");
  a.host = text.substr(0, colon);
  if (!a.host.empty() && a.host.front() == '[') {
    if (a.host.back() != ']' || a.host.size() < 3) throw bad("the bracket is not closed");
    a.host = a.host.substr(1, a.host.size() - 2);
  } else if (a.host.find(':') != std::string::npos) {
    throw bad("an IPv6 address stands in brackets");
  }
  if (a.host.find_first_of("[]") != std::string::npos) throw bad("brackets stand around the host");
  return a;
}

std::string Address::to_string() const {
  const bool v6 = host.find(':') != std::string::npos;
  return (v6 ? "[" + host + "]" : host) + ":" + std::to_string(port);
}

bool Address::is_loopback() const {
  return host == "localhost" || host == "::1" || host.rfind("127.", 0) == 0;
}

}  // namespace cloudrenderer
