#pragma once
#include <asio/ip/tcp.hpp>
#include <memory>
#include <string>

#include "net/stream.h"

namespace asio::ssl {
class context;
}

namespace cloudrenderer {

enum class TlsMode { automatic, on, off };

struct TlsOptions {
  TlsMode mode = TlsMode::automatic;
  std::string certificate, key;  // PEM files; "": a certificate is made, for this process only
  std::string authority;         // PEM file that the peers' certificates must lead to
};

// TLS 1.3 for the connections of this process. A certificate that was made here says nothing of who
// its owner is: the proof of the shared secret covers the channel (see net/handshake.h), so that
// whoever stands in between with another certificate fails there.
class Tls {
 public:
  // Throws UsageError that names the file.
  explicit Tls(const TlsOptions& options);

  // The stream that a new connection needs. Both ends come to the same answer: `automatic` encrypts
  // every connection but those whose other end is on the loopback.
  std::unique_ptr<Stream> accepted(asio::ip::tcp::socket socket) const;
  std::unique_ptr<Stream> connected(asio::ip::tcp::socket socket) const;

 private:
  bool encrypts(const asio::ip::tcp::socket& socket) const;

  const TlsMode mode_;
  std::shared_ptr<asio::ssl::context> context_;
};

// Does a peer that begins with these bytes speak TLS? No frame that may come first does.
bool looks_like_tls(unsigned char first, unsigned char second);

}  // namespace cloudrenderer
