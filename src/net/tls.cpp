#include "net/tls.h"

#include <openssl/ssl.h>

#include <algorithm>
#include <array>
#include <asio/redirect_error.hpp>
#include <asio/ssl.hpp>
#include <asio/use_awaitable.hpp>
#include <asio/write.hpp>
#include <stdexcept>
#include <vector>

#include "base/error.h"
#include "net/own_certificate.h"

namespace cloudrenderer {
namespace {

using asio::ip::tcp;

constexpr unsigned char kAlertRecord = 0x15, kHandshakeRecord = 0x16, kMajorVersion = 0x03;
// What a TLS server says to who does not speak it: fatal, protocol_version.
constexpr std::array<unsigned char, 7> kRefusal{0x15, 0x03, 0x03, 0x00, 0x02, 0x02, 0x46};
constexpr std::size_t kRecordBytes = 16384;                         // of a record at most
constexpr std::string_view kExporter = "EXPORTER-Channel-Binding";  // RFC 9266
constexpr std::size_t kBindingBytes = 32;

bool on_loopback(const asio::ip::address& a) {
  if (a.is_loopback()) return true;
  return a.is_v6() && a.to_v6().is_v4_mapped() &&
         asio::ip::make_address_v4(asio::ip::v4_mapped, a.to_v6()).is_loopback();
}

class TlsStream final : public Stream {
 public:
  using Kind = asio::ssl::stream_base::handshake_type;
  TlsStream(tcp::socket socket, std::shared_ptr<asio::ssl::context> context, Kind kind)
      : ends_(tcp_ends(socket)),
        context_(std::move(context)),
        kind_(kind),
        stream_(std::move(socket), *context_) {}

  asio::any_io_executor executor() override { return stream_.get_executor(); }

  asio::awaitable<void> open() override {
    if (kind_ == Kind::server) co_await require_tls();
    std::error_code error;
    co_await stream_.async_handshake(kind_, asio::redirect_error(asio::use_awaitable, error));
    if (!error) co_return;
    const bool plain =
        error.category() == asio::error::get_ssl_category() &&
        ERR_GET_REASON(static_cast<unsigned long>(error.value())) == SSL_R_WRONG_VERSION_NUMBER;
    if (plain) throw std::runtime_error("it does not speak TLS; do both have the same --tls?");
    throw std::runtime_error("no TLS connection: " + error.message());
  }

  asio::awaitable<std::size_t> read_some(asio::mutable_buffer to) override {
    std::error_code error;
    const std::size_t n =
        co_await stream_.async_read_some(to, asio::redirect_error(asio::use_awaitable, error));
    // Frames say where they end: a connection that is cut is no more than one that ends.
    if (error == asio::ssl::error::stream_truncated) error = asio::error::eof;
    if (error) throw std::system_error(error);
    co_return n;
  }

  // Copied into full records: OpenSSL would make one of every header.
  asio::awaitable<void> write(std::span<const asio::const_buffer> buffers) override {
    staged_.clear();
    for (asio::const_buffer from : buffers)
      while (from.size() > 0) {
        const auto* first = static_cast<const std::byte*>(from.data());
        const std::size_t n = std::min(from.size(), kRecordBytes - staged_.size());
        staged_.insert(staged_.end(), first, first + n);
        from += n;
        if (staged_.size() == kRecordBytes) co_await flush();
      }
    if (!staged_.empty()) co_await flush();
  }

  void close() noexcept override {
    std::error_code ignored;
    stream_.next_layer().shutdown(tcp::socket::shutdown_both, ignored);
    stream_.next_layer().close(ignored);
  }

  std::string channel_binding() override {
    std::string binding(kBindingBytes, '\0');
    if (SSL_export_keying_material(stream_.native_handle(),
                                   reinterpret_cast<unsigned char*>(binding.data()), binding.size(),
                                   kExporter.data(), kExporter.size(), nullptr, 0, 0) != 1)
      throw std::runtime_error("OpenSSL gives no channel binding");
    return binding;
  }

  std::string peer() const override { return ends_.peer; }
  Address local() const override { return ends_.local; }

 private:
  asio::awaitable<void> flush() {
    co_await asio::async_write(stream_, asio::buffer(staged_), asio::use_awaitable);
    staged_.clear();
  }

