#pragma once
#include <cstdint>
#include <string>

namespace cloudrenderer {

// A TCP address as people write it: "host:port", "1.2.3.4:port", "[::1]:port", ":port" (all
// interfaces).
struct Address {
  std::string host;  // without brackets; "" only in addresses to listen on
  std::uint16_t port = 0;

  // Throws UsageError that names the text.
  static Address parse(const std::string& text);
  std::string to_string() const;
  bool is_loopback() const;  // by its text: "localhost", 127.x, ::1
  bool is_wildcard() const { return host.empty() || host == "0.0.0.0" || host == "::"; }  // all interfaces, to listen on
  friend bool operator==(const Address&, const Address&) = default;
};

}  // namespace cloudrenderer