  // Looks at the first bytes, so that a peer without TLS gets to know why it is refused.
  asio::awaitable<void> require_tls() {
    tcp::socket& socket = stream_.next_layer();
    socket.non_blocking(true);
    std::array<unsigned char, 2> head{kHandshakeRecord, kMajorVersion};
    std::error_code error;
    do {
      co_await socket.async_wait(tcp::socket::wait_read, asio::use_awaitable);
      socket.receive(asio::buffer(head), tcp::socket::message_peek, error);
    } while (error == asio::error::would_block);
    if (error) throw std::system_error(error);
    if (head[0] == kHandshakeRecord && head[1] == kMajorVersion) co_return;
    // What is left unread when the socket closes would take the answer with it.
    std::error_code ignored;
    std::array<std::byte, 4096> unread;
    while (socket.read_some(asio::buffer(unread), ignored) == unread.size()) {
    }
    socket.write_some(asio::buffer(kRefusal), ignored);
    throw std::runtime_error("it does not speak TLS; do both have the same --tls?");
  }

  const TcpEnds ends_;
  const std::shared_ptr<asio::ssl::context> context_;
  const Kind kind_;
  asio::ssl::stream<tcp::socket> stream_;
  std::vector<std::byte> staged_;
};

}  // namespace

Tls::Tls(const TlsOptions& o) : mode_(o.mode) {
  if (o.certificate.empty() != o.key.empty())
    throw UsageError("--tls-cert and --tls-key come together");
  if (!o.authority.empty() && o.certificate.empty())
    throw UsageError("--tls-ca needs --tls-cert and --tls-key: peers will ask for them, too");
  if (mode_ == TlsMode::off) {
    if (!o.certificate.empty()) throw UsageError("--tls off does not go with certificates");
    return;
  }
  context_ = std::make_shared<asio::ssl::context>(asio::ssl::context::tls);
  SSL_CTX* c = context_->native_handle();
  SSL_CTX_set_min_proto_version(c, TLS1_3_VERSION);
  // No session is resumed, no early data taken: every connection is proved afresh.
  SSL_CTX_set_options(c, SSL_OP_NO_TICKET);
  SSL_CTX_set_num_tickets(c, 0);
  SSL_CTX_set_session_cache_mode(c, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_ciphersuites(
      c, "TLS_AES_128_GCM_SHA256:TLS_CHACHA20_POLY1305_SHA256:TLS_AES_256_GCM_SHA384");
  context_->set_verify_mode(asio::ssl::verify_none);
  if (o.certificate.empty()) {
    const OwnCertificate own;
    own.use(c);
    return;
  }
  std::error_code error;
  const auto check = [&](const char* option, const std::string& file) {
    if (error) throw UsageError(std::string(option) + " " + file + ": " + error.message());
  };
  context_->use_certificate_chain_file(o.certificate, error);
  check("--tls-cert", o.certificate);
  context_->use_private_key_file(o.key, asio::ssl::context::pem, error);
  check("--tls-key", o.key);
  if (o.authority.empty()) return;
  context_->load_verify_file(o.authority, error);
  check("--tls-ca", o.authority);
  context_->set_verify_mode(asio::ssl::verify_peer | asio::ssl::verify_fail_if_no_peer_cert);
}

bool Tls::encrypts(const tcp::socket& socket) const {
  if (mode_ != TlsMode::automatic) return mode_ == TlsMode::on;
  std::error_code gone;
  const tcp::endpoint peer = socket.remote_endpoint(gone);
  return !on_loopback(peer.address());
}

std::unique_ptr<Stream> Tls::accepted(tcp::socket socket) const {
  if (!encrypts(socket)) return make_tcp_stream(std::move(socket));
  return std::make_unique<TlsStream>(std::move(socket), context_, TlsStream::Kind::server);
}

std::unique_ptr<Stream> Tls::connected(tcp::socket socket) const {
  if (!encrypts(socket)) return make_tcp_stream(std::move(socket));
  return std::make_unique<TlsStream>(std::move(socket), context_, TlsStream::Kind::client);
}

bool looks_like_tls(unsigned char first, unsigned char second) {
  return (first == kAlertRecord || first == kHandshakeRecord) && second == kMajorVersion;
}

}  // namespace cloudrenderer
